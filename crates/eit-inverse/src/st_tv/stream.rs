//! Sliding window over an endless sequence.
//!
//! Over 300 lines because every event of a running instrument is a method of one type, and each must
//! leave all of its arrays consistent.

use super::certificate::{Effort, Evaluation, Iterate, LARGEST_WEIGHT};
use super::data::{Seen, Target};
use super::fit::DataSteps;
use super::flow::Flow;
use super::settings::{Fidelity, StreamSettings};
use super::state::{State, Weights};
use super::step::{self, MapScratch, MapSize};
use super::window::{Outcome, Window};
use super::{StTv, quiet::quiet_threshold};
use crate::check::{check_length, check_positive};
use crate::{Certificate, InverseError, SequenceStatus};
use std::time::Instant;

/// Image of a frame and its certificate.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct StreamStep<'a> {
    /// Image of the lagged frame, siemens, `[unknown]`; `None` until the window contains that frame.
    pub image: Option<&'a [f64]>,
    /// Why the iteration stopped.
    pub status: SequenceStatus,
    /// Number of iterations of this push.
    pub iterations: usize,
    /// Bounds on the optimum of the window.
    pub certificate: Certificate,
    /// `|W^1/2 (J x - dv)|` of the lagged frame over its good channels; 0 without an image.
    pub residual: f64,
    /// Whether the whole window contains only noise or no data, so that no iteration was needed.
    pub quiet: bool,
    /// Run time of this push, seconds.
    pub seconds: f64,
}

/// Spatio-temporal total variation over a sliding window, warm-started.
///
/// Every push moves the window by one frame, keeps image and dual variables of the remaining frames,
/// and iterates until the problem of the window is solved to the target gap or the budget is spent.
/// The problem is exactly that of [`StTv::solve`] on the frames of the window. After set-up nothing is
/// allocated.
///
/// * Masked channels of a frame only change the rows of its data term. The factorisation for a new set
///   of masked channels costs `O(rank^3)` once.
/// * A dropped frame ([`push_dropped`](Self::push_dropped)) is a frame without data, which the window
///   interpolates. The call may also be omitted, since total variation in time does not depend on the
///   frame rate. For the same reason a change of the frame rate needs no call.
/// * A frame that equals its reference, or differs from it by noise only, is treated like any other
///   while the window contains a touch: its image is coupled to its neighbours', and skipping it
///   would change them. When the whole window consists of such frames, the image is zero and nothing is
///   computed ([`StreamStep::quiet`]). Without `noise_std` this requires data that is exactly zero.
/// * A change of the reference frame changes all data of the window
///   ([`change_reference`](Self::change_reference)).
#[derive(Debug, Clone)]
pub struct StTvStream {
    solver: StTv,
    settings: StreamSettings,
    /// Number of frames in the window so far; they are its last ones.
    filled: usize,
    state: State<f32>,
    data: DataSteps<f32>,
    map: MapScratch<f32>,
    flow: Flow<f32>,
    evaluation: Evaluation,
    /// Best images of a push, `[unknown][stride]`, and their residuals.
    best: Vec<f64>,
    best_residual: Vec<f64>,
    scratch: Scratch,
    window: Window,
    /// Difference data and channels as pushed, `[frame][measurement]`.
    raw: Vec<Vec<f64>>,
    good: Vec<Vec<bool>>,
    /// Frames without data.
    dropped: Vec<bool>,
    /// Length of the first round of iterations of the next push.
    expected: usize,
    /// Iterations since the window was at rest or its steps were reset.
    since_rest: usize,
    /// Iterations of this push.
    spent: usize,
    /// Factor on the steps of this push; larger if the bound improves faster than the image.
    boost: f64,
    /// Whether the next bound keeps the data dual: changes after each bound that was no better than the best.
    is_plain: bool,
    /// Squared norm of the linear images of the window at its last step map.
    mapped: f64,
    smoothing: f64,
    /// Norm of a frame's data that corresponds to 1 internally; 0 before the first data.
    scale: f64,
    pushed: usize,
    lagged: Vec<f64>,
    /// Whether image and duals are zero, so that they need not be moved or cleared.
    resting: bool,
}

