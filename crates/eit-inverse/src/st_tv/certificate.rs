//! Primal value and rigorous dual lower bound of an iterate, in `f64`.
//!
//! Over 300 lines because the steps of the bound, from an iterate's duals to a feasible point and its
//! value, all work on one set of arrays; the passes over the unknowns are in `passes`.
//!
//! # The bound
//! For any `y` (one vector a frame), `|q_g| <= lambda_space size_g`, `|q_t| <= lambda_time area` and
//! `p` with `A' y + D' q + D_t' q_t + p = 0`, weak duality gives, for every image within bounds,
//!
//! ```text
//! penalised:    objective >= sum_t -y.b - |y|^2 / 2 + rest^2 / 2  -  h(p)
//! constrained:  objective >= sum_t -y.b - delta |y|               -  h(p)
//! h(p) = sum lower p where p < 0, upper p where p > 0
//! ```
//!
//! The duals of an iterate satisfy the ball constraints, but the equation only approximately. A search
//! from these duals reduces the error `e`: a few steps on the flows with `y` fixed (see [`super::flow`]), then a
//! change of `y` that absorbs a part of what is left, in turn. Flows alone are not enough: where `A' y` exceeds
//! what the balls of an unknown allow, at the edge of an electrode or over a whole region, only `y` can help.
//!
//! ```text
//! y -= factor D A e,     D = 1 / (S^2 + STIFF) without masked channels     (see Seen::absorb)
//! ```
//!
//! In the first rounds the flows make `e - lean x` small instead of `e`. For duals that satisfy the equation,
//!
//! ```text
//! objective(x) - bound = sum_g (radius |D x|_g - q_g . (D x)_g) + the same in time + |y - (A x - b)|^2 / 2
//! ```
//!
//! so the flows should be aligned with the gradients of the image `x`, and this is a step of the proximal method of
//! multipliers, which does that.
//!
//! The remainder is removed exactly by the smallest flow `D z` with `D' D z = e`, after `y` and `q_t` have absorbed the
//! sum of `e` over each connected part of the skin. If `q - D z` then leaves a ball, all of `(y, q,
//! q_t, p)` are scaled down, which preserves the equation; the best scale has a closed form. The bound
//! therefore does not depend on the iteration, its step sizes or `f32`: it is valid for any input, up
//! to the rounding of this evaluation (about 1e-13 of the objective).

use super::fit::DataSteps;
use super::float::Float;
use super::flow::{Boxes, Flow};
use super::kernel::RANKS;
use super::operators::{BLOCK, Operators};
use super::passes::{Analyse, Error, Excess, Subtract, Variation};
use super::problem::{DataTerm, Parts, Problem};
use super::state::{PAD, State};
use pulp::Arch;

/// Largest weight, in the solver's units; larger weights do not change the result but would overflow
/// `f32`.
pub(crate) const LARGEST_WEIGHT: f64 = 1e8;

/// Iterate from which a bound is computed.
pub(crate) struct Iterate<'a, T> {
    pub(crate) ops: &'a Operators<T>,
    pub(crate) state: &'a State<T>,
    pub(crate) data: &'a DataSteps<T>,
}

/// Settings of the search for a flow.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    /// Number of changes of `y`.
    pub(crate) rounds: usize,
    /// Number of steps of the flow before each change of `y`, or in all if `y` is not changed.
    pub(crate) steps: usize,
    /// Relative size of the force towards which the error is moved in the first rounds.
    pub(crate) lean: f64,
    /// Relative enlargement of the balls during the search; the result is scaled down to fit.
    pub(crate) slack: f64,
}

impl Effort {
    /// Returns a search for a flow alone, without changes of `y`.
    pub(crate) fn plain(steps: usize, target_gap: f64) -> Self {
        Self { rounds: 0, steps, lean: 0.0, slack: 0.5 * target_gap }
    }
}

/// Factor on all changes of `y` but the last. With 1.8 and changes after every step the search diverges; 1.3 and 1.7
/// take as many iterations to 1e-3.
const OVER: f64 = 1.5;
/// Squared singular value, relative to the largest, below which `y` hardly changes. 1e-7 takes as many iterations to
/// 1e-3 and a tenth more to 1e-2, 1e-5 up to a twentieth more to 1e-3.
const STIFF: f64 = 1e-6;

