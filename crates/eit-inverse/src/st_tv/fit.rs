//! Exact data step of an iteration in the metric of the step map.
//!
//! ```text
//! x^ = argmin data(x) + |x - w|^2_{T^-1} / 2  =  w - T V F y
//! penalised:    y = M (F' V' w - b),           M = (I + F' G F)^-1,  G = V' T V
//! constrained:  y = E mu r / (1 + mu e),       r = E' (F' V' w - b),  F' G F = E diag(e) E'
//! ```
//!
//! with the data residual `|F' c - b|` of a frame's channels in terms of the coefficients `c = V' x`.
//! Frames of one block that have the same channels share one such step.
//!
//! Over 300 lines because changes of the step map, of the channels and of the data all update the same
//! set of steps.

mod kernels;

use super::data::seen::{Seen, Target};
use super::dense::{Congruent, Eigen, Invert};
use super::float::Float;
use super::kernel::{CHUNK, LANES, RANKS};
use super::operators::Operators;
use super::problem::{DataTerm, Problem};
use super::state::{REFRESH, State};
use crate::InverseError;
use kernels::{Apply, Gram};
use pulp::Arch;

/// Data steps of all frames.
#[derive(Debug, Clone)]
pub(crate) struct DataSteps<T> {
    /// Number of ranks in the exact step, a multiple of [`RANKS`]; see [`super::engine`] for the others.
    head: usize,
    /// `G` of each block of frames, `[block][rank][rank]`; empty before the first step map.
    gram: Vec<f64>,
    steps: Vec<DataStep<T>>,
    /// Number of steps in use, at the start of `steps`.
    used: usize,
    /// Index of each frame's step.
    step_of: Vec<usize>,
    /// `S` of the whole protocol, `[padded rank]`.
    singular: Vec<T>,
    /// `b` in the coordinates of each frame's step, `[padded rank][stride]`.
    targets: Vec<T>,
    /// Residual: `M^-1 y`, or `E' y` for constrained data, `[padded rank][stride]`.
    residual: Vec<T>,
    force: Vec<T>,
    columns: [Vec<[T; LANES]>; 2],
    /// Rows of `T^1/2 V` of a chunk of unknowns, `[unknown][padded rank]`, and the sum of their products.
    scaled: Vec<T>,
    product: Vec<T>,
    half: Vec<f64>,
    matrix: Vec<f64>,
    eigen: Option<Eigen>,
    /// Relative reduction of the radius of a data constraint, see [`margin`].
    margin: f64,
    /// Factor on the margin, which decreases during a long solve.
    pub(crate) fading: f64,
}

/// Data step of the frames of one block that have the same channels.
#[derive(Debug, Clone)]
struct DataStep<T> {
    block: usize,
    good: Vec<bool>,
    is_whole: bool,
    /// Frames of the block that use this step.
    lanes: [bool; LANES],
    rows: usize,
    /// `F'`, or `E' F'`, `[row][head]`; not used by penalised frames without masked channels.
    forward: Vec<T>,
    /// `F M`, or `F E`, `[head][row]`.
    back: Vec<T>,
    /// `e`; not used by penalised frames.
    values: Vec<f64>,
    /// `M` or `E'`, by rows.
    turn: Vec<f64>,
    /// Squared constraint radius of each frame.
    squares: [f64; LANES],
}

