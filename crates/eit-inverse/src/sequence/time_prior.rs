//! One-step Gauss-Newton on a whole sequence with a temporal prior.

use super::markov::{Markov, smooth};
use super::modes::Modes;
use crate::check::check_range;
use crate::{
    DifferenceFrames, ImageSequence, InverseError, OneStepSettings, Prior, SequenceSolver,
};
use ndarray::ArrayRef2;

/// Settings of [`TimePrior`].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct TimePriorSettings {
    /// Hyperparameter, data, noise and channels, as for a single frame.
    pub one_step: OneStepSettings,
    /// Number of frames after which the correlation of images falls to `1 / e` (correlation time in
    /// seconds times frame rate in hertz), at most 1e6; 0: frames are independent. Default 2, for a
    /// touch that lasts a few frames.
    pub correlation_frames: f64,
}

impl Default for TimePriorSettings {
    fn default() -> Self {
        Self { one_step: OneStepSettings::default(), correlation_frames: 2.0 }
    }
}

/// Maximum a posteriori sequence for Gaussian noise and a Gaussian prior in space and time.
///
/// ```text
/// dsigma = argmin  sum_t |dv_t - J dsigma_t|_W^2 + lambda^2 s |dsigma|_(K (x) P)^-1^2
/// K_ts = gamma^|t - s|,   gamma = exp(-1 / correlation_frames)
/// ```
///
/// with `J`, `W`, `P`, `lambda` and `s` of [`OneStepGaussNewton`](crate::OneStepGaussNewton). The
/// images equal those of that method for `correlation_frames = 0`. Images are `[frame, element]`,
/// siemens (per square).
///
/// The problem is solved exactly. The eigenvectors of `W^1/2 J P J' W^1/2` (set-up) separate it into
/// `r` scalar problems with covariance `K`. This is the stationary process
/// `a_t+1 = gamma a_t + noise` with noise variance `1 - gamma^2`, so a scalar Kalman smoother solves
/// each in `O(frames)`; an eigen-expansion of `K` would cost the cube of the number of frames.
/// Channels masked in all frames are first removed from the set-up (`m r^2 + 2 n r^2` flops). Other
/// masked channels require a smoother with `r x r` covariances (`4 m r^2 + 5 r^3` flops per frame).
/// None of the three cases involves an approximation; the tests compare each with the dense solution.
///
/// A frame without a good channel is interpolated from its neighbours. The smoother stores at most
/// `8 r` bytes per frame, `8 r^2` after a masked channel.
///
/// Source: Adler, Dai, Lionheart, *Physiol. Meas.* 28 (2007), S1-S11.
#[derive(Debug, Clone)]
pub struct TimePrior {
    modes: Modes,
    process: Markov,
}

impl TimePrior {
    /// Sets up the method for a Jacobian `[measurement, element]`, volts per siemens.
    ///
    /// Costs the same as [`OneStepGaussNewton::new`](crate::OneStepGaussNewton::new).
    ///
    /// # Errors
    /// The errors of [`OneStepGaussNewton::new`](crate::OneStepGaussNewton::new);
    /// [`InverseError::OutOfRange`] for the correlation.
    pub fn new(
        jacobian: &ArrayRef2<f64>,
        prior: &dyn Prior,
        settings: &TimePriorSettings,
    ) -> Result<Self, InverseError> {
        let value = settings.correlation_frames;
        let fine = (0.0..=1e6).contains(&value);
        check_range("correlation_frames", value, fine, "between 0 and 1e6")?;
        // -0.0 passes the range check
        let frames = value.abs();
        let process = Markov {
            decay: (-1.0 / frames).exp(),
            // 1 - gamma^2 without cancellation
            process_noise: -(-2.0 / frames).exp_m1(),
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
