//! Candidate images of an evaluation and their objective, in `f64`, or rounded up by a bound on the error of
//! products in `f32`.

use super::ball;
use super::dense::{dot, multiply};
use super::differences::{Differences, for_basis};
use super::fit::DataSteps;
use super::lanes::{BLOCKS, LANES, Lane, Project, each, load, total};
use super::operators::Operators;
use super::problem::Problem;
use super::products::SUMMED_PANELS;
use super::state::{State, TOGETHER};

/// Maximum number of steps that move an image into the data constraint.
const REPAIRS: usize = 8;
/// Reduction of the target radius from one step to the next, because clipping to the bounds undoes a part
/// of a step.
const DEEPER: f64 = 0.02;

/// A candidate and its evaluation, in internal units. Arrays are `[frame][cell]` or `[frame][padded rank]`.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    /// Change from the anchor; the images themselves without one.
    pub(crate) change: Vec<f64>,
    pub(crate) images: Vec<f64>,
    /// `V'` times the change.
    pub(crate) coefficients: Vec<f64>,
    /// `A x - b`, `[row of F']`.
    pub(crate) residual: Vec<f64>,
    /// `|A x - b|` of each frame, with the unexplained part of the data.
    pub(crate) misfit: Vec<f64>,
    /// Infinite if a data constraint is violated.
    pub(crate) primal: f64,
    column: Vec<f64>,
    sums: Vec<Lane<f64>>,
}

impl Candidate {
    pub(crate) fn new(problem: &Problem<'_>) -> Self {
        let (frames, exact) = (problem.frames(), &problem.skin.operators);
        let (cells, ranks) = (frames * exact.cells(), frames * exact.padded);
        Self {
            change: vec![0.0; cells],
            images: vec![0.0; cells],
            coefficients: vec![0.0; ranks],
            residual: vec![0.0; ranks],
            misfit: vec![0.0; frames],
            primal: f64::INFINITY,
            column: vec![0.0; exact.padded],
            sums: vec![[0.0; LANES]; TOGETHER.min(frames) * exact.padded],
        }
    }

    /// Takes the images of an iterate, clipped to the bounds. Changes from an anchor are reduced by `threshold`, so
    /// that pixels that did not move are exactly unmoved.
    pub(crate) fn take<T: Project>(
        &mut self,
        problem: &Problem<'_>,
        state: &State<T>,
        threshold: f64,
    ) {
        let [lower, upper] = problem.bounds.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        let exact = &problem.skin.operators;
        for frame in 0..state.frames {
            let base = frame * state.cells;
            for &cell in &exact.places.cells {
                let fresh = state.fresh[base + cell].to_f64();
                self.change[base + cell] = match problem.anchor {
                    None => (state.origin[base + cell].to_f64() + fresh).clamp(lower, upper),
                    Some(anchor) => {
                        let moved = fresh - fresh.clamp(-threshold, threshold);
                        let x = anchor.image[cell];
                        if moved == 0.0 { 0.0 } else { (x + moved).clamp(lower, upper) - x }
                    }
                };
            }
        }
    }

    /// Evaluates the change. With the steps of an iterate, images outside their data constraints are moved into them.
    pub(crate) fn evaluate<T: Project>(
        &mut self,
        problem: &Problem<'_>,
        steps: Option<(&State<T>, &DataSteps<T>)>,
    ) {
        for repairs in 0..=REPAIRS {
            let exact = &problem.skin.operators;
            exact.analyse(&self.change, exact.padded, &mut self.sums, &mut self.coefficients);
            let mut is_feasible = true;
            for frame in 0..problem.frames() {
                let square = self.residual_of(problem, frame);
                self.misfit[frame] = (square + problem.targets[frame].rest_squared).sqrt();
                if let Some(ball) = problem.ball(frame) {
                    // tolerance for the rounding of this evaluation; the data has norm 1
                    is_feasible &= square.sqrt() <= ball.sqrt() * (1.0 + 1e-9) + 1e-12;
                }
            }
            match steps {
                Some(steps) if !is_feasible && repairs < REPAIRS => {
                    self.meet_constraints(problem, steps, 1.0 - DEEPER * repairs as f64);
                }
                _ => {
                    self.finish(problem);
                    self.primal = if is_feasible { self.primal } else { f64::INFINITY };
                    break;
                }
            }
        }
    }

    /// Evaluates the change of a penalised frame with an anchor with products in `T`, whose rounding errors increase
    /// the objective.
    pub(crate) fn evaluate_rounded<T: Project>(
        &mut self,
        problem: &Problem<'_>,
        ops: &Operators<T>,
        sums: &mut [Lane<T>],
    ) {
        ops.analyse(&self.change, ops.padded, sums, &mut self.coefficients);
        let root = self.residual_of(problem, 0).sqrt() + self.misfit_error(ops);
        self.misfit[0] = root.hypot(problem.targets[0].rest_squared.sqrt());
        self.finish(problem);
    }

