//! Settings and reports of the iterated reconstruction.

use crate::{InverseError, OneStepSettings, SequenceStatus};

/// Settings of [`AbsoluteGaussNewton`](crate::sequence::AbsoluteGaussNewton).
#[derive(Debug, Clone, PartialEq)]
pub struct AbsoluteSettings {
    /// Hyperparameter, data, noise and channels, as for a single frame. The scale `s` is that of
    /// the Jacobian at the reference conductivity.
    pub one_step: OneStepSettings,
    /// Least and greatest conductivity of any element, siemens (per square); the reference must lie
    /// between, not on them. `None` (default): a thousandth of its least and a thousand times its
    /// greatest value.
    pub bounds_s: Option<[f64; 2]>,
    /// A frame is finished when a step lowers its objective by less than this part of it, or is
    /// predicted to. Default 1e-3: the objective of noise alone varies by `sqrt(2 / m)`, a tenth for
    /// 208 measurements.
    pub relative_decrease: f64,
    /// Gauss-Newton steps per frame at most. Default 30.
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
    /// Refuses numbers out of range; returns the bounds for a reference.
    pub(super) fn bounds_s(&self, reference_s: &[f64]) -> Result<[f64; 2], InverseError> {
        let decrease = self.relative_decrease;
        if !(decrease > 0.0 && decrease < 1.0) {
            return Err(InverseError::OutOfRange {
                quantity: "relative_decrease",
                value: decrease,
                must: "above 0 and below 1",
            });
        }
        if self.max_iterations == 0 {
            return Err(InverseError::OutOfRange {
                quantity: "max_iterations",
                value: 0.0,
                must: "1 or more",
            });
        }
        let [lower_s, upper_s] = self.bounds_s.unwrap_or_else(|| {
            let least = reference_s.iter().copied().fold(f64::INFINITY, f64::min);
            let greatest = reference_s.iter().copied().fold(0.0, f64::max);
            [1e-3 * least, 1e3 * greatest]
        });
        for (quantity, value, right, must) in [
            ("lower bound (bounds_s[0]), siemens", lower_s, lower_s > 0.0, "above zero"),
            (
                "upper bound (bounds_s[1]), siemens",
                upper_s,
                upper_s > lower_s && upper_s.is_finite(),
                "finite and above the lower bound",
            ),
        ] {
            if !right {
                return Err(InverseError::OutOfRange { quantity, value, must });
            }
        }
        Ok([lower_s, upper_s])
    }
}

/// How one frame of [`AbsoluteGaussNewton`](crate::sequence::AbsoluteGaussNewton) went.
#[derive(Debug, Clone, PartialEq)]
pub struct AbsoluteFrameReport {
    /// Why it stopped.
    pub status: SequenceStatus,
    /// Gauss-Newton steps taken.
    pub iterations: usize,
    /// Forward solutions, those of the line search included.
    pub forward_solves: usize,
    /// Objective before the first step and after each, in units of the weights (see
    /// [`OneStepReport::noise_scale`](crate::OneStepReport::noise_scale)); it never rises.
    pub objective: Vec<f64>,
    /// Part of its value by which the last linearisation expected the objective to fall: below
    /// `relative_decrease` the image is stationary to that accuracy; otherwise it was taken one step
    /// before the returned image.
    pub predicted_decrease: f64,
}
