//! Exact data step of an iteration in the metric of the step map.
//!
//! ```text
//! d^ = argmin data(origin + d) + |d - w|^2_{T^-1} / 2  =  w - T V F y
//! penalised:    y = M (F' V' w - beta),        M = (I + F' G F)^-1,  G = V' T V
//! constrained:  y = E mu r / (1 + mu e),       r = E' (F' V' w - beta),  F' G F = E diag(e) E'
//! ```
//!
//! with the data residual `|F' c - beta|` of a frame's channels in terms of the coefficients `c = V' d`, and
//! `beta = b - F' V' origin`. Frames of one span that have the same channels share one such step.

use super::ball;
use super::dense::{Eigen, congruent, invert, multiply, rows_times};
use super::duals::convert;
use super::lanes::{LANES, Project, each, load, splat, store, vectorised};
use super::operators::Operators;
use super::problem::Problem;
use super::state::{SPAN, State};
use crate::InverseError;

/// Largest `tau s^2` in the tail, whose steps are explicit.
const EXPLICIT: f64 = 0.04;

/// Data steps of all frames.
#[derive(Debug, Clone)]
pub(crate) struct DataSteps<T> {
    /// Number of ranks in the exact step, a multiple of [`LANES`]; see [`super::iterate`] for the others.
    pub(crate) head: usize,
    rank: usize,
    padded: usize,
    /// `G` of each span of frames, `[span][rank][rank]`.
    gram: Vec<f64>,
    steps: Vec<DataStep<T>>,
    /// Number of steps in use, at the start of `steps`.
    used: usize,
    /// Index of each frame's step.
    step_of: Vec<usize>,
    /// `beta`, `[frame][padded rank]`; in `T` for the head, and turned by `E'` for constraints.
    beta: Vec<f64>,
    head_beta: Vec<T>,
    turned: Vec<f64>,
    /// `S` of the whole protocol, `[padded rank]`.
    singular: Vec<T>,
    /// Dual of the tail, `[frame][padded rank]`.
    tail_dual: Vec<f64>,
    /// Squared radius and multiplier of each constrained frame.
    balls: Vec<f64>,
    multipliers: Vec<f64>,
    /// Relative reduction of the radii of the iteration, which keeps images feasible that are clipped to bounds.
    pub(crate) margin: f64,
    /// Scratch memory: columns, a Gram matrix in `T`, matrices.
    columns: [Vec<f64>; 2],
    head_column: Vec<T>,
    product: Vec<T>,
    half: Vec<f64>,
    eigen: Option<Eigen>,
}

/// Data step of the frames of one span that have the same channels.
#[derive(Debug, Clone)]
pub(crate) struct DataStep<T> {
    /// Span and index of the channels.
    key: (usize, usize),
    /// Whether the data separates by ranks, so that the step runs over the head.
    is_head: bool,
    pub(crate) rows: usize,
    /// `M`, `[row of F'][row of F']`; of the head in both types.
    inverse: Vec<f64>,
    head_inverse: Vec<T>,
    /// `F'` and `F M`, or `F'` and `F` turned by the eigenvectors, `[row][rank]` and `[rank][row]`.
    forward: Vec<f64>,
    pub(crate) back: Vec<f64>,
    /// `e`, and `E'` by rows.
    pub(crate) values: Vec<f64>,
    pub(crate) vectors: Vec<f64>,
}

impl<T: Project> DataStep<T> {
    fn new(rank: usize, padded: usize) -> Self {
        Self {
            key: (0, 0),
            is_head: false,
            rows: 0,
            inverse: vec![0.0; padded * padded],
            head_inverse: vec![T::default(); padded * padded],
            forward: vec![0.0; rank * rank],
            back: vec![0.0; rank * rank],
            values: vec![0.0; rank],
            vectors: vec![0.0; rank * rank],
        }
    }
}

