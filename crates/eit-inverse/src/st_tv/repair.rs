//! Exact balance of nearly feasible duals without an anchor, in `f64`.
//!
//! The error `e = A' y + D' q + D_t' q_t + p` must vanish. `y` and `q_t` absorb its sum over each connected part of the
//! skin: `y` balances the sum over all linked frames, `q_t` moves the rest from frame to frame; where a frame has fewer
//! channels than parts, the bound duals `p` take what is left. The remainder is removed by the smallest flow `D z` with
//! `D' D z = e`.

use super::bound::{Bound, of_data};
use super::dense::{multiply, solve_semidefinite};
use super::differences::{Differences, for_basis};
use super::duals::Duals;
use super::flow::{Boxes, Flow};
use super::lanes::{Project, each, load, store};
use super::laplacian::SIDES;
use super::operators::Operators;
use super::problem::Problem;
use std::ops::Range;

/// Duals and memory. Arrays of parts are `[frame][part]`.
#[derive(Debug, Clone)]
pub(crate) struct Repair {
    pub(crate) duals: Duals<f64>,
    /// `e`, then the potential `z`.
    error: Vec<f64>,
    sides: [Vec<[f64; SIDES]>; 2],
    coefficients: Vec<f64>,
    /// Sums of the error over each part.
    sums: Vec<f64>,
    /// Linear system that balances the parts, `[part][part + 1]`.
    gram: Vec<f64>,
    /// `A 1` of each part, `[frame][part][rank]`.
    ones: Vec<f64>,
}

impl Repair {
    pub(crate) fn new(problem: &Problem<'_>) -> Self {
        let (frames, exact) = (problem.frames(), &problem.skin.operators);
        let (cells, parts) = (exact.cells(), problem.skin.parts.sizes.len());
        Self {
            duals: Duals::new(exact, problem, problem.bounds.is_some()),
            error: vec![0.0; frames * cells],
            sides: std::array::from_fn(|_| vec![[0.0; SIDES]; exact.unknowns()]),
            coefficients: vec![0.0; frames * exact.padded],
            sums: vec![0.0; frames * parts],
            gram: vec![0.0; parts * (parts + 1)],
            ones: vec![0.0; frames * parts * exact.rank],
        }
    }

    /// Takes the duals of a flow, and those of the bounds, which absorb a part of its error.
    pub(crate) fn take<T: Project>(
        &mut self,
        problem: &Problem<'_>,
        flow: &Flow<T>,
        images: &[f64],
        how: Boxes,
    ) {
        self.duals.take(&flow.duals, 1.0);
        if self.duals.held.is_empty() {
            return;
        }
        let cells = problem.skin.operators.cells();
        for frame in 0..problem.frames() {
            for part in 0..problem.skin.parts.sizes.len() {
                // the bound duals of a frame must not exceed the error that they balance
                let [mut force, mut sum] = [0.0; 2];
                for at in members(problem, part).map(|cell| frame * cells + cell) {
                    let (e, [most, least]) = (flow.error[at].to_f64(), how.limits(images[at]));
                    self.duals.held[at] = e.min(most).max(least) - e;
                    force += e;
                    sum += self.duals.held[at];
                }
                let share = if force * sum < 0.0 { (-force / sum).min(1.0) } else { 0.0 };
                members(problem, part)
                    .for_each(|cell| self.duals.held[frame * cells + cell] *= share);
            }
        }
    }

    /// Balances the duals exactly; returns their bound.
    pub(crate) fn bound(&mut self, problem: &Problem<'_>, dual: &mut [f64]) -> Bound {
        self.take_ones(problem);
        self.part_sums(problem, dual);
        // the second pass removes the rounding errors of the first
        for _ in 0..2 {
            runs(problem).for_each(|run| self.balance_by_data(problem, dual, run));
            self.part_sums(problem, dual);
        }
        if problem.linked() {
            self.balance_by_links(problem);
        }
        self.balance_by_bounds(problem, dual);
        self.remove_error(problem, dual);
        self.scaled(problem, dual)
    }

    /// Balances the force of `y` alone over linked frames; not with bounds, which may carry a part of it.
    pub(crate) fn balance_alone(&mut self, problem: &Problem<'_>, dual: &mut [f64]) {
        if problem.bounds.is_none() {
            self.take_ones(problem);
            self.data_sums(problem, dual);
            runs(problem).for_each(|run| self.balance_by_data(problem, dual, run));
        }
    }

    /// Computes the measurements of an image of 1 on each part.
    fn take_ones(&mut self, problem: &Problem<'_>) {
        let (parts, rank) = (&problem.skin.parts.sensitivity, problem.skin.singular.len());
        for (frame, own) in self.ones.chunks_exact_mut(parts.len() * rank).enumerate() {
            let rows = own.chunks_exact_mut(rank).zip(parts);
            rows.for_each(|(row, sensitivity)| problem.mode(frame).apply(sensitivity, row));
        }
    }

