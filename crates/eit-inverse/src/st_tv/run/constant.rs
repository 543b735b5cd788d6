//! Constant images: the first candidate of a solve, and the optimum if the weights are large.

use super::super::duals::convert;
use super::super::lanes::Project;
use super::super::problem::Problem;
use super::Run;
use std::ops::Range;

/// Largest objective of images of one value a frame, relative to that of one value for all frames, from which
/// the iteration starts. One row of the reference problem: 0.02, three rows 0.4, all rows 1.
const CONSTANTS_EXPLAIN: f64 = 0.2;

/// Most trials of frame weights, so that one constant meets the constraints of all frames if one can.
const WEIGHTINGS: usize = 50;

impl<T: Project> Run<'_, T> {
    /// Evaluates the best constant image, which is optimal if the weights are large, and computes a
    /// first lower bound.
    pub(super) fn try_constant(&mut self) {
        let problem = self.problem;
        let (frames, padded) = (problem.frames(), self.ops.padded);
        // one constant for all frames if they are linked, otherwise one per frame
        let count = if problem.linked() { frames } else { 1 };
        let mut values = Vec::new();
        let mut weights = vec![1.0; frames];
        for first in (0..frames).step_by(count) {
            let own = constant_values(&problem, first..first + count, &weights);
            values.extend(std::iter::repeat_n(own, count));
        }
        self.keep_constants(&values);
        for _ in 0..WEIGHTINGS {
            if count == 1 || !self.weigh(&mut weights) {
                break;
            }
            values.fill(constant_values(&problem, 0..count, &weights));
            self.keep_constants(&values);
        }
        let certificate = &mut self.engine.certificate;
        for (frame, values) in values.iter().enumerate() {
            let column = coefficients(&problem, values);
            let own = &mut certificate.dual[frame * padded..][..column.len()];
            problem.mode(frame).apply(&column, own);
            own.iter_mut().zip(problem.beta(frame)).for_each(|(y, b)| *y -= b);
        }
        self.record.take_bound(certificate.bound_of_constants(&problem).value);
        if count > 1 {
            self.start_from_constants();
        }
    }

    /// Multiplies the weight of each frame by the square of its residual relative to its constraint. Repeated,
    /// this minimises the largest of these ratios (Lawson, *Contributions to the theory of linear least maximum
    /// approximations*, 1961). Returns false if all constraints hold, if there are none, and if no constant
    /// can meet them all: usually at once, since the weighted residuals are then above the weighted constraints.
    fn weigh(&self, weights: &mut [f64]) -> bool {
        let Some(delta) = self.problem.delta else { return false };
        let ratio = |frame: usize| self.record.candidate.misfit[frame] / delta[frame];
        let largest = (0..weights.len()).map(ratio).fold(0.0, f64::max);
        if !(largest > 1.0 && largest.is_finite()) {
            return false;
        }
        let [mut residual, mut allowed] = [0.0; 2];
        for (frame, weight) in weights.iter().enumerate() {
            residual += weight * self.record.candidate.misfit[frame].powi(2);
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
        let common = self.record.primal;
        let frames = 0..self.problem.frames();
        let values: Vec<_> =
            frames.map(|f| constant_values(&self.problem, f..f + 1, &[1.0])).collect();
        if self.keep_constants(&values) < CONSTANTS_EXPLAIN * common {
            convert(&self.record.candidate.change, 1.0, &mut self.engine.state.change);
            self.engine.state.is_centred = true;
        }
    }

    /// Evaluates images of one value for each frame and part; returns the objective.
    fn keep_constants(&mut self, values: &[Vec<f64>]) -> f64 {
        let (places, label) = (&self.ops.places, &self.problem.skin.parts.label);
        let candidate = &mut self.record.candidate;
        for (frame, values) in values.iter().enumerate() {
            let own = &mut candidate.change[frame * places.length..][..places.length];
            let cells = places.cells.iter().zip(label);
            cells.for_each(|(&cell, &part)| own[cell] = values[part as usize]);
        }
        candidate.evaluate::<T>(&self.problem, None);
        self.record.take();
        self.record.candidate.primal
    }
}

/// Returns `V' x` of an image with one value on each part.
fn coefficients(problem: &Problem<'_>, values: &[f64]) -> Vec<f64> {
    let mut sum = vec![0.0; problem.skin.singular.len()];
    for (sensitivity, value) in problem.skin.parts.sensitivity.iter().zip(values) {
        sum.iter_mut().zip(sensitivity).for_each(|(c, s)| *c += s * value);
    }
    sum
}

/// Returns the least-squares value of each connected part with a weight for each frame, by sweeps over the
/// parts; a single part, the usual case, needs one sweep.
fn constant_values(problem: &Problem<'_>, frames: Range<usize>, weights: &[f64]) -> Vec<f64> {
    let parts = &problem.skin.parts.sensitivity;
    let mut values = vec![0.0; parts.len()];
    let [mut own, mut all] = [(); 2].map(|()| vec![0.0; problem.skin.singular.len()]);
    let sweeps = if values.len() == 1 { 1 } else { 50 };
    for part in (0..sweeps).flat_map(|_| 0..parts.len()) {
        let (mut along, mut power) = (0.0, 0.0);
        for (frame, weight) in frames.clone().zip(weights) {
            let mode = problem.mode(frame);
            mode.apply(&coefficients(problem, &values), &mut all);
            mode.apply(&parts[part], &mut own);
            for ((own, all), b) in own.iter().zip(&all).zip(problem.beta(frame)) {
                along += weight * own * (b - all);
                power += weight * own.powi(2);
            }
        }
        values[part] += if power > 0.0 { along / power } else { 0.0 };
        if let Some([lower, upper]) = problem.bounds {
            values[part] = values[part].clamp(lower, upper);
        }
    }
    values
}
