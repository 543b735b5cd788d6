//! One frame: iterations and evaluations of image and bound, until the gap is proven or a limit is
//! reached.
//!
//! Over 300 lines because the steps of one loop share the arrays of one engine; the objective and the
//! bound of its iterates are computed in `value` and `bound`.

use super::bound::{Proof, prove};
use super::differences::Basis;
use super::fields::{Fields, Setting};
use super::iterate::{Columns, DataStep, Iterate, RowsTimes};
use super::lanes::Project;
use super::map::{StepMap, Weights};
use super::proof::{Expand, FlowFields};
use super::seen::{Seen, Target};
use super::value::{Record, value};
use crate::InverseError;
use crate::st_tv::float::Float;
use crate::st_tv::schedule::{CLOCK, LEAST_SHORT_GAP, SMOOTHING};
use pulp::Arch;
use std::time::Instant;

/// Iterations of a slow frame. From about here on evaluations are farther apart, each followed by a new
/// map, and bounds are computed twice.
const SLOW: usize = 50;
/// Minimum number of iterations before the first evaluation.
const FIRST: usize = 20;
/// Iterations after which the smoothing may keep the gap open; it is halved at each evaluation.
const STUCK: usize = 120;

/// Factor on the step per evaluation of a slow frame with bounds, and smallest step.
const STEP_FALL: f64 = 0.8;
const LEAST_STEP: f64 = 0.05;

/// Problem of one frame in internal units.
#[derive(Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub(crate) arch: Arch,
    pub(crate) seen: &'a Seen,
    pub(crate) target: &'a Target,
    /// `t - F' V' x^`, `[row of F']`.
    pub(crate) beta: &'a [f64],
    pub(crate) weights: Weights,
    pub(crate) bounds: Option<[f64; 2]>,
    /// Squared radius of the data constraint; `None` for penalised data.
    pub(crate) ball: Option<f64>,
    pub(crate) target_gap: f64,
    /// Largest value of the anchor and of the linear image of the innovation.
    pub(crate) shown: f64,
    /// Image of the previous frame, over cells.
    pub(crate) anchor: &'a [f64],
    /// Layout and basis for evaluations in `f64`.
    pub(crate) exact: &'a Setting<f64>,
}

/// Largest scale of an image relative to `objective / lambda_space`; the edge of a small touch is about
/// fifty pixels long. The error of the smoothing is proportional to the scale and must stay small compared
/// with the objective.
const SCALE: f64 = 0.012;

impl Problem<'_> {
    /// Lowers the scale of the image and the smoothing to the limits given by an objective; the scale stays
    /// at or above `shown`.
    fn fit_scale(&mut self, objective: f64) {
        let edge = self.weights.lambda_space * self.exact.mean_radius;
        let largest = SCALE * objective / edge;
        let gamma = SMOOTHING * self.target_gap * largest;
        if gamma < self.weights.gamma && gamma > 0.0 {
            self.weights.gamma = gamma;
        }
        self.weights.image = self.weights.image.min(largest.max(self.shown));
    }
}

/// Limits of the iteration.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    pub(crate) iterations: usize,
    pub(crate) start: Instant,
    /// Seconds after `start`.
    pub(crate) deadline: f64,
    /// Iterations after which the frame continues in `f64`.
    pub(crate) give_up: usize,
    /// Iterations before the first evaluation.
    pub(crate) first_look: usize,
}

/// Why the iteration stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    Proven,
    Deadline,
    Cap,
    /// The gap cannot be proven in this floating-point type.
    GaveUp,
    /// The objective is zero up to rounding: no relative gap can be proven.
    Vanished,
}

/// The iteration in one floating-point type.
#[derive(Debug, Clone)]
pub(crate) struct Engine<T> {
    pub(crate) fields: Fields<T>,
    pub(crate) map: StepMap<T>,
    pub(crate) proof: FlowFields<T>,
    /// Flow of the best bound.
    pub(crate) proven: [Vec<T>; 2],
    /// Singular values and data of the head in this type, `[padded rank]`.
    singular: Vec<T>,
    beta: Vec<T>,
    pub(crate) ranks: Vec<T>,
    /// Dual of the data, `[row of F']`, and scratch, `[rank]`.
    pub(crate) dual: Vec<f64>,
    tail_dual: Vec<f64>,
    pub(crate) columns: [Vec<f64>; 2],
    multiplier: f64,
    /// Duration of an evaluation, seconds.
    look_seconds: f64,
}

