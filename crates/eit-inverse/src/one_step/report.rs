//! What a one-step reconstruction tells of itself.

use super::hyperparameter::HyperparameterStatus;

/// What a reconstruction is and what it cost.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct OneStepReport {
    /// The prior's name.
    pub prior: &'static str,
    /// Measurements of the protocol.
    pub measurements: usize,
    /// Measurements used.
    pub measurements_used: usize,
    /// Elements of the image.
    pub elements: usize,
    /// Eigenvalues of the weighted problem above the noise floor: independent measurements.
    pub rank: usize,
    /// Largest eigenvalue over the smallest one above the noise floor; that floor is
    /// `m f64::EPSILON` of the largest, so this is at most `1 / (m 2.2e-16)`.
    pub condition: f64,
    /// Scale `s`, see [`OneStepGaussNewton`](crate::OneStepGaussNewton), for weights relative to
    /// that of the largest `noise_std`: divided by the square of `noise_scale` it is that of `W = 1
    /// / noise_std^2`.
    pub scale: f64,
    /// The largest `noise_std` of the used measurements, in the unit of `dv`: the weights are
    /// `W = (noise_scale / noise_std)^2`. `None` where no noise was given: then `W = 1`, and the
    /// size of the noise is unknown.
    /// [`OneStepGaussNewton::restricted_to`](crate::OneStepGaussNewton::restricted_to) keeps
    /// weights and scale.
    pub noise_scale: Option<f64>,
    /// Hyperparameter lambda in use.
    pub hyperparameter: f64,
    /// How it was chosen and whether that succeeded.
    pub hyperparameter_status: HyperparameterStatus,
    /// Effective degrees of freedom, `sum d / (d + lambda^2 s)`: measurements that the image
    /// follows; the rest is damped.
    pub degrees_of_freedom: f64,
    /// Time for `J P`, seconds.
    pub prior_s: f64,
    /// Time for `J P J'` and its spectrum, seconds.
    pub spectrum_s: f64,
    /// Time for the image basis, seconds.
    pub basis_s: f64,
}
