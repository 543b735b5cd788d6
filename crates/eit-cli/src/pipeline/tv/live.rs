//! The window of total variation that follows a live instrument.
//!
//! A recording is looked at as a whole before its weights are chosen; a live instrument has shown
//! nothing but an untouched skin by then. The weights are those of a touch that is to be expected:
//! a fingertip that moves over the skin, by the linear model, with the noise that was measured.

use super::{Weights, pixel_jacobian, solver, stop, time_length_m, weights};
use crate::error::CliError;
use crate::frames::Frames;
use crate::method::Method;
use crate::pipeline::noise::{self, DataNoise};
use crate::pipeline::{Linearised, Setup, difference_data};
use crate::scene::{Delta, Scene};
use eit_inverse::{Differences, Fidelity, StTvStream, StreamSettings};
use eit_mesh::Raster;
use ndarray::{Array1, Array2};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64;

/// Frames of the window.
pub(crate) const WINDOW: usize = 8;
/// Frames of the expected touch: a window of them.
const EXPECTED: usize = WINDOW;
/// Standard deviation of its bell as a part of the raster's side: a fingertip on a skin of 20 cm.
const BELL: f64 = 1.0 / 16.0;
/// Its change of conductivity, relative to the background: a light touch. The weights grow with its
/// square. Measured on the two experiments of `eit demo`, where fingers raise the conductivity by
/// 0.35 to 0.4: with 0.1 the weights are those that `eit reconstruct` chooses knowing the recording;
/// with 0.25 the images after the net have the same error for one finger and 1.6 times it for two,
/// with 0.5 twice that error.
const CHANGE: f64 = 0.1;
/// How far from the middle of the skin to its farthest point it comes.
const REACH: f64 = 0.8;

/// A window ready for frames, and its weights.
pub(crate) struct LiveTv {
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
pub(crate) fn stream(
    scene: &Scene,
    method: Method,
    (setup, linearised, raster): (&Setup, &Linearised, &Raster),
    (frames, gain): (&Frames, f64),
) -> Result<LiveTv, CliError> {
    let keys = &scene.reconstruction;
    let kind = scene.difference_kind(&setup.protocol);
    let data = difference_data(kind, linearised);
    let unknown = || CliError::input("the noise is not known: state [noise] additive_v");
    let known = noise::known(scene, frames, (&data, gain))?.ok_or_else(unknown)?;
    let jacobian = pixel_jacobian(linearised, raster, kind, &frames.used)?;
    let expected = expected(&jacobian, raster, &known, CHANGE * scene.skin.conductivity_s);
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
    let differences = Differences { values: expected.view(), good: Some(good.view()) };
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

/// Differences of a fingertip on its way from the middle of the skin towards its farthest point,
/// [frame, measurement], with noise.
fn expected(
    jacobian: &Array2<f64>,
    raster: &Raster,
    noise: &DataNoise,
    change_s: f64,
) -> Array2<f64> {
    let places: Vec<[f64; 2]> =
        raster.masked_pixels().iter().map(|&[i, j]| raster.centre_m(i, j)).collect();
    let count = places.len().max(1) as f64;
    let middle = [0, 1].map(|k| places.iter().map(|p| p[k]).sum::<f64>() / count);
    let distance = |p: &[f64; 2], q: &[f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
    let farthest = places.iter().copied().fold(middle, |best, p| {
        if distance(&p, &middle) > distance(&best, &middle) { p } else { best }
    });
    let width_m = BELL * raster.pixel_m() * raster.pixels() as f64;
    // any seed: the choice sees the size of the noise alone
    let mut random = Pcg64::new(0, 0x0a02_bdbf_7bb3_c0a7);
    let mut frames = Array2::zeros((EXPECTED, jacobian.nrows()));
    for (k, mut frame) in frames.rows_mut().into_iter().enumerate() {
        let part = REACH * k as f64 / (EXPECTED - 1) as f64;
        let at = [0, 1].map(|i| middle[i] + part * (farthest[i] - middle[i]));
        let bell = |p: &[f64; 2]| change_s * (-0.5 * (distance(p, &at) / width_m).powi(2)).exp();
        let image: Array1<f64> = places.iter().map(bell).collect();
        frame.assign(&jacobian.dot(&image));
        for (value, std) in frame.iter_mut().zip(&noise.std) {
            let unit: f64 = StandardNormal.sample(&mut random);
            *value += std * unit;
        }
    }
    frames
}
