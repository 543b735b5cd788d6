//! One-step difference images, and what the methods on elements share: prior, data, lambda.

use super::{DEFAULT_NOISE_FIGURE, Linearised, Setup, check_images, difference_data, raster};
use crate::error::SkinError;
use crate::frames::Frames;
use crate::progress::Progress;
use crate::scene::{DifferenceKind, Hyperparameter, PriorKind, Rule, Scene};
use eit_denoise::ImageStack;
use eit_inverse::{
    ChosenHyperparameter, Gaussian, GaussianSettings, HyperparameterChoice, Laplace,
    LaplaceSettings, NoiseTarget, Noser, OneStepGaussNewton, OneStepSettings, Prior, Tikhonov,
};
use eit_mesh::Raster;
use ndarray::{Array2, ArrayView1, Axis};

/// A reconstruction ready for frames.
pub struct Imaging {
    /// On elements.
    pub difference: OneStepGaussNewton,
    /// How the hyperparameter was chosen.
    pub chosen: ChosenHyperparameter,
    /// The rule in words.
    pub rule: String,
    /// Pixels of the pictures.
    pub raster: Raster,
    /// Plain or normalised.
    pub kind: DifferenceKind,
}

/// The scene's prior.
pub fn prior(scene: &Scene, setup: &Setup) -> Result<Box<dyn Prior + Send + Sync>, SkinError> {
    let surface = setup.mesh.surface();
    let length = scene.reconstruction.correlation_length_m;
    Ok(match scene.reconstruction.prior.unwrap_or(PriorKind::Laplace) {
        PriorKind::Tikhonov => Box::new(Tikhonov::new(surface)),
        PriorKind::Noser => Box::new(Noser::default()),
        PriorKind::Laplace => {
            let settings = LaplaceSettings { correlation_length_m: length };
            Box::new(Laplace::new(surface, &settings)?)
        }
        PriorKind::Gaussian => {
            Box::new(Gaussian::new(surface, &GaussianSettings { length_m: length })?)
        }
    })
}

/// Computes the reconstruction of a scene for frames.
pub fn imaging(
    scene: &Scene,
    setup: &Setup,
    linearised: &Linearised,
    frames: &Frames,
    progress: &mut Progress,
) -> Result<Imaging, SkinError> {
    let kind = scene.difference_kind(&setup.protocol);
    let settings = settings(scene, setup, linearised, &frames.used)?;
    let prior = prior(scene, setup)?;
    let mut difference = progress.stage("reconstruction matrix", || {
        OneStepGaussNewton::new(&linearised.jacobian, prior.as_ref(), settings)
    })?;
    let (chosen, rule) = progress
        .stage("hyperparameter", || choose(scene, setup, linearised, frames, &mut difference))?;
    let raster = raster(scene, setup, progress)?;
    Ok(Imaging { difference, chosen, rule, raster, kind })
}

/// Data, weights and channels; lambda is the default.
pub fn settings(
    scene: &Scene,
    setup: &Setup,
    linearised: &Linearised,
    used: &[bool],
) -> Result<OneStepSettings, SkinError> {
    let data = difference_data(scene.difference_kind(&setup.protocol), linearised);
    let additive = scene.noise.additive_v.map(|e| vec![e; setup.protocol.measurements()]);
    let noise_std = additive.map(|noise_std_v| data.noise_std(&noise_std_v)).transpose()?;
    Ok(OneStepSettings { data, noise_std, used: Some(used.to_vec()), ..Default::default() })
}

/// Chooses the hyperparameter by the scene's rule; the rule in words.
pub fn choose(
    scene: &Scene,
    setup: &Setup,
    linearised: &Linearised,
    frames: &Frames,
    difference: &mut OneStepGaussNewton,
) -> Result<(ChosenHyperparameter, String), SkinError> {
    let keys = &scene.reconstruction;
    let target;
    let figure = keys.noise_figure.unwrap_or(DEFAULT_NOISE_FIGURE);
    let default = Hyperparameter::Rule(Rule::NoiseFigure);
    let clean = frames.clean();
    let needs_data =
        matches!(keys.hyperparameter, Some(Hyperparameter::Rule(Rule::LCurve | Rule::Gcv)));
    if needs_data && clean.is_empty() {
        return Err(SkinError::input(
            "the hyperparameter is chosen from the data, but no frame is good in every used \
             measurement: take hyperparameter = \"noise-figure\" or a number",
        ));
    }
    let values = frames.values.select(Axis(0), &clean);
    let (values, reference_frame) = (values.view(), frames.reference.as_slice());
    let (choice, words) = match keys.hyperparameter.as_ref().unwrap_or(&default) {
        Hyperparameter::Value(value) => {
            (HyperparameterChoice::Fixed(*value), "fixed by the scene".to_owned())
        }
        Hyperparameter::Rule(Rule::NoiseFigure) => {
            target = NoiseTarget::central(setup.mesh.surface(), &linearised.jacobian)?;
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
    Ok((difference.choose_hyperparameter(&choice)?, words))
}

impl Imaging {
    /// Images [frame, row, column] in siemens, NaN outside the skin.
    ///
    /// Frames with bad values among the used measurements are reconstructed without them.
    pub fn images(
        &self,
        frames: &Frames,
        progress: &mut Progress,
    ) -> Result<ImageStack, SkinError> {
        let count = frames.values.nrows();
        check_images(count, &self.raster)?;
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
                reconstructor
                    .reconstruct_masked_into(&values, reference, &bad, memory, &mut image)
                    .map_err(|e| SkinError::from(e).within(&format!("frame {frame}")))?;
                pixels.row_mut(frame).assign(&ArrayView1::from(&image));
                bar.inc();
            }
            let images = self.raster.images_from_pixels(pixels.view())?;
            Ok(ImageStack::new(images, self.raster.mask().clone())?)
        })
    }

    /// Part of each frame's difference that its image leaves unexplained, 0 to 1; `None` where the
    /// frame has bad values or does not differ from the reference.
    pub fn residuals(&self, frames: &Frames) -> Result<Vec<Option<f64>>, SkinError> {
        let mut residuals = vec![None; frames.values.nrows()];
        for frame in frames.clean() {
            let values = frames.values.row(frame).to_vec();
            residuals[frame] = self.difference.relative_residual(&values, &frames.reference)?;
        }
        Ok(residuals)
    }
}