/// Returns the number of ranks in which `y` can absorb a part of the error.
fn absorbing(problem: &Problem<'_>) -> usize {
    let padded = problem.ops.padded_rank;
    if !problem.mode_of.iter().all(|&mode| problem.modes[mode].is_whole) {
        return padded;
    }
    let able = problem.singular.iter().take_while(|&s| s * s > 0.1 * STIFF).count();
    able.next_multiple_of(RANKS).min(padded)
}

/// Memory for an evaluation.
#[derive(Debug, Clone)]
pub(crate) struct Evaluation {
    stride: usize,
    /// The candidate, clipped to the bounds, `[unknown][stride]`.
    pub(crate) image: Vec<f64>,
    dual: Vec<f64>,
    time_dual: Vec<f64>,
    bound_dual: Vec<f64>,
    error: Vec<f64>,
    work: Vec<f64>,
    coefficients: Vec<f64>,
    /// Coefficients before a change.
    before: Vec<f64>,
    /// Dual variable of the data in each frame's mode, `[frame][rank]`.
    pub(crate) data_dual: Vec<f64>,
    /// `|A x_t - b_t|` of each frame.
    pub(crate) residual: Vec<f64>,
    columns: [Vec<f64>; 2],
    sums: Vec<f64>,
    /// Linear system that balances the parts, `[part][part + 1]`.
    gram: Vec<f64>,
    /// `A 1` of each part, `[frame][part][rank]`.
    ones: Vec<f64>,
    /// Sums of the error and of the bound duals, `[part]`.
    shares: Vec<[f64; 2]>,
    /// Whether a frame is linked to the next one, `[frame]`.
    linked: Vec<bool>,
}

impl Evaluation {
    pub(crate) fn new<T: Float>(ops: &Operators<f64>, state: &State<T>, parts: &Parts) -> Self {
        let (stride, frames) = (state.stride, state.frames);
        let values = ops.unknowns.next_multiple_of(BLOCK) * stride;
        Self {
            stride,
            image: vec![0.0; values],
            dual: vec![0.0; state.dual.len()],
            time_dual: vec![0.0; if state.time_dual.is_empty() { 0 } else { values }],
            bound_dual: vec![0.0; state.bound_dual.len()],
            error: vec![0.0; values],
            work: vec![0.0; values],
            coefficients: vec![0.0; ops.padded_rank * stride],
            before: vec![0.0; ops.padded_rank * stride],
            data_dual: vec![0.0; frames * ops.rank],
            residual: vec![0.0; frames],
            columns: std::array::from_fn(|_| vec![0.0; ops.rank]),
            sums: vec![0.0; frames * parts.sizes.len()],
            gram: vec![0.0; parts.sizes.len() * (parts.sizes.len() + 1)],
            ones: vec![0.0; frames * parts.sizes.len() * ops.rank],
            shares: vec![[0.0; 2]; parts.sizes.len()],
            linked: vec![false; frames],
        }
    }

    /// Returns the objective of the state's candidate, clipped to the bounds; infinite if it violates
    /// a data constraint.
    pub(crate) fn primal<T: Float>(
        &mut self,
        arch: Arch,
        problem: &Problem<'_>,
        state: &State<T>,
    ) -> f64 {
        self.take_links(state);
        for (x, c) in self.image.iter_mut().zip(&state.candidate) {
            *x = c.to_f64();
        }
        if let Some([lower, upper]) = problem.bounds {
            self.image.iter_mut().for_each(|x| *x = x.clamp(lower, upper));
        }
        let ops = problem.ops;
        let stride = self.stride;
        let coefficients = &mut self.coefficients;
        arch.dispatch(Analyse { ops, x: &self.image, stride, coefficients });
        let mut sum = 0.0;
        for frame in 0..state.frames {
            let (mode, target) = (&problem.modes[problem.mode_of[frame]], &problem.targets[frame]);
            let [column, rotated] = &mut self.columns;
            gather(coefficients, stride, frame, column);
            mode.apply(column, rotated);
            let square: f64 =
                rotated.iter().zip(&target.values).map(|(u, b)| (u - b).powi(2)).sum();
            let square = square + target.rest_squared;
            self.residual[frame] = square.sqrt();
            match problem.data_term {
                DataTerm::Penalised => sum += 0.5 * square,
                // tolerance for the rounding of this evaluation; the data has norm 1
                DataTerm::Constrained(delta) => {
                    if square.sqrt() > delta[frame] * (1.0 + 1e-9) + 1e-12 {
                        sum = f64::INFINITY;
                    }
                }
            }
        }
        let variation = Variation {
            ops,
            x: &self.image,
            stride,
            linked: &self.linked,
            lambda_space: problem.lambda_space,
            lambda_time: problem.lambda_time,
        };
        sum + arch.dispatch(variation)
    }

