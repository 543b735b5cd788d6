//! What all solvers of sequences have in common.

use crate::InverseError;
use crate::check::check_length;
use ndarray::{Array2, ArrayView2};

/// Difference data of a sequence of frames, with the channels of each frame that count.
#[derive(Debug, Clone, Copy)]
pub struct DifferenceFrames<'a> {
    /// `dv = v - v_ref`, `[frame, measurement]`, in the unit of the Jacobian's rows. Values of
    /// masked channels are never looked at and may be NaN.
    pub values: ArrayView2<'a, f64>,
    /// `[frame, measurement]`, false where a channel of a frame is masked; `None`: all are good.
    pub good: Option<ArrayView2<'a, bool>>,
}

impl<'a> DifferenceFrames<'a> {
    /// Frames without masked channels.
    pub fn all_good(values: ArrayView2<'a, f64>) -> Self {
        Self { values, good: None }
    }

    /// Is this channel of this frame used? Indices must be in range.
    pub fn is_good(&self, frame: usize, measurement: usize) -> bool {
        self.good.is_none_or(|good| good[(frame, measurement)])
    }

    /// Refuses wrong shapes and values of good channels that are not finite.
    ///
    /// # Errors
    /// [`InverseError::WrongLength`], [`InverseError::NonFiniteData`].
    pub fn check(&self, measurements: usize) -> Result<(), InverseError> {
        self.check_shape(measurements)?;
        for ((frame, measurement), &value) in self.values.indexed_iter() {
            if !value.is_finite() && self.is_good(frame, measurement) {
                return Err(InverseError::NonFiniteData { frame, measurement, value });
            }
        }
        Ok(())
    }

    /// Refuses differences of another protocol and masks of another shape.
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
pub enum SequenceStatus {
    /// A direct method: nothing to converge.
    Direct,
    /// The asked accuracy is reached.
    Converged,
    /// The deadline came first; the best iterate so far is returned.
    Deadline,
    /// The iteration cap came first; the best iterate so far is returned.
    IterationCap,
    /// Rounding stops further progress before the asked accuracy; the best iterate is returned.
    Stalled,
}

/// Bounds on the optimum that a convex method proves with its result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Certificate {
    /// Objective of the returned sequence, an upper bound on the optimum.
    pub primal: f64,
    /// Objective of a feasible dual point, a lower bound on the optimum.
    pub lower_bound: f64,
}

impl Certificate {
    /// `(primal - lower_bound) / primal`: the most by which the objective can still fall, relative
    /// to it. 0 where the primal value is 0, infinite where no feasible sequence is known or no lower
    /// bound.
    pub fn relative_gap(&self) -> f64 {
        if self.primal == 0.0 {
            0.0
        } else if self.primal.is_infinite() {
            // not infinity over infinity
            f64::INFINITY
        } else {
            (self.primal - self.lower_bound) / self.primal.abs()
        }
    }
}

/// How a sequence came about.
#[derive(Debug, Clone, PartialEq)]
pub struct SequenceReport {
    /// The method's name: `st-tv`, `tv`, `one-step`, `time-prior`, `kalman-smoother`,
    /// `gauss-newton-absolute`.
    pub method: &'static str,
    /// Why it stopped.
    pub status: SequenceStatus,
    /// Iterations (0 for a direct method).
    pub iterations: usize,
    /// Wall time of this call without the method's set-up, seconds.
    pub seconds: f64,
    /// `|W^1/2 (J dsigma_t - dv_t)|` of each frame over its good channels, `[frame]`: about the
    /// root of the number of good channels where the image explains all but the noise.
    pub residual: Vec<f64>,
    /// Proven bounds, for the methods that have them.
    pub certificate: Option<Certificate>,
    /// The best known at each look, in order: error against run time. Empty for a direct method.
    pub trace: Vec<TracePoint>,
}

/// What an iterative method knew at a point in time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TracePoint {
    /// Wall time since the call, seconds.
    pub seconds: f64,
    /// Iterations, those for bounds included.
    pub iterations: usize,
    /// Best objective so far; infinite where no feasible sequence is known.
    pub primal: f64,
    /// Best lower bound so far.
    pub lower_bound: f64,
}

/// A reconstructed sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageSequence {
    /// Change of sheet conductivity, siemens, `[frame, unknown]`, in the order of the Jacobian's
    /// columns.
    pub images: Array2<f64>,
    /// How it came about.
    pub report: SequenceReport,
}

/// A method that turns difference data into a sequence of images of the conductivity change.
///
/// Set-up (factorisations, hyperparameters) is each method's own constructor; this is the part
/// that runs for each sequence.
pub trait SequenceSolver {
    /// As in [`SequenceReport::method`].
    fn name(&self) -> &'static str;

    /// Reconstructs a sequence.
    ///
    /// # Errors
    /// Wrong shapes, a value of a good channel that is not finite.
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
