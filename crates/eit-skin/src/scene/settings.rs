//! Converts a scene to the settings of the stages after the model, with all paths resolved.

use super::{
    Component, DenoiseSettings, Direction, FramesAre, NoiseSettings, OneOrMany, OneOrManyFiles,
    ReconstructionSettings, RecordingSettings, Reference, Scene, Shape, TouchSettings,
};
use crate::error::SkinError;
use eit_hw::{Format, FrameOrientation, ReadOptions};
use std::path::PathBuf;

/// Settings of the stages after the model: frames, noise, images, touches.
#[derive(Debug, Clone, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct StageSettings {
    /// Recorded frames and how to read them.
    pub recording: FrameSettings,
    /// Noise of the instrument.
    pub noise: NoiseSettings,
    /// Image reconstruction.
    pub reconstruction: ReconstructionSettings,
    /// Detection of touches.
    pub touch: TouchSettings,
    /// The U-net, if there is one.
    pub denoise: Option<DenoiseSettings>,
}

/// Recorded frames and how to read them; paths are relative to the working directory.
#[derive(Debug, Clone, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct FrameSettings {
    /// Files whose frames are concatenated; `None` if the scene names none.
    pub files: Option<Vec<PathBuf>>,
    /// Name of the format, if the file name extension does not tell.
    pub format: Option<String>,
    /// How a table is arranged.
    pub frames_are: Option<FramesAre>,
    /// Whether a table holds complex numbers.
    pub complex: bool,
    /// Which real quantity is computed from complex data.
    pub component: Component,
    /// Row of the frequency in a Sciospec file.
    pub frequency_row: Option<usize>,
    /// The reference frame, which is subtracted.
    pub reference: Option<Reference>,
    /// Frames before this one are skipped.
    pub first_frame: usize,
    /// Frames per second.
    pub frame_rate_hz: Option<f64>,
    /// Factor for every value.
    pub scale: f64,
}

impl FrameSettings {
    /// Returns the format, where it is stated, and how a file of it is read.
    ///
    /// # Errors
    /// An unknown format.
    pub fn reading(&self) -> Result<(Option<Format>, ReadOptions), SkinError> {
        let orientation = |frames_are| match frames_are {
            FramesAre::Rows => FrameOrientation::Rows,
            FramesAre::Columns => FrameOrientation::Columns,
            FramesAre::Matrix => FrameOrientation::Matrix,
        };
        let mut options = ReadOptions {
            complex: self.complex,
            frames_are: self.frames_are.map(orientation),
            ..Default::default()
        };
        if let Some(row) = self.frequency_row {
            options.sciospec.frequency_row = row;
        }
        Ok((self.format.as_deref().map(str::parse).transpose()?, options))
    }
}

/// Rotations and reflections that map a disc with its electrodes onto itself.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Symmetry {
    /// Angle of the centre of electrode 1, counter-clockwise from +x.
    pub first_angle_rad: f64,
    /// Whether electrodes are counted clockwise.
    pub is_clockwise: bool,
}

impl Scene {
    /// Returns the settings of the stages after the model.
    pub fn stage_settings(&self) -> StageSettings {
        let denoise = self.denoise.clone().map(|keys| DenoiseSettings {
            weights: match keys.weights.as_str() {
                "default" => keys.weights,
                file => self.resolve(file).display().to_string(),
            },
            ..keys
        });
        StageSettings {
            recording: self.frame_settings(),
            noise: self.noise.clone(),
            reconstruction: self.reconstruction.clone(),
            touch: TouchSettings {
                learned: self.touch.learned.as_ref().map(|file| self.resolve(file)),
                ..self.touch.clone()
            },
            denoise,
        }
    }

    fn frame_settings(&self) -> FrameSettings {
        let RecordingSettings {
            file,
            format,
            frames_are,
            complex,
            component,
            frequency_row,
            reference,
            first_frame,
            frame_rate_hz,
            scale,
        } = self.recording.clone();
        FrameSettings {
            files: file.map(|files| match files {
                OneOrManyFiles::One(file) => vec![self.resolve(&file)],
                OneOrManyFiles::Many(files) => files.iter().map(|f| self.resolve(f)).collect(),
            }),
            format,
            frames_are,
            complex,
            component,
            frequency_row,
            reference: reference.map(|reference| match reference {
                Reference::Text(text) if Reference::is_file(&text) => {
                    Reference::Text(self.resolve(text).display().to_string())
                }
                other => other,
            }),
            first_frame: first_frame.unwrap_or(0),
            frame_rate_hz,
            scale: scale.unwrap_or(1.0),
        }
    }

    /// Returns the symmetry of a disc with equal electrodes; `None` for every other skin.
    pub(crate) fn symmetry(&self) -> Option<Symmetry> {
        let electrodes = &self.electrodes;
        let is_even = self.skin.shape == Shape::Disc
            && electrodes.positions_m.is_none()
            && !matches!(electrodes.contact_impedance_ohm_m, Some(OneOrMany::Many(_)))
            && matches!(electrodes.width_m, Some(OneOrMany::One(_)));
        is_even.then(|| Symmetry {
            first_angle_rad: electrodes.first_angle_deg.unwrap_or(0.0).to_radians(),
            is_clockwise: electrodes.direction == Direction::Clockwise,
        })
    }
}
