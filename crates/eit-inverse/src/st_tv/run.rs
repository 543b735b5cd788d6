//! Iteration from the first iterate to a certified result.
//!
//! Over 300 lines because the schedule of step maps, evaluations and limits acts on one state.

mod constant;
mod reachable;
mod steps;

use super::certificate::{Certificate, Effort, Iterate};
use super::chain::Chain;
use super::fit::DataSteps;
use super::lanes::Project;
use super::operators::Operators;
use super::problem::Problem;
use super::schedule::{FLOW_STEPS, LEAN, POWER, relative_gap};
use super::settings::Stop;
use super::state::State;
use super::step::{self, MapScratch, MapSize};
use super::task::Task;
use super::travel::Travel;
use super::value::Candidate;
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
/// Iterations from which every second bound keeps the data dual: on one of 6 000 random problems (a pixel, five frames,
/// masked channels, data constraints) the others had not reached a gap of 3e-2 after 20 000 iterations.
const ALTERNATE_FROM: usize = 2000;
/// Largest force of changes in time, relative to that of differences in space, from which on the duals in
/// time take exact steps (see [`super::chain`]). These need 2 to 4 times fewer iterations (reference problem
/// of 32 x 32 to 1e-3, with the bounds of then: 259 and 674 with 10 times the weight in time, 329 and 1 161 with
/// 30, 398 and 1 497 with 100), which cost up to twice as much; with equal weights they save a twentieth.
const EXACT_FROM: f64 = 8.0;
/// Largest number of ranks for which they always do: with data of a few channels most pixels follow each
/// other in time (one row of the reference problem of 32 x 32 to 1e-2: 436 iterations instead of 4 388).
const EXACT_RANK: usize = 4;
/// Objective that counts as zero up to rounding, in the solver's units, where the data has norm 1.
const SMALLEST_PRIMAL: f64 = 1e-14;

/// Returns the mean largest force of a change in time, relative to that of a difference in space.
fn in_time<T: Project>(problem: &Problem<'_>, ops: &Operators<T>) -> f64 {
    let space = problem.lambda_space * ops.mean_radius;
    problem.lambda_time * ops.mean_area / space.max(f64::MIN_POSITIVE)
}

/// Returns the factor on the iterations after which the gap would be smaller by `factor`.
fn growth_for(factor: f64) -> f64 {
    factor.powf(1.0 / POWER).clamp(LEAST_GROWTH, GROWTH)
}

/// State of a solve.
pub(crate) struct Run<'a, T: Project> {
    task: &'a Task<'a>,
    ops: &'a Operators<T>,
    target_gap: f64,
    state: State<T>,
    data: DataSteps<T>,
    map: MapScratch<T>,
    certificate: Certificate<T>,
    candidate: Candidate,
    /// Whether a step map is in use instead of a uniform step.
    mapped: bool,
    /// Factor on the steps of the map.
    boost: f64,
    /// The iterate at the last look at the balance of the steps.
    travel: Option<Travel<T>>,
    /// Whether the next bound keeps the data dual: changes after a bound no better than the best, and in long runs.
    is_plain: bool,
    next_map: usize,
    /// Iterations from which the constraints are checked, if no image has met them.
    next_check: usize,
    smoothing: f64,
    /// Whether the last images that were looked at met all constraints.
    is_feasible: bool,
    done: usize,
    /// Iterations at the last evaluation.
    evaluated: usize,
    progress: Progress,
}

/// Best result so far and its history.
pub(crate) struct Progress {
    best: Best,
    trace: Vec<TracePoint>,
    start: Instant,
}

/// Best image and best lower bound so far.
struct Best {
    primal: f64,
    lower_bound: f64,
    images: Vec<f64>,
    residual: Vec<f64>,
}

impl Best {
    /// Keeps the image of an evaluation if it is better.
    fn take(&mut self, candidate: &Candidate) {
        if candidate.primal < self.primal {
            self.primal = candidate.primal;
            self.images.copy_from_slice(&candidate.images);
            self.residual.copy_from_slice(&candidate.misfit);
        }
    }

