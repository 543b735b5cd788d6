//! The problem of one frame of a stream: iterations and evaluations of image and bound, until the gap is proven or a
//! limit is reached.

use super::super::certificate::Effort;
use super::super::engine::Engine;
use super::super::iterate::Pace;
use super::super::lanes::Project;
use super::super::operators::Operators;
use super::super::problem::{Anchor, Problem};
use super::super::record::Record;
use super::super::schedule::{CLOCK, FLOW_STEPS, LEAN, SMOOTHING};
use super::super::state::State;
use super::super::step::{self, FLOOR};
use super::proof::Proof;
use crate::{InverseError, SequenceStatus};
use std::time::Instant;

/// Target gaps below this sum the data term of a candidate in `f64`: the bound on the rounding error of `f32` is small
/// compared with larger gaps.
const LEAST_ROUNDED_GAP: f64 = 3e-3;
/// Over-relaxation factor.
const RHO: f64 = 1.8;
/// `c (X / lambda_space)` is the factor of the step map, for a largest singular value of 1; between 0.04 and 0.08 the
/// number of iterations of a steady frame varies by a tenth.
const STEP: f64 = 0.057;
/// Factor on the step with bounds, whose duals need large changes: at 32 x 32 a third takes 76 iterations, 1 takes 98,
/// a tenth 117. Factor on it per evaluation of a slow frame, and smallest one.
pub(super) const BOUNDED_STEP: f64 = 0.3;
const STEP_FALL: f64 = 0.8;
const LEAST_STEP: f64 = 0.05;
/// Ridge parameter of the linear image of an innovation, for a largest singular value of 1; it only affects steps.
const RIDGE: f64 = 1e-3;
/// Largest scale of an image relative to `objective / lambda_space`; the edge of a small touch is about
/// fifty pixels long. The error of the smoothing is proportional to the scale and must stay small compared
/// with the objective.
const SCALE: f64 = 0.012;
/// Smallest ratio of the image's scale from one map to the next.
const FORGET: f64 = 0.9;
/// Smallest change of an unknown, relative to the target gap and the scale of the image. Smaller changes
/// are set to zero, larger ones are reduced by it.
const THRESHOLD: f64 = 0.01;
/// Minimum number of iterations before the first evaluation.
const FIRST: usize = 20;
/// Iterations of a slow frame. From about here on evaluations are farther apart, each followed by a new
/// map, and bounds are computed twice.
const SLOW: usize = 50;
/// Iterations after which the smoothing may keep the gap open; it is halved at each evaluation.
const STUCK: usize = 120;
/// Bounds of frames that are not linked: changes of the data dual, slack relative to the target gap, steps of a bound
/// that keeps the data dual, and iterations between them as a share of all, because they cost as many as 25.
const ROUNDS: usize = 6;
const SLACK: f64 = 0.3;
const PLAIN_FLOW_STEPS: usize = 50;
const GROWTH: f64 = 0.15;
/// Objective that is zero up to the accuracy of `f32`, in units where data and images have norm 1.
const SMALLEST: f64 = 1e-7;

/// Limits of the iteration.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub(super) iterations: usize,
    pub(super) start: Instant,
    /// Seconds after `start`.
    pub(super) deadline: f64,
    /// Iterations after which the frame continues in `f64`.
    pub(super) give_up: usize,
    /// Iterations before the first evaluation.
    pub(super) first_look: usize,
}

impl Limits {
    /// Seconds since the start.
    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}

/// Scale of the images, the largest value of anchor and innovation, and the factor on the step and smoothing.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Scale {
    pub(super) image: f64,
    pub(super) shown: f64,
    pub(super) step: f64,
    pub(super) smoothing: f64,
}

impl Scale {
    /// Lowers the scale of the image and the smoothing to the limits given by an objective; the scale stays
    /// at or above `shown`.
    fn fit(&mut self, problem: &Problem<'_>, objective: f64) {
        let edge = problem.lambda_space * problem.skin.operators.mean_radius;
        let largest = SCALE * objective / edge;
        let smoothing = SMOOTHING * problem.target_gap * largest;
        if smoothing < self.smoothing && smoothing > 0.0 {
            self.smoothing = smoothing;
        }
        self.image = self.image.min(largest.max(self.shown));
    }
}