    /// Sums the force of `y` over each part.
    fn data_sums(&mut self, problem: &Problem<'_>, dual: &[f64]) {
        let (parts, rank) = (problem.skin.parts.sizes.len(), problem.skin.singular.len());
        let padded = problem.skin.operators.padded;
        let rows = self.ones.chunks_exact(parts * rank).zip(dual.chunks_exact(padded));
        for (sums, (ones, y)) in self.sums.chunks_exact_mut(parts).zip(rows) {
            multiply(ones, &y[..rank], sums);
        }
    }

    /// Sums the error over each part; `D' q` sums to zero on each.
    fn part_sums(&mut self, problem: &Problem<'_>, dual: &[f64]) {
        self.data_sums(problem, dual);
        let (parts, exact) = (&problem.skin.parts, &problem.skin.operators);
        let cells = exact.cells();
        for frame in 0..problem.frames() {
            let sums = &mut self.sums[frame * parts.sizes.len()..][..parts.sizes.len()];
            for (&label, &cell) in parts.label.iter().zip(&exact.places.cells) {
                let at = frame * cells + cell;
                if !self.duals.links.is_empty() {
                    sums[label as usize] += self.duals.links[at] - self.duals.links[at + cells];
                }
                sums[label as usize] += self.duals.held.get(at).copied().unwrap_or(0.0);
            }
        }
    }

