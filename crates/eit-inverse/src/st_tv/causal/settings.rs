//! Settings and results of a causal stream.

use crate::check::{check_positive, check_range};
use crate::{Certificate, InverseError, SequenceStatus};
use std::time::Duration;

/// Settings of [`CausalStream`](crate::CausalStream).
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct CausalSettings {
    /// Target relative duality gap of a frame, above zero. Below `1e-4` the iteration runs in `f64`.
    pub target_gap: f64,
    /// Maximum number of iterations per frame.
    pub max_iterations: usize,
    /// Time limit per frame, including the final evaluation of image and bound.
    pub deadline: Option<Duration>,
    /// Weight of the change from the image before, as a fraction of the solver's `lambda_time`, above
    /// zero. A window spreads the cost of a change over its frames, whereas a causal frame bears it
    /// alone. A suitable fraction, such as the default of a quarter, suits all values of `lambda_time`,
    /// since both terms have the same unit.
    pub time_share: f64,
}

impl Default for CausalSettings {
    fn default() -> Self {
        Self { target_gap: 1e-2, max_iterations: 2000, deadline: None, time_share: 0.25 }
    }
}

impl CausalSettings {
    pub(crate) fn check(&self) -> Result<(), InverseError> {
        check_positive("target_gap", self.target_gap)?;
        check_positive("time_share", self.time_share)?;
        check_range("max_iterations", 0.0, self.max_iterations > 0, "1 or above")
    }
}

/// Result of a push to a causal stream.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct CausalStep<'a> {
    /// Image of this frame, siemens, `[unknown]`.
    pub image: &'a [f64],
    /// Why the iteration stopped; [`SequenceStatus::Direct`] for a frame without data and for a skin at
    /// rest, [`SequenceStatus::Stalled`] for the zero image of a constrained frame whose objective is
    /// zero up to rounding.
    pub status: SequenceStatus,
    /// Number of iterations of this push.
    pub iterations: usize,
    /// Bounds on the optimum of this frame's problem; infinity and 0 if the previous image was held.
    pub certificate: Certificate,
    /// `|W^1/2 (J x - dv)|` over the good channels; 0 for a frame without data.
    pub residual: f64,
    /// Whether the skin is at rest and the frame contains only noise or is zero, so that no iteration was
    /// needed.
    pub quiet: bool,
    /// Whether the lower bound was computed in `f64`.
    pub in_double: bool,
    /// Run time of this push, seconds.
    pub seconds: f64,
}

/// Dual point that proves the lower bound of a frame, in the caller's units, for independent checks.
///
/// With `A = W^1/2 J`, `b = W^1/2 dv` (zero in unused and masked channels), the previous image `x^`
/// and the rows `D` of the [`Gradient`](crate::Gradient):
///
/// ```text
/// r = -(A' y + D' q),   |q_g| <= lambda_space,   |r_i| <= lambda_time area_i, or more with bounds
/// penalised:    bound = -y.(b - A x^) - |y|^2 / 2 + q.D x^ - sum h(r)
/// constrained:  bound = -y.(b - A x^) - delta |y| + q.D x^ - sum h(r)
/// ```
///
/// where `lambda_time` includes the factor [`CausalSettings::time_share`], and `h` is the term of the
/// bounds. Without bounds `h = 0`; with bounds `lower` and `upper`, for the image `x^` of the frame before,
/// `h(r) = (r - lambda_time area) (upper - x^)` for `r` above `lambda_time area`,
/// `(-r - lambda_time area) (x^ - lower)` for `r` below `-lambda_time area`, and 0 between.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CausalDual {
    /// `y`, `[measurement]`.
    pub data: Vec<f64>,
    /// `q`, `[row of the gradient]`.
    pub flow: Vec<f64>,
}
