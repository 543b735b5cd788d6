//! Frames that hold nothing but noise.

use super::StTv;
use crate::{DifferenceFrames, InverseError};

impl StTv {
    /// Which frames do not differ from the reference beyond noise: those whose squared whitened
    /// data over `k` good channels is below `k + 3 sqrt(2 k)`, three standard deviations above the
    /// mean of pure noise. Without `noise_std` none is. A frame without a good channel is quiet.
    ///
    /// # Errors
    /// As [`StTv::solve`].
    pub fn quiet_frames(&self, frames: &DifferenceFrames<'_>) -> Result<Vec<bool>, InverseError> {
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