/// Evaluates the zero image as a candidate, for a constrained frame that allows it.
///
/// For a skin at rest it is the optimum, which an iteration would only approach. If the best objective so far is zero up
/// to rounding, the zero image is taken in any case, and the function returns true.
pub(super) fn is_nothing(problem: &Problem<'_>, record: &mut Record) -> bool {
    let is_allowed = problem.bounds.is_none_or(|[lower, upper]| lower <= 0.0 && upper >= 0.0);
    let square = problem.targets[0].square();
    let Some(anchor) = problem.anchor.filter(|_| is_allowed) else { return false };
    if problem.ball(0).is_none_or(|ball| square > ball) {
        return false;
    }
    let is_nothing = record.primal <= SMALLEST;
    if is_nothing {
        record.primal = f64::INFINITY;
    }
    let pairs = record.candidate.change.iter_mut().zip(anchor.image);
    pairs.for_each(|(d, x)| *d = -x);
    record.candidate.evaluate::<f32>(problem, None);
    record.take();
    is_nothing
}

/// A frame in one floating-point type.
pub(super) struct Frame<'a, T: Project> {
    pub(super) problem: &'a Problem<'a>,
    pub(super) ops: &'a Operators<T>,
    pub(super) engine: &'a mut Engine<T>,
    pub(super) scale: Scale,
    pub(super) record: &'a mut Record,
    pub(super) proof: &'a mut Proof,
}