impl<T: Float> DataSteps<T> {
    /// Allocates memory for the steps of these frames, initially for `most` different ones.
    pub(crate) fn new(
        problem: &Problem<'_>,
        ops: &Operators<T>,
        state: &State<T>,
        most: usize,
        target_gap: f64,
    ) -> Self {
        let (rank, padded) = (ops.rank, ops.padded_rank);
        let is_constrained = problem.data_term != DataTerm::Penalised;
        let zero = T::default();
        let mut singular: Vec<T> = problem.singular.iter().map(|s| T::from_f64(*s)).collect();
        singular.resize(padded, zero);
        let measurements = problem.modes.first().map_or(0, |mode| mode.good.len());
        Self {
            head: padded,
            gram: vec![0.0; state.blocks() * rank * rank],
            steps: (0..most).map(|_| DataStep::new(measurements, ops)).collect(),
            used: 0,
            step_of: vec![0; state.frames],
            singular,
            targets: vec![zero; padded * state.stride],
            residual: vec![zero; padded * state.stride],
            force: vec![zero; padded * state.stride],
            columns: std::array::from_fn(|_| vec![[zero; LANES]; padded]),
            scaled: vec![zero; CHUNK * padded],
            product: vec![zero; padded * padded],
            half: vec![0.0; rank * rank],
            matrix: vec![0.0; rank * rank],
            eigen: is_constrained.then(|| Eigen::new(rank)),
            margin: margin(T::EPSILON, problem, target_gap),
            fading: 1.0,
        }
    }

    /// Sets up the data steps for a new step map.
    pub(crate) fn set_map(
        &mut self,
        arch: Arch,
        problem: &Problem<'_>,
        ops: &Operators<T>,
        state: &mut State<T>,
    ) -> Result<(), InverseError> {
        self.head = head(problem, ops, state);
        for block in 0..state.blocks() {
            self.set_gram(arch, ops, state, block);
        }
        self.used = 0;
        self.assign(arch, problem, ops, state)
    }

    /// Computes `G` of a block of frames.
    fn set_gram(&mut self, arch: Arch, ops: &Operators<T>, state: &State<T>, block: usize) {
        let (head, rank, padded) = (self.head, ops.rank, ops.padded_rank);
        let Self { scaled, product, gram, .. } = self;
        arch.dispatch(Gram { ops, state, block, head, scaled, product });
        let own = &mut gram[block * rank * rank..][..rank * rank];
        for i in 0..head.min(rank) {
            for j in 0..=i {
                // only the upper triangle was computed
                let value = product[j * padded + i].to_f64();
                own[i * rank + j] = value;
                own[j * rank + i] = value;
            }
        }
    }

    /// Assigns to each frame the step of its channels, building missing ones.
    pub(crate) fn assign(
        &mut self,
        arch: Arch,
        problem: &Problem<'_>,
        ops: &Operators<T>,
        state: &mut State<T>,
    ) -> Result<(), InverseError> {
        if self.head != head(problem, ops, state).max(self.head) {
            return self.set_map(arch, problem, ops, state);
        }
        state.head = self.head;
        for step in &mut self.steps[..self.used] {
            step.lanes = [false; LANES];
        }
        // mark the steps still in use; the others can be overwritten
        for frame in 0..state.frames {
            if let Some(index) = self.find(problem, frame) {
                self.steps[index].lanes[frame % LANES] = true;
            }
        }
        for frame in 0..state.frames {
            let mode = &problem.modes[problem.mode_of[frame]];
            let index = match self.find(problem, frame) {
                Some(index) => index,
                None => self.build(arch, ops, mode, frame / LANES)?,
            };
            self.step_of[frame] = index;
            let step = &mut self.steps[index];
            step.lanes[frame % LANES] = true;
            let target = &problem.targets[frame];
            step.squares[frame % LANES] = match problem.data_term {
                DataTerm::Penalised => 0.0,
                DataTerm::Constrained(delta) => {
                    let inside = delta[frame].powi(2) - target.rest_squared;
                    let margin = (self.fading * self.margin).max(1e3 * T::EPSILON);
                    inside.max(0.0) * (1.0 - margin).powi(2)
                }
            };
            self.set_target(index, target, frame, state.stride);
        }
        Ok(())
    }

    fn find(&self, problem: &Problem<'_>, frame: usize) -> Option<usize> {
        let mode = &problem.modes[problem.mode_of[frame]];
        let fits = |s: &DataStep<T>| s.block == frame / LANES && s.good == mode.good;
        self.steps[..self.used].iter().position(fits)
    }

