//! Iteration from the first iterate to a certified result.

mod constant;
mod reachable;
mod steps;

use super::certificate::Effort;
use super::engine::Engine;
use super::lanes::Project;
use super::operators::Operators;
use super::problem::Problem;
use super::record::Record;
use super::schedule::{FLOW_STEPS, LEAN, POWER};
use super::settings::Stop;
use super::state::State;
use super::step;
use super::task::Task;
use super::travel::Travel;
use crate::{ImageSequence, InverseError, SequenceStatus, TracePoint};
use std::time::Instant;
use steps::{MAP_AT, SHARE};

/// Iterations before the first evaluation, and largest growth of the iterations from one to the next; an
/// evaluation costs as much as three iterations.
const FIRST_LOOK: usize = 32;
const GROWTH: f64 = 1.35;
/// Expected gap, relative to the decrease of the objective while the iterations grow by a factor of e, both
/// relative to the objective. On the reference problems it is 0.3 to 0.5 before 1e-2, 1e-3 and 1e-4.
const REMAINS: f64 = 0.4;
/// A bound is computed when the expected gap is below this multiple of the target gap; a bound costs as much as
/// some 25 iterations, and one that is too early is lost.
const NEAR: f64 = 0.9;
/// Iterations after which a bound is computed at every evaluation.
const PROVE_FROM: usize = 300;
/// Smallest growth from one evaluation to the next, and smallest number of iterations between them.
const LEAST_GROWTH: f64 = 1.06;
const LEAST_BETWEEN: usize = 16;
/// Effort of a bound: changes of the data dual, steps of the flow before each (more with exact steps in time, where
/// forces travel over all frames: 100 times the weight in time to 1e-2 takes 209 iterations with 5 and 191 with 7),
/// slack of the balls, and force towards the image, both relative to the target gap. Half or twice the slack or the
/// force cost at most a fiftieth of the iterations to 1e-3; 20 rounds save as little.
const ROUNDS: usize = 12;
const CHAIN_FLOW_STEPS: usize = 7;
const SLACK: f64 = 0.2;
/// Steps of the flow for a bound that keeps the data dual.
const PLAIN_FLOW_STEPS: usize = 100;
/// Objective that counts as zero up to rounding, in the solver's units, where the data has norm 1.
const SMALLEST_PRIMAL: f64 = 1e-14;

/// Returns the factor on the iterations after which the gap would be smaller by `factor`.
fn growth_for(factor: f64) -> f64 {
    factor.powf(1.0 / POWER).clamp(LEAST_GROWTH, GROWTH)
}

/// A solve.
pub(crate) struct Run<'a, T: Project> {
    task: &'a Task<'a>,
    problem: Problem<'a>,
    ops: &'a Operators<T>,
    engine: Engine<T>,
    record: Record,
    trace: Vec<TracePoint>,
    start: Instant,
    schedule: Schedule,
    /// The iterate at the last look at the balance of the steps.
    travel: Option<Travel<T>>,
}

/// What a solve decided so far.
#[derive(Clone, Copy)]
struct Schedule {
    /// Whether a step map is in use instead of a uniform step.
    is_mapped: bool,
    /// Factor on the steps of the map.
    boost: f64,
    smoothing: f64,
    next_map: usize,
    /// Iterations at the last evaluation.
    evaluated: usize,
    /// Whether the last images that were evaluated met all constraints.
    is_feasible: bool,
    /// Iterations from which the constraints are checked, if no image has met them.
    next_check: usize,
}

/// Limits of a run.
#[derive(Clone, Copy)]
struct Limits {
    iterations: usize,
    seconds: f64,
}

impl<'a, T: Project> Run<'a, T> {
    pub(crate) fn new(
        task: &'a Task<'a>,
        ops: &'a Operators<T>,
        target_gap: f64,
        start: Instant,
    ) -> Result<Self, InverseError> {
        let problem = task.problem(target_gap);
        let mut engine = Engine::new(&problem, ops, 0);
        let record = Record::new(&problem);
        engine.state.set_origin(ops, &record.images, problem.bounds);
        for frame in 0..problem.frames() {
            engine.data.set_beta(&problem, frame, problem.beta(frame).iter().copied());
        }
        let schedule = Schedule {
            is_mapped: false,
            boost: 1.0,
            smoothing: 0.0,
            next_map: MAP_AT[0],
            evaluated: 0,
            is_feasible: true,
            next_check: PROVE_FROM,
        };
        let trace = Vec::new();
        let mut this =
            Self { task, problem, ops, engine, record, trace, start, schedule, travel: None };
        this.engine.data.margin = this.margin();
        let guess = || step::guess(&problem, ops, &this.engine.state).unwrap_or(1.0);
        let first = this.free_step().unwrap_or_else(guess);
        this.set_uniform(first)?;
        this.try_constant();
        this.note();
        Ok(this)
    }