impl<T: Project> Frame<'_, T> {
    /// Starts with zero change and the previous duals.
    pub(super) fn begin(&mut self) {
        let Self { problem, ops, engine, .. } = self;
        let Some(Anchor { image, beta, .. }) = problem.anchor else { return };
        engine.state.set_origin(ops, image, problem.bounds);
        engine.state.start_at_origin();
        engine.data.set_beta(problem, 0, beta.iter().copied());
        engine.set_tail(ops, None);
    }

    /// Computes a new map at the start of a frame. Sets the scale of the image, which falls at most by the factor
    /// [`FORGET`], unless the objective limits it further.
    pub(super) fn set_first_map(&mut self) -> Result<(), InverseError> {
        self.innovation();
        let Self { problem, ops, engine, scale, .. } = self;
        let Engine { state, map, .. } = &mut **engine;
        let largest = |values: &[T]| values.iter().fold(T::default(), |m, v| m.max(v.abs()));
        let most = largest(&state.work).max(largest(&state.origin)).to_f64();
        scale.image = most.max(FORGET * scale.image);
        scale.image = if scale.image > 0.0 { scale.image } else { 1.0 };
        scale.smoothing = SMOOTHING * problem.target_gap * scale.image;
        // the innovation of a constrained frame may be noise, which the image need not explain
        scale.shown = if problem.delta.is_none() { most } else { 0.0 };
        scale.fit(problem, self.record.primal);
        map.clear();
        map.raise(&state.work, 1.0);
        map.take(state.origin.iter().copied());
        map.raise_to_gradient(ops, 1);
        self.set_map()
    }

    /// Computes the linear image of the innovation, in `work`.
    fn innovation(&mut self) {
        let Self { problem, ops, engine, record, .. } = self;
        // scratch memory until the next evaluation
        let column = &mut record.candidate.coefficients[..ops.rank];
        problem.mode(0).apply_transposed(&problem.beta(0)[..ops.rank], column);
        let State { forces, work, .. } = &mut engine.state;
        forces.fill(T::default());
        for ((force, c), s) in forces.iter_mut().zip(column).zip(&problem.skin.singular) {
            *force = T::from_f64(*c / (s * s + RIDGE));
        }
        ops.expand(forces, 0..ops.padded, false, work);
    }

    fn set_map(&mut self) -> Result<(), InverseError> {
        let Self { problem, ops, engine, scale, .. } = self;
        let factor = scale.step * STEP * scale.image / (problem.lambda_space * ops.mean_radius);
        engine.map.set_tau(&mut engine.state, ops, scale.image, FLOOR, factor);
        step::set_even(ops, &mut engine.state);
        engine.set_data(problem, ops)
    }

    /// Alternates rounds of iterations and evaluations; returns `None` if the gap cannot be proven in this type.
    pub(super) fn run(&mut self, limits: &Limits) -> Result<Option<SequenceStatus>, InverseError> {
        let problem = self.problem;
        let mut until = limits.first_look.clamp(FIRST, SLOW).max(self.record.iterations + FIRST);
        loop {
            let is_late = self.iterate(limits, until);
            let before = limits.seconds();
            self.look();
            let look_seconds = (limits.seconds() - before).max(0.9 * self.engine.look_seconds);
            self.engine.look_seconds = look_seconds;
            let done = self.record.iterations;
            if self.record.gap() <= problem.target_gap {
                return Ok(Some(SequenceStatus::Converged));
            }
            if self.record.primal <= SMALLEST && is_nothing(problem, self.record) {
                self.record.lower_bound = 0.0;
                return Ok(Some(SequenceStatus::Stalled));
            }
            if done >= limits.iterations {
                return Ok(Some(SequenceStatus::IterationCap));
            }
            if is_late || limits.seconds() + look_seconds >= limits.deadline {
                return Ok(Some(SequenceStatus::Deadline));
            }
            let is_last = limits.give_up == usize::MAX;
            // rounding alone may take a large part of the target gap
            let is_blurred = self.proof.rounding > 0.3 * problem.target_gap;
            if done >= limits.give_up || (!is_last && is_blurred) {
                return Ok(None);
            }
            let between = match done {
                0..60 => 4,
                60..200 => 10,
                _ => 25,
            };
            let growth = if problem.is_held() { 0.0 } else { GROWTH * done as f64 };
            until = done + between.max(growth as usize);
            // the scale may come from an earlier image with larger values
            self.scale.fit(problem, self.record.primal);
            if done >= STUCK {
                self.scale.smoothing *= 0.5;
                if problem.bounds.is_some() {
                    self.scale.step = (STEP_FALL * self.scale.step).max(LEAST_STEP);
                }
            }
            if done >= SLOW {
                self.renew_map()?;
            }
            self.engine.set_tail(self.ops, Some(&self.record.candidate.residual));
        }
    }

    /// Iterates until a number of iterations or a limit is reached; returns whether it is a limit.
    fn iterate(&mut self, limits: &Limits, until: usize) -> bool {
        let mut is_late = false;
        while self.record.iterations < until && !is_late {
            let left = limits.iterations.saturating_sub(self.record.iterations).max(1);
            let count = CLOCK.min(until - self.record.iterations).min(left);
            let pace = Pace { smoothing: self.scale.smoothing, rho: RHO };
            let Engine { state, data, look_seconds, .. } = &mut *self.engine;
            state.iterate(self.ops, self.problem, data, pace, count);
            self.record.iterations += count;
            is_late = limits.seconds() + *look_seconds >= limits.deadline
                || self.record.iterations >= limits.iterations;
        }
        is_late
    }

    /// Evaluates the candidate and bounds; keeps the best of each.
    fn look(&mut self) {
        let Self { problem, ops, engine, scale, record, proof } = self;
        let gap = problem.target_gap;
        let threshold = if problem.is_held() { THRESHOLD * gap * scale.image } else { 0.0 };
        let Engine { state, data, .. } = &mut **engine;
        record.candidate.take(problem, state, threshold);
        let is_single = T::EPSILON > f64::EPSILON;
        if is_single && problem.delta.is_none() && gap >= LEAST_ROUNDED_GAP {
            record.candidate.evaluate_rounded(problem, ops, &mut state.sums);
        } else {
            record.candidate.evaluate(problem, Some((state, data)));
        }
        record.take();
        let is_slow = record.iterations >= SLOW + 10;
        let efforts = match (problem.is_held(), engine.is_plain) {
            (true, _) => [1.0, 0.3].map(|share| Effort::anchored(share * gap)),
            (false, true) => [Effort::plain(PLAIN_FLOW_STEPS, gap); 2],
            (false, false) => {
                let (slack, lean) = (SLACK * gap, LEAN * gap);
                [Effort { rounds: ROUNDS, steps: FLOW_STEPS, slack, lean }; 2]
            }
        };
        let count = if is_slow && problem.is_held() { 2 } else { 1 };
        let images = std::mem::take(&mut record.images);
        for effort in &efforts[..count] {
            let before = record.lower_bound;
            let bound = engine.prove(problem, ops, record, (&images, scale.image), *effort);
            proof.take(bound, before, &engine.certificate);
        }
        record.images = images;
    }

    /// Replaces the stale map of a slow frame, based on the change so far.
    fn renew_map(&mut self) -> Result<(), InverseError> {
        let Engine { state, map, .. } = &mut *self.engine;
        map.clear();
        map.raise(&state.fresh, 0.5);
        map.take(state.origin.iter().copied());
        map.raise_to_gradient(self.ops, 1);
        map.take(self.record.images.iter().map(|x| T::from_f64(*x)));
        map.raise_to_gradient(self.ops, 1);
        self.set_map()
    }
}
