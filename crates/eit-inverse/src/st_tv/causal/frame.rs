//! The problem of one frame of a stream: iterations and evaluations of image and bound, until the gap is proven or a
//! limit is reached.
//!
//! Over 400 lines because the numbers of one schedule, and the steps of one loop over both floating-point types, are
//! best read together.

use super::super::certificate::{Certificate, Effort, Iterate};
use super::super::fit::DataSteps;
use super::super::iterate::Pace;
use super::super::lanes::Project;
use super::super::operators::Operators;
use super::super::problem::{Anchor, Problem};
use super::super::products::Expand;
use super::super::schedule::{CLOCK, FLOW_STEPS, LEAN, SINGLE_PRECISION_GAP, SMOOTHING};
use super::super::state::State;
use super::super::step::{self, FLOOR, MapScratch};
use super::record::Record;
use super::settings::CausalSettings;
use crate::InverseError;
use std::time::Instant;

/// Number of frames of a steady stream between two step maps.
const MAP_EVERY: usize = 4;
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
const BOUNDED_STEP: f64 = 0.3;
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
/// An innovation larger than usual by this factor is an event, for which a new map is computed.
const EVENT: f64 = 1.5;
/// Minimum number of iterations before the first evaluation.
const FIRST: usize = 20;
/// Iterations of a slow frame. From about here on evaluations are farther apart, each followed by a new
/// map, and bounds are computed twice.
const SLOW: usize = 50;
/// Iterations after which the smoothing may keep the gap open; it is halved at each evaluation.
const STUCK: usize = 120;
/// Number of `f32` iterations after which a frame continues in `f64`.
const GIVE_UP: usize = 400;
/// Bounds of frames that are not linked: changes of the data dual, slack relative to the target gap, steps of a bound
/// that keeps the data dual, and iterations between them as a share of all, because they cost as many as 25.
const ROUNDS: usize = 6;
const SLACK: f64 = 0.3;
const PLAIN_FLOW_STEPS: usize = 50;
const GROWTH: f64 = 0.15;
/// Objective that is zero up to the accuracy of `f32`, in units where data and images have norm 1.
const SMALLEST: f64 = 1e-7;

/// Why the iteration stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum End {
    Proven,
    Deadline,
    Cap,
    /// The gap cannot be proven in this floating-point type.
    GaveUp,
    /// The objective is zero up to rounding: no relative gap can be proven.
    Vanished,
}

/// Limits of the iteration.
#[derive(Debug, Clone, Copy)]
struct Limits {
    iterations: usize,
    start: Instant,
    /// Seconds after `start`.
    deadline: f64,
    /// Iterations after which the frame continues in `f64`.
    give_up: usize,
    /// Iterations before the first evaluation.
    first_look: usize,
}

/// The iteration in one floating-point type.
#[derive(Debug, Clone)]
struct Engine<T: Project> {
    state: State<T>,
    data: DataSteps<T>,
    map: MapScratch<T>,
    certificate: Certificate<T>,
    column: Vec<f64>,
    /// Duration of an evaluation, seconds.
    look_seconds: f64,
    /// Whether the next bound of a frame that is not linked keeps the data dual.
    is_plain: bool,
}

/// Scale of the images, the largest value of anchor and innovation, and the factor on the step and smoothing.
#[derive(Debug, Clone, Copy, Default)]
struct Scale {
    image: f64,
    shown: f64,
    step: f64,
    smoothing: f64,
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

/// Engines in both floating-point types, and what a frame keeps for the next.
#[derive(Debug, Clone)]
pub(super) struct Frames {
    single: Engine<f32>,
    double: Engine<f64>,
    scale: Scale,
    /// Running mean of the innovation, iterations of the last two frames, frames since the last map, and in all.
    usual: f64,
    recent: [usize; 2],
    map_age: usize,
    count: usize,
}

impl Frames {
    pub(super) fn new(problem: &Problem<'_>, single: &Operators<f32>) -> Self {
        Self {
            single: Engine::new(problem, single),
            double: Engine::new(problem, &problem.skin.operators),
            scale: Scale::default(),
            usual: 0.0,
            recent: [0; 2],
            map_age: MAP_EVERY,
            count: 0,
        }
    }

