//! Candidate image of an evaluation and its objective, in `f64`, or rounded up by a bound on the error of
//! products in `f32`.
//!
//! Over 300 lines because all ways to a candidate (unchanged, zero, from an iterate) share one record.

use super::bound::Proof;
use super::differences::{Basis, Differences};
use super::fields::Setting;
use super::frame::{Engine, Problem};
use super::iterate::dot;
use super::lanes::{BLOCKS, LANES, Lane, Project, each, load, total};
use crate::st_tv::ball;
use crate::st_tv::schedule::{LEAST_SHORT_GAP, relative_gap};
use pulp::{Simd, WithSimd};

/// Smallest change of an unknown, relative to the target gap and the scale of the image. Smaller changes
/// are set to zero, larger ones are reduced by it.
const THRESHOLD: f64 = 0.01;
/// Maximum number of steps that move an image into the data constraint.
const REPAIRS: usize = 8;
/// Reduction of the target radius from one step to the next, because clipping to the bounds undoes a part
/// of a step.
const DEEPER: f64 = 0.02;

/// Number of panels whose products are summed in a lane before conversion to `f64`.
const SUMMED_PANELS: usize = 8;

/// Best result of a frame so far, in internal units.
#[derive(Debug, Clone)]
pub(crate) struct Record {
    pub(crate) iterations: usize,
    pub(crate) primal: f64,
    pub(crate) lower_bound: f64,
    /// Change of the best image, over cells, and its coefficients `V' d`.
    pub(crate) change: Vec<f64>,
    pub(crate) coefficients: Vec<f64>,
    /// `|F' c - t|` of the best image, including the unexplained part of the data.
    pub(crate) misfit: f64,
    /// `F' c - t` of the last candidate, `[row of F']`.
    pub(crate) residual: Vec<f64>,
    /// Scaled data dual of the best bound, and the scale.
    pub(crate) dual: Vec<f64>,
    pub(crate) scale: f64,
    /// Whether the best bound was computed in `f64`.
    pub(crate) is_double: bool,
    /// Rounding error of the last bound, relative to the smallest radius of the change.
    pub(crate) rounding: f64,
    candidate: Vec<f64>,
    candidate_coefficients: Vec<f64>,
    image: Vec<f64>,
    column: Vec<f64>,
    /// Scratch memory of [`Coefficients`].
    pub(crate) sums: Vec<Lane<f64>>,
}

impl Record {
    pub(crate) fn new(setting: &Setting<f64>) -> Self {
        let (cells, ranks) = (vec![0.0; setting.places.length], vec![0.0; setting.padded]);
        Self {
            iterations: 0,
            primal: f64::INFINITY,
            lower_bound: f64::NEG_INFINITY,
            change: cells.clone(),
            coefficients: ranks.clone(),
            misfit: 0.0,
            residual: ranks.clone(),
            dual: ranks.clone(),
            scale: 0.0,
            is_double: false,
            rounding: 0.0,
            candidate: cells.clone(),
            candidate_coefficients: ranks.clone(),
            image: cells,
            column: ranks,
            sums: vec![[0.0; LANES]; setting.padded],
        }
    }

    /// Resets the record for a new frame.
    pub(crate) fn clear(&mut self) {
        self.iterations = 0;
        (self.primal, self.lower_bound) = (f64::INFINITY, f64::NEG_INFINITY);
        self.change.fill(0.0);
        self.coefficients.fill(0.0);
        self.dual.fill(0.0);
        self.scale = 0.0;
        self.is_double = false;
        self.rounding = 0.0;
    }

    pub(crate) fn gap(&self) -> f64 {
        relative_gap(self.primal, self.lower_bound)
    }

    /// Returns whether rounding alone takes a large part of the target gap.
    pub(crate) fn is_blurred(&self, target_gap: f64) -> bool {
        self.rounding > 0.3 * target_gap
    }

