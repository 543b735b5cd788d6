//! Whole sequences, in `f32` and, where that leads no further, in `f64`.

use super::StTv;
use super::run::Run;
use super::settings::{Stop, Weights};
use super::task::Task;
use crate::check::check_positive;
use crate::{DifferenceFrames, ImageSequence, InverseError, SequenceSolver, SequenceStatus};
use std::time::Instant;

/// Gap below which rounding of `f32` shows.
const SINGLE_PRECISION_GAP: f64 = 1e-4;
/// Iterations that `f32` is given, twice to three times what well-conditioned problems take: it may be
/// what keeps the gap open, and `f64` then takes over.
const SINGLE_PRECISION_ITERATIONS: usize = 1000;

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
        let mut run = if stop.target_gap < SINGLE_PRECISION_GAP || !task.delta.is_empty() {
            Run::new(&task, &self.double, stop.target_gap, start)?
        } else {
            let mut run = Run::new(&task, &self.single, stop.target_gap, start)?;
            if let Some(status) = run.advance(stop, SINGLE_PRECISION_ITERATIONS)? {
                return Ok(run.finish(status));
            }
            run.converted(&self.double)?
        };
        let status = run.advance(stop, usize::MAX)?.unwrap_or(SequenceStatus::IterationCap);
        Ok(run.finish(status))
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
