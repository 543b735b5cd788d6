//! The window of total variation that follows a live instrument.
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
use eit_inverse::{DifferenceFrames, Fidelity, StTvStream, StreamSettings};
use ndarray::Array2;

/// Frames of the window.
pub const WINDOW: usize = 8;

/// A window ready for frames, and its weights.
#[derive(Debug)]
pub struct TvStream {
    /// Takes frames.
    pub stream: StTvStream,
    /// How they are weighted.
    pub weights: Weights,
}

impl TvStream {
    /// Its weights, for small print.
    pub fn words(&self) -> String {
        let Weights { lambda_space, lambda_time, rule, .. } = &self.weights;
        format!("λ {lambda_space:.2e}, {lambda_time:.2e} ({rule})")
    }
}

impl FittedFrames {
    /// Sets up the window that follows a stream whose reference these frames are. Nothing in it looks
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
    // the window weighs by the noise alone, which tells a quiet skin from a faint touch
    let factor = raised.model_error;
    weights.lambda_space *= factor * factor;
    weights.lambda_time *= factor * factor;
    weights.delta = weights.delta.map(|delta| factor * delta);
    if !given {
        weights.rule += " for a touch that is to be expected";
    }
    let fidelity =
        weights.delta.map_or(Fidelity::Penalised, |delta| Fidelity::Constrained { delta });
    let mut solver = with(&known)?;
    solver.set_weights(weights.lambda_space, weights.lambda_time, fidelity)?;
    let settings = StreamSettings {
        window: if method == Method::StTv { WINDOW } else { 1 },
        lag: 0,
        target_gap: stop(keys).target_gap,
        deadline: None,
        ..Default::default()
    };
    Ok(TvStream { stream: StTvStream::new(solver, settings)?, weights })
}
