//! From the first iterate to a certified result.

mod constant;

use super::certificate::Evaluation;
use super::fit::{self, Memory};
use super::float::Float;
use super::operators::Operators;
use super::settings::Stop;
use super::state::State;
use super::step;
use super::task::Task;
use crate::{ImageSequence, SequenceStatus, TracePoint};
use std::time::Instant;

/// Step of the run that finds feasible dual variables, relative to that of the image. Between 30
/// and 1000 the bound is found in the same number of iterations within a third.
const PROOF_STEP: f64 = 100.0;
/// Iterations after which the step has halved, and its least value relative to the first.
const HALVING: f64 = 30.0;
const LEAST_STEP: f64 = 1.0 / 15.0;
/// Iterations at which the first step is set anew from the norms found so far.
const MEASURE_AT: [usize; 4] = [8, 16, 32, 64];
/// First look at the image, and growth of the interval between looks: one costs two iterations.
const FIRST_LOOK: usize = 32;
const GROWTH: f64 = 1.35;
/// That growth where the objective falls by less than so many target gaps from one decision, whether
/// to try a proof, to the next.
const NEAR: f64 = 30.0;
const NEAR_GROWTH: f64 = 1.08;
/// Share of an image's iterations that its proof gets, and of the time under a deadline.
const PROOF_SHARE: f64 = 0.4;
/// Iterations between two looks at the clock.
const CLOCK: usize = 4;
/// Objective that is rounding of zero, in the solver's units, where data is 1.
const SMALLEST_PRIMAL: f64 = 1e-14;

/// State of a solve.
pub(crate) struct Run<'a, T> {
    task: &'a Task<'a>,
    ops: &'a Operators<T>,
    image: State<T>,
    proof: State<T>,
    evaluation: Evaluation,
    /// Data dual of the image's run and of the proof's, `[frame][rank]`.
    columns: [Vec<f64>; 2],
    /// First step size, see [`Self::step`].
    first_step: f64,
    /// Iterations of the image's run, and of all.
    done: usize,
    total: usize,
    best: Best,
    trace: Vec<TracePoint>,
    start: Instant,
}

/// The best that was found.
struct Best {
    primal: f64,
    lower_bound: f64,
    images: Vec<f64>,
    residual: Vec<f64>,
}

impl Best {
    /// Keeps the image of an evaluation if it is better.
    fn take(&mut self, primal: f64, evaluation: &Evaluation) {
        if primal < self.primal {
            self.primal = primal;
            self.images.copy_from_slice(&evaluation.image);
            self.residual.copy_from_slice(&evaluation.residual);
        }
    }

    fn gap(&self) -> f64 {
        match self.primal - self.lower_bound {
            gap if gap <= 0.0 => 0.0,
            gap => gap / self.primal.abs(),
        }
    }
}

/// How far a run may go.
#[derive(Clone, Copy)]
struct Limits {
    iterations: usize,
    seconds: f64,
}

impl<'a, T: Float> Run<'a, T> {
    pub(crate) fn new(task: &'a Task<'a>, ops: &'a Operators<T>, start: Instant) -> Self {
        let image = State::new(ops, task.frames, task.linked(), task.bounds.is_some());
        let evaluation = Evaluation::new(&task.solver.double, &image, &task.solver.parts);
        let rank = task.solver.rank();
        let best = Best {
            primal: f64::INFINITY,
            lower_bound: f64::NEG_INFINITY,
            images: evaluation.image.clone(),
            residual: vec![0.0; task.frames],
        };
        let proof = image.clone();
        let columns = [vec![0.0; rank], vec![0.0; rank]];
        let mut this = Self {
            task,
            ops,
            image,
            proof,
            evaluation,
            columns,
            first_step: 1.0,
            done: 0,
            total: 0,
            best,
            trace: Vec::new(),
            start,
        };
        if let Some(step) = step::guess(&task.problem(), ops, &this.image) {
            this.first_step = step;
        }
        this
    }