    /// Applies `y_t -= sum_p theta_p a_tp` over the frames of a run, so that the sums of all parts
    /// vanish together, with `a_tp = A_t 1` on part `p`: least squares over the parts, which share `y`.
    fn balance_by_data(&mut self, problem: &Problem<'_>, dual: &mut [f64], run: Range<usize>) {
        let (parts, rank) = (problem.skin.parts.sizes.len(), problem.skin.singular.len());
        let Self { gram, ones, sums, .. } = self;
        gram.fill(0.0);
        for frame in run.clone() {
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
        for frame in run {
            let forces = ones[frame * parts * rank..][..parts * rank].chunks_exact(rank);
            let own = &mut dual[frame * problem.skin.operators.padded..][..rank];
            for (force, theta) in forces.zip(gram.chunks_exact(parts + 1)) {
                own.iter_mut().zip(force).for_each(|(y, a)| *y -= theta[parts] * a);
            }
        }
    }

    /// Carries the sums of all parts to the last frame.
    fn balance_by_links(&mut self, problem: &Problem<'_>) {
        let (parts, cells) = (&problem.skin.parts, problem.skin.operators.cells());
        for (part, size) in parts.sizes.iter().enumerate() {
            let mut carried = 0.0;
            for frame in 0..problem.frames() {
                let sum = &mut self.sums[frame * parts.sizes.len() + part];
                carried += *sum;
                if frame + 1 == problem.frames() {
                    *sum = carried;
                    continue;
                }
                *sum = 0.0;
                for cell in members(problem, part) {
                    self.duals.links[(frame + 1) * cells + cell] += carried / size;
                }
            }
        }
    }

    /// Balances with the bound duals what `y` and `q_t` could not, since a frame has fewer channels than parts.
    /// A frame whose bounds do not allow that proves nothing: its duals are set to zero.
    fn balance_by_bounds(&mut self, problem: &Problem<'_>, dual: &mut [f64]) {
        let Some([lower, upper]) = problem.bounds else { return };
        if !self.is_unbalanced(problem, dual, 0..problem.frames()) {
            return;
        }
        let (sizes, exact) = (&problem.skin.parts.sizes, &problem.skin.operators);
        let (parts, cells) = (sizes.len(), exact.cells());
        for frame in 0..problem.frames() {
            for (part, size) in sizes.iter().enumerate() {
                let sum = self.sums[frame * parts + part];
                let places = || members(problem, part).map(|cell| frame * cells + cell);
                // a dual of this sign can always be reduced; one of the other sign needs a finite bound
                let held: f64 =
                    places().map(|at| self.duals.held[at]).filter(|p| p * sum > 0.0).sum();
                let reduced = if held == 0.0 { 0.0 } else { (sum / held).min(1.0) };
                let bound = if sum > 0.0 { lower } else { upper };
                let rest = sum - reduced * held;
                let added = if bound.is_finite() { rest / size } else { 0.0 };
                for at in places() {
                    let p = self.duals.held[at];
                    self.duals.held[at] -= added + if p * sum > 0.0 { reduced * p } else { 0.0 };
                }
                self.sums[frame * parts + part] = rest - added * size;
            }
            if !problem.linked() && self.is_unbalanced(problem, dual, frame..frame + 1) {
                dual[frame * exact.padded..][..exact.padded].fill(0.0);
                self.duals
                    .flow
                    .iter_mut()
                    .for_each(|q| q[frame * exact.groups..][..exact.groups].fill(0.0));
                self.duals.held[frame * cells..][..cells].fill(0.0);
                self.sums[frame * parts..][..parts].fill(0.0);
            }
        }
    }

    /// Returns whether the sum of any part exceeds rounding error in one of the frames.
    fn is_unbalanced(&self, problem: &Problem<'_>, dual: &[f64], frames: Range<usize>) -> bool {
        let sensitivity = &problem.skin.parts.sensitivity;
        let most = |values: &[f64]| values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let dual = most(dual);
        sensitivity.iter().enumerate().any(|(part, own)| {
            let scale = most(own) * dual;
            frames.clone().any(|f| self.sums[f * sensitivity.len() + part].abs() > 1e-12 * scale)
        })
    }

    /// Computes the error of the equation and removes it from `q`.
    fn remove_error(&mut self, problem: &Problem<'_>, dual: &[f64]) {
        let ops = &problem.skin.operators;
        let (cells, rank, frames) = (ops.cells(), ops.rank, problem.frames());
        let rows =
            self.coefficients.chunks_exact_mut(ops.padded).zip(dual.chunks_exact(ops.padded));
        for (frame, (c, y)) in rows.enumerate() {
            problem.mode(frame).apply_transposed(&y[..rank], &mut c[..rank]);
        }
        ops.expand(&self.coefficients, 0..ops.padded, false, &mut self.error);
        for_basis!(ops, |differences| self.add_forces(ops, differences));
        let [x, work] = &mut self.sides;
        for first in (0..frames).step_by(SIDES) {
            let known = SIDES.min(frames - first);
            for (x, &cell) in x.iter_mut().zip(&ops.places.cells) {
                *x = [0.0; SIDES];
                for (l, x) in x.iter_mut().enumerate().take(known) {
                    *x = self.error[(first + l) * cells + cell];
                }
            }
            problem.skin.laplacian.solve(x, work);
            for (x, &cell) in x.iter().zip(&ops.places.cells) {
                for (l, x) in x.iter().enumerate().take(known) {
                    self.error[(first + l) * cells + cell] = *x;
                }
            }
        }
        for_basis!(ops, |differences| self.subtract_potential(ops, differences));
    }

    /// Adds the forces of all duals but `y` to the error.
    #[inline(always)]
    fn add_forces<D: Differences<f64>>(&mut self, ops: &Operators<f64>, differences: &D) {
        for (frame, error) in self.error.chunks_exact_mut(ops.cells()).enumerate() {
            let q = self.duals.flow_of(frame);
            for (block, &at) in ops.places.blocks.iter().enumerate() {
                let place = (block, at, frame * ops.cells() + at);
                let e = self.duals.pull(differences, q, place, load(error, at));
                store(error, at, e);
            }
        }
    }

    /// Computes `q -= D z` with `z` in the place of the error.
    #[inline(always)]
    fn subtract_potential<D: Differences<f64>>(&mut self, ops: &Operators<f64>, differences: &D) {
        for (frame, z) in self.error.chunks_exact(ops.cells()).enumerate() {
            for &at in differences.group_blocks() {
                let (change, here) = (differences.difference(z, at), frame * ops.groups + at);
                for (q, change) in self.duals.flow.iter_mut().zip(change) {
                    let own = load(q, here);
                    store(q, here, each!(|l| own[l] - change[l]));
                }
            }
        }
    }

    /// Returns the bound at the best feasible scale.
    fn scaled(&self, problem: &Problem<'_>, dual: &[f64]) -> Bound {
        let is_unbalanced = self.is_unbalanced(problem, dual, 0..problem.frames());
        let (space, time) = (problem.lambda_space, problem.lambda_time);
        let excess = self.duals.largest_ratio(&problem.skin.operators, space, time);
        let [constant, linear, square] = of_data(problem, dual);
        if is_unbalanced || !excess.is_finite() {
            return Bound::scaled(constant, 0.0, 0.0, 0.0);
        }
        let linear = linear - self.support(problem);
        Bound::scaled(constant, linear, square, 1.0 / excess.max(1.0))
    }

    /// Returns `h(p)`.
    fn support(&self, problem: &Problem<'_>) -> f64 {
        let Some([lower, upper]) = problem.bounds else { return 0.0 };
        let term = |p: &f64| match *p {
            p if p > 0.0 => upper * p,
            p if p < 0.0 => lower * p,
            _ => 0.0,
        };
        self.duals.held.iter().map(term).sum()
    }
}

/// Returns the cells of a part.
fn members<'a>(problem: &Problem<'a>, part: usize) -> impl Iterator<Item = usize> + use<'a> {
    let skin = problem.skin;
    let cells = skin.parts.label.iter().zip(&skin.operators.places.cells);
    cells.filter(move |(label, _)| **label as usize == part).map(|(_, &cell)| cell)
}

/// Returns the runs of linked frames.
fn runs(problem: &Problem<'_>) -> impl Iterator<Item = Range<usize>> + use<> {
    let frames = problem.frames();
    let length = if problem.linked() { frames } else { 1 };
    (0..frames).step_by(length).map(move |first| first..first + length)
}
