//! One-step images frame by frame.

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::movement::{self, MovementRemoved, Whitening};
use crate::one_step::DEFAULT_NOISE_FIGURE;
use crate::progress::Progress;
use eit_inverse::{
    HyperparameterChoice, InverseError, NoiseTarget, OneStepGaussNewton, OneStepSettings,
    Reconstructor, Workspace,
};

/// One-step reconstruction weighted by the noise, at noise figure 1: an image as noisy as its data. If
/// electrodes may move, their movement is removed first, and the prior stays the same.
#[derive(Debug, Clone)]
pub(super) struct LiveOneStep {
    reconstructor: Reconstructor,
    workspace: Workspace,
    /// Removes electrode movement from the differences.
    whitening: Option<Whitening>,
    /// Used measurements that the current frame lacks.
    missing: Vec<usize>,
}

impl LiveOneStep {
    /// Prepares images for frames like `fitted`.
    ///
    /// # Errors
    ///
    /// Unknown noise of the frames; errors of the reconstruction.
    pub(crate) fn new(fitted: &FittedFrames, progress: &mut Progress) -> Result<Self, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let Some(noise) = fitted.noise()? else {
            return Err(SkinError::input("the noise of the frames is unknown: set [noise]"));
        };
        let mut settings = fitted.one_step_settings()?;
        settings.noise_std = Some(noise.std.clone());
        let prior = skin.prior()?;
        let raster = skin.raster(progress)?;
        progress.stage("one-step images", || {
            let mut difference = OneStepGaussNewton::new(&skin.jacobian, prior.as_ref(), settings)?;
            let target = NoiseTarget::central(skin.skin.mesh.surface(), &skin.jacobian)?;
            let figure = DEFAULT_NOISE_FIGURE;
            let choice = HyperparameterChoice::NoiseFigure { figure, target: &target };
            difference.choose_hyperparameter(&choice)?;
            let removed = movement::remove(skin, &noise, &frames.used, Some(&difference))?;
            let whitening = match removed {
                None => None,
                Some(MovementRemoved { side, linearised, .. }) => {
                    let used = Some(frames.used.clone());
                    let settings = OneStepSettings { used, ..Default::default() };
                    let mut left =
                        OneStepGaussNewton::new(&linearised.jacobian, prior.as_ref(), settings)?;
                    left.set_prior_of(&difference)?;
                    difference = left;
                    Some(Whitening::new(side, skin.difference_kind(), &frames.used))
                }
            };
            let reconstructor = difference.on_raster(raster.pixel_from_element())?;
            Ok(Self {
                workspace: reconstructor.workspace(),
                reconstructor,
                whitening,
                missing: Vec::with_capacity(frames.used.len()),
            })
        })
    }

    /// Computes the image of a frame `[measurement]`, volts, against its reference, one value per pixel of
    /// the skin; zero if too little of the frame is valid.
    ///
    /// # Errors
    ///
    /// Errors of the reconstruction.
    pub(crate) fn push(
        &mut self,
        values: &[f64],
        reference: &[f64],
        is_missing: impl Fn(usize) -> bool,
        pixels: &mut [f64],
    ) -> Result<(), SkinError> {
        let Self { reconstructor, workspace, whitening, missing } = self;
        missing.clear();
        missing.extend((0..values.len()).filter(|&i| is_missing(i)));
        let Some(whitening) = whitening else {
            return match reconstructor
                .reconstruct_masked_into(values, reference, missing, workspace, pixels)
            {
                // too little is left for an image; touches continue
                Err(InverseError::MaskedDominates { .. } | InverseError::NothingUsed { .. }) => {
                    pixels.fill(0.0);
                    Ok(())
                }
                made => Ok(made.map(|_| ())?),
            };
        };
        if missing.is_empty() {
            let white = whitening.of(values, reference)?;
            reconstructor.reconstruct_difference_into(white, workspace, pixels)?;
        } else {
            // whitening mixes measurements: without all of them there is no image
            pixels.fill(0.0);
        }
        Ok(())
    }
}