impl<T: Project> DataSteps<T> {
    /// Allocates memory for the steps of these frames, initially for `most` different ones.
    pub(crate) fn new(problem: &Problem<'_>, ops: &Operators<T>, most: usize) -> Self {
        let (frames, rank, padded) = (problem.frames(), ops.rank, ops.padded);
        let mut singular: Vec<T> = problem.skin.singular.iter().map(|s| T::from_f64(*s)).collect();
        singular.resize(padded, T::default());
        Self {
            head: padded,
            rank,
            padded,
            gram: vec![0.0; frames.div_ceil(SPAN) * rank * rank],
            steps: (0..most).map(|_| DataStep::new(rank, padded)).collect(),
            used: 0,
            step_of: vec![0; frames],
            beta: vec![0.0; frames * padded],
            head_beta: vec![T::default(); frames * padded],
            turned: vec![0.0; if problem.delta.is_some() { frames * padded } else { 0 }],
            singular,
            tail_dual: vec![0.0; frames * padded],
            balls: vec![0.0; frames],
            multipliers: vec![0.0; frames],
            margin: 0.0,
            columns: std::array::from_fn(|_| vec![0.0; padded]),
            head_column: vec![T::default(); padded],
            product: vec![T::default(); padded * padded],
            half: vec![0.0; rank * rank],
            eigen: problem.delta.is_some().then(|| Eigen::new(rank)),
        }
    }

    /// Returns the step of a frame.
    pub(crate) fn step(&self, frame: usize) -> &DataStep<T> {
        &self.steps[self.step_of[frame]]
    }

    /// Sets up the data steps for a new step map.
    pub(crate) fn set_map(
        &mut self,
        problem: &Problem<'_>,
        ops: &Operators<T>,
        state: &State<T>,
    ) -> Result<(), InverseError> {
        self.head = head(problem, ops, state);
        for span in 0..state.spans() {
            let tau = &state.tau[span * state.cells..][..state.cells];
            let (ranks, out) = (self.head, self.product.as_mut_slice());
            ops.gram(tau, ranks, out);
            let own = &mut self.gram[span * self.rank * self.rank..][..self.rank * self.rank];
            for i in 0..self.head.min(self.rank) {
                for j in 0..=i {
                    // only the upper triangle was computed
                    let value = self.product[j * self.padded + i].to_f64();
                    own[i * self.rank + j] = value;
                    own[j * self.rank + i] = value;
                }
            }
        }
        self.used = 0;
        for frame in 0..state.frames {
            let key = (frame / SPAN, problem.mode_of[frame]);
            let known = self.steps[..self.used].iter().position(|step| step.key == key);
            self.step_of[frame] = match known {
                Some(index) => index,
                None => self.build(problem, key)?,
            };
            self.turn(problem, frame);
        }
        Ok(())
    }

    /// Builds the step of a span and its channels.
    fn build(&mut self, problem: &Problem<'_>, key: (usize, usize)) -> Result<usize, InverseError> {
        let (rank, head, index) = (self.rank, self.head, self.used);
        if index == self.steps.len() {
            self.steps.push(DataStep::new(rank, self.padded));
        }
        self.used += 1;
        let (mode, singular) = (&problem.modes[key.1], &problem.skin.singular);
        let Self { steps, gram, half, eigen, .. } = self;
        let gram = &gram[key.0 * rank * rank..][..rank * rank];
        let step = &mut steps[index];
        (step.key, step.rows) = (key, mode.rows);
        step.is_head = mode.is_whole && eigen.is_none();
        let DataStep { is_head, rows, inverse, forward, back, values, vectors, .. } = step;
        let (rows, f) = (*rows, &mode.transposed[..*rows * rank]);
        let size = if *is_head { head } else { rows };
        let inverse = &mut inverse[..size * size];
        if *is_head {
            let known = head.min(rank);
            inverse.fill(0.0);
            for (i, row) in inverse.chunks_exact_mut(head).enumerate().take(known) {
                for (j, own) in row.iter_mut().enumerate().take(known) {
                    *own = singular[i] * gram[i * rank + j] * singular[j];
                }
            }
        } else {
            vectorised!(congruent(f, gram, half, rank, inverse));
        }
        let turn = if let Some(eigen) = eigen {
            eigen.set(inverse, rows, values, &mut vectors[..rows * rows])?;
            &vectors[..rows * rows]
        } else {
            (0..size).for_each(|i| inverse[i * size + i] += 1.0);
            vectorised!(invert(inverse, size));
            &*inverse
        };
        if *is_head {
            convert(turn, 1.0, &mut step.head_inverse);
            return Ok(index);
        }
        for (i, row) in turn.chunks_exact(rows.max(1)).enumerate() {
            let out = &mut forward[i * rank..][..rank];
            out.fill(0.0);
            for (e, f) in row.iter().zip(f.chunks_exact(rank)) {
                out.iter_mut().zip(f).for_each(|(o, f)| *o += e * f);
            }
            for (k, value) in out.iter().enumerate() {
                back[k * rows + i] = *value;
            }
        }
        if eigen.is_none() {
            forward[..rows * rank].copy_from_slice(f);
        }
        Ok(index)
    }