    fn gap(&self) -> f64 {
        relative_gap(self.primal, self.lower_bound)
    }
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
        let mut state = State::new(ops, &problem);
        let is_few = task.solver.rank() <= EXACT_RANK;
        if problem.linked() && (is_few || in_time(&problem, ops) >= EXACT_FROM) {
            state.chain = Some(Chain::new(task.frames));
        }
        let candidate = Candidate::new(&problem);
        state.set_origin(ops, &candidate.images, problem.bounds);
        let best = Best {
            primal: f64::INFINITY,
            lower_bound: f64::NEG_INFINITY,
            images: candidate.images.clone(),
            residual: vec![0.0; task.frames],
        };
        let progress = Progress { best, trace: Vec::new(), start };
        let mut this = Self::with(task, ops, state, candidate, (progress, target_gap));
        this.data.margin = this.margin();
        let first = || step::guess(&problem, ops, &this.state).unwrap_or(1.0);
        let first = this.free_step().unwrap_or_else(first);
        this.set_uniform(first)?;
        this.try_constant();
        this.note();
        Ok(this)
    }

    fn with(
        task: &'a Task<'a>,
        ops: &'a Operators<T>,
        state: State<T>,
        candidate: Candidate,
        (progress, target_gap): (Progress, f64),
    ) -> Self {
        let problem = task.problem(target_gap);
        let mut data = DataSteps::new(&problem, ops, 0);
        for frame in 0..task.frames {
            data.set_beta(frame, problem.beta(frame).iter().copied());
        }
        Self {
            task,
            ops,
            target_gap,
            data,
            map: MapScratch::new(&state),
            certificate: Certificate::new(ops, &state, &problem),
            state,
            candidate,
            mapped: false,
            boost: 1.0,
            travel: None,
            is_plain: false,
            next_map: MAP_AT[0],
            next_check: PROVE_FROM,
            smoothing: 0.0,
            is_feasible: true,
            done: 0,
            evaluated: 0,
            progress,
        }
    }

    fn problem(&self) -> Problem<'a> {
        self.task.problem(self.target_gap)
    }

    /// Continues this run in another precision.
    pub(crate) fn converted<U: Project>(
        self,
        ops: &'a Operators<U>,
    ) -> Result<Run<'a, U>, InverseError> {
        let mut state = State::new(ops, &self.problem());
        state.take(&self.state);
        let goal = (self.progress, self.target_gap);
        let mut new = Run::with(self.task, ops, state, self.candidate, goal);
        (new.mapped, new.boost, new.next_map) = (self.mapped, self.boost, self.next_map);
        (new.done, new.smoothing, new.is_plain) = (self.done, self.smoothing, self.is_plain);
        new.data.margin = self.data.margin;
        new.evaluated = new.done;
        new.keep_image(false);
        match new.free_step() {
            Some(step) => new.set_uniform(step)?,
            None => new.set_data()?,
        }
        Ok(new)
    }

    /// Starts from the images and duals of the same frames with weights smaller by `factor`.
    pub(crate) fn start_from(&mut self, state: &State<T>, factor: f64) -> Result<(), InverseError> {
        self.state.take_duals(state, factor);
        let images = state.origin.iter().zip(&state.change).map(|(x, d)| *x + *d);
        let origins = self.state.origin.iter().zip(images);
        self.state.change.iter_mut().zip(origins).for_each(|(d, (o, x))| *d = x - *o);
        let steps = MapSize { share: SHARE, floor: step::FLOOR };
        let arch = self.task.solver.skin.arch;
        if step::set_map(arch, self.ops, &mut self.state, &mut self.map, steps) {
            self.mapped = true;
        }
        self.set_data()
    }

    pub(crate) fn state(&self) -> &State<T> {
        &self.state
    }

    /// Runs to the target gap or a limit; returns `None` if `most` iterations did not suffice.
    pub(crate) fn advance(
        &mut self,
        stop: &Stop,
        most: usize,
    ) -> Result<Option<SequenceStatus>, InverseError> {
        let deadline = stop.deadline.map_or(f64::INFINITY, |d| d.as_secs_f64());
        let limits = Limits { iterations: stop.max_iterations, seconds: deadline };
        let mut look = self.next_look(self.growth(stop.target_gap)).max(FIRST_LOOK);
        let (mut last, mut last_at) = (f64::INFINITY, self.done.max(1));
        // the time of the first evaluation, of a constant image, estimates the cost of later ones
        let mut evaluation_s = self.progress.start.elapsed().as_secs_f64();
        loop {
            let gap = self.progress.best.gap();
            if gap <= stop.target_gap {
                return Ok(Some(SequenceStatus::Converged));
            }
            // if the optimum is zero, no relative gap can be reached
            if self.progress.best.primal <= SMALLEST_PRIMAL {
                return Ok(Some(SequenceStatus::Stalled));
            }
            if let Some(status) = self.over(limits) {
                return Ok(Some(status));
            }
            if self.done >= most {
                return Ok(None);
            }
            let inner = Limits { seconds: limits.seconds - evaluation_s, ..limits };
            let ended = self.improve(look.min(most), inner)?;
            let before = Instant::now();
            let primal = self.keep_image(true);
            self.is_feasible = primal.is_finite();
            if self.progress.best.primal.is_infinite() && stop.deadline.is_none() {
                self.check_reachable()?;
            }
            let e_folds = (self.done as f64 / last_at as f64).ln();
            let fallen = last - primal;
            let expected = REMAINS * fallen / (e_folds * primal.abs());
            (last, last_at) = (primal, self.done);
            let due = ended || self.done >= PROVE_FROM.min(most);
            let growth = if due || expected < NEAR * stop.target_gap {
                self.prove();
                if self.done > MAP_AT[2] {
                    self.balance();
                }
                self.growth(stop.target_gap)
            } else {
                growth_for(expected / (NEAR * stop.target_gap))
            };
            self.note();
            evaluation_s = before.elapsed().as_secs_f64();
            look = self.next_look(growth);
        }
    }

    /// Returns the factor on the iterations after which the target gap would be reached.
    fn growth(&self, target_gap: f64) -> f64 {
        let gap = self.progress.best.gap();
        // without a feasible image there is no gap
        if !gap.is_finite() {
            return GROWTH;
        }
        growth_for(gap / target_gap)
    }

    fn next_look(&self, growth: f64) -> usize {
        ((self.done as f64 * growth).ceil() as usize).max(self.done + LEAST_BETWEEN)
    }

    /// Returns the best result, or the last one if none met the data constraints.
    pub(crate) fn finish(self, status: SequenceStatus) -> ImageSequence {
        let Progress { best, trace, start } = self.progress;
        let (images, residual) = match best.primal.is_finite() {
            true => (&best.images, &best.residual),
            false => (&self.candidate.images, &self.candidate.misfit),
        };
        self.task.sequence(images, residual, &trace, status, start)
    }

    /// Appends the current bounds to the trace.
    fn note(&mut self) {
        let Progress { best, trace, start } = &mut self.progress;
        trace.push(TracePoint {
            seconds: start.elapsed().as_secs_f64(),
            iterations: self.done,
            primal: best.primal,
            lower_bound: best.lower_bound,
        });
    }

    fn over(&self, limits: Limits) -> Option<SequenceStatus> {
        if self.progress.start.elapsed().as_secs_f64() >= limits.seconds {
            Some(SequenceStatus::Deadline)
        } else if self.done >= limits.iterations {
            Some(SequenceStatus::IterationCap)
        } else {
            None
        }
    }

    /// Computes a lower bound on the optimum.
    fn prove(&mut self) {
        let steps = if self.state.chain.is_some() { CHAIN_FLOW_STEPS } else { FLOW_STEPS };
        let (slack, lean) = (SLACK * self.target_gap, LEAN * self.target_gap);
        let effort = match self.is_plain {
            true => Effort::plain(PLAIN_FLOW_STEPS, self.target_gap),
            false => Effort { rounds: ROUNDS, steps, slack, lean },
        };
        let problem = self.problem();
        let Self { ops, state, data, candidate, certificate, progress, .. } = self;
        let iterate = Iterate { ops, state, data, images: &candidate.images, size: 0.0 };
        let bound = certificate.bound(&problem, iterate, effort).value;
        let old = progress.best.lower_bound;
        progress.best.lower_bound = old.max(bound);
        if progress.best.lower_bound <= old || self.done >= ALTERNATE_FROM {
            self.is_plain = !self.is_plain;
        }
    }

    /// Evaluates the images of the iterate and stores them if they are the best; returns their objective. Changes are
    /// counted from them afterwards. Images outside their data constraints may be moved into them.
    fn keep_image(&mut self, may_move: bool) -> f64 {
        let problem = self.problem();
        let Self { ops, state, data, candidate, .. } = self;
        candidate.take(&problem, state, 0.0);
        candidate.evaluate(&problem, may_move.then_some((&*state, &*data)));
        state.set_origin(ops, &candidate.images, problem.bounds);
        let padded = ops.padded;
        for (frame, residual) in candidate.residual.chunks_exact(padded).enumerate() {
            data.set_beta(frame, residual.iter().map(|r| -r));
        }
        data.set_tail(&problem, ops, state, None);
        self.evaluated = self.done;
        self.progress.best.take(candidate);
        candidate.primal
    }
}