    fn take_links<T: Float>(&mut self, state: &State<T>) {
        let linked = self.linked.iter_mut().enumerate();
        linked.for_each(|(frame, linked)| *linked = state.is_linked(frame));
    }

    /// Computes a lower bound on the optimum from the state's duals, its data dual and a search that starts
    /// from them.
    pub(crate) fn lower_bound<T: Float>(
        &mut self,
        arch: Arch,
        problem: &Problem<'_>,
        iterate: Iterate<'_, T>,
        flow: &mut Flow<T>,
        effort: Effort,
    ) -> f64 {
        let Iterate { ops, state, data } = iterate;
        self.take_links(state);
        self.take_ones(problem, state.frames);
        for (frame, own) in self.data_dual.chunks_exact_mut(problem.ops.rank).enumerate() {
            data.dual(frame, state.stride, own);
        }
        self.balance_alone(problem, state.frames);
        self.set_force(problem, state.frames);
        for (to, from) in flow.coefficients.iter_mut().zip(&self.coefficients) {
            *to = T::from_f64(*from);
        }
        let size = self.image.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        let larger = 1.0 + effort.slack;
        let per_size = |force: f64| if size > 0.0 { force / size } else { 1.0 };
        let how = Boxes {
            steps: effort.steps,
            ranks: absorbing(problem),
            lean: 0.0,
            lambda_space: larger * problem.lambda_space.min(LARGEST_WEIGHT),
            lambda_time: larger * problem.lambda_time.min(LARGEST_WEIGHT),
            bounds: problem.bounds,
            per_image: per_size(problem.lambda_space),
        };
        let radius =
            problem.ops.radius.iter().sum::<f64>() / problem.ops.radius.len().max(1) as f64;
        let lean = effort.lean * per_size(how.lambda_space * radius);
        flow.start(arch, ops, state, &self.image, how);
        if effort.rounds == 0 {
            flow.advance(arch, ops, Boxes { ranks: 0, ..how });
        }
        for round in 0..effort.rounds {
            let last = round + 1 == effort.rounds;
            let leans = round < effort.rounds * 3 / 4;
            flow.advance(arch, ops, Boxes { lean: if leans { lean } else { 0.0 }, ..how });
            self.absorb(problem, state.frames, flow, if last { 1.0 } else { OVER });
            flow.push(arch, ops, how.ranks);
        }
        if how.bounds.is_some() {
            flow.finish(arch, ops, how);
        }
        self.take_flow(problem, flow, how);
        self.balance_parts(problem, state.frames);
        self.repair(arch, problem, state.frames);
        self.scaled_value(arch, problem, state.frames)
    }

    /// Changes `y` such that its force balances a part of the error of a flow, whose coefficients are replaced by
    /// the change of the force.
    fn absorb<T: Float>(
        &mut self,
        problem: &Problem<'_>,
        frames: usize,
        flow: &mut Flow<T>,
        factor: f64,
    ) {
        let (rank, stride) = (problem.ops.rank, self.stride);
        self.before.copy_from_slice(&self.coefficients);
        for frame in 0..frames {
            let [column, rotated] = &mut self.columns;
            for (k, c) in column.iter_mut().enumerate() {
                *c = factor * flow.coefficients[k * stride + frame].to_f64();
            }
            problem.modes[problem.mode_of[frame]].absorb(column, STIFF, rotated);
            let own = self.data_dual[frame * rank..][..rank].iter_mut();
            own.zip(&*rotated).for_each(|(y, change)| *y -= change);
        }
        self.balance_alone(problem, frames);
        self.set_force(problem, frames);
        let changes = self.coefficients.iter().zip(&self.before);
        for (c, (after, before)) in flow.coefficients.iter_mut().zip(changes) {
            *c = T::from_f64(after - before);
        }
    }

