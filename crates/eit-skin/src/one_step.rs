//! One-step difference images, and what all element-based methods share: prior, data, lambda.

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::frames::Frames;
use crate::limits::check_images;
use crate::progress::Progress;
use crate::scene::{DifferenceKind, Hyperparameter, Rule};
use eit_denoise::ImageStack;
use eit_inverse::{
    ChosenHyperparameter, HyperparameterChoice, InverseError, NoiseTarget, OneStepGaussNewton,
    OneStepSettings,
};
use eit_mesh::Raster;
use ndarray::{Array2, ArrayView1, Axis};

/// Default noise figure: the image is as noisy as the data.
pub(crate) const DEFAULT_NOISE_FIGURE: f64 = 1.0;
/// The same where the reference frame has other levels than the model
/// ([`ModelFit::is_scattered`](crate::frames::ModelFit::is_scattered)): the error is that of the
/// model, which smoothing reduces more than noise. It is below the smallest noise figure that can
/// be reached, so images are as smooth as possible.
const SCATTERED_NOISE_FIGURE: f64 = 0.2;

/// A one-step reconstruction that is ready for frames.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Imaging {
    /// Reconstruction on elements.
    pub difference: OneStepGaussNewton,
    /// How the hyperparameter was chosen.
    pub chosen: ChosenHyperparameter,
    /// Rule that chose it, in words.
    pub rule: String,
    /// Pixels of the images.
    pub raster: Raster,
    /// Plain or normalised differences.
    pub kind: DifferenceKind,
}

impl FittedFrames {
    /// Prepares the one-step reconstruction that the settings specify.
    ///
    /// # Errors
    ///
    /// Errors of the reconstruction and of choosing its hyperparameter.
    pub fn one_step(&self, progress: &mut Progress) -> Result<Imaging, SkinError> {
        let settings = self.one_step_settings()?;
        let prior = self.skin.prior()?;
        let mut difference = progress.stage("reconstruction matrix", || {
            OneStepGaussNewton::new(&self.skin.jacobian, prior.as_ref(), settings)
        })?;
        let found = progress.stage("hyperparameter", || choose(self, &mut difference))?;
        let raster = self.skin.raster(progress)?.clone();
        let (chosen, rule) = (found.chosen, found.rule);
        Ok(Imaging { difference, chosen, rule, raster, kind: self.skin.difference_kind() })
    }

    /// Returns settings with data, weights and channels; lambda is the default.
    ///
    /// # Errors
    ///
    /// The errors of the difference data.
    pub fn one_step_settings(&self) -> Result<OneStepSettings, SkinError> {
        let data = self.skin.difference_data();
        let skin = &self.skin.skin;
        let stated = if self.skin.is_white { None } else { skin.settings.noise.additive_v };
        let additive = stated.map(|e| vec![e; skin.protocol.measurements()]);
        let noise_std = additive.map(|noise_std_v| data.noise_std(&noise_std_v)).transpose()?;
        let noise_std = noise_std.or_else(|| self.noise_of_levels());
        let used = Some(self.frames.used.clone());
        Ok(OneStepSettings { data, noise_std, used, ..Default::default() })
    }
}

impl FittedFrames {
    /// Noise of normalised differences that is equal in all measurements in volts, if the levels of
    /// the reference frame differ from the model's: otherwise the smallest levels, whose changes
    /// carry least information, would count most. `None` for plain differences, and for levels like
    /// the model's.
    fn noise_of_levels(&self) -> Option<Vec<f64>> {
        let is_normalised = self.skin.difference_kind() == DifferenceKind::Normalised;
        if !(is_normalised && self.fit.is_scattered()) {
            return None;
        }
        let sizes: Vec<f64> = self.frames.reference.iter().map(|v| v.abs()).collect();
        let used =
            sizes.iter().zip(&self.frames.used).filter(|(size, used)| **used && **size > 0.0);
        let median = eit_core::median(used.map(|(size, _)| *size))?;
        // measurements that are not used need some number
        Some(sizes.iter().map(|size| if *size > 0.0 { median / size } else { 1.0 }).collect())
    }
}

/// A hyperparameter and the rule that chose it.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub(crate) struct ChosenBy {
    /// The choice.
    pub chosen: ChosenHyperparameter,
    /// The rule, in words.
    pub rule: String,
}

