//! Converts a scene to the settings of the stages after the model, with all paths resolved.

use super::{
    DenoiseSettings, Direction, NoiseSettings, OneOrMany, OneOrManyFiles, ReconstructionSettings,
    RecordingSettings, Reference, Scene, Shape, TouchSettings,
};
use crate::error::SkinError;
use crate::weave::Weave;
use eit_hw::{Format, MeasuredFrames, Quality, ReadOptions};
use std::path::PathBuf;

/// Settings of the stages after the model: frames, noise, images, touches.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StageSettings {
    /// Recorded frames and how to read them; paths are relative to the working directory.
    pub recording: RecordingSettings,
    /// Noise of the instrument.
    pub noise: NoiseSettings,
    /// Image reconstruction.
    pub reconstruction: ReconstructionSettings,
    /// Detection of touches.
    pub touch: TouchSettings,
    /// The U-net, if there is one.
    pub denoise: Option<DenoiseSettings>,
}

impl RecordingSettings {
    /// Returns the files; `None` if the scene names none.
    pub fn files(&self) -> Option<&[PathBuf]> {
        self.file.as_ref().map(|files| match files {
            OneOrManyFiles::One(file) => std::slice::from_ref(file),
            OneOrManyFiles::Many(files) => files,
        })
    }

    /// Converts values of frames to voltages; those that have none are flagged.
    pub(crate) fn convert(&self, frames: &mut MeasuredFrames) {
        let (kind, factor) = (self.values, self.factor());
        ndarray::Zip::from(&mut frames.values).and(&mut frames.quality).for_each(
            |value, quality| {
                let was_known = value.is_finite();
                *value = factor * kind.voltage(*value);
                if was_known && !value.is_finite() {
                    *quality |= Quality::NON_FINITE;
                }
            },
        );
    }

    /// Factor for every voltage.
    pub(crate) fn factor(&self) -> f64 {
        self.scale.unwrap_or(1.0)
    }

    /// Returns the format, where it is stated, and how a file of it is read.
    ///
    /// # Errors
    /// An unknown format.
    pub fn reading(&self) -> Result<(Option<Format>, ReadOptions), SkinError> {
        let mut options = ReadOptions {
            complex: self.complex,
            frames_are: self.frames_are,
            array: self.array.clone(),
            ..Default::default()
        };
        if let Some(row) = self.frequency_row {
            options.frequency_row = row;
        }
        Ok((self.format.as_deref().map(str::parse).transpose()?, options))
    }
}

/// Rotations and reflections that map a disc with its electrodes onto itself.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Symmetry {
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
            recording: self.resolved_recording(),
            noise: self.noise.clone(),
            reconstruction: self.reconstruction.clone(),
            touch: TouchSettings {
                learned: self.touch.learned.as_ref().map(|file| self.resolve(file)),
                ..self.touch.clone()
            },
            denoise,
        }
    }

    /// The recording with paths relative to the working directory.
    fn resolved_recording(&self) -> RecordingSettings {
        let mut recording = self.recording.clone();
        let files = recording.files();
        let files = files.map(|files| files.iter().map(|file| self.resolve(file)).collect());
        recording.file = files.map(OneOrManyFiles::Many);
        if let Some(Reference::Text(text)) = &mut recording.reference
            && Reference::is_file(text)
        {
            *text = self.resolve(&*text).display().to_string();
        }
        recording
    }

    /// Returns the weave that the scene states.
    pub(crate) fn weave(&self) -> Option<Weave> {
        let angle_deg = self.skin.weave_angle_deg.unwrap_or(0.0);
        self.skin.weave_ratio.map(|ratio| Weave { ratio, angle_deg })
    }

    /// Returns the symmetry of a disc with equal electrodes; `None` for every other skin.
    pub(crate) fn symmetry(&self) -> Option<Symmetry> {
        let electrodes = &self.electrodes;
        let is_even = self.skin.shape == Shape::Disc
            && self.skin.weave_ratio.is_none_or(|ratio| ratio == 1.0)
            && electrodes.positions_m.is_none()
            && !matches!(electrodes.contact_impedance_ohm_m, Some(OneOrMany::Many(_)))
            && matches!(electrodes.width_m, Some(OneOrMany::One(_)));
        is_even.then(|| Symmetry {
            first_angle_rad: electrodes.first_angle_deg.unwrap_or(0.0).to_radians(),
            is_clockwise: electrodes.direction == Direction::Clockwise,
        })
    }
}