    /// Computes a lower bound from the data duals in `data_dual` alone, for a constant image.
    pub(crate) fn lower_bound_of_constant<T: Float>(
        &mut self,
        arch: Arch,
        problem: &Problem<'_>,
        state: &State<T>,
    ) -> f64 {
        self.take_links(state);
        self.take_ones(problem, state.frames);
        self.dual.fill(0.0);
        self.time_dual.fill(0.0);
        self.bound_dual.fill(0.0);
        self.balance_parts(problem, state.frames);
        self.repair(arch, problem, state.frames);
        self.scaled_value(arch, problem, state.frames)
    }

    /// Copies the duals of a flow and sets the bound duals, which absorb a part of its error.
    fn take_flow<T: Float>(&mut self, problem: &Problem<'_>, flow: &Flow<T>, how: Boxes) {
        self.dual.iter_mut().zip(&flow.dual).for_each(|(d, s)| *d = s.to_f64());
        if !self.time_dual.is_empty() {
            let rows = self.time_dual.iter_mut().zip(&flow.time_dual[PAD..]);
            rows.for_each(|(d, s)| *d = s.to_f64());
        }
        let (stride, frames) = (self.stride, self.residual.len());
        if how.bounds.is_none() {
            return;
        }
        for ((p, e), x) in self.bound_dual.iter_mut().zip(&flow.error).zip(&self.image) {
            let (e, [most, least]) = (e.to_f64(), how.limits(*x));
            *p = e.min(most).max(least) - e;
        }
        // the bound duals of a frame must not exceed the error that they balance
        let mut sums = std::mem::take(&mut self.shares);
        for frame in 0..frames {
            sums.fill([0.0; 2]);
            for (p, &label) in problem.parts.label.iter().enumerate() {
                let at = p * stride + frame;
                let own = &mut sums[label as usize];
                own[0] += flow.error[at].to_f64();
                own[1] += self.bound_dual[at];
            }
            for (p, &label) in problem.parts.label.iter().enumerate() {
                let [force, held] = sums[label as usize];
                let share = if force * held < 0.0 { (-force / held).min(1.0) } else { 0.0 };
                self.bound_dual[p * stride + frame] *= share;
            }
        }
        self.shares = sums;
    }

    /// Makes the error sum to zero on each part in each frame: `y` balances the sum over all frames,
    /// `q_t` moves the rest from frame to frame (without a time term `y` does both).
    fn balance_parts(&mut self, problem: &Problem<'_>, frames: usize) {
        self.balance_by_data_twice(problem, frames);
        for part in 0..problem.parts.sizes.len() {
            let mut first = 0;
            while first < frames {
                let range = self.run_from(first, frames);
                first = range.end;
                self.balance_by_links(problem, part, range);
            }
        }
        self.balance_by_bounds(problem, frames);
    }

