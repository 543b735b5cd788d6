//! One-step Gauss-Newton on a whole sequence with a temporal prior.

use super::markov::{Markov, smooth};
use super::modes::Modes;
use crate::{
    DifferenceFrames, ImageSequence, InverseError, OneStepSettings, Prior, SequenceSolver,
};
use ndarray::ArrayRef2;

/// Settings of [`TimePrior`].
#[derive(Debug, Clone, PartialEq)]
pub struct TimePriorSettings {
    /// Hyperparameter, data, noise and channels, as for a single frame.
    pub one_step: OneStepSettings,
    /// Frames after which images are correlated by `1 / e` only (a time in seconds times the frame
    /// rate in hertz), at most 1e6; 0: frames are independent. Default 2, a touch that lasts a few
    /// frames.
    pub correlation_frames: f64,
}

impl Default for TimePriorSettings {
    fn default() -> Self {
        Self { one_step: OneStepSettings::default(), correlation_frames: 2.0 }
    }
}

/// The most probable sequence for Gaussian noise and a Gaussian prior in space and time.
///
/// ```text
/// dsigma = argmin  sum_t |dv_t - J dsigma_t|_W^2 + lambda^2 s |dsigma|_(K (x) P)^-1^2
/// K_ts = gamma^|t - s|,   gamma = exp(-1 / correlation_frames)
/// ```
///
/// with `J`, `W`, `P`, `lambda` and `s` of [`OneStepGaussNewton`](crate::OneStepGaussNewton), whose
/// images these are for `correlation_frames = 0`. Images are `[frame, element]`, siemens (per
/// square).
///
/// Solved exactly. The eigenvectors of `W^1/2 J P J' W^1/2` (set-up) part the problem into `r`
/// scalar ones with covariance `K`; that is the stationary process `a_t+1 = gamma a_t + noise` of
/// variance `1 - gamma^2`, so a scalar Kalman smoother solves each in `O(frames)`, where an
/// eigen-expansion of `K` takes the cube of the number of frames. Channels that are masked in all
/// frames leave the set-up before (`m r^2 + 2 n r^2` flops); other masked channels make the smoother
/// one of `r x r` covariances (`4 m r^2 + 5 r^3` flops a frame). No approximation is made in
/// any of the three; the tests compare each with the dense solution.
///
/// A frame without a good channel is interpolated from its neighbours. At most `8 r` bytes are kept
/// for a frame, `8 r^2` after a masked channel.
///
/// Source: Adler, Dai, Lionheart, *Physiol. Meas.* 28 (2007), S1-S11.
#[derive(Debug, Clone)]
pub struct TimePrior {
    modes: Modes,
    process: Markov,
}

impl TimePrior {
    /// Set-up for a linearisation; `jacobian` is `[measurement, element]`, volts per siemens.
    ///
    /// Costs what [`OneStepGaussNewton::new`](crate::OneStepGaussNewton::new) does.
    ///
    /// # Errors
    /// As there; [`InverseError::OutOfRange`] for the correlation.
    pub fn new(
        jacobian: &ArrayRef2<f64>,
        prior: &dyn Prior,
        settings: &TimePriorSettings,
    ) -> Result<Self, InverseError> {
        let value = settings.correlation_frames;
        if !(0.0..=1e6).contains(&value) {
            let quantity = "correlation_frames";
            return Err(InverseError::OutOfRange { quantity, value, must: "between 0 and 1e6" });
        }
        // a negative zero passes the range
        let frames = value.abs();
        let process = Markov {
            decay: (-1.0 / frames).exp(),
            // 1 - gamma^2 without cancellation
            process_noise: -(-2.0 / frames).exp_m1(),
            initial_variance: 1.0,
        };
        Ok(Self { modes: Modes::new(jacobian, prior, &settings.one_step)?, process })
    }
}

impl SequenceSolver for TimePrior {
    fn name(&self) -> &'static str {
        "time-prior"
    }

    fn reconstruct_sequence(
        &mut self,
        frames: &DifferenceFrames<'_>,
    ) -> Result<ImageSequence, InverseError> {
        smooth(self.name(), &self.modes, &self.process, frames)
    }
}
