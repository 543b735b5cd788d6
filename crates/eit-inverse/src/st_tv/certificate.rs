//! Proven lower bound of a problem.
//!
//! For any `y` (one vector a frame), `|q_g| <= lambda_space size_g`, `|q_t| <= lambda_time area` and `r` with
//! `A' y + D' q + D_t' q_t + r = 0`, weak duality gives, for every image within bounds and with `beta = b - A x^`,
//!
//! ```text
//! penalised:    objective >= sum_t -y.beta - |y|^2 / 2 + rest^2 / 2 + q.D x^ - h(r)
//! constrained:  objective >= sum_t -y.beta - delta |y|              + q.D x^ - h(r)
//! h(r) = (r - lambda_anchor a) (upper - x^)    where r >  lambda_anchor a
//!        (-r - lambda_anchor a) (x^ - lower)   where r < -lambda_anchor a,   else 0
//! ```
//!
//! with `a` the area of the unknown, and `x^ = 0` and `lambda_anchor = 0` without an anchor; `h` is infinite if there
//! is no bound on that side. `y`, `q` and `q_t` come from an iterate and a search that starts from it (see
//! [`super::flow`]). With an anchor `r` is computed from the equation, which then holds exactly; without one it is what
//! bounds can take, and the rest is removed exactly (see [`super::repair`]). Duals that violate their limits are scaled
//! down: `(s y, s q, s q_t, s r)` is feasible for `s <= 1 / kappa`, and the best scale has a closed form. The bound
//! therefore does not depend on the iteration, its step sizes or `f32`: it is valid for any input.
//!
//! # Rounding
//! `y` and its products with the data are in `f64`. With an anchor, the force `f = V F y` and `D' q` may be in `f32`.
//! Both are sums of known terms, so that their rounding error is bounded by the sizes of these terms
//! (Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd ed., 3.1), and that bound is added
//! to every `|r|`. Without an anchor all final values are in `f64`, up to about 1e-13 of the objective.

use super::anchored::Best;
use super::bound::Bound;
use super::differences::for_basis;
use super::duals::convert;
use super::flow::{Boxes, Flow};
use super::iterate::LARGEST_WEIGHT;
use super::lanes::{LANES, Project};
use super::operators::Operators;
use super::problem::Problem;
use super::repair::Repair;
use super::state::State;

/// Steps of the flow search of an anchored frame, and how many of them are shifted.
const STEPS: usize = 40;
const SHIFTED: usize = 10;
/// Factor on all changes of `y` but the last. With 1.8 and changes after every step the search diverges; 1.3 and 1.7
/// take as many iterations to 1e-3.
const OVER: f64 = 1.5;
/// Squared singular value, relative to the largest, below which `y` hardly changes. 1e-7 takes as many iterations to
/// 1e-3 and a tenth more to 1e-2, 1e-5 up to a twentieth more to 1e-3.
const STIFF: f64 = 1e-6;

/// Settings of the search.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Effort {
    /// Number of changes of `y`; none with an anchor.
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

    /// Returns the search for an anchored frame.
    pub(crate) fn anchored(slack: f64) -> Self {
        Self { rounds: 0, steps: STEPS, lean: 1.0, slack }
    }
}

/// Memory for bounds.
#[derive(Debug, Clone)]
pub(crate) struct Certificate<T: Project> {
    pub(crate) flow: Flow<T>,
    /// Dual of the data in each frame's mode, `[frame][padded rank]`.
    pub(crate) dual: Vec<f64>,
    /// Without an anchor.
    repair: Option<Repair>,
    before: Vec<f64>,
    columns: [Vec<f64>; 2],
}

impl<T: Project> Certificate<T> {
    pub(crate) fn new(ops: &Operators<T>, problem: &Problem<'_>) -> Self {
        let is_free = !problem.is_held();
        let ranks = problem.frames() * ops.padded;
        Self {
            flow: Flow::new(ops, problem),
            dual: vec![0.0; ranks],
            repair: is_free.then(|| Repair::new(problem)),
            before: vec![0.0; if is_free { ranks } else { 0 }],
            columns: std::array::from_fn(|_| vec![0.0; ops.padded]),
        }
    }

