//! Frames that hold nothing but noise, and how large that is.

use super::StTv;
use crate::{Differences, InverseError};
use ndarray::{ArrayView2, Axis};

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
    let deviation = |channel: ndarray::ArrayView1<'_, f64>| {
        let changes = channel.iter().zip(channel.iter().skip(1));
        let square: f64 = changes.map(|(a, b)| (b - a).powi(2)).sum();
        (0.5 * square / (count - 1) as f64).sqrt()
    };
    let noise: Vec<f64> = frames.axis_iter(Axis(1)).map(deviation).collect();
    let mut sorted: Vec<f64> = noise.iter().copied().filter(|e| *e > 0.0).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(&median) = sorted.get(sorted.len() / 2) else {
        let (quantity, value) = ("noise of the quiet frames", 0.0);
        let must = "above zero: the frames are all equal";
        return Err(InverseError::OutOfRange { quantity, value, must });
    };
    Ok(noise.iter().map(|e| e.max(0.1 * median)).collect())
}

impl StTv {
    /// Which frames do not differ from the reference beyond noise: those whose squared whitened
    /// data over `k` good channels is below `k + 3 sqrt(2 k)`, three standard deviations above the
    /// mean of pure noise. Without `noise_std` none is. A frame without a good channel is quiet.
    ///
    /// # Errors
    /// As [`StTv::solve`].
    pub fn quiet_frames(&self, frames: &Differences<'_>) -> Result<Vec<bool>, InverseError> {
        frames.check(self.measurements())?;
        let noise = self.settings.noise_std.is_some();
        let quiet = |frame: usize| {
            let (mut square, mut good) = (0.0, 0.0);
            for (i, w) in self.compression.root_weights.iter().enumerate() {
                if *w > 0.0 && frames.is_good(frame, i) {
                    square += (w * frames.values[(frame, i)]).powi(2);
                    good += 1.0;
                }
            }
            noise && square <= quiet_threshold(good)
        };
        Ok((0..frames.values.nrows()).map(quiet).collect())
    }
}

/// Squared whitened norm up to which `good` channels hold nothing but noise.
pub(crate) fn quiet_threshold(good: f64) -> f64 {
    good + 3.0 * (2.0 * good).sqrt()
}
