//! Input, results and trait shared by all sequence solvers.

use crate::InverseError;
use crate::check::check_length;
use ndarray::{Array2, ArrayView2};
use std::time::Instant;

/// Difference data of a sequence of frames, with a channel mask per frame.
#[derive(Debug, Clone, Copy)]
pub struct DifferenceFrames<'a> {
    /// `dv = v - v_ref`, `[frame, measurement]`, in the unit of the Jacobian's rows. Values of
    /// masked channels are never read and may be NaN.
    pub values: ArrayView2<'a, f64>,
    /// `[frame, measurement]`, false where a channel of a frame is masked; `None`: all are good.
    pub good: Option<ArrayView2<'a, bool>>,
}

impl<'a> DifferenceFrames<'a> {
    /// Creates frames without masked channels.
    pub fn all_good(values: ArrayView2<'a, f64>) -> Self {
        Self { values, good: None }
    }

    /// Returns whether this channel of this frame is not masked. Indices must be in range.
    pub fn is_good(&self, frame: usize, measurement: usize) -> bool {
        self.good.is_none_or(|good| good[(frame, measurement)])
    }

    /// Rejects wrong shapes and non-finite values of good channels.
    #[cfg(feature = "st-tv")]
    pub(crate) fn check(&self, measurements: usize) -> Result<(), InverseError> {
        self.check_shape(measurements)?;
        for ((frame, measurement), &value) in self.values.indexed_iter() {
            if !value.is_finite() && self.is_good(frame, measurement) {
                return Err(InverseError::NonFiniteData { frame, measurement, value });
            }
        }
        Ok(())
    }

    /// Rejects differences for another number of measurements and masks of another shape.
    pub(crate) fn check_shape(&self, measurements: usize) -> Result<(), InverseError> {
        check_length("columns of differences", self.values.ncols(), measurements)?;
        if let Some(good) = self.good {
            check_length("rows of good", good.nrows(), self.values.nrows())?;
            check_length("columns of good", good.ncols(), measurements)?;
        }
        Ok(())
    }
}

/// Why a solver stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum SequenceStatus {
    /// The method is direct and does not iterate.
    Direct,
    /// The requested accuracy was reached.
    Converged,
    /// The deadline was reached first; the best iterate so far is returned.
    Deadline,
    /// The iteration cap was reached first; the best iterate so far is returned.
    IterationCap,
    /// Rounding prevents further progress before the requested accuracy; the best iterate is
    /// returned.
    Stalled,
}

/// Proven bounds on the optimum, returned by convex methods.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Certificate {
    /// Objective of the returned sequence, an upper bound on the optimum.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::infinite"))]
    pub primal: f64,
    /// Objective of a feasible dual point, a lower bound on the optimum.
    pub lower_bound: f64,
}

impl Certificate {
    /// Returns `(primal - lower_bound) / primal`, an upper bound on the relative decrease of the
    /// objective that is still possible. 0 if the primal value is 0; infinite if no feasible sequence
    /// or no lower bound is known.
    pub fn relative_gap(&self) -> f64 {
        if self.primal == 0.0 {
            0.0
        } else if self.primal.is_infinite() {
            // avoids infinity / infinity
            f64::INFINITY
        } else {
            (self.primal - self.lower_bound) / self.primal.abs()
        }
    }
}

/// Report of a sequence reconstruction.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct SequenceReport {
    /// Name of the method: `st-tv`, `tv`, `one-step`, `time-prior`,
    /// `gauss-newton-absolute`.
    pub method: &'static str,
    /// Why the method stopped.
    pub status: SequenceStatus,
    /// Number of iterations (0 for a direct method).
    pub iterations: usize,
    /// Wall time of this call without the method's set-up, seconds.
    pub seconds: f64,
    /// `|W^1/2 (J dsigma_t - dv_t)|` of each frame over its good channels, `[frame]`: about the
    /// root of the number of good channels if the image explains everything but the noise.
    pub residual: Vec<f64>,
    /// Proven bounds on the optimum, for methods that provide them.
    pub certificate: Option<Certificate>,
    /// Best bounds at each evaluation, in order, for plots of error against run time. Empty for a
    /// direct method.
    pub trace: Vec<TracePoint>,
}

impl SequenceReport {
    /// Report of a direct method that began at `start`.
    pub(super) fn direct(method: &'static str, start: Instant, residual: Vec<f64>) -> Self {
        Self {
            method,
            status: SequenceStatus::Direct,
            iterations: 0,
            seconds: start.elapsed().as_secs_f64(),
            residual,
            certificate: None,
            trace: Vec::new(),
        }
    }
}

/// Progress of an iterative method at one point in time.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct TracePoint {
    /// Wall time since the call, seconds.
    pub seconds: f64,
    /// Number of iterations so far, including those for bounds.
    pub iterations: usize,
    /// Best objective so far; infinite if no feasible sequence is known.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::infinite"))]
    pub primal: f64,
    /// Best lower bound so far.
    pub lower_bound: f64,
}

/// A reconstructed sequence.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ImageSequence {
    /// Change of sheet conductivity, siemens, `[frame, unknown]`, in the order of the Jacobian's
    /// columns.
    pub images: Array2<f64>,
    /// Report of the reconstruction.
    pub report: SequenceReport,
}

/// A method that reconstructs a sequence of conductivity changes from difference data.
///
/// Set-up (factorisations, hyperparameters) belongs to the constructor of each method; this trait
/// covers the part that runs for each sequence.
pub trait SequenceSolver {
    /// Returns the method's name, as in [`SequenceReport::method`].
    fn name(&self) -> &'static str;

    /// Reconstructs a sequence.
    ///
    /// # Errors
    /// Returns an error for wrong shapes and for non-finite values of good channels.
    fn reconstruct_sequence(
        &mut self,
        frames: &DifferenceFrames<'_>,
    ) -> Result<ImageSequence, InverseError>;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_of_missing_bounds_are_infinite() {
        let gap = |primal, lower_bound| Certificate { primal, lower_bound }.relative_gap();
        assert_eq!(gap(f64::INFINITY, 0.0), f64::INFINITY);
        assert_eq!(gap(f64::INFINITY, f64::NEG_INFINITY), f64::INFINITY);
        assert_eq!(gap(2.0, f64::NEG_INFINITY), f64::INFINITY);
        assert_eq!(gap(2.0, 1.5), 0.25);
        assert_eq!(gap(0.0, 0.0), 0.0);
    }
}