    /// Runs to the target or a limit.
    pub(crate) fn finish(mut self, stop: &Stop) -> ImageSequence {
        let deadline = stop.deadline.map_or(f64::INFINITY, |d| d.as_secs_f64());
        let limits = Limits { iterations: stop.max_iterations, seconds: deadline };
        self.try_constant();
        self.note();
        let mut look = FIRST_LOOK;
        let mut last = f64::INFINITY;
        let (mut next_decision, mut next_proof) = (0, 0);
        let mut growth = GROWTH;
        let status = loop {
            if self.best.gap() <= stop.target_gap {
                break SequenceStatus::Converged;
            }
            // where the optimum is zero no relative gap can be reached
            if self.best.primal <= SMALLEST_PRIMAL {
                break SequenceStatus::Stalled;
            }
            if let Some(status) = self.over(limits) {
                break status;
            }
            let image = Limits {
                iterations: (limits.iterations as f64 * (1.0 - PROOF_SHARE)) as usize,
                seconds: limits.seconds * (1.0 - PROOF_SHARE),
            };
            let ended = self.improve_image(look, image);
            let primal = self.keep_image();
            self.note();
            look = (self.done as f64 * growth) as usize;
            if !ended && self.done < next_decision {
                continue;
            }
            next_decision = (self.done as f64 * GROWTH) as usize;
            let falling = (last - primal) / primal.abs();
            last = primal;
            growth = if falling < NEAR * stop.target_gap { NEAR_GROWTH } else { GROWTH };
            look = (self.done as f64 * growth) as usize;
            // the objective falls like a power of the iterations: what it still has to fall is
            // about what it fell since the last decision
            if ended || (falling < stop.target_gap && self.done >= next_proof) {
                let share = (self.done as f64 * PROOF_SHARE) as usize;
                let count = if ended { usize::MAX } else { share.max(FIRST_LOOK / 2) };
                self.prove(count, limits, stop.target_gap);
                self.note();
                next_proof = (self.done as f64 * GROWTH) as usize;
            }
        };
        let (images, residual) = (&self.best.images, &self.best.residual);
        let stride = self.image.stride;
        self.task.sequence(images, stride, residual, &self.trace, status, self.start)
    }

    /// Notes what is known now.
    fn note(&mut self) {
        self.trace.push(TracePoint {
            seconds: self.start.elapsed().as_secs_f64(),
            iterations: self.total,
            primal: self.best.primal,
            lower_bound: self.best.lower_bound,
        });
    }

    fn over(&self, limits: Limits) -> Option<SequenceStatus> {
        if self.start.elapsed().as_secs_f64() >= limits.seconds {
            Some(SequenceStatus::Deadline)
        } else if self.total >= limits.iterations {
            Some(SequenceStatus::IterationCap)
        } else {
            None
        }
    }

    /// Iterates on the image until `self.done` is `until`; true where a limit came first.
    fn improve_image(&mut self, until: usize, limits: Limits) -> bool {
        while self.done < until {
            if self.done.is_multiple_of(CLOCK) && self.over(limits).is_some() {
                self.improve(true);
                return true;
            }
            if MEASURE_AT.contains(&self.done) {
                self.measure_step();
            }
            self.improve(self.done + 1 == until);
        }
        false
    }

    /// One more iteration on the image.
    fn improve(&mut self, keep: bool) {
        let step = self.step();
        self.done += 1;
        self.total += 1;
        self.iterate(Which::Image, [step, self.step()], keep);
    }

    /// Runs towards feasible dual variables from the image's state, and keeps the best bound.
    fn prove(&mut self, count: usize, limits: Limits, target: f64) {
        self.proof.copy_from(&self.image);
        let step = self.step() * PROOF_STEP;
        let problem = self.task.problem();
        let arch = self.task.solver.arch;
        let mut look = count / 2;
        for k in 0..count {
            let ending = k + 1 == count
                || (self.total + 1) >= limits.iterations
                || (k.is_multiple_of(CLOCK) && self.over(limits).is_some());
            self.iterate(Which::Proof, [step; 2], k == look || ending);
            self.total += 1;
            if k == look || ending {
                let bound = self.evaluation.lower_bound(arch, &problem, &self.proof);
                self.best.lower_bound = self.best.lower_bound.max(bound);
                // where few measurements bind the image, large steps also find it sooner
                let primal = self.evaluation.primal(arch, &problem, &self.proof);
                self.best.take(primal, &self.evaluation);
                look = (k as f64 * GROWTH) as usize;
                if ending || self.best.gap() <= target {
                    break;
                }
            }
        }
    }

    /// Values the candidate of the image's run and keeps it if it is the best.
    fn keep_image(&mut self) -> f64 {
        let problem = self.task.problem();
        let primal = self.evaluation.primal(self.task.solver.arch, &problem, &self.image);
        self.best.take(primal, &self.evaluation);
        primal
    }

    /// Step size now: falls like 1 / iterations. Large steps bring the image near, small ones
    /// settle its details.
    fn step(&self) -> f64 {
        self.first_step * (1.0 / (1.0 + self.done as f64 / HALVING)).max(LEAST_STEP)
    }

    /// Sets the first step from the norms of image and duals.
    fn measure_step(&mut self) {
        if let Some(step) = step::measure(self.ops, &self.image) {
            self.first_step = step.clamp(0.1 * self.first_step, 10.0 * self.first_step);
        }
    }

    /// One iteration of one of the runs with this step, before one with the next.
    fn iterate(&mut self, which: Which, taus: [f64; 2], keep: bool) {
        let Self { task, ops, image, proof, evaluation, columns, .. } = self;
        let state = match which {
            Which::Image => image,
            Which::Proof => proof,
        };
        let memory = Memory { columns, data_dual: &mut evaluation.data_dual };
        let problem = task.problem();
        fit::iterate(task.solver.arch, ops, &problem, state, memory, taus, keep);
    }
}

/// The two runs.
#[derive(Debug, Clone, Copy)]
enum Which {
    Image,
    Proof,
}