    /// Returns an upper bound on the rounding error of `|F' c - t|`, using `|F| <= 1`.
    ///
    /// `V`, the change, and each product that is summed in a lane before conversion to `f64` contribute half a
    /// unit each (Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd ed., 3.1).
    fn misfit_error<T: Project>(&self, ops: &Operators<T>) -> f64 {
        let sum: f64 = ops.places.cells.iter().map(|&cell| self.change[cell].abs()).sum();
        let roundings = 2.0 + (SUMMED_PANELS * BLOCKS) as f64;
        0.51 * roundings * T::EPSILON * ops.longest_row * sum
    }

    /// Computes the residual of a frame from its coefficients; returns its squared norm.
    fn residual_of(&mut self, problem: &Problem<'_>, frame: usize) -> f64 {
        let exact = &problem.skin.operators;
        let (rank, at) = (exact.rank, frame * exact.padded);
        let (mode, beta) = (problem.mode(frame), problem.beta(frame));
        let residual = &mut self.residual[at..][..rank];
        mode.apply(&self.coefficients[at..][..rank], residual);
        let mut square = 0.0;
        for (own, beta) in residual.iter_mut().zip(beta).take(mode.rows) {
            *own -= beta;
            square += *own * *own;
        }
        square
    }

    /// Computes images and objective of the evaluated residuals.
    fn finish(&mut self, problem: &Problem<'_>) {
        let exact = &problem.skin.operators;
        match problem.anchor {
            None => self.images.copy_from_slice(&self.change),
            Some(anchor) => {
                for &cell in &exact.places.cells {
                    self.images[cell] = anchor.image[cell] + self.change[cell];
                }
            }
        }
        let variation = for_basis!(exact, |differences| self.variation(problem, differences));
        let squares: f64 = self.misfit.iter().map(|m| m * m).sum();
        self.primal = variation + if problem.delta.is_some() { 0.0 } else { 0.5 * squares };
    }

    /// Projects frames onto their data constraints, times a share of the radius, in the metric of the step map, then
    /// clips them to the bounds.
    fn meet_constraints<T: Project>(
        &mut self,
        problem: &Problem<'_>,
        (state, data): (&State<T>, &DataSteps<T>),
        share: f64,
    ) {
        let ops = &problem.skin.operators;
        let (cells, frames) = (ops.cells(), problem.frames());
        self.coefficients.fill(0.0);
        for frame in 0..frames {
            let (step, at) = (data.step(frame), frame * ops.padded);
            let rows = step.rows;
            let residual = &self.residual[at..][..rows];
            let ball = problem.ball(frame).unwrap_or(f64::INFINITY);
            if dot(residual, residual) <= ball {
                continue;
            }
            // slightly smaller, to allow for the rounding of the map
            let inside = ball * share * share * (1.0 - 1e-6);
            let turned = &mut self.column[..rows];
            multiply(&step.vectors[..rows * rows], residual, turned);
            let values = step.values[..rows].iter().copied();
            let mu = ball::multiplier(|| turned.iter().copied().zip(values.clone()), inside);
            for (u, value) in turned.iter_mut().zip(&step.values) {
                *u = ball::dual(*u, *value, mu);
            }
            // until they are computed anew, the memory of the coefficients holds the force
            let forces = &mut self.coefficients[at..][..ops.rank];
            multiply(&step.back[..ops.rank * rows], turned, forces);
        }
        ops.expand(&self.coefficients, 0..ops.padded, false, &mut self.images);
        let [lower, upper] = problem.bounds.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
        for frame in 0..frames {
            for &cell in &ops.places.cells {
                let at = frame * cells + cell;
                let moved = self.change[at] - state.tau_of(frame, cell) * self.images[at];
                let x = problem.anchor.map_or(0.0, |anchor| anchor.image[cell]);
                self.change[at] = (x + moved).clamp(lower, upper) - x;
            }
        }
    }

    /// Computes `lambda_space |D x|_{2,1} + lambda_time |D_t x|_1 + lambda_anchor |d|_1`.
    #[inline(always)]
    fn variation<D: Differences<f64>>(&self, problem: &Problem<'_>, differences: &D) -> f64 {
        let exact = &problem.skin.operators;
        let cells = exact.cells();
        let [mut space, mut time, mut held]: [Lane<f64>; 3] = [[0.0; LANES]; 3];
        for image in self.images.chunks_exact(cells) {
            for &at in differences.group_blocks() {
                let [a, b] = differences.difference(image, at);
                let radius = differences.group_radius(at);
                space = each!(|l| {
                    let norm = a[l].mul_add(a[l], b[l] * b[l]).sqrt();
                    radius[l].mul_add(norm, space[l])
                });
            }
        }
        if problem.linked() {
            for frame in 1..problem.frames() {
                let (before, own) = self.images[(frame - 1) * cells..].split_at(cells);
                for &at in &exact.places.blocks {
                    let (x, y) = (load(before, at), load(own, at));
                    let radius = differences.cell_radius(at);
                    time = each!(|l| radius[l].mul_add((y[l] - x[l]).abs(), time[l]));
                }
            }
        }
        if let Some(anchor) = problem.anchor {
            for &at in &exact.places.blocks {
                let (d, radius) = (load(&self.change, at), differences.cell_radius(at));
                held = each!(|l| radius[l].mul_add(d[l].abs(), held[l]));
            }
            held = each!(|l| anchor.lambda * held[l]);
        }
        problem.lambda_space * total(&space) + problem.lambda_time * total(&time) + total(&held)
    }
}