impl<T: Project> Engine<T> {
    pub(crate) fn new(setting: &Setting<T>, constrained: bool) -> Self {
        let ranks = vec![T::default(); setting.padded];
        let column = vec![0.0; setting.padded];
        let proof = FlowFields::new(setting);
        Self {
            fields: Fields::new(setting),
            map: StepMap::new(setting, constrained),
            proven: proof.flow.clone(),
            proof,
            singular: ranks.clone(),
            beta: ranks.clone(),
            ranks,
            dual: column.clone(),
            tail_dual: column.clone(),
            columns: [column.clone(), column],
            multiplier: 0.0,
            look_seconds: 0.0,
        }
    }

    /// Starts a frame with zero change and the previous duals.
    pub(crate) fn begin(&mut self, setting: &Setting<T>, problem: &Problem<'_>) {
        let Fields { change, fresh, anchor, room, .. } = &mut self.fields;
        change.fill(T::default());
        fresh.fill(T::default());
        for &cell in &setting.places.cells {
            let x = problem.anchor[cell];
            anchor[cell] = T::from_f64(x);
            if let Some([lower, upper]) = problem.bounds {
                room[0][cell] = T::from_f64(lower - x);
                room[1][cell] = T::from_f64(upper - x);
            }
        }
        self.set_tail(setting, problem, None);
    }

    /// Copies the state of another engine.
    pub(crate) fn take<U: Float>(&mut self, other: &Fields<U>) {
        let own = &mut self.fields;
        let pairs = [
            (&mut own.change, &other.change),
            (&mut own.fresh, &other.fresh),
            (&mut own.force, &other.force),
        ];
        let [first, second] = &mut own.flow;
        let flows = [(first, &other.flow[0]), (second, &other.flow[1])];
        for (own, other) in pairs.into_iter().chain(flows) {
            for (own, other) in own.iter_mut().zip(other) {
                *own = T::from_f64(other.to_f64());
            }
        }
    }

    /// Sets the duals to zero.
    pub(crate) fn clear(&mut self) {
        self.fields.force.fill(T::default());
        self.fields.flow.iter_mut().for_each(|q| q.fill(T::default()));
    }

    /// Multiplies the duals.
    pub(crate) fn scale_duals(&mut self, factor: f64) {
        let factor = T::from_f64(factor);
        let [first, second] = &mut self.fields.flow;
        for array in [first, second, &mut self.fields.force] {
            array.iter_mut().for_each(|v| *v = *v * factor);
        }
    }

    /// Returns whether the data step is split into head and tail.
    fn is_split(problem: &Problem<'_>) -> bool {
        problem.seen.is_whole && problem.ball.is_none()
    }

    /// Sets the force of the tail from `residual`, or from the residual at zero change.
    fn set_tail(&mut self, setting: &Setting<T>, problem: &Problem<'_>, residual: Option<&[f64]>) {
        let (head, rank) = (self.map.head.min(setting.padded), setting.rank);
        if !Self::is_split(problem) || head >= rank {
            self.fields.tail.fill(T::default());
            return;
        }
        self.ranks.fill(T::default());
        for k in head..rank {
            let y = residual.map_or(-problem.beta[k], |residual| residual[k]);
            self.tail_dual[k] = y;
            self.ranks[k] = T::from_f64(problem.seen.transposed[k * (rank + 1)] * y);
        }
        let (z, out) = (&self.ranks, &mut self.fields.tail);
        problem.arch.dispatch(Expand { setting, ranks: head..setting.padded, z, out });
    }

    /// Computes a new map at the start of a frame. Sets and returns the scale of the image, which falls at
    /// most by the factor `keep`, unless the objective limits it further.
    pub(crate) fn set_first_map(
        &mut self,
        setting: &Setting<T>,
        problem: &mut Problem<'_>,
        keep: f64,
        most_primal: f64,
    ) -> Result<f64, InverseError> {
        self.innovation(setting, problem);
        let Fields { work, anchor, .. } = &self.fields;
        let mut most = 0.0_f64;
        for &cell in &setting.places.cells {
            most = most.max(anchor[cell].abs().to_f64()).max(work[cell].abs().to_f64());
        }
        let scale = most.max(keep * problem.weights.image);
        problem.weights.image = if scale > 0.0 { scale } else { 1.0 };
        problem.weights.gamma = SMOOTHING * problem.target_gap * problem.weights.image;
        // the innovation of a constrained frame may be noise, which the image need not explain
        problem.shown = if problem.ball.is_none() { most } else { 0.0 };
        problem.fit_scale(most_primal);
        self.map.clear();
        self.map.raise(&self.fields.work, 1.0);
        self.map.raise_to_gradient(problem.arch, setting, &self.fields.anchor);
        self.set_map(setting, problem)?;
        self.set_tail(setting, problem, None);
        Ok(problem.weights.image)
    }

