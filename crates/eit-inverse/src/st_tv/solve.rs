//! Solution of whole sequences, in `f32` first and in `f64` if that does not converge.

use super::StTv;
use super::run::Run;
use super::schedule::SINGLE_PRECISION_GAP;
use super::settings::{StTvSettings, Stop, Weights};
use super::task::Task;
use crate::check::check_positive;
use crate::{DifferenceFrames, ImageSequence, InverseError, SequenceStatus};
use std::time::Instant;

/// Maximum number of `f32` iterations, two to three times what well-conditioned problems need. If the
/// gap is still open then, rounding may be the cause, and the solve continues in `f64`.
const SINGLE_PRECISION_ITERATIONS: usize = 1000;

impl StTv {
    /// Reconstructs a whole sequence.
    ///
    /// Objective values are in the unit of the whitened problem: squared standard deviations with
    /// `noise_std`, squares of the unit of `dv` without it.
    ///
    /// # Errors
    /// Returns an error for wrong shapes, a sequence without frames, a non-finite value of a good
    /// channel, a `delta` that no image can satisfy, and a target gap that is not positive. That no image within
    /// the bounds can satisfy it is found after 300 iterations without one that does, not with a deadline.
    pub fn solve(
        &self,
        frames: &DifferenceFrames<'_>,
        stop: &Stop,
    ) -> Result<ImageSequence, InverseError> {
        let start = Instant::now();
        frames.check(self.compression.measurements)?;
        if frames.values.nrows() == 0 {
            return Err(InverseError::WrongLength { what: "frames", found: 0, wanted: 1 });
        }
        check_positive("target_gap", stop.target_gap)?;
        let StTvSettings { lambda_space, lambda_time, fidelity, .. } = self.settings;
        let task = Task::new(self, Weights { lambda_space, lambda_time, fidelity }, frames)?;
        if task.is_zero {
            return Ok(task.nothing(start));
        }
        let mut run = if stop.target_gap < SINGLE_PRECISION_GAP {
            Run::new(&task, &self.skin.operators, stop.target_gap, start)?
        } else {
            let mut run = Run::new(&task, &self.single, stop.target_gap, start)?;
            if let Some(status) = run.advance(stop, SINGLE_PRECISION_ITERATIONS)? {
                return Ok(run.finish(status));
            }
            run.converted(&self.skin.operators)?
        };
        let status = run.advance(stop, usize::MAX)?.unwrap_or(SequenceStatus::IterationCap);
        Ok(run.finish(status))
    }
}
