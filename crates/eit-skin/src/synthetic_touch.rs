//! A synthetic touch, for choosing weights without a recording.

use crate::noise::DataNoise;
use eit_core::Random;
use ndarray::{Array1, Array2};

/// Number of frames of the touch.
const FRAMES: usize = 8;
/// Standard deviation of its bell as a fraction of the skin's longer side: a fingertip on a skin of 20 cm.
const BELL: f64 = 1.0 / 16.0;
/// Its change of conductivity, relative to the background: a light touch. The weights of total variation grow
/// with its square. Measured on the two experiments of `eit demo`, where fingers raise the conductivity by
/// 0.35 to 0.4: with 0.1 the weights equal those that `eit reconstruct` chooses knowing the recording; with
/// 0.25 the images after the U-net have the same error for one finger and 1.6 times it for two; with 0.5
/// twice that error.
const CHANGE: f64 = 0.1;
/// Fraction of the way from the middle of the skin to its farthest point that it covers.
const REACH: f64 = 0.8;

/// Positions of unknowns, seen from +z.
#[derive(Debug, Clone)]
pub(crate) struct Places {
    /// Positions, metres.
    pub at_m: Vec<[f64; 2]>,
    /// Longer side of the skin, metres.
    pub side_m: f64,
}

/// Simulates the differences of a fingertip that moves from the middle of the skin towards its farthest
/// point, [frame, measurement], with noise. `jacobian` has a column per place; `sheet_s` is the background.
pub(crate) fn touch(
    jacobian: &Array2<f64>,
    places: &Places,
    noise: &DataNoise,
    sheet_s: f64,
) -> Array2<f64> {
    let Places { at_m, side_m } = places;
    let count = at_m.len().max(1) as f64;
    let middle = [0, 1].map(|k| at_m.iter().map(|p| p[k]).sum::<f64>() / count);
    let distance = |p: &[f64; 2], q: &[f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
    let farthest = at_m.iter().copied().fold(middle, |best, p| {
        if distance(&p, &middle) > distance(&best, &middle) { p } else { best }
    });
    let (width_m, change_s) = (BELL * side_m, CHANGE * sheet_s);
    // any seed: the choice only depends on the size of the noise
    let mut random = Random::stream(0, 0x0a02_bdbf_7bb3_c0a7);
    let mut frames = Array2::zeros((FRAMES, jacobian.nrows()));
    for (k, mut frame) in frames.rows_mut().into_iter().enumerate() {
        let part = REACH * k as f64 / (FRAMES - 1) as f64;
        let at = [0, 1].map(|i| middle[i] + part * (farthest[i] - middle[i]));
        let bell = |p: &[f64; 2]| change_s * (-0.5 * (distance(p, &at) / width_m).powi(2)).exp();
        let image: Array1<f64> = at_m.iter().map(bell).collect();
        frame.assign(&jacobian.dot(&image));
        for (value, std) in frame.iter_mut().zip(&noise.std) {
            *value += std * random.normal();
        }
    }
    frames
}
