//! Exact balance of nearly feasible duals without an anchor, in `f64`.
//!
//! The error `e = A' y + D' q + D_t' q_t + p` must vanish. `y` and `q_t` absorb its sum over each connected part of the
//! skin: `y` balances the sum over all linked frames, `q_t` moves the rest from frame to frame; where a frame has fewer
//! channels than parts, the bound duals `p` take what is left. The remainder is removed by the smallest flow `D z` with
//! `D' D z = e`.

use super::certificate::{Bound, of_data};
use super::dense::multiply;
use super::differences::{Differences, for_basis};
use super::flow::{Boxes, Flow};
use super::iterate::Expand;
use super::lanes::{Lane, Project, each, largest, load, splat, store};
use super::laplacian::SIDES;
use super::operators::Operators;
use super::problem::Problem;
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// Duals and memory. Arrays are as in [`super::state`], and those of parts `[frame][part]`.
#[derive(Debug, Clone)]
pub(crate) struct Repair {
    pub(crate) flow: [Vec<f64>; 2],
    links: Vec<f64>,
    /// `p`; empty without bounds.
    held: Vec<f64>,
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
        let zeros = |is_used: bool, count: usize| vec![0.0; if is_used { count } else { 0 }];
        Self {
            flow: std::array::from_fn(|_| vec![0.0; frames * exact.groups]),
            links: zeros(problem.linked(), (frames + 1) * cells),
            held: zeros(problem.bounds.is_some(), frames * cells),
            error: vec![0.0; frames * cells],
            sides: std::array::from_fn(|_| vec![[0.0; SIDES]; exact.unknowns()]),
            coefficients: vec![0.0; frames * exact.padded],
            sums: vec![0.0; frames * parts],
            gram: vec![0.0; parts * (parts + 1)],
            ones: vec![0.0; frames * parts * exact.rank],
        }
    }

    pub(crate) fn clear(&mut self) {
        let [first, second] = &mut self.flow;
        for array in [first, second, &mut self.links, &mut self.held] {
            array.fill(0.0);
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
        let [first, second] = &mut self.flow;
        let pairs =
            [(first, &flow.flow[0]), (second, &flow.flow[1]), (&mut self.links, &flow.links)];
        for (to, from) in pairs {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = from.to_f64());
        }
        if self.held.is_empty() {
            return;
        }
        let cells = problem.skin.operators.cells();
        for frame in 0..problem.frames() {
            for part in 0..problem.skin.parts.sizes.len() {
                // the bound duals of a frame must not exceed the error that they balance
                let [mut force, mut sum] = [0.0; 2];
                for at in members(problem, part).map(|cell| frame * cells + cell) {
                    let (e, [most, least]) = (flow.error[at].to_f64(), how.limits(images[at]));
                    self.held[at] = e.min(most).max(least) - e;
                    force += e;
                    sum += self.held[at];
                }
                let share = if force * sum < 0.0 { (-force / sum).min(1.0) } else { 0.0 };
                members(problem, part).for_each(|cell| self.held[frame * cells + cell] *= share);
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
                if !self.links.is_empty() {
                    sums[label as usize] += self.links[at] - self.links[at + cells];
                }
                sums[label as usize] += self.held.get(at).copied().unwrap_or(0.0);
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
                    self.links[(frame + 1) * cells + cell] += carried / size;
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
                let held: f64 = places().map(|at| self.held[at]).filter(|p| p * sum > 0.0).sum();
                let reduced = if held == 0.0 { 0.0 } else { (sum / held).min(1.0) };
                let bound = if sum > 0.0 { lower } else { upper };
                let rest = sum - reduced * held;
                let added = if bound.is_finite() { rest / size } else { 0.0 };
                for at in places() {
                    let p = self.held[at];
                    self.held[at] -= added + if p * sum > 0.0 { reduced * p } else { 0.0 };
                }
                self.sums[frame * parts + part] = rest - added * size;
            }
            if !problem.linked() && self.is_unbalanced(problem, dual, frame..frame + 1) {
                dual[frame * exact.padded..][..exact.padded].fill(0.0);
                self.flow
                    .iter_mut()
                    .for_each(|q| q[frame * exact.groups..][..exact.groups].fill(0.0));
                self.held[frame * cells..][..cells].fill(0.0);
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
        let (arch, ops) = (problem.skin.arch, &problem.skin.operators);
        let (cells, rank, frames) = (ops.cells(), ops.rank, problem.frames());
        let rows =
            self.coefficients.chunks_exact_mut(ops.padded).zip(dual.chunks_exact(ops.padded));
        for (frame, (c, y)) in rows.enumerate() {
            problem.mode(frame).apply_transposed(&y[..rank], &mut c[..rank]);
        }
        let (z, out) = (&self.coefficients, &mut self.error);
        arch.dispatch(Expand { ops, frames, ranks: 0..ops.padded, z, add: false, out });
        for_basis!(arch, ops.basis, |differences| Add { ops, differences, repair: &mut *self });
        let [x, work] = &mut self.sides;
        for first in (0..frames).step_by(SIDES) {
            let known = SIDES.min(frames - first);
            for (x, &cell) in x.iter_mut().zip(&ops.places.cells) {
                *x = [0.0; SIDES];
                for (l, x) in x.iter_mut().enumerate().take(known) {
                    *x = self.error[(first + l) * cells + cell];
                }
            }
            problem.skin.laplacian.solve(arch, x, work);
            for (x, &cell) in x.iter().zip(&ops.places.cells) {
                for (l, x) in x.iter().enumerate().take(known) {
                    self.error[(first + l) * cells + cell] = *x;
                }
            }
        }
        for_basis!(arch, ops.basis, |differences| Subtract {
            ops,
            differences,
            repair: &mut *self
        });
    }

    /// Returns the bound at the best feasible scale.
    fn scaled(&self, problem: &Problem<'_>, dual: &[f64]) -> Bound {
        let (arch, basis) = (problem.skin.arch, &problem.skin.operators.basis);
        let is_unbalanced = self.is_unbalanced(problem, dual, 0..problem.frames());
        let excess =
            for_basis!(arch, *basis, |differences| Excess { problem, differences, repair: self });
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
        self.held.iter().map(term).sum()
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

/// Adds the forces of all duals but `y` to the error.
struct Add<'a, D> {
    ops: &'a Operators<f64>,
    differences: &'a D,
    repair: &'a mut Repair,
}

impl<D: Differences<f64>> WithSimd for Add<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { ops, differences, repair } = self;
        let Repair { flow, links, held, error, .. } = repair;
        let (cells, groups) = (ops.cells(), ops.groups);
        for frame in 0..error.len() / cells {
            let own = frame * groups..(frame + 1) * groups;
            let q = [&flow[0][own.clone()], &flow[1][own]];
            for (block, &at) in ops.places.blocks.iter().enumerate() {
                let here = frame * cells + at;
                let (divergence, mut e) = (differences.adjoint(q, block, at), load(error, here));
                if !links.is_empty() {
                    let (own, next) = (load(links, here), load(links, here + cells));
                    e = each(|l| e[l] + (own[l] - next[l]));
                }
                if !held.is_empty() {
                    let p = load(held, here);
                    e = each(|l| e[l] + p[l]);
                }
                store(error, here, each(|l| e[l] + divergence[l]));
            }
        }
    }
}