/// Memory that a push writes before it reads.
#[derive(Clone)]
struct Scratch {
    /// The frame being pushed, until it has passed all checks.
    mode: Seen,
    target: Target,
    good: Vec<bool>,
    whitened: Vec<f64>,
}

impl std::fmt::Debug for Scratch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scratch").finish_non_exhaustive()
    }
}

/// Steps of the map relative to balanced ones: a compromise between fast convergence of the image and of
/// the bound.
const SHARE: f64 = 0.4;
/// Additional factor on the steps with bounds, whose duals need large changes, as in a causal frame. The
/// window of the stream example takes 98 to 392 iterations per frame, and 129 to 1309 without the factor.
const BOUNDED_SHARE: f64 = 0.3;
/// Smoothing of the norms, and the iterations of a push after which it decreases, see [`super::run`].
const SMOOTHING: f64 = 0.04;
const SMOOTH: f64 = 120.0;
/// A frame larger than the unit of the data by this factor sets a new unit.
const OUTGROWN: f64 = 1e4;
/// Number of pushes between two step maps.
const MAP_EVERY: usize = 4;
/// Iterations after rest at which the uniform step is updated, and at which maps are computed.
const MEASURE_AT: [usize; 2] = [8, 16];
const MAP_AT: [usize; 3] = [24, 48, 96];
/// Effort of a bound, as for a whole sequence but with half as many rounds: with all of them, a window of 8 frames
/// to 1e-2 takes as many iterations and a tenth more time.
const ROUNDS: usize = 6;
const FLOW_STEPS: usize = 5;
const SLACK: f64 = 0.3;
const LEAN: f64 = 0.4;
/// Steps of the flow for a bound that keeps the data dual.
const PLAIN_FLOW_STEPS: usize = 50;
/// Growth of the squared linear images since the last map that makes the map useless. A new touch has
/// appeared where its steps are small, and the steps are determined as after rest.
const ONSET: f64 = 4.0;
/// Assumed decay of the gap, as a power of the iterations.
const POWER: f64 = 3.0;
/// Iterations of a push after which the map is stale. A new one is computed then, and whenever the
/// iterations have doubled.
const STALE: usize = 150;
/// Iterations before the first evaluation of the first push, and minimum of any first round.
const FIRST_ROUND: usize = 20;
/// First round of a push as a fraction of the iterations of the previous push, because evaluations are
/// expensive; and length of later rounds as a fraction of all iterations so far.
const BEGIN: f64 = 0.85;
const GROWTH: f64 = 0.15;
/// Iterations between two checks of the clock.
const CLOCK: usize = 4;

impl StTvStream {
    /// Sets up a stream.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`] for a window of 0 frames, a lag outside the window, a target gap
    /// that is not positive, or 0 iterations.
    pub fn new(solver: StTv, settings: StreamSettings) -> Result<Self, InverseError> {
        let StreamSettings { window, lag, target_gap, max_iterations, .. } = settings;
        check_positive("target_gap", target_gap)?;
        let checks = [
            ("window, frames", window, window > 0, "1 or above"),
            ("lag, frames", lag, lag < window, "below the window"),
            ("max_iterations", max_iterations, max_iterations > 0, "1 or above"),
        ];
        for (quantity, value, fine, must) in checks {
            if !fine {
                return Err(InverseError::OutOfRange { quantity, value: value as f64, must });
            }
        }
        let time = window > 1 && solver.settings.lambda_time > 0.0;
        let mut state = State::new(&solver.single, window, time, solver.settings.bounded());
        state.links_mut().fill(0.0);
        let evaluation = Evaluation::new(&solver.double, &state, &solver.parts);
        let measurements = solver.measurements();
        // built separately, because a clone would not keep the capacity
        let empty = || {
            let mut seen = Seen::new(&solver.compression);
            seen.clear();
            seen
        };
        let empty_target = Target::zero(&solver.compression);
        let scratch = Scratch {
            mode: empty(),
            target: empty_target.clone(),
            good: vec![false; measurements],
            whitened: vec![0.0; measurements],
        };
        let frames = Window {
            modes: (0..window).map(|_| empty()).collect(),
            mode_of: (0..window).collect(),
            targets: vec![empty_target; window],
            delta: match solver.settings.fidelity {
                Fidelity::Penalised => Vec::new(),
                Fidelity::Constrained { .. } => vec![0.0; window],
            },
            weights: [0.0; 2],
            bounds: None,
        };
        let data =
            DataSteps::new(&frames.problem(&solver), &solver.single, &state, window, target_gap);
        Ok(Self {
            filled: 0,
            data,
            map: MapScratch::new(&solver.single, &state),
            flow: Flow::new(&solver.single, &state),
            best: evaluation.image.clone(),
            best_residual: evaluation.residual.clone(),
            state,
            evaluation,
            scratch,
            window: frames,
            raw: vec![vec![0.0; measurements]; window],
            good: vec![vec![false; measurements]; window],
            dropped: vec![true; window],
            expected: FIRST_ROUND,
            since_rest: 0,
            spent: 0,
            boost: 1.0,
            is_plain: false,
            mapped: 0.0,
            smoothing: 0.0,
            scale: 0.0,
            pushed: 0,
            lagged: vec![0.0; solver.unknowns()],
            resting: true,
            solver,
            settings,
        })
    }