    /// Computes a lower bound from the duals of an iterate and those of its data in `dual`, with images near the optimum
    /// of this size, over cells.
    pub(crate) fn bound(
        &mut self,
        problem: &Problem<'_>,
        ops: &Operators<T>,
        state: &State<T>,
        (images, size): (&[f64], f64),
        effort: Effort,
    ) -> Bound {
        if let Some(repair) = &mut self.repair {
            repair.balance_alone(problem, &mut self.dual);
        }
        self.set_force(problem, ops.padded);
        let larger = 1.0 + effort.slack;
        let weight = |lambda: f64| larger * lambda.min(LARGEST_WEIGHT);
        let how = Boxes {
            lambda_space: weight(problem.lambda_space),
            lambda_time: weight(problem.lambda_time),
            lambda_anchor: weight(problem.anchor.map_or(0.0, |anchor| anchor.lambda)),
            bounds: problem.bounds,
            mu: match size {
                0.0 => 1.0,
                size => problem.lambda_space * ops.mean_radius / size,
            },
        };
        self.flow.start(ops, state, images, how);
        let shift = effort.lean * how.mu;
        if let Some(anchor) = problem.anchor.filter(|anchor| anchor.lambda > 0.0) {
            let rounding = self.rounding(problem, ops);
            self.flow.advance(ops, shift, SHIFTED);
            self.flow.advance(ops, 0.0, effort.steps - SHIFTED);
            self.flow.finish(ops);
            let ratio = self.flow.duals.largest_ratio(ops, how.lambda_space, how.lambda_time);
            // allows for the rounding of norm, division and radius
            let ratio = larger * ratio * (1.0 + 8.0 * T::EPSILON);
            let (exact, flow, dual) = (&problem.skin.operators, &self.flow, &self.dual);
            return for_basis!(exact, |differences| {
                Best { problem, anchor, differences, flow, dual, ratio, rounding }.bound()
            });
        }
        if effort.rounds == 0 {
            self.flow.advance(ops, 0.0, effort.steps);
        }
        let ranks = absorbing(problem, ops.padded);
        for round in 0..effort.rounds {
            let is_last = round + 1 == effort.rounds;
            let leans = round < effort.rounds * 3 / 4;
            self.flow.advance(ops, if leans { shift } else { 0.0 }, effort.steps);
            self.flow.analyse(ops, ranks);
            self.absorb(problem, ops.padded, ranks, if is_last { 1.0 } else { OVER });
            self.flow.push(ops, ranks, true);
        }
        if how.bounds.is_some() {
            self.flow.finish(ops);
        }
        let Some(repair) = &mut self.repair else { return Bound::nothing() };
        repair.take(problem, &self.flow, images, how);
        repair.bound(problem, &mut self.dual)
    }

    /// Computes a lower bound from the data duals in `dual` alone, for constant images.
    pub(crate) fn bound_of_constants(&mut self, problem: &Problem<'_>) -> Bound {
        let Some(repair) = &mut self.repair else { return Bound::nothing() };
        repair.duals.scale(0.0);
        repair.bound(problem, &mut self.dual)
    }

    /// Writes the flow of the last bound, before scaling.
    pub(crate) fn flow_into(&self, out: &mut [Vec<f64>; 2]) {
        for (component, out) in out.iter_mut().enumerate() {
            match &self.repair {
                Some(repair) => out.copy_from_slice(&repair.duals.flow[component]),
                None => convert(&self.flow.duals.flow[component], 1.0, out),
            }
        }
    }

    /// Computes the coefficients of the force of the data, `F y` of each frame.
    fn set_force(&mut self, problem: &Problem<'_>, padded: usize) {
        let rank = problem.skin.singular.len();
        let rows =
            self.dual.chunks_exact(padded).zip(self.flow.coefficients.chunks_exact_mut(padded));
        for (frame, (y, c)) in rows.enumerate() {
            problem.mode(frame).apply_transposed(&y[..rank], &mut c[..rank]);
        }
    }

    /// Changes `y` such that its force balances a part of the error of the flow, whose coefficients are replaced by
    /// the change of the force:
    ///
    /// ```text
    /// y -= factor D A e,     D = 1 / (S^2 + STIFF) without masked channels     (see Seen::absorb)
    /// ```
    ///
    /// Flows alone are not enough: where `A' y` exceeds what the balls of an unknown allow, at the edge of an electrode
    /// or over a whole region, only `y` can help.
    fn absorb(&mut self, problem: &Problem<'_>, padded: usize, ranks: usize, factor: f64) {
        let rank = problem.skin.singular.len();
        let Self { flow, dual, before, columns: [column, change], repair, .. } = self;
        for frame in 0..problem.frames() {
            let (mode, at) = (problem.mode(frame), frame * padded);
            mode.apply_transposed(&dual[at..][..rank], &mut before[at..][..rank]);
            column.fill(0.0);
            let known = column.iter_mut().zip(&flow.coefficients[at..][..ranks]);
            known.for_each(|(own, c)| *own = factor * c);
            mode.absorb(&column[..rank], STIFF, &mut change[..rank]);
            dual[at..][..rank].iter_mut().zip(&*change).for_each(|(y, change)| *y -= change);
        }
        if let Some(repair) = repair {
            repair.balance_alone(problem, dual);
        }
        self.set_force(problem, padded);
        let coefficients = self.flow.coefficients.iter_mut().zip(&self.before);
        coefficients.for_each(|(c, before)| *c -= before);
    }

    /// Returns a bound on the rounding error of the force and of `D' q`, for one frame.
    fn rounding(&self, problem: &Problem<'_>, ops: &Operators<T>) -> f64 {
        let norm = self.flow.coefficients.iter().map(|c| c * c).sum::<f64>().sqrt();
        let unit = 0.5 * T::EPSILON;
        // both factors are rounded, then summed over the ranks
        let products = (ops.padded as f64 + 3.0) * unit * 1.01;
        let [terms, sum] = ops.adjoint_terms;
        // the flow is at most twice its radius; the weights are rounded too
        let adjoint = (terms + 4.0) * unit * 1.01 * 2.0 * sum * problem.lambda_space;
        // the final sum of the two
        let last = unit * (ops.longest_row * norm + sum * 2.0 * problem.lambda_space);
        products * ops.longest_row * norm + adjoint + last
    }
}

/// Returns the number of ranks in which `y` can absorb a part of the error.
fn absorbing(problem: &Problem<'_>, padded: usize) -> usize {
    if !problem.mode_of.iter().all(|&mode| problem.modes[mode].is_whole) {
        return padded;
    }
    let able = problem.skin.singular.iter().take_while(|&s| s * s > 0.1 * STIFF).count();
    able.next_multiple_of(LANES).min(padded)
}