/// Computes `q -= D z` with `z` in the place of the error.
struct Subtract<'a, D> {
    ops: &'a Operators<f64>,
    differences: &'a D,
    repair: &'a mut Repair,
}

impl<D: Differences<f64>> WithSimd for Subtract<'_, D> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { ops, differences, repair } = self;
        let [first, second] = &mut repair.flow;
        for (frame, z) in repair.error.chunks_exact(ops.cells()).enumerate() {
            for &at in differences.group_blocks() {
                let ([a, b], here) = (differences.difference(z, at), frame * ops.groups + at);
                let (qa, qb) = (load(first, here), load(second, here));
                store(first, here, each(|l| qa[l] - a[l]));
                store(second, here, each(|l| qb[l] - b[l]));
            }
        }
    }
}

/// Computes the largest ratio of a dual to its radius; infinite if a dual with radius zero is non-zero.
struct Excess<'a, D> {
    problem: &'a Problem<'a>,
    differences: &'a D,
    repair: &'a Repair,
}

impl<D: Differences<f64>> WithSimd for Excess<'_, D> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { problem, differences, repair } = self;
        let ops = &problem.skin.operators;
        let Problem { lambda_space, lambda_time, .. } = *problem;
        let mut most: Lane<f64> = splat(0.0);
        for frame in 0..problem.frames() {
            for &at in differences.group_blocks() {
                let here = frame * ops.groups + at;
                let (a, b) = (load(&repair.flow[0], here), load(&repair.flow[1], here));
                let radius = differences.group_radius(at);
                most = each(|l| {
                    let norm = a[l].mul_add(a[l], b[l] * b[l]).sqrt();
                    let ratio = norm / (lambda_space * radius[l]);
                    if norm > 0.0 && ratio > most[l] { ratio } else { most[l] }
                });
            }
        }
        if !repair.links.is_empty() {
            for frame in 1..problem.frames() {
                for &at in &ops.places.blocks {
                    let q = load(&repair.links, frame * ops.cells() + at);
                    let radius = differences.cell_radius(at);
                    most = each(|l| {
                        let ratio = q[l].abs() / (lambda_time * radius[l]);
                        if q[l] != 0.0 && ratio > most[l] { ratio } else { most[l] }
                    });
                }
            }
        }
        largest(&most)
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