    fn set_target(&mut self, index: usize, target: &Target, frame: usize, stride: usize) {
        let step = &self.steps[index];
        let rows = step.rows;
        for k in 0..self.targets.len() / stride {
            let turned = self.eigen.is_some() && k < rows;
            let value = match turned {
                true => {
                    let row = &step.turn[k * rows..][..rows];
                    row.iter().zip(&target.values).map(|(e, b)| e * b).sum()
                }
                false => target.values.get(k).copied().unwrap_or(0.0),
            };
            self.targets[k * stride + frame] = T::from_f64(value);
        }
    }

    /// Builds the step of a block for these channels.
    fn build(
        &mut self,
        arch: Arch,
        ops: &Operators<T>,
        mode: &Seen,
        block: usize,
    ) -> Result<usize, InverseError> {
        let unused = |s: &DataStep<T>| !s.lanes.contains(&true);
        let index = match self.steps[..self.used].iter().position(unused) {
            Some(index) => index,
            None => {
                self.used += 1;
                self.used - 1
            }
        };
        if index == self.steps.len() {
            self.steps.push(DataStep::new(mode.good.len(), ops));
        }
        let rank = ops.rank;
        let gram = &self.gram[block * rank * rank..][..rank * rank];
        let step = &mut self.steps[index];
        step.lanes = [false; LANES];
        step.block = block;
        step.good.copy_from_slice(&mode.good);
        step.is_whole = mode.is_whole;
        step.rows = if mode.is_whole { self.head.min(rank) } else { mode.rows };
        let rows = step.rows;
        let matrix = &mut self.matrix[..rows * rows];
        let seen = |i: usize, k: usize| mode.transposed[i * rank + k];
        if mode.is_whole {
            for (i, row) in matrix.chunks_exact_mut(rows.max(1)).enumerate() {
                for (j, value) in row.iter_mut().enumerate() {
                    *value = seen(i, i) * gram[i * rank + j] * seen(j, j);
                }
            }
        } else {
            let (f, half, out) = (&mode.transposed, &mut self.half, &mut *matrix);
            arch.dispatch(Congruent { f, gram, half, rank, rows, out });
        }
        let ranks = self.head.min(rank);
        step.back.fill(T::default());
        match &mut self.eigen {
            None => {
                (0..rows).for_each(|i| matrix[i * rows + i] += 1.0);
                arch.dispatch(Invert { matrix, n: rows });
                step.turn[..rows * rows].copy_from_slice(matrix);
                step.take_penalised(self.head, rank, mode);
            }
            Some(eigen) => {
                eigen.set(matrix, rows, &mut step.values, &mut step.turn[..rows * rows])?;
                for i in 0..rows {
                    let vector = &step.turn[i * rows..][..rows];
                    for k in 0..ranks {
                        let value: f64 = match mode.is_whole {
                            true => vector[k] * seen(k, k),
                            false => (0..rows).map(|j| vector[j] * seen(j, k)).sum(),
                        };
                        step.forward[i * self.head + k] = T::from_f64(value);
                        step.back[k * rows + i] = T::from_f64(value);
                    }
                }
            }
        }
        Ok(index)
    }

    /// Writes the data dual of a frame, `[row of F']`.
    pub(crate) fn dual(&self, frame: usize, stride: usize, out: &mut [f64]) {
        let step = &self.steps[self.step_of[frame]];
        let rows = step.rows;
        let own = |k: usize| self.residual[k * stride + frame].to_f64();
        // beyond the head of frames without masked channels the residual is the dual
        for (k, y) in out.iter_mut().enumerate() {
            *y = if step.is_whole { own(k) } else { 0.0 };
        }
        out[..rows].fill(0.0);
        for (i, row) in step.turn.chunks_exact(rows.max(1)).enumerate().take(rows) {
            match self.eigen {
                None => out[i] = row.iter().enumerate().map(|(k, m)| m * own(k)).sum(),
                Some(_) => {
                    let share = own(i);
                    out[..rows].iter_mut().zip(row).for_each(|(y, e)| *y += share * e);
                }
            }
        }
    }

