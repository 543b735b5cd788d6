//! From a scene to the settings of the stages behind the model, with every path resolved.

use super::{
    Component, DenoiseSettings, Direction, FramesAre, NoiseSettings, OneOrMany, OneOrManyFiles,
    ReconstructionSettings, RecordingSettings, Reference, Scene, Shape, TouchSettings,
};
use std::path::PathBuf;

/// What a scene asks of the stages behind the model: frames, noise, images, touches.
#[derive(Debug, Clone, Default)]
pub struct StageSettings {
    /// Recorded frames and how they are read.
    pub recording: FrameSettings,
    /// Noise of the instrument.
    pub noise: NoiseSettings,
    /// Images.
    pub reconstruction: ReconstructionSettings,
    /// Touches.
    pub touch: TouchSettings,
    /// The U-net, where there is one.
    pub denoise: Option<DenoiseSettings>,
}

/// Recorded frames and how they are read; paths as seen from the working folder.
#[derive(Debug, Clone, Default)]
pub struct FrameSettings {
    /// Files whose frames follow each other; empty where the scene names none.
    pub files: Option<Vec<PathBuf>>,
    /// Name of the format, where the ending does not tell.
    pub format: Option<String>,
    /// How a table holds frames.
    pub frames_are: Option<FramesAre>,
    /// Whether a table holds complex numbers.
    pub complex: bool,
    /// Which real number is taken of complex data.
    pub component: Component,
    /// Row of the frequency in a Sciospec file.
    pub frequency_row: Option<usize>,
    /// The frame to subtract.
    pub reference: Option<Reference>,
    /// Frames before this one are passed over.
    pub first_frame: usize,
    /// Frames a second.
    pub frame_rate_hz: Option<f64>,
    /// Every value is multiplied by this.
    pub scale: f64,
}

/// Turns and mirror images that leave a disc with its electrodes as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Symmetry {
    /// Centre of electrode 1, counter-clockwise from +x.
    pub first_angle_rad: f64,
    /// Electrodes are counted clockwise.
    pub is_clockwise: bool,
}

impl Scene {
    /// The settings of the stages behind the model.
    pub fn stage_settings(&self) -> StageSettings {
        let denoise = self.denoise.clone().map(|keys| DenoiseSettings {
            weights: match keys.weights.as_str() {
                "default" => keys.weights,
                file => self.resolve(file.as_ref()).display().to_string(),
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
                    Reference::Text(self.resolve(text.as_ref()).display().to_string())
                }
                other => other,
            }),
            first_frame: first_frame.unwrap_or(0),
            frame_rate_hz,
            scale: scale.unwrap_or(1.0),
        }
    }

    /// The symmetries of a disc whose electrodes are alike; `None` for every other skin.
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
