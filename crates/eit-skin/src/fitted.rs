//! Frames fitted to a linearised skin: the input of a reconstruction.

use crate::error::SkinError;
use crate::frames::{Frames, ModelFit, QuietFrames};
use crate::linearised::LinearisedSkin;
use crate::noise::DataNoise;
use crate::scene::DifferenceKind;
use crate::weave::FoundWeave;
use eit_inverse::{DifferenceData, noise_std_of_quiet_frames};
use ndarray::{Array2, ArrayView1};
use std::sync::Arc;

impl LinearisedSkin {
    /// Fits the model to the reference of frames. If the scene states no weave, and the reference shows one, the
    /// result has the skin of that weave.
    ///
    /// # Errors
    ///
    /// A reference of zero, or of the opposite sign if differences are plain.
    pub fn fit(self: &Arc<Self>, mut frames: Frames) -> Result<FittedFrames, SkinError> {
        let weave = self.skin.find_weave(&frames.reference, &frames.used)?;
        let skin = match &weave {
            None => Arc::clone(self),
            Some(found) => {
                frames.notes.push(found.description());
                Arc::new(self.with_weave(found.weave)?)
            }
        };
        let kind = skin.difference_kind();
        let values = skin.skin.settings.recording.values;
        let model_v = skin.voltages.to_vec();
        let fit = frames.fit_model(&model_v, kind, skin.skin.conductivity_s, values)?;
        Ok(FittedFrames { skin, frames, fit, weave })
    }
}

/// Frames with their reference, fitted to a linearised skin: the input of a reconstruction.
#[derive(Debug, Clone)]
pub struct FittedFrames {
    /// The model.
    pub skin: Arc<LinearisedSkin>,
    /// Values and reference, in protocol order.
    pub frames: Frames,
    /// How well the model's voltages explain the reference.
    pub fit: ModelFit,
    /// The weave that the reference showed.
    pub weave: Option<FoundWeave>,
}

impl FittedFrames {
    /// Returns the median size of the ratio `g` of measured to modelled voltage over the used measurements; 1 if none is
    /// known.
    ///
    /// Voltages of `g` times the model's are those of a sheet with `1 / g` of the scene's conductivity, and the strengths
    /// of touches are changes of that sheet. Another unit of the frames, or another current, looks the same.
    pub fn level(&self) -> f64 {
        let Self { skin, frames, .. } = self;
        let ratios =
            frames.reference.iter().zip(&skin.voltages).map(|(v, model)| (v / model).abs());
        let known = |(ratio, used): (f64, &bool)| {
            (*used && ratio.is_finite() && ratio > 0.0).then_some(ratio)
        };
        eit_core::median(ratios.zip(&frames.used).filter_map(known)).unwrap_or(1.0)
    }

    /// Returns the factor from the strength of a touch to the integral of its image. Normalised images are relative to
    /// the scene's conductivity, those of plain differences to the model's voltages.
    pub fn image_per_strength(&self) -> f64 {
        match self.skin.difference_kind() {
            DifferenceKind::Normalised => self.level(),
            DifferenceKind::Plain => self.level().powi(2),
        }
    }

    /// Returns difference data [frame, measurement], zero where a value is not used: in volt, or relative to
    /// the reference.
    pub fn differences(&self) -> Array2<f64> {
        self.frames.differences(self.skin.difference_kind())
    }

    /// Returns the same with NaN where a value is not used or not good.
    pub fn differences_or_nan(&self) -> Array2<f64> {
        let mut differences = self.differences();
        differences.zip_mut_with(&self.good(), |value, good| {
            if !good {
                *value = f64::NAN;
            }
        });
        differences
    }

    /// Returns whether each value is good and used, [frame, measurement].
    pub(crate) fn good(&self) -> Array2<bool> {
        &self.frames.good & &ArrayView1::from(&self.frames.used)
    }

    /// Returns the noise of the differences: that of the settings, else that of the quiet frames; `None` if
    /// it is unknown.
    ///
    /// For normalised data, the gain between the model's voltages and the reference scales the division. The
    /// variance of a difference is that of its frame plus `1 / k` of it from a reference that is the mean of
    /// `k` frames.
    ///
    /// # Errors
    ///
    /// Quiet frames that the settings name, but that show no noise.
    pub fn noise(&self) -> Result<Option<DataNoise>, SkinError> {
        let Self { skin, frames, fit, .. } = self;
        if skin.is_white {
            return Ok(Some(DataNoise::white(frames)));
        }
        let data = skin.difference_data();
        let keys = &skin.skin.settings.noise;
        if let Some(additive_v) = keys.additive_v {
            let mut std = data.noise_std(&vec![additive_v; frames.used.len()])?;
            if matches!(data, DifferenceData::Normalised { .. }) {
                std.iter_mut().for_each(|e| *e /= fit.gain.abs());
            }
            let source = format!("{additive_v:e} V in a voltage, from the scene");
            return Ok(Some(DataNoise::of_single_frames(std, frames, source)));
        }
        let Some(quiet) = &frames.quiet else { return Ok(None) };
        match measured(quiet, frames, &data) {
            Ok(std) => {
                let source = format!("measured on {}", quiet.source);
                Ok(Some(DataNoise::of_single_frames(std, frames, source)))
            }
            Err(error) if keys.quiet_frames.is_some() => {
                Err(SkinError::from(error).within("noise.quiet_frames"))
            }
            // the reference frames were not declared quiet
            Err(_) => Ok(None),
        }
    }
}

fn measured(
    quiet: &QuietFrames,
    frames: &Frames,
    data: &DifferenceData,
) -> Result<Vec<f64>, eit_inverse::InverseError> {
    let mut std = noise_std_of_quiet_frames(quiet.values.view())?;
    if matches!(data, DifferenceData::Normalised { .. }) {
        for (e, (reference, used)) in std.iter_mut().zip(frames.reference.iter().zip(&frames.used))
        {
            // the reference of an unused measurement may be anything
            if *used {
                *e /= reference.abs();
            }
        }
    }
    Ok(std)
}
