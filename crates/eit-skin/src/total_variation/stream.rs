//! Total variation for a live instrument, frame by frame.
//!
//! The weights of a recording are chosen after seeing all of it, but a live instrument has only shown an
//! untouched skin by then. The weights are therefore those of a synthetic touch ([`synthetic_touch`]): a
//! fingertip that moves over the skin, simulated by the linear model with the measured noise.

use super::{Weights, solver, stop, weights};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::method::Method;
use crate::noise::DataNoise;
use crate::progress::Progress;
use crate::scene::Delta;
use crate::synthetic_touch::{self, Places};
use eit_inverse::{
    CausalSettings, CausalStep, CausalStream, Certificate, DifferenceFrames, Fidelity,
    InverseError, SequenceStatus,
};
use ndarray::Array2;

/// A stream that is ready for frames, and its weights.
#[derive(Debug, Clone)]
pub struct TvStream {
    stream: CausalStream,
    /// Weights of the frames' images.
    pub weights: Weights,
}

/// Result for one frame.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub struct TvStep<'a> {
    /// Image in siemens, `[masked pixel]`.
    pub image: &'a [f64],
    /// Why the iteration stopped.
    pub status: SequenceStatus,
    /// Number of iterations for this frame.
    pub iterations: usize,
    /// Bounds on the optimum of the frame's problem.
    pub certificate: Certificate,
    /// Whether the frame is nothing but noise, so that no iteration was needed.
    pub quiet: bool,
}

impl TvStream {
    /// Takes differences `[measurement]`; `good` tells which of them count.
    ///
    /// # Errors
    ///
    /// Errors of the solver, which is then unchanged.
    pub fn push(
        &mut self,
        differences: &[f64],
        good: Option<&[bool]>,
    ) -> Result<TvStep<'_>, InverseError> {
        Ok(TvStep::new(self.stream.push(differences, good)?))
    }

    /// Records a lost frame: a coupled stream keeps its image, one without a time term shows none (zero).
    pub(crate) fn push_dropped(&mut self) -> TvStep<'_> {
        TvStep::new(self.stream.push_dropped())
    }

    /// Discards the previous image, because frames have passed without one.
    pub fn restart(&mut self) {
        self.stream.restart();
    }

    /// Describes the weights in a few words, such as for a caption.
    pub fn description(&self) -> String {
        let Weights { lambda_space, lambda_time, rule, .. } = &self.weights;
        format!("λ {lambda_space:.2e}, {lambda_time:.2e} ({rule})")
    }

    /// Returns whether images are coupled in time.
    pub(crate) fn has_time(&self) -> bool {
        self.weights.lambda_time > 0.0
    }
}

impl<'a> TvStep<'a> {
    fn new(step: CausalStep<'a>) -> Self {
        let CausalStep { image, status, iterations, certificate, quiet, .. } = step;
        Self { image, status, iterations, certificate, quiet }
    }
}

impl FittedFrames {
    /// Sets up total variation for a stream whose reference these frames are. It does not depend on a clock,
    /// so a recording reproduces its images; `deadline_s` is therefore ignored.
    ///
    /// # Errors
    ///
    /// Unknown noise, or weights that cannot be chosen.
    pub fn tv_stream(
        &self,
        method: Method,
        progress: &mut Progress,
    ) -> Result<TvStream, SkinError> {
        stream(self, method, progress)
    }
}

/// Number of multiplications for an image, at most: about 20 ms on one core. The next image begins where it ended.
const MOST_WORK: f64 = 1e8;

/// Number of iterations for an image, each of which passes twice over the Jacobian `[measurement, pixel]`.
fn most_iterations(jacobian: &Array2<f64>) -> usize {
    (MOST_WORK / (2.0 * jacobian.len() as f64).max(1.0)).ceil() as usize
}

fn stream(
    fitted: &FittedFrames,
    method: Method,
    progress: &mut Progress,
) -> Result<TvStream, SkinError> {
    let FittedFrames { skin, frames, .. } = fitted;
    let keys = &skin.skin.settings.reconstruction;
    let raster = skin.raster(progress)?;
    let unknown = || SkinError::input("the noise is unknown: set [noise] additive_v");
    let known = fitted.noise()?.ok_or_else(unknown)?;
    let jacobian = skin.pixel_jacobian(raster, &frames.used)?;
    let places = Places {
        at_m: raster.masked_pixels().iter().map(|&[i, j]| raster.centre_m(i, j)).collect(),
        side_m: raster.pixel_m() * raster.pixels() as f64,
    };
    let expected = synthetic_touch::touch(&jacobian, &places, &known, skin.skin.conductivity_s);
    let good = Array2::from_shape_fn(expected.dim(), |(_, i)| frames.used[i]);
    let used = good.row(0).iter().filter(|used| **used).count();
    // given numbers refer to the noise alone
    let given = keys.lambda_space.is_some() || matches!(keys.delta, Some(Delta::Value(_)));
    let raised = match given {
        true => known.clone(),
        false => known.clone().with_model_error(&expected, &good),
    };
    let with = |noise: &DataNoise| {
        solver(&jacobian, raster, method, keys, Some(noise.std.clone()), &frames.used)
    };
    let differences = DifferenceFrames { values: expected.view(), good: Some(good.view()) };
    let mut trial = with(&raised)?;
    let mut weights = weights(&mut trial, keys, &differences, raster, used)?;
    // the stream weights by the noise alone, to distinguish a quiet skin from a faint touch
    let factor = raised.model_error;
    weights.rescale(factor * factor);
    weights.delta = weights.delta.map(|delta| factor * delta);
    if !given {
        weights.rule += " for a synthetic touch";
    }
    let fidelity =
        weights.delta.map_or(Fidelity::Penalised, |delta| Fidelity::Constrained { delta });
    let mut solver = with(&known)?;
    solver.set_weights(weights.lambda_space, weights.lambda_time, fidelity)?;
    let target_gap = stop(keys).target_gap;
    let max_iterations = most_iterations(&jacobian);
    let settings = CausalSettings { target_gap, max_iterations, ..Default::default() };
    Ok(TvStream { stream: CausalStream::new(solver, settings)?, weights })
}
