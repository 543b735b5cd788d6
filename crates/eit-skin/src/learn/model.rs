//! The model's response to a touch at each place, and the size of the skin.

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::linearised::LinearisedSkin;
use eit_inverse::learn::bell_responses;
use ndarray::Array2;

/// Ratios of measured to modelled voltage beyond this factor of the median are attributed to noise.
const RATIO_RANGE: f64 = 3.0;

/// Ratios of measured to modelled voltage per channel, with sign: values of an instrument that measures
/// magnitudes change with the sign of the model's voltage.
pub(super) fn ratios(fitted: &FittedFrames, channels: &[usize]) -> Vec<f64> {
    let ratio = |i: usize| fitted.frames.reference[i] / fitted.skin.voltages[i];
    let sizes = channels.iter().map(|&i| ratio(i).abs()).filter(|r| r.is_finite());
    let median = eit_core::median(sizes).filter(|m| *m > 0.0).unwrap_or(1.0);
    let within = |r: f64| match r.is_finite() {
        true => r.signum() * r.abs().clamp(median / RATIO_RANGE, median * RATIO_RANGE),
        false => median,
    };
    channels.iter().map(|&i| within(ratio(i))).collect()
}

/// The model's responses to 1 S m^2 at given places, `[place, channel]`.
pub(super) fn responses(
    skin: &LinearisedSkin,
    channels: &[usize],
    ratios: &[f64],
    places_m: &[[f64; 3]],
    bell_m: f64,
) -> Result<Array2<f64>, SkinError> {
    let surface = skin.skin.mesh.surface();
    let jacobian = skin.jacobian.select(ndarray::Axis(0), channels);
    let all = bell_responses(surface, &jacobian, places_m, bell_m)?;
    Ok(all * ndarray::ArrayView1::from(ratios))
}

pub(super) fn middle_m(skin: &LinearisedSkin) -> [f64; 3] {
    let [low, high] = skin.skin.mesh.surface().bounds_m();
    std::array::from_fn(|k| 0.5 * (low[k] + high[k]))
}

/// Half of the longest side of the bounding box.
pub(super) fn radius_m(skin: &LinearisedSkin) -> f64 {
    let [low, high] = skin.skin.mesh.surface().bounds_m();
    (0..3).map(|k| 0.5 * (high[k] - low[k])).fold(0.0, f64::max)
}
