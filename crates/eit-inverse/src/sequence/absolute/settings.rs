//! Settings and reports of the iterated reconstruction.

use crate::check::check_range;
use crate::{InverseError, OneStepSettings, SequenceStatus};

/// Settings of [`AbsoluteGaussNewton`](crate::sequence::AbsoluteGaussNewton).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct AbsoluteSettings {
    /// Hyperparameter, data, noise and channels, as for a single frame. The scale `s` is that of
    /// the Jacobian at the reference conductivity.
    pub one_step: OneStepSettings,
    /// Lower and upper bound of the conductivity of every element, siemens (per square). The reference
    /// must lie strictly between them. `None` (default): a thousandth of the smallest and a thousand
    /// times the largest reference value.
    pub bounds_s: Option<[f64; 2]>,
    /// Relative decrease of the objective below which a frame has converged, actual or predicted for
    /// a step. Default 1e-3; for comparison, the objective of pure noise varies by `sqrt(2 / m)`, a
    /// tenth for 208 measurements.
    pub relative_decrease: f64,
    /// Maximum number of Gauss-Newton steps per frame. Default 30.
    pub max_iterations: usize,
}

impl Default for AbsoluteSettings {
    fn default() -> Self {
        Self {
            one_step: OneStepSettings::default(),
            bounds_s: None,
            relative_decrease: 1e-3,
            max_iterations: 30,
        }
    }
}

impl AbsoluteSettings {
    /// Rejects settings out of range; returns the bounds for a given reference.
    pub(super) fn bounds_s(&self, reference_s: &[f64]) -> Result<[f64; 2], InverseError> {
        let decrease = self.relative_decrease;
        let fine = decrease > 0.0 && decrease < 1.0;
        check_range("relative_decrease", decrease, fine, "above 0 and below 1")?;
        check_range("max_iterations", 0.0, self.max_iterations > 0, "1 or more")?;
        let [lower_s, upper_s] = self.bounds_s.unwrap_or_else(|| {
            let least = reference_s.iter().copied().fold(f64::INFINITY, f64::min);
            let greatest = reference_s.iter().copied().fold(0.0, f64::max);
            [1e-3 * least, 1e3 * greatest]
        });
        check_range("lower bound (bounds_s[0]), siemens", lower_s, lower_s > 0.0, "above zero")?;
        let fine = upper_s > lower_s && upper_s.is_finite();
        let must = "finite and above the lower bound";
        check_range("upper bound (bounds_s[1]), siemens", upper_s, fine, must)?;
        Ok([lower_s, upper_s])
    }
}

/// Report of one frame of [`AbsoluteGaussNewton`](crate::sequence::AbsoluteGaussNewton).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct AbsoluteFrameReport {
    /// Why the iteration stopped.
    pub status: SequenceStatus,
    /// Number of Gauss-Newton steps taken.
    pub iterations: usize,
    /// Number of forward solutions, including the line search.
    pub forward_solves: usize,
    /// Objective before the first step and after each step, in units of the weights (see
    /// [`OneStepReport::noise_scale`](crate::OneStepReport::noise_scale)); it never increases.
    pub objective: Vec<f64>,
    /// Relative decrease of the objective predicted by the last linearisation. Below
    /// `relative_decrease` the image is stationary to that accuracy; otherwise the linearisation was
    /// one step before the returned image.
    pub predicted_decrease: f64,
}