    /// Continues this run in another precision.
    pub(crate) fn converted<U: Project>(
        self,
        ops: &'a Operators<U>,
    ) -> Result<Run<'a, U>, InverseError> {
        let Self { task, problem, record, trace, start, schedule, .. } = self;
        let mut engine = Engine::new(&problem, ops, 0);
        engine.state.take(&self.engine.state);
        engine.data.margin = self.engine.data.margin;
        engine.is_plain = self.engine.is_plain;
        let mut new =
            Run { task, problem, ops, engine, record, trace, start, schedule, travel: None };
        new.keep_image(false);
        match new.free_step() {
            Some(step) => new.set_uniform(step)?,
            None => new.engine.set_data(&problem, ops)?,
        }
        Ok(new)
    }

    /// Starts from the images and duals of the same frames with weights smaller by `factor`.
    pub(crate) fn start_from(&mut self, other: &State<T>, factor: f64) -> Result<(), InverseError> {
        let Self { problem, ops, engine, schedule, .. } = self;
        engine.state.duals.take(&other.duals, factor);
        let origins = engine.state.origin.iter().zip(other.images());
        engine.state.change.iter_mut().zip(origins).for_each(|(d, (o, x))| *d = x - *o);
        let Engine { state, map, .. } = engine;
        schedule.is_mapped |= step::set_map(ops, state, map, [SHARE, step::FLOOR]);
        engine.set_data(problem, ops)
    }

    pub(crate) fn state(&self) -> &State<T> {
        &self.engine.state
    }

    /// Runs to the target gap or a limit; returns `None` if `most` iterations did not suffice.
    pub(crate) fn advance(
        &mut self,
        stop: &Stop,
        most: usize,
    ) -> Result<Option<SequenceStatus>, InverseError> {
        let deadline = stop.deadline.map_or(f64::INFINITY, |d| d.as_secs_f64());
        let limits = Limits { iterations: stop.max_iterations, seconds: deadline };
        let mut look = self.next_look(self.growth()).max(FIRST_LOOK);
        let (mut last, mut last_at) = (f64::INFINITY, self.record.iterations.max(1));
        // the time of the first evaluation, of a constant image, estimates the cost of later ones
        self.engine.look_seconds = self.start.elapsed().as_secs_f64();
        loop {
            let done = self.record.iterations;
            if self.record.gap() <= self.problem.target_gap {
                return Ok(Some(SequenceStatus::Converged));
            }
            // if the optimum is zero, no relative gap can be reached
            if self.record.primal <= SMALLEST_PRIMAL {
                return Ok(Some(SequenceStatus::Stalled));
            }
            if self.start.elapsed().as_secs_f64() >= limits.seconds {
                return Ok(Some(SequenceStatus::Deadline));
            }
            if done >= limits.iterations {
                return Ok(Some(SequenceStatus::IterationCap));
            }
            if done >= most {
                return Ok(None);
            }
            let inner = Limits { seconds: limits.seconds - self.engine.look_seconds, ..limits };
            let has_ended = self.improve(look.min(most), inner)?;
            let before = Instant::now();
            let primal = self.keep_image(true);
            self.schedule.is_feasible = primal.is_finite();
            if self.record.primal.is_infinite() && stop.deadline.is_none() {
                self.check_reachable()?;
            }
            let done = self.record.iterations;
            let e_folds = (done as f64 / last_at as f64).ln();
            let expected = REMAINS * (last - primal) / (e_folds * primal.abs());
            (last, last_at) = (primal, done);
            let near = NEAR * self.problem.target_gap;
            let growth = if has_ended || done >= PROVE_FROM.min(most) || expected < near {
                self.prove();
                if done > MAP_AT[2] {
                    self.balance();
                }
                self.growth()
            } else {
                growth_for(expected / near)
            };
            self.note();
            self.engine.look_seconds = before.elapsed().as_secs_f64();
            look = self.next_look(growth);
        }
    }

    /// Returns the factor on the iterations after which the target gap would be reached.
    fn growth(&self) -> f64 {
        let gap = self.record.gap();
        // without a feasible image there is no gap
        if gap.is_finite() { growth_for(gap / self.problem.target_gap) } else { GROWTH }
    }

    fn next_look(&self, growth: f64) -> usize {
        let done = self.record.iterations;
        ((done as f64 * growth).ceil() as usize).max(done + LEAST_BETWEEN)
    }

    /// Returns the best result, or the last one if none met the data constraints.
    pub(crate) fn finish(self, status: SequenceStatus) -> ImageSequence {
        let Record { primal, images, misfit, candidate, .. } = &self.record;
        let (images, misfit) = match primal.is_finite() {
            true => (images, misfit),
            false => (&candidate.images, &candidate.misfit),
        };
        self.task.sequence(images, misfit, self.trace, status, self.start)
    }

    /// Appends the current bounds to the trace.
    fn note(&mut self) {
        let Record { iterations, primal, lower_bound, .. } = self.record;
        let seconds = self.start.elapsed().as_secs_f64();
        self.trace.push(TracePoint { seconds, iterations, primal, lower_bound });
    }

    /// Computes a lower bound on the optimum.
    fn prove(&mut self) {
        let Self { problem, ops, engine, record, .. } = self;
        let gap = problem.target_gap;
        let effort = match engine.is_plain {
            true => Effort::plain(PLAIN_FLOW_STEPS, gap),
            false => Effort {
                rounds: ROUNDS,
                steps: if engine.state.chain.is_some() { CHAIN_FLOW_STEPS } else { FLOW_STEPS },
                lean: LEAN * gap,
                slack: SLACK * gap,
            },
        };
        let images = std::mem::take(&mut record.candidate.images);
        let size = images.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
        engine.prove(problem, ops, record, (&images, size), effort);
        record.candidate.images = images;
    }

    /// Evaluates the images of the iterate and stores them if they are the best; returns their objective. Changes are
    /// counted from them afterwards. Images outside their data constraints may be moved into them.
    fn keep_image(&mut self, may_move: bool) -> f64 {
        let Self { problem, ops, engine, record, .. } = self;
        let Engine { state, data, .. } = &mut *engine;
        let candidate = &mut record.candidate;
        candidate.take(problem, state, 0.0);
        candidate.evaluate(problem, may_move.then_some((&*state, &*data)));
        state.set_origin(ops, &candidate.images, problem.bounds);
        for (frame, residual) in candidate.residual.chunks_exact(ops.padded).enumerate() {
            data.set_beta(problem, frame, residual.iter().map(|r| -r));
        }
        engine.set_tail(ops, None);
        self.schedule.evaluated = record.iterations;
        record.take();
        record.candidate.primal
    }
}
