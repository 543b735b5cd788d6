//! Total variation that follows a live instrument, frame by frame.
//!
//! A recording is looked at as a whole before its weights are chosen; a live instrument has shown
//! nothing but an untouched skin by then. The weights are those of a synthetic touch
//! ([`synthetic_touch`]): a fingertip that moves over the skin, by the linear model, with the noise that was
//! measured.

use super::{Weights, solver, stop, time_length_m, weights};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::method::Method;
use crate::noise::DataNoise;
use crate::progress::Progress;
use crate::scene::Delta;
use crate::synthetic_touch::{self, Places};
use eit_inverse::{
    CausalSettings, CausalStep, CausalStream, Certificate, DifferenceFrames, Fidelity,
    InverseError, SequenceStatus, StTvStream, StreamSettings, StreamStep,
};
use ndarray::Array2;

/// A stream ready for frames, and its weights.
#[derive(Debug)]
pub struct TvStream {
    solver: Solver,
    /// How frames are weighted.
    pub weights: Weights,
}

#[derive(Debug)]
enum Solver {
    /// Each frame anchored to the image before it.
    Causal(Box<CausalStream>),
    /// Each frame alone: a window of one, without a term in time.
    Alone(Box<StTvStream>),
}

/// What a frame gave.
#[derive(Debug, Clone, Copy)]
pub struct TvStep<'a> {
    /// Siemens, `[masked pixel]`. `None`: there has been none yet.
    pub image: Option<&'a [f64]>,
    /// Why the iteration stopped.
    pub status: SequenceStatus,
    /// Iterations of this frame.
    pub iterations: usize,
    /// Bounds on the optimum of its problem.
    pub certificate: Certificate,
    /// Nothing but noise: no iteration was needed.
    pub quiet: bool,
}

impl TvStream {
    /// Takes differences `[measurement]`, and which of them count.
    ///
    /// # Errors
    ///
    /// Those of the solver; it is then as it was.
    pub fn push(
        &mut self,
        differences: &[f64],
        good: Option<&[bool]>,
    ) -> Result<TvStep<'_>, InverseError> {
        Ok(match &mut self.solver {
            Solver::Causal(stream) => TvStep::causal(stream.push(differences, good)?),
            Solver::Alone(stream) => TvStep::alone(stream.push(differences, good)?),
        })
    }

    /// Takes note that a frame was lost: the image before it is held.
    pub fn push_dropped(&mut self) -> TvStep<'_> {
        match &mut self.solver {
            Solver::Causal(stream) => TvStep::causal(stream.push_dropped()),
            Solver::Alone(stream) => TvStep::alone(stream.push_dropped()),
        }
    }

    /// Forgets the image before: frames have passed that it has not seen.
    pub fn restart(&mut self) {
        match &mut self.solver {
            Solver::Causal(stream) => stream.restart(),
            // every frame stands alone
            Solver::Alone(_) => {}
        }
    }

    /// Its weights, for small print.
    pub fn words(&self) -> String {
        let Weights { lambda_space, lambda_time, rule, .. } = &self.weights;
        format!("λ {lambda_space:.2e}, {lambda_time:.2e} ({rule})")
    }

    /// Whether images are linked in time.
    pub fn has_time(&self) -> bool {
        matches!(self.solver, Solver::Causal(_))
    }
}

impl<'a> TvStep<'a> {
    fn causal(step: CausalStep<'a>) -> Self {
        let CausalStep { image, status, iterations, certificate, quiet, .. } = step;
        Self { image: Some(image), status, iterations, certificate, quiet }
    }

    fn alone(step: StreamStep<'a>) -> Self {
        let StreamStep { image, status, iterations, certificate, quiet, .. } = step;
        Self { image, status, iterations, certificate, quiet }
    }
}

impl FittedFrames {
    /// Sets up what follows a stream whose reference these frames are. Nothing in it looks
    /// at a clock, so that a recording gives the same images again: `deadline_s` is not read.
    ///
    /// # Errors
    ///
    /// Noise that is not known, or weights that cannot be chosen.
    pub fn tv_stream(
        &self,
        method: Method,
        progress: &mut Progress,
    ) -> Result<TvStream, SkinError> {
        stream(self, method, progress)
    }
}

fn stream(
    fitted: &FittedFrames,
    method: Method,
    progress: &mut Progress,
) -> Result<TvStream, SkinError> {
    let FittedFrames { skin, frames, .. } = fitted;
    let keys = &skin.skin.settings.reconstruction;
    let raster = skin.raster(progress)?;
    let unknown = || SkinError::input("the noise is not known: state [noise] additive_v");
    let known = fitted.noise()?.ok_or_else(unknown)?;
    let jacobian = skin.pixel_jacobian(raster, &frames.used)?;
    let places = Places {
        at_m: raster.masked_pixels().iter().map(|&[i, j]| raster.centre_m(i, j)).collect(),
        side_m: raster.pixel_m() * raster.pixels() as f64,
    };
    let expected = synthetic_touch::touch(&jacobian, &places, &known, skin.skin.conductivity_s);
    let good = Array2::from_shape_fn(expected.dim(), |(_, i)| frames.used[i]);
    let used = good.row(0).iter().filter(|used| **used).count();
    // numbers that are given mean the noise alone
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
    let mut weights = weights(&mut trial, keys, &differences, time_length_m(raster), used)?;
    // the stream weighs by the noise alone, which tells a quiet skin from a faint touch
    let factor = raised.model_error;
    weights.rescale(factor * factor);
    weights.delta = weights.delta.map(|delta| factor * delta);
    if !given {
        weights.rule += " for a touch that is to be expected";
    }
    let fidelity =
        weights.delta.map_or(Fidelity::Penalised, |delta| Fidelity::Constrained { delta });
    let mut solver = with(&known)?;
    solver.set_weights(weights.lambda_space, weights.lambda_time, fidelity)?;
    let target_gap = stop(keys).target_gap;
    let solver = match weights.lambda_time > 0.0 {
        true => {
            let settings = CausalSettings { target_gap, ..Default::default() };
            Solver::Causal(Box::new(CausalStream::new(solver, settings)?))
        }
        false => {
            let settings = StreamSettings { window: 1, lag: 0, target_gap, ..Default::default() };
            Solver::Alone(Box::new(StTvStream::new(solver, settings)?))
        }
    };
    Ok(TvStream { solver, weights })
}
