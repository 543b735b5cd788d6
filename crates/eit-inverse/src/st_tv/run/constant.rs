//! Constant images: the first candidate of a solve, and the optimum if the weights are large.

use super::Run;
use crate::st_tv::lanes::Project;

/// Largest objective of images of one value a frame, relative to that of one value for all frames, from which
/// the iteration starts. One row of the reference problem: 0.02, three rows 0.4, all rows 1.
const CONSTANTS_EXPLAIN: f64 = 0.2;

/// Most trials of frame weights, so that one constant meets the constraints of all frames if one can.
const WEIGHTINGS: usize = 50;

impl<T: Project> Run<'_, T> {
    /// Evaluates the best constant image, which is optimal if the weights are large, and computes a
    /// first lower bound.
    pub(super) fn try_constant(&mut self) {
        let task = self.task;
        let parts = &task.solver.skin.parts;
        // one constant for all frames if they are linked, otherwise one per frame
        let count = if task.linked() { task.frames } else { 1 };
        let mut values = Vec::new();
        let mut weights = vec![1.0; task.frames];
        for first in (0..task.frames).step_by(count) {
            let own = self.constant_values(first..first + count, &weights);
            values.extend(std::iter::repeat_n(own, count));
        }
        self.keep_constants(&values);
        for _ in 0..WEIGHTINGS {
            if count == 1 || !self.weigh(&mut weights) {
                break;
            }
            let own = self.constant_values(0..count, &weights);
            values.fill(own);
            self.keep_constants(&values);
        }
        let (rank, padded) = (task.solver.rank(), self.ops.padded);
        let problem = self.problem();
        let mut column = vec![0.0; rank];
        for (frame, values) in values.iter().enumerate() {
            column.fill(0.0);
            for (sensitivity, value) in parts.sensitivity.iter().zip(values) {
                column.iter_mut().zip(sensitivity).for_each(|(c, s)| *c += s * value);
            }
            let own = &mut self.certificate.dual[frame * padded..][..rank];
            problem.mode(frame).apply(&column, own);
            own.iter_mut().zip(problem.beta(frame)).for_each(|(y, b)| *y -= b);
        }
        let bound = self.certificate.bound_of_constants(&problem).value;
        let best = &mut self.progress.best;
        best.lower_bound = best.lower_bound.max(bound);
        if count > 1 {
            self.start_from_constants();
        }
    }

    /// Multiplies the weight of each frame by the square of its residual relative to its constraint. Repeated,
    /// this minimises the largest of these ratios (Lawson, *Contributions to the theory of linear least maximum
    /// approximations*, 1961). Returns false if all constraints hold, if there are none, and if no constant
    /// can meet them all: usually at once, since the weighted residuals are then above the weighted constraints.
    fn weigh(&self, weights: &mut [f64]) -> bool {
        let Some(delta) = self.problem().delta else { return false };
        let ratio = |frame: usize| self.candidate.misfit[frame] / delta[frame];
        let largest = (0..weights.len()).map(ratio).fold(0.0, f64::max);
        if !(largest > 1.0 && largest.is_finite()) {
            return false;
        }
        let [mut residual, mut allowed] = [0.0; 2];
        for (frame, weight) in weights.iter().enumerate() {
            residual += weight * self.candidate.misfit[frame].powi(2);
            allowed += weight * delta[frame].powi(2);
        }
        if residual > allowed {
            return false;
        }
        let weighted = weights.iter_mut().enumerate();
        weighted.for_each(|(frame, weight)| *weight *= (ratio(frame) / largest).powi(2));
        let most = weights.iter().copied().fold(0.0, f64::max);
        weights.iter_mut().for_each(|weight| *weight /= most);
        true
    }

    /// Starts linked frames from a constant each, if that explains far more of the data than one constant for
    /// all: only with few channels, where the optimum is close to such images and far from zero.
    fn start_from_constants(&mut self) {
        let common = self.progress.best.primal;
        let frames = self.task.frames;
        let values: Vec<_> = (0..frames).map(|f| self.constant_values(f..f + 1, &[1.0])).collect();
        if self.keep_constants(&values) < CONSTANTS_EXPLAIN * common {
            let changes = self.state.change.iter_mut().zip(&self.candidate.change);
            changes.for_each(|(d, x)| *d = T::from_f64(*x));
            self.state.is_centred = true;
        }
    }

    /// Evaluates images of one value for each frame and part; returns the objective.
    fn keep_constants(&mut self, values: &[Vec<f64>]) -> f64 {
        let problem = self.problem();
        let (places, label) = (&self.ops.places, &problem.skin.parts.label);
        for (frame, values) in values.iter().enumerate() {
            let own = &mut self.candidate.change[frame * places.length..][..places.length];
            let cells = places.cells.iter().zip(label);
            cells.for_each(|(&cell, &part)| own[cell] = values[part as usize]);
        }
        self.candidate.evaluate::<T>(&problem, None);
        self.progress.best.take(&self.candidate);
        self.candidate.primal
    }

    /// Returns the least-squares value of each connected part with a weight for each frame, by sweeps over the
    /// parts; a single part, the usual case, needs one sweep.
    fn constant_values(&self, range: std::ops::Range<usize>, weights: &[f64]) -> Vec<f64> {
        let task = self.task;
        let parts = &task.solver.skin.parts;
        let mut values = vec![0.0; parts.sizes.len()];
        let [mut own, mut all] = [vec![0.0; task.solver.rank()], vec![0.0; task.solver.rank()]];
        let sweeps = if values.len() == 1 { 1 } else { 50 };
        for _ in 0..sweeps {
            for part in 0..values.len() {
                let (mut along, mut power) = (0.0, 0.0);
                let targets = &task.data.targets[range.clone()];
                let modes = &task.data.mode_of[range.clone()];
                for ((target, &mode), weight) in targets.iter().zip(modes).zip(weights) {
                    let mode = &task.data.modes[mode];
                    own.fill(0.0);
                    for (sensitivity, value) in parts.sensitivity.iter().zip(&values) {
                        own.iter_mut().zip(sensitivity).for_each(|(c, s)| *c += s * value);
                    }
                    mode.apply(&own, &mut all);
                    mode.apply(&parts.sensitivity[part], &mut own);
                    for ((own, all), b) in own.iter().zip(all.iter()).zip(&target.values) {
                        along += weight * own * (b - all);
                        power += weight * own.powi(2);
                    }
                }
                values[part] += if power > 0.0 { along / power } else { 0.0 };
                if let Some([lower, upper]) = task.bounds {
                    values[part] = values[part].clamp(lower, upper);
                }
            }
        }
        values
    }
}
