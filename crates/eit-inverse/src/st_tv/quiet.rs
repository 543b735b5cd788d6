//! Detection of frames that contain only noise.

use super::StTv;
use crate::{DifferenceFrames, InverseError};

impl StTv {
    /// Returns, for each frame, whether it differs from the reference by noise only.
    ///
    /// A frame with `k` good channels is quiet if its squared whitened data is at most
    /// `k + 3 sqrt(2 k)`, three standard deviations above the mean for pure noise. Without
    /// `noise_std` no frame is quiet. A frame without a good channel is quiet.
    ///
    /// # Errors
    /// See [`StTv::solve`].
    pub fn quiet_frames(&self, frames: &DifferenceFrames<'_>) -> Result<Vec<bool>, InverseError> {
        frames.check(self.measurements())?;
        let noise = self.settings.noise_std.is_some();
        let quiet = |frame: usize| {
            let square: f64 = self.whitened(frames, frame).map(|v| v.powi(2)).sum();
            let good = self.whitened(frames, frame).count() as f64;
            noise && square <= quiet_threshold(good)
        };
        Ok((0..frames.values.nrows()).map(quiet).collect())
    }
}

/// Returns the largest squared whitened norm of `good` channels that counts as pure noise.
pub(crate) fn quiet_threshold(good: f64) -> f64 {
    good + 3.0 * (2.0 * good).sqrt()
}