    /// Balances with the bound duals what `y` and `q_t` could not, since a frame has fewer channels than parts.
    /// A frame whose bounds do not allow that proves nothing: its duals are set to zero.
    fn balance_by_bounds(&mut self, problem: &Problem<'_>, frames: usize) {
        let Some([lower, upper]) = problem.bounds else { return };
        if self.bound_dual.is_empty() || !self.unbalanced(problem, 0..frames) {
            return;
        }
        let (parts, stride) = (problem.parts.sizes.len(), self.stride);
        for frame in 0..frames {
            for (part, size) in problem.parts.sizes.iter().enumerate() {
                let sum = self.sums[frame * parts + part];
                let label = || problem.parts.label.iter().enumerate();
                let members =
                    || label().filter(|l| *l.1 as usize == part).map(|l| l.0 * stride + frame);
                // a dual of this sign can always be reduced; one of the other sign needs a finite bound
                let duals = members().map(|p| self.bound_dual[p]);
                let held: f64 = duals.filter(|dual| dual * sum > 0.0).sum();
                let reduced = if held == 0.0 { 0.0 } else { (sum / held).min(1.0) };
                let bound = if sum > 0.0 { lower } else { upper };
                let rest = sum - reduced * held;
                let added = if bound.is_finite() { rest / size } else { 0.0 };
                for p in members() {
                    let dual = &mut self.bound_dual[p];
                    *dual -= added + if *dual * sum > 0.0 { reduced * *dual } else { 0.0 };
                }
                self.sums[frame * parts + part] = rest - added * size;
            }
            let alone = !self.linked[frame] && (frame == 0 || !self.linked[frame - 1]);
            if alone && self.unbalanced(problem, frame..frame + 1) {
                self.data_dual[frame * problem.ops.rank..][..problem.ops.rank].fill(0.0);
                self.dual.iter_mut().skip(frame).step_by(stride).for_each(|q| *q = 0.0);
                self.bound_dual.iter_mut().skip(frame).step_by(stride).for_each(|p| *p = 0.0);
                self.sums[frame * parts..][..parts].fill(0.0);
            }
        }
    }

    /// Balances the force of `y` alone over linked frames; not with bounds, which may carry a part of it.
    fn balance_alone(&mut self, problem: &Problem<'_>, frames: usize) {
        if problem.bounds.is_some() {
            return;
        }
        self.data_sums(problem, frames);
        let mut first = 0;
        while first < frames {
            let range = self.run_from(first, frames);
            first = range.end;
            self.balance_by_data(problem, range);
        }
    }

    /// Balances the error sum of each part over linked frames by changing `y`.
    fn balance_by_data_twice(&mut self, problem: &Problem<'_>, frames: usize) {
        self.part_sums(problem, frames);
        // the second pass removes the rounding errors of the first
        for _ in 0..2 {
            let mut first = 0;
            while first < frames {
                let range = self.run_from(first, frames);
                first = range.end;
                self.balance_by_data(problem, range);
            }
            self.part_sums(problem, frames);
        }
    }

    /// Returns the run of linked frames that starts at `first`.
    fn run_from(&self, first: usize, frames: usize) -> std::ops::Range<usize> {
        let end = (first..frames).find(|&f| !self.linked[f]).map_or(frames, |f| f + 1);
        first..end
    }

    /// Carries the sums of a part over a run of linked frames to its last frame.
    fn balance_by_links(
        &mut self,
        problem: &Problem<'_>,
        part: usize,
        range: std::ops::Range<usize>,
    ) {
        let parts = problem.parts.sizes.len();
        let size = problem.parts.sizes[part];
        let last = range.end - 1;
        let mut carried = 0.0;
        for frame in range.start..last {
            carried += self.sums[frame * parts + part];
            let flow = carried / size;
            for (p, &label) in problem.parts.label.iter().enumerate() {
                if label as usize == part {
                    self.time_dual[p * self.stride + frame] += flow;
                }
            }
            self.sums[frame * parts + part] = 0.0;
        }
        self.sums[last * parts + part] += carried;
    }

    /// Applies `y_t -= sum_p theta_p a_tp` over the frames of `range`, so that the sums of all parts
    /// vanish together, with `a_tp = A_t 1` on part `p`: least squares over the parts, which share `y`.
    fn balance_by_data(&mut self, problem: &Problem<'_>, range: std::ops::Range<usize>) {
        let parts = problem.parts.sizes.len();
        let rank = problem.ops.rank;
        let Self { gram, ones, data_dual, sums, .. } = self;
        gram.fill(0.0);
        for frame in range.clone() {
            let own = &ones[frame * parts * rank..][..parts * rank];
            let rows = gram.chunks_exact_mut(parts + 1).zip(own.chunks_exact(rank));
            for (p, (row, force)) in rows.enumerate() {
                row[parts] += sums[frame * parts + p];
                for (entry, other) in row.iter_mut().zip(own.chunks_exact(rank)) {
                    *entry += force.iter().zip(other).map(|(a, b)| a * b).sum::<f64>();
                }
            }
        }
        solve_semidefinite(gram, parts);
        for frame in range {
            let forces = ones[frame * parts * rank..][..parts * rank].chunks_exact(rank);
            let own = &mut data_dual[frame * rank..][..rank];
            for (force, theta) in forces.zip(gram.chunks_exact(parts + 1)) {
                own.iter_mut().zip(force).for_each(|(y, a)| *y -= theta[parts] * a);
            }
        }
    }

