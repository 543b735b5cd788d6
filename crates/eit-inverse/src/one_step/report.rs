//! Report of a one-step reconstruction.

use super::hyperparameter::HyperparameterStatus;

/// Sizes, conditioning and set-up times of a [`OneStepGaussNewton`](crate::OneStepGaussNewton).
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct OneStepReport {
    /// The prior's name.
    pub prior: &'static str,
    /// Number of measurements of the protocol.
    pub measurements: usize,
    /// Number of measurements used.
    pub measurements_used: usize,
    /// Number of elements of the image.
    pub elements: usize,
    /// Number of eigenvalues of the weighted problem above the rounding floor, which is the number of
    /// independent measurements.
    pub rank: usize,
    /// Ratio of the largest eigenvalue to the smallest one above the rounding floor. The floor is
    /// `m f64::EPSILON` of the largest, so this is at most `1 / (m 2.2e-16)`.
    pub condition: f64,
    /// Scale `s`, see [`OneStepGaussNewton`](crate::OneStepGaussNewton), for weights relative to
    /// that of the largest `noise_std`. Divided by the square of `noise_scale` it is the scale for
    /// `W = 1 / noise_std^2`.
    pub scale: f64,
    /// Largest `noise_std` of the used measurements, in the unit of `dv`. The weights are
    /// `W = (noise_scale / noise_std)^2`. `None` if no noise was given: then `W = 1`, and the noise
    /// level is unknown.
    /// [`OneStepGaussNewton::restricted_to`](crate::OneStepGaussNewton::restricted_to) keeps weights
    /// and noise scale.
    pub noise_scale: Option<f64>,
    /// Hyperparameter lambda in use.
    pub hyperparameter: f64,
    /// How lambda was chosen, and whether the choice succeeded.
    pub hyperparameter_status: HyperparameterStatus,
    /// Effective degrees of freedom, `sum d / (d + lambda^2 s)`: the effective number of measurements
    /// that the image fits; the others are damped.
    pub degrees_of_freedom: f64,
    /// Time to compute `J P`, seconds.
    pub prior_s: f64,
    /// Time to compute `J P J'` and its spectrum, seconds.
    pub spectrum_s: f64,
    /// Time to compute the image basis, seconds.
    pub basis_s: f64,
}
