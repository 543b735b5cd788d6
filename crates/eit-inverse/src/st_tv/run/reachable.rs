//! Data constraints that no image within the bounds can meet.

use super::Run;
use crate::InverseError;
use crate::st_tv::lanes::Project;
use crate::st_tv::reach::least_residual;
use faer::Mat;

/// Most frames that are checked at a time: at 64 x 64 one takes up to a second.
const FRAMES: usize = 2;
/// Relative excess of a residual over its constraint that is no rounding error.
const EXCESS: f64 = 1e-6;

impl<T: Project> Run<'_, T> {
    /// Checks the frames whose images are furthest from their constraints, after 300 iterations without an image that
    /// meets all, and again after twice as many.
    pub(super) fn check_reachable(&mut self) -> Result<(), InverseError> {
        let (task, problem) = (self.task, self.problem);
        let (Some(delta), Some(bounds)) = (problem.delta, problem.bounds) else { return Ok(()) };
        if self.record.iterations < self.schedule.next_check {
            return Ok(());
        }
        self.schedule.next_check = 2 * self.record.iterations;
        let ratio = |frame: usize| self.record.candidate.misfit[frame] / delta[frame];
        let mut frames: Vec<usize> =
            (0..delta.len()).filter(|&f| ratio(f) > 1.0 + EXCESS).collect();
        frames.sort_by(|&f, &g| ratio(g).total_cmp(&ratio(f)));
        for frame in frames.into_iter().take(FRAMES) {
            let mode = problem.mode(frame);
            let target = &problem.targets[frame];
            let rank = task.solver.rank();
            let seen = Mat::from_fn(mode.rows, rank, |i, k| mode.transposed[i * rank + k]);
            let columns = &seen * task.solver.compression.basis.transpose();
            let enough = (delta[frame].powi(2) - target.rest_squared).max(0.0).sqrt();
            let found = least_residual(
                columns.as_ref(),
                &target.values[..mode.rows],
                bounds,
                enough * (1.0 + EXCESS),
            );
            if let Some(least) = found {
                let [lower_s, upper_s] = task.solver.settings.bounds_s();
                return Err(InverseError::DeltaTooSmallWithinBounds {
                    frame,
                    delta: delta[frame] * task.units.one,
                    least: least.hypot(target.rest_squared.sqrt()) * task.units.one,
                    lower_s,
                    upper_s,
                });
            }
        }
        Ok(())
    }
}