    /// Sums the force of `y` over each part, `[frame][part]`.
    fn data_sums(&mut self, problem: &Problem<'_>, frames: usize) {
        let (parts, rank) = (problem.parts.sizes.len(), problem.ops.rank);
        self.sums.fill(0.0);
        let rows = self.ones.chunks_exact(parts * rank).zip(self.data_dual.chunks_exact(rank));
        for (sums, (ones, own)) in self.sums.chunks_exact_mut(parts).zip(rows).take(frames) {
            for (sum, row) in sums.iter_mut().zip(ones.chunks_exact(rank)) {
                *sum = row.iter().zip(own).map(|(u, y)| u * y).sum();
            }
        }
    }

    /// Computes the measurements of an image of 1 on each part.
    fn take_ones(&mut self, problem: &Problem<'_>, frames: usize) {
        let (parts, rank) = (problem.parts.sizes.len(), problem.ops.rank);
        for (frame, own) in self.ones.chunks_exact_mut(parts * rank).enumerate().take(frames) {
            let mode = &problem.modes[problem.mode_of[frame]];
            let rows = own.chunks_exact_mut(rank).zip(&problem.parts.sensitivity);
            rows.for_each(|(row, sensitivity)| mode.apply(sensitivity, row));
        }
    }

    /// Sums the error over each part, `[frame][part]`; `D' q` sums to zero on each.
    fn part_sums(&mut self, problem: &Problem<'_>, frames: usize) {
        self.data_sums(problem, frames);
        let (parts, stride) = (problem.parts.sizes.len(), self.stride);
        for (p, &label) in problem.parts.label.iter().enumerate() {
            let row = p * stride;
            for frame in 0..frames {
                let mut value = 0.0;
                if !self.time_dual.is_empty() {
                    value -= self.time_dual[row + frame];
                    if frame > 0 {
                        value += self.time_dual[row + frame - 1];
                    }
                }
                if !self.bound_dual.is_empty() {
                    value += self.bound_dual[row + frame];
                }
                self.sums[frame * parts + label as usize] += value;
            }
        }
    }

    /// Computes the coefficients of the force of the data, `F y` of each frame.
    fn set_force(&mut self, problem: &Problem<'_>, frames: usize) {
        let (rank, stride) = (problem.ops.rank, self.stride);
        self.coefficients.fill(0.0);
        for frame in 0..frames {
            let mode = &problem.modes[problem.mode_of[frame]];
            let own = &self.data_dual[frame * rank..][..rank];
            let column = &mut self.columns[0];
            mode.apply_transposed(own, column);
            for (k, c) in column.iter().enumerate() {
                self.coefficients[k * stride + frame] = *c;
            }
        }
    }

    /// Computes the error of the equation and removes it from `q`.
    fn repair(&mut self, arch: Arch, problem: &Problem<'_>, frames: usize) {
        self.set_force(problem, frames);
        let (ops, stride) = (problem.ops, self.stride);
        arch.dispatch(Error {
            ops,
            stride,
            coefficients: &self.coefficients,
            dual: &self.dual,
            time_dual: &self.time_dual,
            bound_dual: &self.bound_dual,
            error: &mut self.error,
        });
        problem.laplacian.solve(arch, &mut self.error, &mut self.work, stride);
        arch.dispatch(Subtract { ops, stride, potential: &self.error, dual: &mut self.dual });
    }