    /// Replaces the image coefficients `c` of the tail by their force `s y`, `y = s c - b`.
    pub(crate) fn pull(&mut self, coefficients: &mut [T], stride: usize, frames: usize) {
        for k in self.head..coefficients.len() / stride {
            for t in 0..frames {
                let at = k * stride + t;
                let y = self.singular[k] * coefficients[at] - self.targets[at];
                self.residual[at] = y;
                coefficients[at] = self.singular[k] * y;
            }
        }
    }

    /// Replaces the coefficients of `w` in the head, `[rank][stride]`, by the force of the data.
    pub(crate) fn apply(&mut self, arch: Arch, coefficients: &mut [T], stride: usize) {
        arch.dispatch(Apply { steps: self, coefficients, stride });
    }
}

impl<T: Float> DataStep<T> {
    fn new(measurements: usize, ops: &Operators<T>) -> Self {
        let square = || vec![T::default(); ops.padded_rank * ops.padded_rank];
        Self {
            block: 0,
            good: vec![false; measurements],
            is_whole: false,
            lanes: [false; LANES],
            rows: 0,
            forward: square(),
            back: square(),
            values: vec![0.0; ops.rank],
            turn: vec![0.0; ops.rank * ops.rank],
            squares: [0.0; LANES],
        }
    }

    /// Sets `F'` and `F M`.
    fn take_penalised(&mut self, head: usize, rank: usize, mode: &Seen) {
        let rows = self.rows;
        let rows_of = self.turn.chunks_exact(rows.max(1)).enumerate().take(rows);
        if mode.is_whole {
            for (i, row) in rows_of {
                let s = mode.transposed[i * rank + i];
                let back = self.back[i * rows..][..rows].iter_mut();
                back.zip(row).for_each(|(b, m)| *b = T::from_f64(s * m));
            }
            return;
        }
        for (i, f) in mode.transposed.chunks_exact(rank).enumerate().take(rows) {
            let forward = &mut self.forward[i * head..][..head];
            forward.fill(T::default());
            forward.iter_mut().zip(f).for_each(|(to, f)| *to = T::from_f64(*f));
        }
        let Self { values, turn, back, .. } = self;
        let sums = &mut values[..rows];
        for k in 0..rank {
            sums.fill(0.0);
            let pairs = turn.chunks_exact(rows.max(1)).zip(mode.transposed.chunks_exact(rank));
            for (m, f) in pairs.take(rows) {
                sums.iter_mut().zip(m).for_each(|(sum, m)| *sum += f[k] * m);
            }
            let back = back[k * rows..][..rows].iter_mut();
            back.zip(&*sums).for_each(|(b, sum)| *b = T::from_f64(*sum));
        }
    }
}

/// Returns the number of ranks that need the exact step.
///
/// In the others an explicit step must not overshoot between two updates of the tail. All ranks need
/// the exact step if the data does not separate by ranks.
fn head<T: Float>(problem: &Problem<'_>, ops: &Operators<T>, state: &State<T>) -> usize {
    let whole = |&mode: &usize| problem.modes[mode].is_whole;
    if problem.data_term != DataTerm::Penalised || !problem.mode_of.iter().all(whole) {
        return ops.padded_rank;
    }
    let largest = state.tau.iter().fold(0.0_f64, |most, tau| most.max(tau.to_f64()));
    let least = 1.0 / (2.0 * REFRESH as f64 * largest);
    let strong = problem.singular.iter().take_while(|&s| s * s > least).count();
    strong.next_multiple_of(RANKS).clamp(RANKS, ops.padded_rank)
}

/// Returns the relative reduction of the radius of a data constraint. It keeps the image feasible
/// despite rounding in the iteration and clipping to the bounds, and is small compared with the
/// requested gap.
fn margin(rounding: f64, problem: &Problem<'_>, target_gap: f64) -> f64 {
    let of_bounds = if problem.bounds.is_some() { 0.05 * target_gap.min(1.0) } else { 0.0 };
    (1e3 * rounding).max(of_bounds)
}
