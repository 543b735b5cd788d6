//! The noise of each channel, from frames that hold nothing else.

use crate::InverseError;
use ndarray::{ArrayView1, ArrayView2, Axis};

/// Standard deviation of the noise of each channel, `[measurement]`, from frames `[frame,
/// measurement]` during which nothing touched the skin: the root mean square of differences of
/// successive frames over the root of 2, so that slow drift does not count as noise.
///
/// A channel that does not move at all (a stuck converter) gets a tenth of the median channel's
/// noise: it must not have all the weight.
///
/// # Errors
/// [`InverseError::WrongLength`] for fewer than three frames; [`InverseError::NonFiniteData`];
/// [`InverseError::OutOfRange`] where no channel moves.
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
    let mut sorted: Vec<f64> = noise.iter().copied().filter(|e| *e > 0.0).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(&median) = sorted.get(sorted.len() / 2) else {
        let (quantity, value) = ("noise of the quiet frames", 0.0);
        let must = "above zero: the frames are all equal";
        return Err(InverseError::OutOfRange { quantity, value, must });
    };
    Ok(noise.iter().map(|e| e.max(0.1 * median)).collect())
}

/// Root mean square of differences of successive frames over the root of 2, `[measurement]`; at least
/// two frames.
pub(crate) fn deviations(frames: ArrayView2<'_, f64>) -> Vec<f64> {
    let deviation = |channel: ArrayView1<'_, f64>| {
        let changes = channel.iter().zip(channel.iter().skip(1));
        let square: f64 = changes.map(|(a, b)| (b - a).powi(2)).sum();
        (0.5 * square / (frames.nrows() - 1) as f64).sqrt()
    };
    frames.axis_iter(Axis(1)).map(deviation).collect()
}