    /// Computes the linear image of the innovation, in `work`.
    pub(crate) fn innovation(&mut self, setting: &Setting<T>, problem: &Problem<'_>) {
        /// Ridge parameter, for a largest singular value of 1; it only affects step sizes.
        const RIDGE: f64 = 1e-3;
        let rank = setting.rank;
        self.columns[0].fill(0.0);
        for (f, beta) in problem.seen.transposed.chunks_exact(rank).zip(problem.beta) {
            self.columns[0].iter_mut().zip(f).for_each(|(z, f)| *z += f * beta);
        }
        for k in 0..setting.padded {
            let s = problem.exact.singular.get(k).copied().unwrap_or(0.0);
            self.ranks[k] = T::from_f64(self.columns[0][k] / (s * s + RIDGE));
        }
        let (z, out) = (&self.ranks, &mut self.fields.work);
        problem.arch.dispatch(Expand { setting, ranks: 0..setting.padded, z, out });
    }

    fn set_map(&mut self, setting: &Setting<T>, problem: &Problem<'_>) -> Result<(), InverseError> {
        self.map.set(problem.arch, setting, &mut self.fields, problem.seen, problem.weights)
    }

    /// Alternates rounds of iterations and evaluations.
    pub(crate) fn run(
        &mut self,
        setting: &Setting<T>,
        problem: &mut Problem<'_>,
        record: &mut Record,
        limits: &Limits,
    ) -> Result<End, InverseError> {
        let mut until = limits.first_look.clamp(FIRST, SLOW).max(record.iterations + FIRST);
        let seconds = || limits.start.elapsed().as_secs_f64();
        loop {
            let mut is_late = false;
            while record.iterations < until && !is_late {
                let count = CLOCK
                    .min(until - record.iterations)
                    .min(limits.iterations.saturating_sub(record.iterations).max(1));
                self.iterate(setting, problem, count);
                record.iterations += count;
                is_late = seconds() + self.look_seconds >= limits.deadline
                    || record.iterations >= limits.iterations;
            }
            let before = seconds();
            value(self, setting, problem, record);
            let is_slow = record.iterations >= SLOW + 10;
            for share in &[1.0, 0.3][..1 + usize::from(is_slow)] {
                let proof: Proof = prove(self, setting, problem, record, *share);
                record.take_proof(&proof, self);
            }
            let look = seconds() - before;
            self.look_seconds = look.max(0.9 * self.look_seconds);
            if record.gap() <= problem.target_gap {
                return Ok(End::Proven);
            }
            if record.iterations >= limits.iterations {
                return Ok(End::Cap);
            }
            if is_late || seconds() + self.look_seconds >= limits.deadline {
                return Ok(End::Deadline);
            }
            let is_last = limits.give_up == usize::MAX;
            if record.iterations >= limits.give_up
                || (!is_last && record.is_blurred(problem.target_gap))
            {
                return Ok(End::GaveUp);
            }
            until = record.iterations
                + match record.iterations {
                    0..60 => 4,
                    60..200 => 10,
                    _ => 25,
                };
            // the scale may come from an earlier image with larger values
            problem.fit_scale(record.primal);
            if record.iterations >= STUCK {
                problem.weights.gamma *= 0.5;
                if problem.bounds.is_some() {
                    problem.weights.step = (STEP_FALL * problem.weights.step).max(LEAST_STEP);
                }
            }
            if record.iterations >= SLOW {
                self.renew_map(setting, problem, record)?;
            }
            let residual = std::mem::take(&mut record.residual);
            self.set_tail(setting, problem, Some(&residual));
            record.residual = residual;
        }
    }

    /// Replaces the stale map of a slow frame, based on the change so far.
    fn renew_map(
        &mut self,
        setting: &Setting<T>,
        problem: &Problem<'_>,
        record: &Record,
    ) -> Result<(), InverseError> {
        self.map.clear();
        self.map.raise(&self.fields.fresh, 0.5);
        self.map.raise_to_gradient(problem.arch, setting, &self.fields.anchor);
        for &cell in &setting.places.cells {
            self.fields.work[cell] = T::from_f64(problem.anchor[cell] + record.change[cell]);
        }
        self.map.raise_to_gradient(problem.arch, setting, &self.fields.work);
        self.set_map(setting, problem)
    }