    /// Sets `beta` of a frame, `[row of F']`.
    pub(crate) fn set_beta(
        &mut self,
        problem: &Problem<'_>,
        frame: usize,
        beta: impl Iterator<Item = f64>,
    ) {
        let range = frame * self.padded..(frame + 1) * self.padded;
        let rows = self.beta[range.clone()].iter_mut().zip(&mut self.head_beta[range]);
        for ((own, head), value) in rows.zip(beta.chain(std::iter::repeat(0.0))) {
            (*own, *head) = (value, T::from_f64(value));
        }
        if self.used > 0 {
            self.turn(problem, frame);
        }
    }

    /// Sets the radius of a frame's constraint, and turns its `beta` by the eigenvectors.
    fn turn(&mut self, problem: &Problem<'_>, frame: usize) {
        let Some(ball) = problem.ball(frame) else { return };
        self.balls[frame] = ball * (1.0 - self.margin).powi(2);
        let (step, at) = (&self.steps[self.step_of[frame]], frame * self.padded);
        let (rows, vectors) = (step.rows, &step.vectors[..step.rows * step.rows]);
        multiply(vectors, &self.beta[at..][..rows], &mut self.turned[at..][..rows]);
    }

    /// Sets the force of the tail from the residuals `F' V' x - b` of the images, `[frame][padded rank]`, or from those
    /// of the origin.
    pub(crate) fn set_tail(
        &mut self,
        ops: &Operators<T>,
        state: &mut State<T>,
        residual: Option<&[f64]>,
    ) {
        state.has_tail = self.head < self.rank;
        if !state.has_tail {
            return;
        }
        state.forces.fill(T::default());
        for at in (0..state.frames * self.padded).filter(|at| at % self.padded >= self.head) {
            let y = residual.map_or(-self.beta[at], |residual| residual[at]);
            self.tail_dual[at] = y;
            state.forces[at] = T::from_f64(self.singular[at % self.padded].to_f64() * y);
        }
        ops.expand(&state.forces, self.head..self.padded, false, &mut state.tail);
    }

    /// Computes the force `F y` of the data from the coefficients `V' w` of frames from `first` on,
    /// `[frame][padded rank]`.
    #[inline(always)]
    pub(super) fn apply(&mut self, first: usize, coefficients: &[T], forces: &mut [T]) {
        let (padded, rank, head) = (self.padded, self.rank, self.head);
        let Self { steps, step_of, beta, head_beta, turned, singular, .. } = self;
        let rows = coefficients.chunks_exact(padded).zip(forces.chunks_exact_mut(padded));
        for (index, (c, out)) in rows.enumerate() {
            let frame = first + index;
            let (step, at) = (&steps[step_of[frame]], frame * padded);
            if step.is_head {
                let own = &mut self.head_column[..head];
                let data = &head_beta[at..][..head];
                for (k, own) in own.iter_mut().enumerate() {
                    *own = singular[k].mul_add(c[k], T::default() - data[k]);
                }
                multiply_head(&step.head_inverse[..head * head], own, out);
                out[..head].iter_mut().zip(&*singular).for_each(|(z, s)| *z = *z * *s);
                continue;
            }
            let [own, second] = &mut self.columns;
            let (own, u) = (&mut own[..rank], &mut second[..step.rows]);
            own.iter_mut().zip(c).for_each(|(own, c)| *own = c.to_f64());
            rows_times(&step.forward, own, u);
            let data = if turned.is_empty() { &beta[at..] } else { &turned[at..] };
            u.iter_mut().zip(data).for_each(|(u, b)| *u -= b);
            if !turned.is_empty() {
                let values = &step.values[..step.rows];
                let terms = || u.iter().copied().zip(values.iter().copied());
                let mu = ball::multiplier(terms, self.balls[frame]);
                self.multipliers[frame] = mu;
                u.iter_mut().zip(values).for_each(|(u, e)| *u = ball::dual(*u, *e, mu));
            }
            rows_times(&step.back[..rank * step.rows], u, own);
            out.iter_mut().zip(own).for_each(|(z, own)| *z = T::from_f64(*own));
        }
    }

