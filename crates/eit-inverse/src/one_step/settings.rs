//! Settings of a one-step reconstruction.

use crate::data::Channels;
use crate::{DifferenceData, InverseError};

/// Settings of [`OneStepGaussNewton`](crate::OneStepGaussNewton).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct OneStepSettings {
    /// Hyperparameter lambda, dimensionless, entering as `lambda^2` (see
    /// [`OneStepGaussNewton`](crate::OneStepGaussNewton)). Default 0.03.
    pub hyperparameter: f64,
    /// Plain (default) or normalised difference.
    pub data: DifferenceData,
    /// Standard deviation of the noise of each difference `dv_i`, `[measurement]`, in the unit of
    /// `dv`; `None`: equal in all measurements and of unknown size.
    ///
    /// The unit is volts for plain differences; normalised differences are dimensionless. For the
    /// latter, noise of `e_i` volts becomes `e_i / |v0_i|` with the model's voltage
    /// ([`DifferenceData::noise_std`]). A reference frame is not used for this, because its drift
    /// would change `W` and so the meaning of lambda.
    ///
    /// The noise covariance `W^-1` is the diagonal of the squares. The image depends only on their
    /// ratios, because the scale `s` contains the weights. The weights are therefore stored relative
    /// to the largest value, which is [`OneStepReport::noise_scale`](crate::OneStepReport::noise_scale).
    pub noise_std: Option<Vec<f64>>,
    /// Which measurements to use, `[measurement]`; `None`: all. The row of an unused measurement is
    /// removed from the problem, not filled in, and its values in frames, reference frame,
    /// `noise_std` and `model_voltages_v` are never read (they may be NaN).
    pub used: Option<Vec<bool>>,
}

impl Default for OneStepSettings {
    fn default() -> Self {
        Self { hyperparameter: 0.03, data: DifferenceData::Plain, noise_std: None, used: None }
    }
}

impl OneStepSettings {
    /// Returns the used measurements of a Jacobian with `count` rows.
    pub(crate) fn channels(&self, count: usize) -> Result<Channels, InverseError> {
        Channels::new(count, &self.data, self.noise_std.as_deref(), self.used.as_deref())
    }
}
