//! Settings of a causal stream, and what its pushes give.

use crate::check::check_positive;
use crate::{Certificate, InverseError, SequenceStatus};
use std::time::Duration;

/// Settings of [`CausalStream`](crate::CausalStream).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CausalSettings {
    /// Relative duality gap of a frame that is good enough, above zero. Below `1e-4` the iteration
    /// runs in `f64`.
    pub target_gap: f64,
    /// Iterations for one frame at most.
    pub max_iterations: usize,
    /// Time for one frame at most; the last look at image and bound is part of it.
    pub deadline: Option<Duration>,
    /// Weight of the change against the image before, as a share of the solver's `lambda_time`, above
    /// zero. A window spreads a change over its frames and pays its share in each; a causal frame pays
    /// at once. Where a quarter is right for one weight it is for all: both terms are in the same unit.
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
        if self.max_iterations == 0 {
            let (quantity, must) = ("max_iterations", "1 or above");
            return Err(InverseError::OutOfRange { quantity, value: 0.0, must });
        }
        Ok(())
    }
}

/// What a push to a causal stream gave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CausalStep<'a> {
    /// Image of this frame, siemens, `[unknown]`.
    pub image: &'a [f64],
    /// Why the iteration stopped; [`SequenceStatus::Direct`] for a frame without data and for rest,
    /// [`SequenceStatus::Stalled`] for the zero image of a constrained frame whose objective is rounding.
    pub status: SequenceStatus,
    /// Iterations of this push.
    pub iterations: usize,
    /// Bounds on the optimum of this frame's problem; from infinity to 0 where an image was held.
    pub certificate: Certificate,
    /// `|W^1/2 (J x - dv)|` over the good channels; 0 for a frame without data.
    pub residual: f64,
    /// Nothing but noise on a skin at rest, or nothing at all: no iteration was needed.
    pub quiet: bool,
    /// The gap was proven in `f64`, as `f32` could not.
    pub in_double: bool,
    /// Time of this push, seconds.
    pub seconds: f64,
}

/// The dual point that proves a frame's lower bound, in the caller's units, for whoever wants to check
/// it. With `A = W^1/2 J`, `b = W^1/2 dv` (zero in channels that do not count), the image before `x^`
/// and the rows `D` of the [`Gradient`](crate::Gradient):
///
/// ```text
/// r = -(A' y + D' q),   |q_g| <= lambda_space,   |r_i| <= lambda_time area_i up to what bounds allow
/// penalised:    bound = -y.(b - A x^) - |y|^2 / 2 + q.D x^ - sum h(r)
/// constrained:  bound = -y.(b - A x^) - delta |y| + q.D x^ - sum h(r)
/// ```
///
/// with `h` of the bounds as in the module, 0 without them, and `lambda_time` times
/// [`CausalSettings::time_share`].
#[derive(Debug, Clone, PartialEq)]
pub struct CausalDual {
    /// `y`, `[measurement]`.
    pub data: Vec<f64>,
    /// `q`, `[row of the gradient]`.
    pub flow: Vec<f64>,
}
