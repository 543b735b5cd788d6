//! Internal units, in which the data and the largest singular value of the Jacobian are about 1. They avoid overflow
//! and underflow in `f32` for any units of the caller.

use super::StTv;
use super::settings::{Fidelity, Weights};
use crate::InverseError;

/// Conversion from the caller's units.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Units {
    /// Norm of the data that is 1.
    pub(crate) one: f64,
    /// Internal value of a siemens, and of a weight of 1.
    pub(crate) image: f64,
    pub(crate) weight: f64,
    /// Objective that is 1.
    pub(crate) objective: f64,
    pub(crate) bounds: Option<[f64; 2]>,
}

impl Units {
    /// Returns the units in which data of norm `one` is 1.
    pub(crate) fn new(solver: &StTv, weights: Weights, one: f64) -> Self {
        let image = solver.unit / one;
        let largest = weights.lambda_space.max(weights.lambda_time);
        let (weight, objective) = match weights.fidelity {
            Fidelity::Penalised => (1.0 / (solver.unit * one), one * one),
            Fidelity::Constrained { .. } => (1.0 / largest, largest / image),
        };
        let bounds = solver.settings.bounds_s();
        let is_bounded = bounds.iter().any(|bound| bound.is_finite());
        let bounds = is_bounded.then(|| bounds.map(|bound| bound * image));
        Self { one, image, weight, objective, bounds }
    }
}

/// Returns the constraint radius of a frame with `good` channels; `None` for penalised data.
///
/// # Errors
/// [`InverseError::DeltaTooSmall`] if the norm `least` of the data that no image explains exceeds it; `explained` is
/// the norm of the other data.
pub(crate) fn radius(
    solver: &StTv,
    fidelity: Fidelity,
    (frame, good): (usize, usize),
    [least, explained]: [f64; 2],
) -> Result<Option<f64>, InverseError> {
    let Fidelity::Constrained { delta } = fidelity else { return Ok(None) };
    let delta = delta * (good as f64 / solver.channels as f64).sqrt();
    // a tiny remainder is rounding error of an exact fit
    if least > delta && least > 1e-10 * (explained + least) {
        return Err(InverseError::DeltaTooSmall { frame, delta, least });
    }
    Ok(Some(delta))
}