    pub(crate) fn take_proof<T: Project>(&mut self, proof: &Proof, engine: &mut Engine<T>) {
        self.rounding = proof.rounding;
        if proof.bound > self.lower_bound {
            self.lower_bound = proof.bound;
            self.scale = proof.scale;
            self.is_double = T::EPSILON == f64::EPSILON;
            for (own, y) in self.dual.iter_mut().zip(&engine.dual) {
                *own = proof.scale * y;
            }
            std::mem::swap(&mut engine.proven, &mut engine.proof.flow);
        }
    }
}

/// Evaluates the previous image as a candidate; returns infinity if it violates the data constraint. The
/// record must be cleared before.
pub(crate) fn unchanged(problem: &Problem<'_>, record: &mut Record) -> f64 {
    record.candidate.fill(0.0);
    let square = residual(problem, record);
    if problem.ball.is_some_and(|ball| square > ball) {
        return f64::INFINITY;
    }
    take(problem, record, square);
    record.primal
}

/// Evaluates the zero image as a candidate, for a constrained frame that allows it.
///
/// For a skin at rest it is the optimum, which an iteration would only approach. `coefficients` are those
/// of the anchor. If the best objective is already zero up to rounding, the zero image is taken in any
/// case, and the function returns true.
pub(crate) fn vanished(problem: &Problem<'_>, record: &mut Record, coefficients: &[f64]) -> bool {
    /// Objective that is zero up to rounding, in units where the data has norm 1.
    const SMALLEST: f64 = 1e-7;
    let best = record.primal;
    let square = problem.target.values.iter().map(|t| t * t).sum::<f64>();
    if problem.ball.is_none_or(|ball| square > ball) {
        return false;
    }
    if best <= SMALLEST {
        record.primal = f64::INFINITY;
    }
    for &cell in &problem.exact.places.cells {
        record.candidate[cell] = -problem.anchor[cell];
    }
    record.candidate_coefficients.iter_mut().zip(coefficients).for_each(|(out, c)| *out = -c);
    take(problem, record, square);
    best <= SMALLEST
}

/// Evaluates the candidate of an engine and stores it if it is the best.
pub(crate) fn value<T: Project>(
    engine: &mut Engine<T>,
    setting: &Setting<T>,
    problem: &Problem<'_>,
    record: &mut Record,
) {
    let threshold = THRESHOLD * problem.target_gap * problem.weights.image;
    let [lower, upper] = problem.bounds.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
    let places = &problem.exact.places;
    for &cell in &places.cells {
        let fresh = engine.fields.fresh[cell].to_f64();
        let moved = fresh - fresh.clamp(-threshold, threshold);
        let x = problem.anchor[cell];
        record.candidate[cell] =
            if moved == 0.0 { 0.0 } else { (x + moved).clamp(lower, upper) - x };
    }
    let is_rounded =
        T::HAS_SHORT && problem.ball.is_none() && problem.target_gap >= LEAST_SHORT_GAP;
    let mut square = match is_rounded {
        true => {
            let square = rounded_residual(engine, setting, problem, record);
            (square.sqrt() + misfit_error::<T>(setting, record)).powi(2)
        }
        false => residual(problem, record),
    };
    if let Some(ball) = problem.ball {
        let mut repairs = 0;
        while square > ball && repairs < REPAIRS {
            let inside = 1.0 - DEEPER * repairs as f64;
            into_ball(engine, problem, record, ball * inside * inside);
            square = residual(problem, record);
            repairs += 1;
        }
        // tolerance for the rounding of this evaluation; the data has norm 1
        if square.sqrt() > ball.sqrt() * (1.0 + 1e-9) + 1e-12 {
            return;
        }
    }
    take(problem, record, square);
}