    /// Returns the bound at the best feasible scale.
    fn scaled_value(&self, arch: Arch, problem: &Problem<'_>, frames: usize) -> f64 {
        let unbalanced = self.unbalanced(problem, 0..frames);
        let excess = arch.dispatch(Excess {
            ops: problem.ops,
            stride: self.stride,
            frames,
            dual: &self.dual,
            time_dual: &self.time_dual,
            lambda_space: problem.lambda_space,
            lambda_time: problem.lambda_time,
        });
        if unbalanced || !excess.is_finite() {
            return self.constant(problem);
        }
        let largest = 1.0 / excess.max(1.0);
        let rank = problem.ops.rank;
        let (mut linear, mut square) = (-self.support(problem, frames), 0.0);
        for frame in 0..frames {
            let own = &self.data_dual[frame * rank..][..rank];
            let target = &problem.targets[frame];
            linear -= own.iter().zip(&target.values).map(|(y, b)| y * b).sum::<f64>();
            let norm: f64 = own.iter().map(|y| y * y).sum();
            match problem.data_term {
                DataTerm::Penalised => square += norm,
                DataTerm::Constrained(delta) => {
                    let inside = (delta[frame].powi(2) - target.rest_squared).max(0.0).sqrt();
                    linear -= inside * norm.sqrt();
                }
            }
        }
        let scale = match (linear > 0.0, square > 0.0) {
            (false, _) => 0.0,
            (true, false) => largest,
            (true, true) => largest.min(linear / square),
        };
        self.constant(problem) + scale * linear - 0.5 * scale * scale * square
    }

    /// Returns the part of the objective that does not depend on the image.
    fn constant(&self, problem: &Problem<'_>) -> f64 {
        match problem.data_term {
            DataTerm::Penalised => problem.targets.iter().map(|t| 0.5 * t.rest_squared).sum(),
            DataTerm::Constrained(_) => 0.0,
        }
    }

    /// Returns whether the sum of any part exceeds rounding error in one of the frames.
    fn unbalanced(&self, problem: &Problem<'_>, frames: std::ops::Range<usize>) -> bool {
        let parts = problem.parts.sizes.len();
        (0..parts).any(|part| {
            let sensitivity: f64 =
                problem.parts.sensitivity[part].iter().map(|v| v.abs()).fold(0.0, f64::max);
            let dual = self.data_dual.iter().fold(0.0_f64, |m, y| m.max(y.abs()));
            let scale = sensitivity * dual;
            frames.clone().any(|f| self.sums[f * parts + part].abs() > 1e-12 * scale)
        })
    }

    /// Returns `h(p)`.
    fn support(&self, problem: &Problem<'_>, frames: usize) -> f64 {
        let Some([lower, upper]) = problem.bounds else { return 0.0 };
        let term = |p: f64| match p {
            p if p > 0.0 => upper * p,
            p if p < 0.0 => lower * p,
            _ => 0.0,
        };
        let rows = self.bound_dual.chunks_exact(self.stride).take(problem.ops.unknowns);
        rows.flat_map(|row| &row[..frames]).map(|&p| term(p)).sum()
    }
}

/// Solves a semidefinite system `[n][n + 1]` with the right-hand side in the last column, which is
/// replaced by the solution. Uses elimination with diagonal pivots; the solution is zero in null
/// directions.
fn solve_semidefinite(rows: &mut [f64], n: usize) {
    let width = n + 1;
    let floor = (0..n).map(|k| rows[k * width + k]).fold(0.0, f64::max) * 1e-12;
    // a diagonal entry of -1 marks a row that has been a pivot
    for _ in 0..n {
        let mut pivot = None;
        let mut most = floor;
        for k in 0..n {
            if rows[k * width + k] > most {
                most = rows[k * width + k];
                pivot = Some(k);
            }
        }
        let Some(k) = pivot else { break };
        for c in 0..width {
            if c != k {
                rows[k * width + c] /= most;
            }
        }
        for i in (0..n).filter(|&i| i != k) {
            let factor = rows[i * width + k];
            for c in (0..width).filter(|&c| c != k) {
                rows[i * width + c] -= factor * rows[k * width + c];
            }
            rows[i * width + k] = 0.0;
        }
        rows[k * width + k] = -1.0;
    }
    for k in 0..n {
        if rows[k * width + k] != -1.0 {
            rows[k * width + n] = 0.0;
        }
    }
}

/// Copies the column of one frame from `[rank][stride]`.
pub(crate) fn gather<T: Float>(values: &[T], stride: usize, frame: usize, column: &mut [f64]) {
    for (k, c) in column.iter_mut().enumerate() {
        *c = values[k * stride + frame].to_f64();
    }
}
