//! The window of total variation that follows a live instrument.
//!
//! A recording is looked at as a whole before its weights are chosen; a live instrument has shown
//! nothing but an untouched skin by then. The weights are those of a touch that is to be expected
//! ([`expected`]): a fingertip that moves over the skin, by the linear model, with the noise that was
//! measured.

use super::{Weights, pixel_jacobian, solver, stop, time_length_m, weights};
use crate::error::SkinError;
use crate::frames::Frames;
use crate::method::Method;
use crate::pipeline::expected::{self, Places};
use crate::pipeline::noise::{self, DataNoise};
use crate::pipeline::{Linearised, Setup, difference_data};
use crate::scene::{Delta, Scene};
use eit_inverse::{DifferenceFrames, Fidelity, StTvStream, StreamSettings};
use eit_mesh::Raster;
use ndarray::Array2;

/// Frames of the window.
pub const WINDOW: usize = 8;

/// A window ready for frames, and its weights.
pub struct LiveTv {
    pub stream: StTvStream,
    pub weights: Weights,
}

impl LiveTv {
    /// Its weights, for small print.
    pub fn words(&self) -> String {
        let Weights { lambda_space, lambda_time, rule, .. } = &self.weights;
        format!("λ {lambda_space:.2e}, {lambda_time:.2e} ({rule})")
    }
}

/// Sets up the window of a scene; `frames` are those of the reference, `gain` as in
/// [`noise::known`]. Nothing in it looks at a clock, so that a recording gives the same images
/// again: `deadline_s` is not read.
pub fn stream(
    scene: &Scene,
    method: Method,
    (setup, linearised, raster): (&Setup, &Linearised, &Raster),
    (frames, gain): (&Frames, f64),
) -> Result<LiveTv, SkinError> {
    let keys = &scene.reconstruction;
    let kind = scene.difference_kind(&setup.protocol);
    let data = difference_data(kind, linearised);
    let unknown = || SkinError::input("the noise is not known: state [noise] additive_v");
    let known = noise::known(scene, frames, (&data, gain))?.ok_or_else(unknown)?;
    let jacobian = pixel_jacobian(linearised, raster, kind, &frames.used)?;
    let places = Places {
        at_m: raster.masked_pixels().iter().map(|&[i, j]| raster.centre_m(i, j)).collect(),
        side_m: raster.pixel_m() * raster.pixels() as f64,
    };
    let expected = expected::touch(&jacobian, &places, &known, scene.skin.conductivity_s);
    let good = Array2::from_shape_fn(expected.dim(), |(_, i)| frames.used[i]);
    let used = good.row(0).iter().filter(|used| **used).count();
    // numbers that are given mean the noise alone
    let given = keys.lambda_space.is_some() || matches!(keys.delta, Some(Delta::Value(_)));
    let raised = match given {
        true => known.clone(),
        false => known.clone().with_model_error(&expected, &good),
    };
    let with = |noise: &DataNoise| {
        solver(&jacobian, raster, (method, keys), Some(noise.std.clone()), &frames.used)
    };
    let differences = DifferenceFrames { values: expected.view(), good: Some(good.view()) };
    let mut trial = with(&raised)?;
    let mut weights = weights(&mut trial, keys, &differences, (time_length_m(raster), used))?;
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
    Ok(LiveTv { stream: StTvStream::new(solver, settings)?, weights })
}
