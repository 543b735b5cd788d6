//! Image reconstruction and touch detection, set up for one noise level.

use super::super::solver::{BoundedMethod, Solver};
use super::simulated_disc::SimulatedDisc;
use crate::error::ReportError;
use eit_inverse::touch::NoiseFloor;
use eit_inverse::{
    HyperparameterChoice, NoiseTarget, OneStepGaussNewton, OneStepSettings, Reconstructor, StTv,
};
use eit_skin::method::Method;
use eit_skin::one_step::DEFAULT_NOISE_FIGURE;
use eit_skin::scene::Rule;
use ndarray::{Array2, ArrayView1, Axis};

/// One-step images and their noise floor.
pub(super) struct OneStepDetector {
    pub reconstructor: Reconstructor,
    pub floor: NoiseFloor,
}

impl OneStepDetector {
    /// Creates the detector of `eit reconstruct`: weighted by the noise, noise figure 1.
    pub fn new(disc: &SimulatedDisc, noise_std_v: f64) -> Result<Self, ReportError> {
        let model = &disc.model;
        let data = model.linearised.difference_data();
        let noise_std = data.noise_std(&vec![noise_std_v; disc.reference_v.len()])?;
        let settings =
            OneStepSettings { data, noise_std: Some(noise_std.clone()), ..Default::default() };
        let jacobian = &model.linearised.jacobian;
        let mut difference = OneStepGaussNewton::new(jacobian, model.prior.as_ref(), settings)?;
        let target = NoiseTarget::central(model.skin().mesh.surface(), jacobian)?;
        let figure = DEFAULT_NOISE_FIGURE;
        let choice = HyperparameterChoice::NoiseFigure { figure, target: &target };
        difference.choose_hyperparameter(&choice)?;
        let reconstructor = difference.on_raster(model.raster.pixel_from_element())?;
        let floor = NoiseFloor::of_reconstruction(&reconstructor, &noise_std)?;
        Ok(Self { reconstructor, floor })
    }
}

/// Creates ST-TV with the bound that pressing only raises the conductivity; its weights are chosen
/// on frames.
pub(super) fn total_variation(
    disc: &SimulatedDisc,
    frames: Array2<f64>,
    reference: &[f64],
    noise_std_v: f64,
) -> Result<StTv, ReportError> {
    let method = BoundedMethod { method: Method::StTv, lower_s: Some(0.0) };
    let frames = disc.frames(frames, reference);
    let fitted = disc.model.fit(&frames, noise_std_v, method.settings(&disc.model, Rule::Gcv));
    let solver = Solver::new(&disc.model, &fitted, method.method)?;
    let works_on_pixels = || ReportError::Failure("st-tv works on pixels".to_owned());
    solver.into_total_variation().ok_or_else(works_on_pixels)
}

/// Difference data of a frame, as used by the methods on pixels.
pub(super) fn difference(disc: &SimulatedDisc, frame: &[f64], reference: &[f64]) -> Array2<f64> {
    let row = ArrayView1::from(frame).insert_axis(Axis(0)).to_owned();
    disc.frames(row, reference).differences(disc.model.difference_kind())
}