    /// Adds a frame of difference data `[measurement]` with its good channels (`None`: all) and returns
    /// the image of the lagged frame.
    ///
    /// # Errors
    /// Returns an error for wrong lengths, a non-finite value of a good channel (the frame index counts
    /// pushes from 0), and a `delta` that no image can satisfy. The window is then unchanged.
    pub fn push(
        &mut self,
        dv: &[f64],
        good: Option<&[bool]>,
    ) -> Result<StreamStep<'_>, InverseError> {
        let start = Instant::now();
        let measurements = self.solver.measurements();
        check_length("frame", dv.len(), measurements)?;
        if let Some(good) = good {
            check_length("good", good.len(), measurements)?;
        }
        let is_good = |i: usize| good.is_none_or(|good| good[i]);
        for (measurement, &value) in dv.iter().enumerate() {
            if !value.is_finite() && is_good(measurement) {
                let frame = self.pushed;
                return Err(InverseError::NonFiniteData { frame, measurement, value });
            }
        }
        self.scratch.good.iter_mut().enumerate().for_each(|(i, slot)| *slot = is_good(i));
        self.stage(dv)?;
        self.advance();
        let newest = self.settings.window - 1;
        self.raw[newest].copy_from_slice(dv);
        self.good[newest].copy_from_slice(&self.scratch.good);
        self.dropped[newest] = false;
        std::mem::swap(&mut self.window.modes[newest], &mut self.scratch.mode);
        self.fit_scale();
        let one = self.one();
        self.scratch.target.divide(one);
        std::mem::swap(&mut self.window.targets[newest], &mut self.scratch.target);
        Ok(self.finish(start))
    }

    /// Records a dropped frame: the window advances, and the dropped frame is interpolated from its
    /// neighbours.
    pub fn push_dropped(&mut self) -> StreamStep<'_> {
        let start = Instant::now();
        self.advance();
        let newest = self.settings.window - 1;
        self.dropped[newest] = true;
        self.window.modes[newest].clear();
        self.window.targets[newest].clear();
        self.finish(start)
    }

    /// Changes the reference frame by `change = v_ref_new - v_ref_old`, `[measurement]`.
    ///
    /// Data pushed from now on must be relative to the new reference; the data of the window is
    /// converted. If the new reference is closer to the newest frame than the old one was, the newest
    /// image is subtracted from the images, as it is then part of the reference.
    ///
    /// # Errors
    /// Returns an error for a wrong length, a value that is not finite, and a frame of the window for
    /// which no image could then satisfy `delta`. The window is then unchanged.
    pub fn change_reference(&mut self, change: &[f64]) -> Result<(), InverseError> {
        check_length("change of reference", change.len(), self.solver.measurements())?;
        if let Some(measurement) = change.iter().position(|v| !v.is_finite()) {
            let value = change[measurement];
            return Err(InverseError::NonFiniteReference { measurement, value });
        }
        let window = self.settings.window;
        let before = self.newest_power();
        self.move_data(|dv, change| *dv -= change, change);
        let frames = window - self.filled..window;
        for frame in frames.clone().filter(|&f| !self.dropped[f]) {
            let number = (self.pushed + frame).saturating_sub(window);
            let one = self.one();
            let checked = self.check_delta(
                number,
                &self.window.modes[frame],
                &self.window.targets[frame],
                one,
            );
            if checked.is_err() {
                self.move_data(|dv, change| *dv += change, change);
                return checked;
            }
        }
        if self.newest_power() < before {
            self.state.subtract_newest(frames);
        }
        Ok(())
    }

    /// Changes the data of the whole window, measurement by measurement.
    fn move_data(&mut self, apply: impl Fn(&mut f64, f64), change: &[f64]) {
        for raw in &mut self.raw {
            raw.iter_mut().zip(change).for_each(|(dv, c)| apply(dv, *c));
        }
        let window = self.settings.window;
        for frame in (window - self.filled..window).filter(|&f| !self.dropped[f]) {
            let one = if self.scale > 0.0 { self.scale } else { 1.0 };
            let Self { solver, scratch, window, raw, .. } = self;
            let (mode, target) = (&window.modes[frame], &mut window.targets[frame]);
            whiten(solver, mode, &raw[frame], &mut scratch.whitened);
            mode.take(&solver.compression, &scratch.whitened, one, target);
        }
    }

    /// Returns the squared norm of the newest frame's data.
    fn newest_power(&self) -> f64 {
        let target = &self.window.targets[self.settings.window - 1];
        target.norm().powi(2) + target.rest_squared
    }

    /// Returns the solver in use.
    pub fn solver(&self) -> &StTv {
        &self.solver
    }

    /// Returns the settings in use.
    pub fn settings(&self) -> &StreamSettings {
        &self.settings
    }

    /// Returns the value of an unknown in the frame `age` frames before the newest (0), siemens; `None`
    /// if the frame or the unknown does not exist.
    pub fn window_image(&self, age: usize, unknown: usize) -> Option<f64> {
        let fine = age < self.filled && unknown < self.solver.unknowns();
        fine.then(|| self.value(self.settings.window - 1 - age, unknown))
    }

    fn value(&self, frame: usize, unknown: usize) -> f64 {
        let per_image = self.scale / self.solver.unit;
        let settings = &self.solver.settings;
        let value = self.best[unknown * self.state.stride + frame] * per_image;
        value.clamp(settings.lower_s, settings.upper_s)
    }

    /// Moves all frames one back in time; the new frame starts from the newest image.
    fn advance(&mut self) {
        let window = self.settings.window;
        self.pushed += 1;
        if !self.resting {
            self.state.shift();
        }
        self.window.modes.rotate_left(1);
        self.window.targets.rotate_left(1);
        self.raw.rotate_left(1);
        self.good.rotate_left(1);
        self.dropped.rotate_left(1);
        self.filled = (self.filled + 1).min(window);
        let first = window - self.filled;
        for (frame, link) in self.state.links_mut().iter_mut().enumerate() {
            *link = if frame >= first && frame + 1 < window { 1.0 } else { 0.0 };
        }
    }

    /// Transforms a frame and its channels into the scratch memory, in the caller's units. Reuses the
    /// factorisation of the newest frame if the channels are the same.
    fn stage(&mut self, dv: &[f64]) -> Result<(), InverseError> {
        let Self { solver, window, scratch, .. } = self;
        let Scratch { mode, target, good, whitened } = scratch;
        match window.modes.last() {
            Some(last) if last.fits(&solver.compression, |i| good[i]) => mode.copy_from(last),
            _ => mode.set(&solver.compression, |i| good[i]),
        }
        whiten(solver, mode, dv, whitened);
        mode.take(&solver.compression, whitened, 1.0, target);
        self.check_delta(self.pushed, &self.scratch.mode, &self.scratch.target, 1.0)
    }

    /// Rejects a frame whose constraint no image can satisfy; its target is in units of `one`.
    fn check_delta(
        &self,
        frame: usize,
        mode: &Seen,
        target: &Target,
        one: f64,
    ) -> Result<(), InverseError> {
        let Some(delta) = self.delta(mode) else { return Ok(()) };
        let least = target.rest_squared.sqrt() * one;
        // a tiny remainder is rounding error of an exact fit
        if least > delta && least > 1e-10 * (target.norm() * one + least) {
            return Err(InverseError::DeltaTooSmall { frame, delta, least });
        }
        Ok(())
    }

    /// Returns the constraint radius of a frame with these channels.
    fn delta(&self, mode: &Seen) -> Option<f64> {
        let Fidelity::Constrained { delta } = self.solver.settings.fidelity else { return None };
        Some(delta * (mode.count as f64 / self.solver.channels as f64).sqrt())
    }

    /// Sets the unit of the data from the staged frame if there is none yet, or if this frame is too
    /// large for the precision of `f32`; in the latter case the iterate restarts from zero.
    fn fit_scale(&mut self) {
        let target = &self.scratch.target;
        let noise = match self.solver.settings.noise_std {
            Some(_) => (self.window.modes[self.settings.window - 1].count as f64).sqrt(),
            None => 0.0,
        };
        let norm = target.norm().max(noise);
        if self.scale > 0.0 && norm <= OUTGROWN * self.scale {
            return;
        }
        if self.scale > 0.0 {
            let unit = norm / self.scale;
            self.window.targets.iter_mut().for_each(|t| t.divide(unit));
            self.state.clear();
            self.since_rest = 0;
        }
        self.scale = norm;
    }

    /// Iterates and returns the lagged image.
    fn finish(&mut self, start: Instant) -> StreamStep<'_> {
        self.set_units();
        let quiet = self.is_quiet();
        let outcome = match quiet {
            true => self.rest(),
            // only the eigenvalue decomposition can fail, and only for non-finite input
            false => self.iterate(start).unwrap_or(Outcome {
                status: SequenceStatus::Stalled,
                iterations: 0,
                primal: f64::INFINITY,
                lower_bound: f64::NEG_INFINITY,
            }),
        };
        let window = self.settings.window;
        let frame = window - 1 - self.settings.lag;
        let known = self.settings.lag < self.filled;
        if quiet {
            self.lagged.fill(0.0);
        } else if known {
            for unknown in 0..self.solver.unknowns() {
                self.lagged[unknown] = self.value(frame, unknown);
            }
        }
        let (objective, one) = self.units();
        StreamStep {
            image: known.then_some(self.lagged.as_slice()),
            status: outcome.status,
            iterations: outcome.iterations,
            certificate: Certificate {
                primal: outcome.primal * objective,
                lower_bound: outcome.lower_bound * objective,
            },
            residual: if known { self.best_residual[frame] * one } else { 0.0 },
            quiet,
            seconds: start.elapsed().as_secs_f64(),
        }
    }

    /// Sets weights, bounds and radii in internal units.
    fn set_units(&mut self) {
        let one = self.one();
        let settings = &self.solver.settings;
        let largest = settings.lambda_space.max(settings.lambda_time);
        let weight = match settings.fidelity {
            Fidelity::Penalised => 1.0 / (self.solver.unit * one),
            Fidelity::Constrained { .. } => 1.0 / largest,
        };
        let per_image = self.solver.unit / one;
        let bounds = [settings.lower_s * per_image, settings.upper_s * per_image];
        let bounds = settings.bounded().then_some(bounds);
        self.window.weights = [settings.lambda_space * weight, settings.lambda_time * weight];
        self.window.bounds = bounds;
        for frame in 0..self.window.delta.len() {
            let delta = self.delta(&self.window.modes[frame]);
            self.window.delta[frame] = delta.unwrap_or_default() / one;
        }
    }

    /// Returns the internal unit of the data.
    fn one(&self) -> f64 {
        if self.scale > 0.0 { self.scale } else { 1.0 }
    }

    /// Returns whether the whole window contains only noise or no data.
    fn is_quiet(&self) -> bool {
        let noise = self.solver.settings.noise_std.is_some();
        let zero = self.solver.settings.lower_s <= 0.0 && self.solver.settings.upper_s >= 0.0;
        let quiet = |frame: usize| {
            let target = &self.window.targets[frame];
            let square = target.values.iter().map(|v| v * v).sum::<f64>() + target.rest_squared;
            let good = if self.dropped[frame] { 0 } else { self.window.modes[frame].count };
            let threshold = if noise { quiet_threshold(good as f64) } else { 0.0 };
            square * self.scale * self.scale <= threshold
        };
        zero && (0..self.settings.window).all(quiet)
    }

    /// Sets the zero image, the result of a quiet window.
    fn rest(&mut self) -> Outcome {
        if !self.resting {
            self.state.clear();
            self.best.fill(0.0);
            self.resting = true;
        }
        self.since_rest = 0;
        let mut square = 0.0;
        for (residual, target) in self.best_residual.iter_mut().zip(&self.window.targets) {
            let own = target.values.iter().map(|v| v * v).sum::<f64>() + target.rest_squared;
            *residual = own.sqrt();
            square += own;
        }
        let primal = if self.window.delta.is_empty() { 0.5 * square } else { 0.0 };
        // the zero image is not proven optimal, but the data agrees with it to within the noise
        Outcome { status: SequenceStatus::Direct, iterations: 0, primal, lower_bound: 0.0 }
    }

    /// Returns the caller's units of objective and residual per internal unit.
    fn units(&self) -> (f64, f64) {
        let one = self.one();
        let settings = &self.solver.settings;
        match settings.fidelity {
            Fidelity::Penalised => (one * one, one),
            Fidelity::Constrained { .. } => {
                let largest = settings.lambda_space.max(settings.lambda_time);
                (largest * one / self.solver.unit, one)
            }
        }
    }

    /// Alternates rounds of iterations and evaluations.
    fn iterate(&mut self, start: Instant) -> Result<Outcome, InverseError> {
        self.resting = false;
        let StreamSettings { target_gap, max_iterations, deadline, .. } = self.settings;
        let deadline = deadline.map_or(f64::INFINITY, |d| d.as_secs_f64());
        let mut outcome = Outcome {
            status: SequenceStatus::Converged,
            iterations: 0,
            primal: f64::INFINITY,
            lower_bound: f64::NEG_INFINITY,
        };
        let [linear, _] = step::linear_image(&self.window.problem(&self.solver));
        if linear > ONSET * self.mapped {
            self.since_rest = 0;
            self.expected = FIRST_ROUND;
        }
        self.mapped = if self.since_rest == 0 { linear } else { self.mapped };
        self.spent = 0;
        self.boost = 1.0;
        let is_cold = self.since_rest < MAP_AT[MAP_AT.len() - 1];
        if self.since_rest == 0 {
            let problem = self.window.problem(&self.solver);
            let step = step::guess(&problem, &self.solver.single, &self.state).unwrap_or(1.0);
            self.set_uniform(step)?;
        } else if !is_cold && self.pushed.is_multiple_of(MAP_EVERY) {
            self.mapped = linear;
            self.set_map()?;
        } else {
            self.assign()?;
        }
        let mut round = self.expected.max(FIRST_ROUND);
        let mut next_map = STALE;
        // time of an evaluation; unknown before the first one
        let mut look_s = 0.0;
        loop {
            let count = round.min(max_iterations - outcome.iterations);
            let done = self.run(count, start, deadline - look_s)?;
            outcome.iterations += done;
            let before = Instant::now();
            let last = [outcome.primal, outcome.lower_bound];
            self.look(&mut outcome);
            look_s = before.elapsed().as_secs_f64();
            // if the gap is below the target, the next push can use fewer iterations
            let spare = (outcome.gap() / target_gap).powf(1.0 / POWER).clamp(0.5, 1.0);
            // capped, because a sudden event does not predict the frame after it
            self.expected = ((outcome.iterations as f64 * BEGIN * spare) as usize).min(STALE);
            round = ((outcome.iterations as f64 * GROWTH) as usize).max(CLOCK);
            if outcome.gap() <= target_gap {
                return Ok(outcome);
            }
            if done < count || start.elapsed().as_secs_f64() >= deadline {
                return Ok(Outcome { status: SequenceStatus::Deadline, ..outcome });
            }
            if outcome.iterations >= max_iterations {
                return Ok(Outcome { status: SequenceStatus::IterationCap, ..outcome });
            }
            // With bounds a new map within a frame slows convergence: the frame after a release takes 1037
            // iterations without new maps, more than 2000 with them.
            if outcome.iterations >= next_map && self.window.bounds.is_none() {
                next_map = 2 * outcome.iterations;
                let [raised, fallen] = [outcome.lower_bound - last[1], last[0] - outcome.primal];
                if raised > 8.0 * fallen {
                    self.boost = (self.boost * 1.5).min(16.0);
                } else if fallen > 8.0 * raised {
                    self.boost = (self.boost / 1.5).max(1.0 / 16.0);
                }
                self.set_map()?;
            }
        }
    }

    /// Evaluates the candidate and computes a lower bound; keeps the best of each.
    fn look(&mut self, outcome: &mut Outcome) {
        let Self { solver, window, evaluation, state, data, flow, .. } = self;
        let problem = window.problem(solver);
        let primal = evaluation.primal(solver.arch, &problem, state);
        if primal < outcome.primal || outcome.primal == f64::INFINITY {
            outcome.primal = primal;
            self.best.copy_from_slice(&evaluation.image);
            self.best_residual.copy_from_slice(&evaluation.residual);
        }
        let iterate = Iterate { ops: &solver.single, state, data };
        let target_gap = self.settings.target_gap;
        let (slack, lean) = (SLACK * target_gap, LEAN * target_gap);
        let effort = match self.is_plain {
            true => Effort::plain(PLAIN_FLOW_STEPS, target_gap),
            false => Effort { rounds: ROUNDS, steps: FLOW_STEPS, slack, lean },
        };
        let bound = evaluation.lower_bound(solver.arch, &problem, iterate, flow, effort);
        if bound <= outcome.lower_bound {
            self.is_plain = !self.is_plain;
        }
        outcome.lower_bound = outcome.lower_bound.max(bound);
    }

    /// Runs up to `count` iterations until the deadline and returns their number, at least one. The last
    /// iteration stores its image as the candidate.
    fn run(&mut self, count: usize, start: Instant, deadline: f64) -> Result<usize, InverseError> {
        let [lambda_space, lambda_time] = self.window.weights.map(|w| w.min(LARGEST_WEIGHT));
        for k in 0..count {
            if MEASURE_AT.contains(&self.since_rest) {
                if let Some(step) = step::measure(&self.solver.single, &self.state) {
                    self.set_uniform(step)?;
                }
            } else if MAP_AT.contains(&self.since_rest) {
                self.set_map()?;
            }
            self.since_rest += 1;
            self.spent += 1;
            let clock = (k + 1).is_multiple_of(CLOCK);
            let late = clock && start.elapsed().as_secs_f64() >= deadline;
            let (bounds, smoothing) = (self.window.bounds, self.smoothing);
            let weights = Weights { lambda_space, lambda_time, bounds, smoothing };
            let Self { solver, state, data, .. } = self;
            let last = late || k + 1 == count;
            state.iterate(solver.arch, &solver.single, &weights, data, last);
            if late {
                return Ok(k + 1);
            }
        }
        Ok(count)
    }

    fn set_uniform(&mut self, step: f64) -> Result<(), InverseError> {
        self.smoothing = 0.0;
        step::set_uniform(&self.solver.single, &mut self.state, step);
        self.set_data()
    }

    /// Computes a step map from the current images.
    fn set_map(&mut self) -> Result<(), InverseError> {
        let Self { solver, state, map, window, .. } = self;
        let bounded = if window.bounds.is_some() { BOUNDED_SHARE } else { 1.0 };
        let steps = MapSize { share: bounded * self.boost * SHARE, floor: step::FLOOR };
        if step::set_map(&solver.single, state, map, steps) {
            let size = state.image.iter().fold(0.0_f32, |most, x| most.max(x.abs()));
            let fading = (SMOOTH / self.spent.max(1) as f64).powi(2).min(1.0);
            self.smoothing = SMOOTHING * self.settings.target_gap * f64::from(size) * fading;
        }
        self.set_data()
    }

    /// Recomputes the data steps for the current step map.
    fn set_data(&mut self) -> Result<(), InverseError> {
        let Self { solver, window, state, data, .. } = self;
        state.disturb();
        data.set_map(solver.arch, &window.problem(solver), &solver.single, state)
    }

    /// Assigns the data steps for the channels and data of the window.
    fn assign(&mut self) -> Result<(), InverseError> {
        let Self { solver, window, state, data, .. } = self;
        state.disturb();
        data.assign(solver.arch, &window.problem(solver), &solver.single, state)
    }
}

/// Whitens the data of a frame; masked values may be NaN.
fn whiten(solver: &StTv, mode: &Seen, dv: &[f64], out: &mut [f64]) {
    for (i, value) in out.iter_mut().enumerate() {
        *value = if mode.good[i] { solver.compression.root_weights[i] * dv[i] } else { 0.0 };
    }
}
