//! Noise of each channel, estimated from quiet frames.

use crate::InverseError;
use eit_core::median;
use ndarray::{ArrayView1, ArrayView2, Axis};

/// Estimates the standard deviation of each channel's noise, `[measurement]`, from frames
/// `[frame, measurement]` during which nothing touched the skin.
///
/// The estimate is the root mean square difference of successive frames divided by the root of 2, so slow
/// drift does not count as noise. It is at least the rounding of the converter,
/// [`smallest_step`]` / sqrt(12)`: a channel with less noise repeats its value, and its next step is no
/// event. It is also at least a tenth of the median channel's noise, so that a stuck channel does not get
/// all the weight.
///
/// # Errors
/// [`InverseError::WrongLength`] for fewer than three frames; [`InverseError::NonFiniteData`];
/// [`InverseError::OutOfRange`] if no channel changes.
pub fn noise_std_of_quiet_frames(frames: ArrayView2<'_, f64>) -> Result<Vec<f64>, InverseError> {
    let count = frames.nrows();
    if count < 3 {
        return Err(InverseError::WrongLength { what: "quiet frames", found: count, wanted: 3 });
    }
    for ((frame, measurement), &value) in frames.indexed_iter() {
        if !value.is_finite() {
            return Err(InverseError::NonFiniteData { frame, measurement, value });
        }
    }
    let noise = deviations(frames);
    if noise.iter().all(|e| *e == 0.0) {
        return rounding_of_equal_frames(frames);
    }
    let rounding = smallest_step(frames) / 12.0_f64.sqrt();
    // channels that are always zero are not measured
    let is_measured = |i: &usize| frames.column(*i).iter().any(|v| *v != 0.0);
    let measured = (0..noise.len()).filter(is_measured);
    let median = median(measured.map(|i| noise[i].max(rounding))).unwrap_or(rounding);
    Ok(noise.iter().map(|e| e.max(rounding).max(0.1 * median)).collect())
}

/// Noise of identical frames, from a converter so coarse that it hides the noise. Its step is taken as the
/// smallest difference between any two values of a frame.
fn rounding_of_equal_frames(frames: ArrayView2<'_, f64>) -> Result<Vec<f64>, InverseError> {
    let mut values: Vec<f64> = frames.row(0).iter().copied().filter(|v| *v != 0.0).collect();
    values.sort_by(f64::total_cmp);
    let largest = values.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let gaps = values.windows(2).map(|pair| pair[1] - pair[0]);
    // a finer converter than this would show noise
    let step = gaps.filter(|gap| *gap > FINEST * largest).fold(f64::INFINITY, f64::min);
    if step.is_finite() {
        return Ok(vec![step / 12.0_f64.sqrt(); frames.ncols()]);
    }
    let (quantity, value) = ("noise of the quiet frames", 0.0);
    let must = "above zero: the frames are all equal";
    Err(InverseError::OutOfRange { quantity, value, must })
}

/// Finest step of a converter that can hide all noise, relative to the largest value: 14 bits.
const FINEST: f64 = 6e-5;

/// Returns the smallest non-zero change of any channel between successive frames `[frame, measurement]`; 0
/// if nothing changes.
///
/// With rounding this is one step of the converter; without, it is far below the noise.
pub fn smallest_step(frames: ArrayView2<'_, f64>) -> f64 {
    let later = frames.rows().into_iter().skip(1);
    let pairs = frames.rows().into_iter().zip(later).flat_map(|(a, b)| a.into_iter().zip(b));
    let changes = pairs.map(|(a, b)| (b - a).abs());
    let least = changes.filter(|change| *change > 0.0).fold(f64::INFINITY, f64::min);
    if least.is_finite() { least } else { 0.0 }
}

/// Root mean square difference of successive frames divided by the root of 2, `[measurement]`, for at least
/// two frames.
fn deviations(frames: ArrayView2<'_, f64>) -> Vec<f64> {
    let deviation = |channel: ArrayView1<'_, f64>| {
        let changes = channel.iter().zip(channel.iter().skip(1));
        let square: f64 = changes.map(|(a, b)| (b - a).powi(2)).sum();
        (0.5 * square / (frames.nrows() - 1) as f64).sqrt()
    };
    frames.axis_iter(Axis(1)).map(deviation).collect()
}