/// Chooses the hyperparameter by the rule of the settings.
pub(crate) fn choose(
    fitted: &FittedFrames,
    difference: &mut OneStepGaussNewton,
) -> Result<ChosenBy, SkinError> {
    let FittedFrames { skin: linearised, frames, .. } = fitted;
    let keys = &linearised.skin.settings.reconstruction;
    let target;
    let default_figure = match fitted.fit.is_scattered() {
        true => SCATTERED_NOISE_FIGURE,
        false => DEFAULT_NOISE_FIGURE,
    };
    let figure = keys.noise_figure.unwrap_or(default_figure);
    let default = Hyperparameter::Rule(Rule::NoiseFigure);
    let clean = frames.clean();
    let needs_data =
        matches!(keys.hyperparameter, Some(Hyperparameter::Rule(Rule::LCurve | Rule::Gcv)));
    if needs_data && clean.is_empty() {
        return Err(SkinError::input(
            "the hyperparameter is chosen from the data, but no frame is good in every used \
             measurement: set hyperparameter = \"noise-figure\" or a number",
        ));
    }
    let values = frames.values.select(Axis(0), &clean);
    let (values, reference_frame) = (values.view(), frames.reference.as_slice());
    let (choice, words) = match keys.hyperparameter.as_ref().unwrap_or(&default) {
        Hyperparameter::Value(value) => {
            (HyperparameterChoice::Fixed(*value), "fixed by the scene".to_owned())
        }
        Hyperparameter::Rule(Rule::NoiseFigure) => {
            target = NoiseTarget::central(linearised.skin.mesh.surface(), &linearised.jacobian)?;
            let choice = HyperparameterChoice::NoiseFigure { figure, target: &target };
            (choice, format!("noise figure {figure}"))
        }
        Hyperparameter::Rule(Rule::LCurve) => {
            (HyperparameterChoice::LCurve { frames: values, reference_frame }, "L-curve".into())
        }
        Hyperparameter::Rule(Rule::Gcv) => (
            HyperparameterChoice::Gcv { frames: values, reference_frame },
            "generalised cross-validation".into(),
        ),
    };
    Ok(ChosenBy { chosen: difference.choose_hyperparameter(&choice)?, rule: words })
}

impl Imaging {
    /// Computes images [frame, row, column] in siemens, NaN outside the skin.
    ///
    /// Frames with bad values among the used measurements are reconstructed without those values; the image
    /// of a frame without a good value is zero.
    ///
    /// # Errors
    ///
    /// Frames of another length, and values that are not finite.
    pub fn images(
        &self,
        frames: &Frames,
        progress: &mut Progress,
    ) -> Result<ImageStack, SkinError> {
        let count = frames.values.nrows();
        check_images(count, self.raster.pixels())?;
        progress.steps("images", count, |bar| {
            let reconstructor = self.difference.on_raster(self.raster.pixel_from_element())?;
            let mut pixels = Array2::zeros((count, self.raster.masked_pixels().len()));
            let clean = frames.clean();
            let values = frames.values.select(Axis(0), &clean);
            let found = reconstructor.reconstruct_frames(values.view(), &frames.reference)?;
            for (row, frame) in found.rows().into_iter().zip(&clean) {
                pixels.row_mut(*frame).assign(&row);
            }
            bar.set_position(clean.len());
            let mut workspace = reconstructor.workspace();
            let mut image = vec![0.0; reconstructor.image_len()];
            for frame in (0..count).filter(|frame| clean.binary_search(frame).is_err()) {
                let bad: Vec<usize> =
                    (0..frames.used.len()).filter(|&i| !frames.good[[frame, i]]).collect();
                let values = frames.values.row(frame).to_vec();
                let (reference, memory) = (&frames.reference, &mut workspace);
                match reconstructor
                    .reconstruct_masked_into(&values, reference, &bad, memory, &mut image)
                {
                    // a dropped frame has an empty image and does not affect others
                    Err(InverseError::NothingUsed { .. }) => image.fill(0.0),
                    made => {
                        made.map_err(|e| SkinError::from(e).within(&format!("frame {frame}")))?;
                    }
                }
                pixels.row_mut(frame).assign(&ArrayView1::from(&image));
                bar.inc();
            }
            let images = self.raster.images_from_pixels(pixels.view())?;
            Ok(ImageStack::new(images, self.raster.mask().clone())?)
        })
    }

    /// Returns the fraction of each frame's difference that its image does not explain, 0 to 1; `None` if the
    /// frame has bad values or does not differ from the reference.
    ///
    /// # Errors
    ///
    /// Frames of another length.
    pub fn residuals(&self, frames: &Frames) -> Result<Vec<Option<f64>>, SkinError> {
        let mut residuals = vec![None; frames.values.nrows()];
        for frame in frames.clean() {
            let values = frames.values.row(frame).to_vec();
            residuals[frame] = self.difference.relative_residual(&values, &frames.reference)?;
        }
        Ok(residuals)
    }
}