/// Evaluates the candidate for a given squared residual and stores it if it is the best.
fn take(problem: &Problem<'_>, record: &mut Record, square: f64) {
    let places = &problem.exact.places;
    for &cell in &places.cells {
        record.image[cell] = problem.anchor[cell] + record.candidate[cell];
    }
    let variation = match &problem.exact.basis {
        Basis::Grid(differences) => {
            problem.arch.dispatch(Variation { problem, differences, record })
        }
        Basis::Gathered(differences) => {
            problem.arch.dispatch(Variation { problem, differences: differences.as_ref(), record })
        }
    };
    let whole = square + problem.target.rest_squared;
    let primal = if problem.ball.is_some() { variation } else { 0.5 * whole + variation };
    if primal < record.primal {
        record.primal = primal;
        record.misfit = whole.sqrt();
        std::mem::swap(&mut record.change, &mut record.candidate);
        std::mem::swap(&mut record.coefficients, &mut record.candidate_coefficients);
    }
}

/// Returns an upper bound on the rounding error of `|F' c - t|`, using `|F| <= 1`.
///
/// `V`, the change, and each product that is summed in a lane before conversion to `f64` contribute half a
/// unit each (Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd ed., 3.1).
fn misfit_error<T: Project>(setting: &Setting<T>, record: &Record) -> f64 {
    let cells = &setting.places.cells;
    let sum: f64 = cells.iter().map(|&cell| record.candidate[cell].abs()).sum();
    let roundings = 2.0 + (SUMMED_PANELS * BLOCKS) as f64;
    0.51 * roundings * T::EPSILON * setting.longest_row * sum
}

/// Computes `F' c - t` of the candidate in `f64`; returns its squared norm.
fn residual(problem: &Problem<'_>, record: &mut Record) -> f64 {
    let Record { candidate: change, candidate_coefficients: out, sums, .. } = &mut *record;
    let setting = problem.exact;
    problem.arch.dispatch(Coefficients { setting, change, sums, out });
    residual_of_coefficients(problem, record)
}

/// Like [`residual`], but with products in `T`; [`misfit_error`] bounds their rounding error.
fn rounded_residual<T: Project>(
    engine: &mut Engine<T>,
    setting: &Setting<T>,
    problem: &Problem<'_>,
    record: &mut Record,
) -> f64 {
    let (change, out) = (&record.candidate, &mut record.candidate_coefficients);
    let sums = &mut engine.fields.sums;
    problem.arch.dispatch(Coefficients { setting, change, sums, out });
    residual_of_coefficients(problem, record)
}

fn residual_of_coefficients(problem: &Problem<'_>, record: &mut Record) -> f64 {
    let rank = problem.exact.rank;
    let rows = problem.seen.transposed.chunks_exact(rank).zip(problem.beta);
    let mut square = 0.0;
    for (k, (row, beta)) in rows.enumerate().take(problem.seen.rows) {
        let own = match problem.seen.is_whole {
            true => row[k] * record.candidate_coefficients[k],
            false => dot(row, &record.candidate_coefficients[..rank]),
        } - beta;
        record.residual[k] = own;
        square += own * own;
    }
    square
}

/// Projects the candidate onto the data constraint in the metric of the step map, then clips it to the
/// bounds.
fn into_ball<T: Project>(
    engine: &Engine<T>,
    problem: &Problem<'_>,
    record: &mut Record,
    ball: f64,
) {
    let (rank, rows) = (problem.exact.rank, problem.seen.rows);
    // slightly smaller, to allow for the rounding of the map
    let inside = ball * (1.0 - 1e-6);
    let turned = &mut record.column[..rows];
    for (out, vector) in turned.iter_mut().zip(engine.map.vectors.chunks_exact(rows)) {
        *out = dot(vector, &record.residual[..rows]);
    }
    let values = engine.map.values[..rows].iter().copied();
    let mu = ball::multiplier(|| turned.iter().copied().zip(values.clone()), inside);
    for (u, value) in turned.iter_mut().zip(&engine.map.values) {
        *u = ball::dual(*u, *value, mu);
    }
    // the candidate's coefficients are no longer needed; their memory is reused
    for (z, row) in
        record.candidate_coefficients.iter_mut().zip(engine.map.back.chunks_exact(rows)).take(rank)
    {
        *z = dot(row, turned);
    }
    let [lower, upper] = problem.bounds.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]);
    let setting = problem.exact;
    for (row, &cell) in setting.rows.chunks_exact(setting.padded).zip(&setting.places.cells) {
        let pull = dot(&row[..rank], &record.candidate_coefficients[..rank]);
        let moved = record.candidate[cell] - engine.fields.tau[cell].to_f64() * pull;
        let x = problem.anchor[cell];
        record.candidate[cell] = (x + moved).clamp(lower, upper) - x;
    }
}