    /// Asks for a new step map.
    pub(super) fn renew_map(&mut self) {
        self.map_age = MAP_EVERY;
    }

    /// Sets the duals to zero.
    pub(super) fn clear(&mut self) {
        self.single.state.clear();
        self.double.state.clear();
    }

    /// Changes the unit of the data to a larger one.
    pub(super) fn grow(&mut self, factor: f64, is_penalised: bool) {
        self.scale.image /= factor;
        if is_penalised {
            self.single.state.scale_duals(1.0 / factor);
            self.double.state.scale_duals(1.0 / factor);
        }
    }

    /// Solves a frame; the record must belong to it alone.
    pub(super) fn solve(
        &mut self,
        problem: Problem<'_>,
        ops: &Operators<f32>,
        record: &mut Record,
        settings: &CausalSettings,
        start: Instant,
    ) -> Result<End, InverseError> {
        self.count += 1;
        self.map_age += 1;
        let rows = problem.modes[0].rows;
        let size = problem.beta(0)[..rows].iter().map(|b| b * b).sum::<f64>().sqrt();
        let is_event = size > EVENT * self.usual || self.count <= 2;
        let is_stale = self.map_age > MAP_EVERY || is_event;
        let step = 0.1 * (size.min(2.0 * self.usual) - self.usual);
        self.usual = if self.count <= 2 { size } else { self.usual + step };
        record.clear();
        self.scale.step = if problem.bounds.is_some() { BOUNDED_STEP } else { 1.0 };
        self.scale.smoothing = SMOOTHING * problem.target_gap * self.scale.image;
        let deadline = settings.deadline.map_or(f64::INFINITY, |d| d.as_secs_f64());
        let least = self.recent[0].min(self.recent[1]);
        let mut limits = Limits {
            iterations: settings.max_iterations,
            start,
            deadline,
            give_up: GIVE_UP,
            first_look: least.saturating_sub(4),
        };
        // the previous image is a candidate, often the best one without motion
        record.candidate.change.fill(0.0);
        record.candidate.evaluate::<f32>(&problem, None);
        record.take();
        if is_nothing(&problem, record) {
            record.lower_bound = 0.0;
            return Ok(End::Vanished);
        }
        if record.primal == 0.0 {
            record.lower_bound = 0.0;
            return Ok(End::Proven);
        }
        let is_single = problem.target_gap >= SINGLE_PRECISION_GAP;
        let mut end = End::GaveUp;
        let Self { single, double, scale, .. } = self;
        let unchanged = record.primal;
        if is_single {
            single.begin(ops, &problem);
            if is_stale {
                single.set_first_map(ops, &problem, scale, unchanged)?;
                self.map_age = 1;
            } else {
                single.data.assign(&problem, ops, &single.state)?;
            }
            let mut own = *scale;
            end = single.run(ops, &problem, &mut own, record, &limits)?;
        }
        if end == End::GaveUp {
            limits.give_up = usize::MAX;
            let exact = &problem.skin.operators;
            double.begin(exact, &problem);
            let mut own = *scale;
            if is_single {
                double.state.take_iterate(&single.state);
            }
            double.set_first_map(exact, &problem, &mut own, unchanged)?;
            if !is_single {
                scale.image = own.image;
            }
            end = double.run(exact, &problem, &mut own, record, &limits)?;
            if is_single {
                single.state.take_duals(&double.state, 1.0);
                // the map in the other type belongs to an earlier iterate
                self.map_age = MAP_EVERY;
            }
        }
        self.recent = [self.recent[1], record.iterations];
        Ok(end)
    }
}

/// Evaluates the zero image as a candidate, for a constrained frame that allows it.
///
/// For a skin at rest it is the optimum, which an iteration would only approach. If the best objective so far is zero up
/// to rounding, the zero image is taken in any case, and the function returns true.
fn is_nothing(problem: &Problem<'_>, record: &mut Record) -> bool {
    let is_allowed = problem.bounds.is_none_or(|[lower, upper]| lower <= 0.0 && upper >= 0.0);
    let square = problem.targets[0].values.iter().map(|t| t * t).sum::<f64>();
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

impl<T: Project> Engine<T> {
    fn new(problem: &Problem<'_>, ops: &Operators<T>) -> Self {
        let state = State::new(ops, problem);
        Self {
            data: DataSteps::new(problem, ops, 1),
            map: MapScratch::new(&state),
            certificate: Certificate::new(ops, &state, problem),
            state,
            column: vec![0.0; ops.padded],
            look_seconds: 0.0,
            is_plain: false,
        }
    }

    /// Starts a frame with zero change and the previous duals.
    fn begin(&mut self, ops: &Operators<T>, problem: &Problem<'_>) {
        let Some(Anchor { image, .. }) = problem.anchor else { return };
        self.state.set_origin(ops, image, problem.bounds);
        self.state.start_at_origin();
        self.data.set_beta(0, problem.beta(0).iter().copied());
        self.data.set_tail(problem, ops, &mut self.state, None);
    }

    /// Computes a new map at the start of a frame. Sets the scale of the image, which falls at most by the factor
    /// [`FORGET`], unless the objective limits it further.
    fn set_first_map(
        &mut self,
        ops: &Operators<T>,
        problem: &Problem<'_>,
        scale: &mut Scale,
        most_primal: f64,
    ) -> Result<(), InverseError> {
        self.innovation(ops, problem);
        let State { work, origin, .. } = &self.state;
        let largest = |values: &[T]| values.iter().fold(T::default(), |m, v| m.max(v.abs()));
        let most = largest(work).max(largest(origin)).to_f64();
        scale.image = most.max(FORGET * scale.image);
        scale.image = if scale.image > 0.0 { scale.image } else { 1.0 };
        scale.smoothing = SMOOTHING * problem.target_gap * scale.image;
        // the innovation of a constrained frame may be noise, which the image need not explain
        scale.shown = if problem.delta.is_none() { most } else { 0.0 };
        scale.fit(problem, most_primal);
        self.map.clear();
        self.map.raise(work, 1.0);
        self.map.take(origin.iter().copied());
        self.map.raise_to_gradient(problem.skin.arch, ops, 1);
        self.set_map(ops, problem, scale)?;
        self.data.set_tail(problem, ops, &mut self.state, None);
        Ok(())
    }

    /// Computes the linear image of the innovation, in `work`.
    fn innovation(&mut self, ops: &Operators<T>, problem: &Problem<'_>) {
        let (mode, rank) = (problem.mode(0), ops.rank);
        mode.apply_transposed(&problem.beta(0)[..rank], &mut self.column[..rank]);
        self.state.forces.fill(T::default());
        for (k, s) in problem.skin.singular.iter().enumerate() {
            self.state.forces[k] = T::from_f64(self.column[k] / (s * s + RIDGE));
        }
        let State { forces: z, work: out, .. } = &mut self.state;
        let ranks = 0..ops.padded;
        problem.skin.arch.dispatch(Expand { ops, frames: 1, ranks, z, add: false, out });
    }

    fn set_map(
        &mut self,
        ops: &Operators<T>,
        problem: &Problem<'_>,
        scale: &Scale,
    ) -> Result<(), InverseError> {
        let factor = scale.step * STEP * scale.image / (problem.lambda_space * ops.mean_radius);
        self.map.set_tau(&mut self.state, ops, scale.image, FLOOR, factor);
        step::set_even(problem.skin.arch, ops, &mut self.state);
        self.data.set_map(problem, ops, &self.state)
    }

    /// Alternates rounds of iterations and evaluations.
    fn run(
        &mut self,
        ops: &Operators<T>,
        problem: &Problem<'_>,
        scale: &mut Scale,
        record: &mut Record,
        limits: &Limits,
    ) -> Result<End, InverseError> {
        let mut until = limits.first_look.clamp(FIRST, SLOW).max(record.iterations + FIRST);
        let seconds = || limits.start.elapsed().as_secs_f64();
        let arch = problem.skin.arch;
        loop {
            let mut is_late = false;
            let pace = Pace { smoothing: scale.smoothing, rho: RHO };
            while record.iterations < until && !is_late {
                let left = limits.iterations.saturating_sub(record.iterations).max(1);
                let count = CLOCK.min(until - record.iterations).min(left);
                self.state.iterate(arch, ops, problem, &mut self.data, pace, count);
                record.iterations += count;
                is_late = seconds() + self.look_seconds >= limits.deadline
                    || record.iterations >= limits.iterations;
            }
            let before = seconds();
            self.look(ops, problem, scale, record);
            let look = seconds() - before;
            self.look_seconds = look.max(0.9 * self.look_seconds);
            if record.gap() <= problem.target_gap {
                return Ok(End::Proven);
            }
            if record.primal <= SMALLEST && is_nothing(problem, record) {
                record.lower_bound = 0.0;
                return Ok(End::Vanished);
            }
            if record.iterations >= limits.iterations {
                return Ok(End::Cap);
            }
            if is_late || seconds() + self.look_seconds >= limits.deadline {
                return Ok(End::Deadline);
            }
            let is_last = limits.give_up == usize::MAX;
            // rounding alone may take a large part of the target gap
            let is_blurred = record.rounding > 0.3 * problem.target_gap;
            if record.iterations >= limits.give_up || (!is_last && is_blurred) {
                return Ok(End::GaveUp);
            }
            let between = match record.iterations {
                0..60 => 4,
                60..200 => 10,
                _ => 25,
            };
            let growth = match problem.is_held() {
                true => 0,
                false => (GROWTH * record.iterations as f64) as usize,
            };
            until = record.iterations + between.max(growth);
            // the scale may come from an earlier image with larger values
            scale.fit(problem, record.primal);
            if record.iterations >= STUCK {
                scale.smoothing *= 0.5;
                if problem.bounds.is_some() {
                    scale.step = (STEP_FALL * scale.step).max(LEAST_STEP);
                }
            }
            if record.iterations >= SLOW {
                self.renew_map(ops, problem, scale, record)?;
            }
            let residual = Some(record.candidate.residual.as_slice());
            self.data.set_tail(problem, ops, &mut self.state, residual);
        }
    }

    /// Evaluates the candidate and bounds; keeps the best of each.
    fn look(
        &mut self,
        ops: &Operators<T>,
        problem: &Problem<'_>,
        scale: &Scale,
        record: &mut Record,
    ) {
        let gap = problem.target_gap;
        let threshold = if problem.is_held() { THRESHOLD * gap * scale.image } else { 0.0 };
        record.candidate.take(problem, &self.state, threshold);
        if T::HAS_SHORT && problem.delta.is_none() && gap >= LEAST_ROUNDED_GAP {
            record.candidate.evaluate_rounded(problem, ops, &mut self.state.sums);
        } else {
            record.candidate.evaluate(problem, Some((&self.state, &self.data)));
        }
        record.take();
        let is_slow = record.iterations >= SLOW + 10;
        let efforts = match (problem.is_held(), self.is_plain) {
            (true, _) => [1.0, 0.3].map(|share| Effort::anchored(share * gap)),
            (false, true) => [Effort::plain(PLAIN_FLOW_STEPS, gap); 2],
            (false, false) => {
                let (slack, lean) = (SLACK * gap, LEAN * gap);
                [Effort { rounds: ROUNDS, steps: FLOW_STEPS, slack, lean }; 2]
            }
        };
        let count = if is_slow && problem.is_held() { 2 } else { 1 };
        for effort in &efforts[..count] {
            let Self { state, data, certificate, .. } = self;
            let (images, size) = (record.images.as_slice(), scale.image);
            let iterate = Iterate { ops, state, data, images, size };
            let bound = certificate.bound(problem, iterate, *effort);
            if bound.value <= record.lower_bound {
                self.is_plain = !self.is_plain;
            }
            record.take_proof(bound, certificate);
        }
    }

    /// Replaces the stale map of a slow frame, based on the change so far.
    fn renew_map(
        &mut self,
        ops: &Operators<T>,
        problem: &Problem<'_>,
        scale: &Scale,
        record: &Record,
    ) -> Result<(), InverseError> {
        let arch = problem.skin.arch;
        self.map.clear();
        self.map.raise(&self.state.fresh, 0.5);
        self.map.take(self.state.origin.iter().copied());
        self.map.raise_to_gradient(arch, ops, 1);
        self.map.take(record.images.iter().map(|x| T::from_f64(*x)));
        self.map.raise_to_gradient(arch, ops, 1);
        self.set_map(ops, problem, scale)
    }
}
