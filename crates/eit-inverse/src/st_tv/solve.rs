//! Whole sequences: the two phases that lead to an image and to its certificate.

use super::StTv;
use super::run::Run;
use super::settings::{Stop, Weights};
use super::task::Task;
use crate::check::check_positive;
use crate::{DifferenceFrames, ImageSequence, InverseError, SequenceSolver};
use std::time::Instant;

/// Gap below which rounding of `f32` shows.
const SINGLE_PRECISION_GAP: f64 = 1e-4;

impl StTv {
    /// Solves for a whole sequence.
    ///
    /// Values are in the unit of the whitened problem: with `noise_std` the primal value counts
    /// squared standard deviations, without it squares of `dv`.
    ///
    /// # Errors
    /// Wrong shapes, no frame, a value of a good channel that is not finite, a `delta` that no
    /// image can reach, a target gap that is not positive.
    pub fn solve(
        &self,
        frames: &DifferenceFrames<'_>,
        stop: &Stop,
    ) -> Result<ImageSequence, InverseError> {
        self.solve_with(self.settings.weights(), frames, stop)
    }

    /// [`StTv::solve`] with other weights.
    pub(crate) fn solve_with(
        &self,
        weights: Weights,
        frames: &DifferenceFrames<'_>,
        stop: &Stop,
    ) -> Result<ImageSequence, InverseError> {
        let start = Instant::now();
        frames.check(self.compression.measurements)?;
        if frames.values.nrows() == 0 {
            return Err(InverseError::WrongLength { what: "frames", found: 0, wanted: 1 });
        }
        check_positive("target_gap", stop.target_gap)?;
        let task = Task::new(self, weights, frames)?;
        if task.scale == 0.0 {
            return Ok(task.nothing(start));
        }
        // a data constraint must hold, not nearly hold: rounding of f32 would cost objective
        if stop.target_gap < SINGLE_PRECISION_GAP || !task.delta.is_empty() {
            Ok(Run::new(&task, &self.double, start).finish(stop))
        } else {
            Ok(Run::new(&task, &self.single, start).finish(stop))
        }
    }
}

impl SequenceSolver for StTv {
    fn name(&self) -> &'static str {
        if self.settings.lambda_time > 0.0 { "st-tv" } else { "tv" }
    }

    fn reconstruct_sequence(
        &mut self,
        frames: &DifferenceFrames<'_>,
    ) -> Result<ImageSequence, InverseError> {
        self.solve(frames, &self.stop)
    }
}