    /// Computes the data dual of a frame's last iteration, `[row of F']`.
    pub(crate) fn dual(&mut self, state: &State<T>, frame: usize, out: &mut [f64]) {
        vectorised!(self.dual_of(&state.coefficients, frame, out));
    }

    #[inline(always)]
    fn dual_of(&mut self, coefficients: &[T], frame: usize, out: &mut [f64]) {
        let (at, rank) = (frame * self.padded, self.rank);
        let step = &self.steps[self.step_of[frame]];
        let (rows, c) = (step.rows, &coefficients[at..]);
        let [first, u] = &mut self.columns;
        out.fill(0.0);
        if step.is_head {
            let (head, known) = (self.head, self.head.min(rank));
            u[..head].fill(0.0);
            for (k, u) in u.iter_mut().enumerate().take(known) {
                *u = self.singular[k].to_f64() * c[k].to_f64() - self.beta[at + k];
            }
            rows_times(&step.inverse[..known * head], &u[..head], &mut out[..known]);
            out[known..rank].copy_from_slice(&self.tail_dual[at + known..at + rank]);
            return;
        }
        for (own, c) in first.iter_mut().zip(c) {
            *own = c.to_f64();
        }
        let u = &mut u[..rows];
        rows_times(&step.forward, &first[..rank], u);
        if self.turned.is_empty() {
            subtract(u, &self.beta[at..]);
            return rows_times(&step.inverse[..rows * rows], u, &mut out[..rows]);
        }
        subtract(u, &self.turned[at..]);
        let vectors = step.vectors.chunks_exact(rows.max(1)).zip(&step.values);
        for ((vector, value), u) in vectors.zip(u) {
            let turned = ball::dual(*u, *value, self.multipliers[frame]);
            for (y, e) in out.iter_mut().zip(vector) {
                *y += turned * e;
            }
        }
    }
}

#[inline(always)]
fn subtract(values: &mut [f64], others: &[f64]) {
    for (value, other) in values.iter_mut().zip(others) {
        *value -= other;
    }
}

/// Returns the number of ranks that need the exact step; all if the data does not separate by ranks.
fn head<T: Project>(problem: &Problem<'_>, ops: &Operators<T>, state: &State<T>) -> usize {
    if !problem.is_diagonal() {
        return ops.padded;
    }
    let largest = state.tau.iter().fold(0.0_f64, |most, tau| most.max(tau.to_f64()));
    let strong = problem.skin.singular.iter().take_while(|&s| largest * s * s > EXPLICIT).count();
    strong.next_multiple_of(LANES).clamp(LANES, ops.padded)
}

/// Computes `out = M x` for `M` `[column][row]` of a head that is a multiple of [`LANES`].
#[inline(always)]
fn multiply_head<T: Project>(matrix: &[T], x: &[T], out: &mut [T]) {
    let head = x.len();
    for at in (0..head).step_by(LANES) {
        let mut sum = splat(T::default());
        for (column, x) in matrix.chunks_exact(head).zip(x) {
            let m = load(column, at);
            sum = each!(|l| x.mul_add(m[l], sum[l]));
        }
        store(out, at, sum);
    }
}