    fn iterate(&mut self, setting: &Setting<T>, problem: &Problem<'_>, count: usize) {
        let (rank, rows) = (setting.rank, problem.seen.rows);
        let Self { fields, map, singular, beta, columns, multiplier, .. } = self;
        let data = if Self::is_split(problem) {
            let head = map.head;
            for k in 0..head {
                let known = k < rank;
                let value = if known { problem.seen.transposed[k * (rank + 1)] } else { 0.0 };
                singular[k] = T::from_f64(value);
                beta[k] = T::from_f64(if known { problem.beta[k] } else { 0.0 });
            }
            let inverse = &map.head_inverse[..head * head];
            DataStep::Head { singular: &singular[..head], inverse, beta: &beta[..head], head }
        } else {
            let (transposed, back) = (&map.transposed[..rows * rank], &map.back[..rows * rank]);
            match problem.ball {
                None => DataStep::Dense { transposed, back, beta: &problem.beta[..rows] },
                Some(square) => {
                    // transformed once per round
                    let turned = &mut self.dual[..rows];
                    let vectors = map.vectors.chunks_exact(rows);
                    for (out, vector) in turned.iter_mut().zip(vectors) {
                        *out = super::iterate::dot(vector, &problem.beta[..rows]);
                    }
                    let values = &map.values[..rows];
                    DataStep::Ball { transposed, back, beta: turned, values, square }
                }
            }
        };
        let [first, second] = columns;
        let columns = Columns { first, second, multiplier };
        let weights = problem.weights;
        let (lambda_space, lambda_time) =
            (T::from_f64(weights.lambda_space), T::from_f64(weights.lambda_time));
        let bounded = problem.bounds.is_some();
        let is_short = problem.target_gap >= LEAST_SHORT_GAP;
        match &setting.basis {
            Basis::Grid(differences) => problem.arch.dispatch(Iterate {
                setting,
                differences,
                fields,
                data,
                columns,
                lambda_space,
                lambda_time,
                bounded,
                is_short,
                count,
            }),
            Basis::Gathered(differences) => problem.arch.dispatch(Iterate {
                setting,
                differences: differences.as_ref(),
                fields,
                data,
                columns,
                lambda_space,
                lambda_time,
                bounded,
                is_short,
                count,
            }),
        }
    }

    /// Computes the data dual of the last iteration, `[row of F']`, in `dual`.
    pub(crate) fn set_dual(&mut self, setting: &Setting<T>, problem: &Problem<'_>) {
        use super::iterate::dot;
        use crate::st_tv::ball;
        let (rank, rows) = (setting.rank, problem.seen.rows);
        let Self { fields, map, dual, tail_dual, columns, multiplier, .. } = self;
        let [c, u] = columns;
        for (c, own) in c.iter_mut().zip(&fields.coefficients).take(rank) {
            *c = own.to_f64();
        }
        if Self::is_split(problem) {
            let head = map.head;
            let known = head.min(rank);
            u[..head].fill(0.0);
            for k in 0..known {
                u[k] = problem.seen.transposed[k * (rank + 1)] * c[k] - problem.beta[k];
            }
            let (matrix, out) = (&map.inverse[..known * head], &mut dual[..known]);
            problem.arch.dispatch(RowsTimes { matrix, x: &u[..head], out });
            dual[known..rank].copy_from_slice(&tail_dual[known..rank]);
            return;
        }
        let residual = problem.seen.transposed.chunks_exact(rank).zip(problem.beta);
        for (u, (row, beta)) in u.iter_mut().zip(residual).take(rows) {
            *u = dot(row, &c[..rank]) - beta;
        }
        match problem.ball {
            None => {
                for (y, row) in dual.iter_mut().zip(map.inverse.chunks_exact(rows)).take(rows) {
                    *y = dot(row, &u[..rows]);
                }
            }
            Some(_) => {
                let vectors = || map.vectors.chunks_exact(rows).zip(&map.values).take(rows);
                dual[..rows].fill(0.0);
                for (vector, value) in vectors() {
                    let turned = ball::dual(dot(vector, &u[..rows]), *value, *multiplier);
                    dual.iter_mut().zip(vector).for_each(|(y, e)| *y += turned * e);
                }
            }
        }
    }
}