/// Computes `V' d`, with products and sums in `T` over [`SUMMED_PANELS`] panels, then in `f64`.
///
/// Panels without a change are skipped. The speed is limited by memory bandwidth: `V` is read once,
/// `4 n rank` bytes in `f32` and twice that in `f64`.
pub(crate) struct Coefficients<'a, T: Project> {
    pub(crate) setting: &'a Setting<T>,
    pub(crate) change: &'a [f64],
    /// Scratch memory, `[padded rank]`.
    pub(crate) sums: &'a mut [Lane<T>],
    pub(crate) out: &'a mut [f64],
}

impl<T: Project> WithSimd for Coefficients<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { setting, change, sums, out } = self;
        let ranks = setting.padded;
        let (sums, out) = (&mut sums[..ranks], &mut out[..ranks]);
        out.fill(0.0);
        sums.fill([T::default(); LANES]);
        let mut known = 0;
        for (panel, blocks) in setting.places.blocks.chunks_exact(BLOCKS).enumerate() {
            let mut w = [[T::default(); LANES]; BLOCKS];
            let mut largest = 0.0_f64;
            for (w, &at) in w.iter_mut().zip(blocks) {
                let d = load(change, at);
                *w = each(|l| T::from_f64(d[l]));
                for l in d {
                    largest = largest.max(l.abs());
                }
            }
            if largest > 0.0 {
                T::project(simd, setting.panel(panel, 0..ranks), &w, sums);
                known += 1;
            }
            if known == SUMMED_PANELS {
                flush(sums, out);
                known = 0;
            }
        }
        flush(sums, out);
    }
}

/// Adds the lane of each rank to its sum and clears the lane.
#[inline(always)]
fn flush<T: Project>(sums: &mut [Lane<T>], out: &mut [f64]) {
    for (sum, out) in sums.iter_mut().zip(out) {
        let mut wide = [0.0; LANES];
        for l in 0..LANES {
            wide[l] = sum[l].to_f64();
        }
        *out += total(&wide);
        *sum = [T::default(); LANES];
    }
}

/// Computes `lambda_space TV(x) + lambda_time |d|`.
struct Variation<'a, D> {
    problem: &'a Problem<'a>,
    differences: &'a D,
    record: &'a Record,
}

impl<D: Differences<f64>> WithSimd for Variation<'_, D> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self { problem, differences, record } = self;
        let mut space: Lane<f64> = [0.0; LANES];
        for &at in differences.group_blocks() {
            let [a, b] = differences.difference(&record.image, at);
            let radius = differences.group_radius(at);
            space = each(|l| {
                let norm = a[l].mul_add(a[l], b[l] * b[l]).sqrt();
                radius[l].mul_add(norm, space[l])
            });
        }
        let mut time: Lane<f64> = [0.0; LANES];
        for &at in &problem.exact.places.blocks {
            let (d, radius) = (load(&record.candidate, at), differences.cell_radius(at));
            time = each(|l| radius[l].mul_add(d[l].abs(), time[l]));
        }
        problem.weights.lambda_space * total(&space) + problem.weights.lambda_time * total(&time)
    }
}
