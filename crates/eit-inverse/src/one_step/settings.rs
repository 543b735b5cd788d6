//! Settings of a one-step reconstruction.

use crate::data::Channels;
use crate::{DifferenceData, InverseError};

/// Settings of [`OneStepGaussNewton`](crate::OneStepGaussNewton).
#[derive(Debug, Clone, PartialEq)]
pub struct OneStepSettings {
    /// Hyperparameter lambda, dimensionless, entering as `lambda^2` (see
    /// [`OneStepGaussNewton`](crate::OneStepGaussNewton)). Default 0.03.
    pub hyperparameter: f64,
    /// Plain (default) or normalised difference.
    pub data: DifferenceData,
    /// Standard deviation of the noise of each difference `dv_i`, `[measurement]`, in the unit of
    /// `dv`: volts (plain) or dimensionless (normalised; noise of `e_i` volts in a channel is
    /// `e_i / |v0_i|` by the model's voltage, not by a reference frame, whose drift would change
    /// `W` and with it the meaning of lambda: [`DifferenceData::noise_std`]). `None`: equal in all
    /// and of unknown size.
    ///
    /// The noise covariance `W^-1` is the diagonal of the squares. An image depends on the ratios
    /// alone, because the scale `s` contains the weights, which are therefore kept relative to the
    /// largest value; that value is [`OneStepReport::noise_scale`](crate::OneStepReport::noise_scale).
    pub noise_std: Option<Vec<f64>>,
    /// Which measurements to use, `[measurement]`; `None`: all. An unused one is left out, not
    /// filled in: its row is removed from the problem, and its values in frames, reference,
    /// `noise_std` and `model_voltages_v` are never looked at (they may be NaN).
    pub used: Option<Vec<bool>>,
}

impl Default for OneStepSettings {
    fn default() -> Self {
        Self { hyperparameter: 0.03, data: DifferenceData::Plain, noise_std: None, used: None }
    }
}

impl OneStepSettings {
    /// The measurements that count, of a Jacobian of `count` rows.
    pub(crate) fn channels(&self, count: usize) -> Result<Channels, InverseError> {
        Channels::new(count, &self.data, self.noise_std.as_deref(), self.used.as_deref())
    }
}
