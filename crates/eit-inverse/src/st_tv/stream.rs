//! A sliding window over an endless sequence.
//!
//! Long because every event of a running instrument is a method of one type, and each must leave all
//! of its arrays consistent.

use super::certificate::Evaluation;
use super::data::{Mode, ModeScratch, Target};
use super::fit::{self, Memory};
use super::settings::{Fidelity, StreamSettings};
use super::state::State;
use super::step;
use super::window::{Outcome, Which, Window};
use super::{StTv, quiet::quiet_threshold};
use crate::check::{check_length, check_positive};
use crate::{Certificate, InverseError, SequenceStatus};
use std::time::Instant;

/// What a push gave.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StreamStep<'a> {
    /// Image of the lagged frame, siemens, `[unknown]`; `None` until the window reaches back to it.
    pub image: Option<&'a [f64]>,
    /// Why the iteration stopped.
    pub status: SequenceStatus,
    /// Iterations of this push.
    pub iterations: usize,
    /// Bounds on the window's optimum.
    pub certificate: Certificate,
    /// `|W^1/2 (J x - dv)|` of the lagged frame over its good channels; 0 without an image.
    pub residual: f64,
    /// The whole window holds nothing but noise, or nothing at all: no iteration was needed.
    pub quiet: bool,
    /// Time of this push, seconds.
    pub seconds: f64,
}

/// Spatio-temporal total variation of the last frames, warm-started.
///
/// Every push moves the window by one frame, keeps image and dual variables of the frames that stay,
/// and iterates until the window's problem, exactly that of [`StTv::solve`] on its frames, is solved
/// to the target gap or the budget is spent. After set-up nothing is allocated.
///
/// * A frame with masked channels changes the rows of its data term and nothing else; the expansion
///   of a new set of masked channels costs `O(rank^3)` once.
/// * A dropped frame ([`push_dropped`](Self::push_dropped)) is a frame without data: the window
///   interpolates it. It may as well be left out, since a total variation in time does not depend
///   on the frame rate; for the same reason a change of rate needs no call.
/// * A frame that equals its reference, or differs from it by noise alone, is data like any other as
///   long as the window holds a touch: its image is coupled to its neighbours', and leaving it out
///   would change both. Once the whole window is such frames its image is zero, and nothing is
///   computed ([`StreamStep::quiet`]); without `noise_std` only data that is zero to the bit is.
/// * Another reference frame moves all data of the window
///   ([`change_reference`](Self::change_reference)).
#[derive(Debug)]
pub struct StTvStream {
    solver: StTv,
    settings: StreamSettings,
    /// Frames in the window so far, the last ones.
    filled: usize,
    image: State<f32>,
    proof: State<f32>,
    evaluation: Evaluation,
    scratch: Scratch,
    window: Window,
    /// Difference data and channels as pushed, `[frame][measurement]`.
    raw: Vec<Vec<f64>>,
    good: Vec<Vec<bool>>,
    /// No data at all.
    dropped: Vec<bool>,
    step: f64,
    /// Iterations on the image that the next push begins with.
    expected: usize,
    /// Norm of a frame's data that is 1 inside; 0 before there is any.
    scale: f64,
    pushed: usize,
    lagged: Vec<f64>,
    /// Image and proof are zero, so that nothing of them need be moved or cleared.
    resting: bool,
}

/// Memory that a push writes before it reads.
struct Scratch {
    /// The frame that is being pushed, until all of it is known to be fine.
    mode: Mode,
    target: Target,
    good: Vec<bool>,
    modes: ModeScratch,
    columns: [Vec<f64>; 2],
    whitened: Vec<f64>,
}

impl std::fmt::Debug for Scratch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scratch").finish_non_exhaustive()
    }
}

/// Step of the image's run relative to the balanced one: that of a batch solve after some hundred
/// iterations, as the window starts near its solution.
const WARM_STEP: f64 = 0.25;
/// Step of the proof's run relative to the image's.
const PROOF_STEP: f64 = 100.0;
/// A frame this much larger than the unit of the data sets another one.
const OUTGROWN: f64 = 1e4;
/// Pushes between two measurements of the norms that set the step.
const MEASURE_EVERY: usize = 8;
/// Iterations on the image before the first evaluation of the first push, and the least of any.
const FIRST_ROUND: usize = 20;
/// A later push begins with this share of what the one before it took: evaluations are dear, and
/// so is a proof that comes too early. Rounds after the first add this share of all before.
const BEGIN: f64 = 0.9;
const GROWTH: f64 = 0.35;
/// Iterations of a proof, relative to all of the image's before it.
const PROOF_SHARE: f64 = 0.7;

impl StTvStream {
    /// Sets up a stream.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`] for a window of 0, a lag outside it, a target gap that is not
    /// positive, no iterations.
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
        let mut image = State::new(&solver.single, window, time, solver.settings.bounded());
        image.links_mut().fill(0.0);
        let proof = image.clone();
        let evaluation = Evaluation::new(&solver.double, &image, &solver.parts);
        let (rank, measurements) = (solver.rank(), solver.measurements());
        let mut empty = Mode::with_room(&solver.compression);
        empty.drop_data();
        let scratch = Scratch {
            mode: empty.with_same_room(),
            target: Target::zero(rank),
            good: vec![false; measurements],
            modes: ModeScratch::new(&solver.compression),
            columns: [vec![0.0; rank], vec![0.0; rank]],
            whitened: vec![0.0; measurements],
        };
        let modes = (0..window).map(|_| empty.with_same_room()).collect();
        Ok(Self {
            filled: 0,
            image,
            proof,
            evaluation,
            scratch,
            window: Window {
                modes,
                mode_of: (0..window).collect(),
                targets: vec![Target::zero(rank); window],
                delta: match solver.settings.fidelity {
                    Fidelity::Penalised => Vec::new(),
                    Fidelity::Constrained { .. } => vec![0.0; window],
                },
                weights: [0.0; 2],
                bounds: None,
            },
            raw: vec![vec![0.0; measurements]; window],
            good: vec![vec![false; measurements]; window],
            dropped: vec![true; window],
            step: 1.0,
            expected: FIRST_ROUND,
            scale: 0.0,
            pushed: 0,
            lagged: vec![0.0; solver.unknowns()],
            resting: true,
            solver,
            settings,
        })
    }

    /// Takes a frame of difference data `[measurement]` and its good channels (`None`: all), and
    /// gives the image of the lagged frame.
    ///
    /// # Errors
    /// Wrong lengths, a value of a good channel that is not finite (the frame number counts pushes
    /// from 0), a `delta` that no image can reach. The window is then as it was.
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

    /// Takes note that a frame was lost: the window moves on, and the lost frame is interpolated
    /// from its neighbours.
    pub fn push_dropped(&mut self) -> StreamStep<'_> {
        let start = Instant::now();
        self.advance();
        let newest = self.settings.window - 1;
        self.dropped[newest] = true;
        self.window.modes[newest].drop_data();
        self.window.targets[newest].clear();
        self.finish(start)
    }

    /// Changes the reference frame by `change = v_ref_new - v_ref_old`, `[measurement]`: data
    /// pushed from now on is against the new reference; that of the window is moved. Where the new
    /// reference is nearer to the newest frame than the old one was, the images are moved by the
    /// newest one, which is then what the reference holds.
    ///
    /// # Errors
    /// Wrong length, a value that is not finite, a frame of the window for which no image could then
    /// reach `delta`. The window is then as it was.
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
            self.image.subtract_newest(frames.clone());
            self.proof.subtract_newest(frames);
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
            let Scratch { columns, whitened, .. } = &mut self.scratch;
            let raw = &self.raw[frame];
            let Window { modes, targets, .. } = &mut self.window;
            let (mode, target) = (&modes[frame], &mut targets[frame]);
            target.set(&self.solver.compression, mode, |i| raw[i], &mut columns[0], whitened);
            let one = if self.scale > 0.0 { self.scale } else { 1.0 };
            target.divide(one);
        }
    }

    /// Squared data of the newest frame.
    fn newest_power(&self) -> f64 {
        let target = &self.window.targets[self.settings.window - 1];
        target.norm().powi(2) + target.rest_squared
    }

    /// The solver in use.
    pub fn solver(&self) -> &StTv {
        &self.solver
    }

    /// The settings in use.
    pub fn settings(&self) -> &StreamSettings {
        &self.settings
    }

    /// Value of an unknown in the window's frame of an age (0 for the newest), siemens; `None`
    /// outside.
    pub fn window_image(&self, age: usize, unknown: usize) -> Option<f64> {
        let fine = age < self.filled && unknown < self.solver.unknowns();
        fine.then(|| self.value(self.settings.window - 1 - age, unknown))
    }

    fn value(&self, frame: usize, unknown: usize) -> f64 {
        let per_image = self.scale / self.solver.unit;
        let settings = &self.solver.settings;
        let value = self.evaluation.image[unknown * self.image.stride + frame] * per_image;
        value.clamp(settings.lower_s, settings.upper_s)
    }

    /// Moves everything one frame back in time; the new frame starts from the newest image.
    fn advance(&mut self) {
        let window = self.settings.window;
        self.pushed += 1;
        if !self.resting {
            self.image.shift();
            self.proof.shift();
        }
        self.window.modes.rotate_left(1);
        self.window.targets.rotate_left(1);
        self.raw.rotate_left(1);
        self.good.rotate_left(1);
        self.dropped.rotate_left(1);
        self.filled = (self.filled + 1).min(window);
        let first = window - self.filled;
        for state in [&mut self.image, &mut self.proof] {
            for (frame, link) in state.links_mut().iter_mut().enumerate() {
                *link = if frame >= first && frame + 1 < window { 1.0 } else { 0.0 };
            }
        }
    }

    /// Expands a frame and its channels in the scratch memory, in the caller's units; the newest
    /// frame's expansion is taken where the channels are the same.
    fn stage(&mut self, dv: &[f64]) -> Result<(), InverseError> {
        let Self { solver, window, scratch, .. } = self;
        let Scratch { mode, target, good, modes, columns, whitened } = scratch;
        match window.modes.last() {
            Some(last) if last.fits(&solver.compression, good) => mode.take(last),
            _ => mode.set(&solver.compression, |i| !good[i], modes)?,
        }
        target.set(&solver.compression, mode, |i| dv[i], &mut columns[0], whitened);
        self.check_delta(self.pushed, &self.scratch.mode, &self.scratch.target, 1.0)
    }

    /// Refuses a frame that no image can fit, its target in units of `one`.
    fn check_delta(
        &self,
        frame: usize,
        mode: &Mode,
        target: &Target,
        one: f64,
    ) -> Result<(), InverseError> {
        let Some(delta) = self.delta(mode) else { return Ok(()) };
        let least = target.rest_squared.sqrt() * one;
        // the rest of an exact fit is rounding, not noise
        if least > delta && least > 1e-10 * (target.norm() * one + least) {
            return Err(InverseError::DeltaTooSmall { frame, delta, least });
        }
        Ok(())
    }

    /// Radius of a frame with these channels.
    fn delta(&self, mode: &Mode) -> Option<f64> {
        let Fidelity::Constrained { delta } = self.solver.settings.fidelity else { return None };
        Some(delta * (mode.good as f64 / self.solver.full.good as f64).sqrt())
    }

    /// Sets the unit of the data from the staged frame where there is none yet, or where this frame
    /// is so much larger that `f32` would suffer: then the window starts anew.
    fn fit_scale(&mut self) {
        let target = &self.scratch.target;
        let noise = match self.solver.settings.noise_std {
            Some(_) => (self.window.modes[self.settings.window - 1].good as f64).sqrt(),
            None => 0.0,
        };
        let norm = target.norm().max(noise);
        if self.scale > 0.0 && norm <= OUTGROWN * self.scale {
            return;
        }
        if self.scale > 0.0 {
            let unit = norm / self.scale;
            self.window.targets.iter_mut().for_each(|t| t.divide(unit));
            self.image.clear();
            self.proof.clear();
        }
        self.scale = norm;
    }

    /// Iterates and gives the lagged image.
    fn finish(&mut self, start: Instant) -> StreamStep<'_> {
        self.set_units();
        let quiet = self.is_quiet();
        let outcome = if quiet { self.rest() } else { self.iterate(start) };
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
            residual: if known { self.evaluation.residual[frame] * one } else { 0.0 },
            quiet,
            seconds: start.elapsed().as_secs_f64(),
        }
    }

    /// Weights, bounds and radii in inner units.
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

    /// The unit of the data inside.
    fn one(&self) -> f64 {
        if self.scale > 0.0 { self.scale } else { 1.0 }
    }

    /// Nothing but noise in the whole window, or nothing at all.
    fn is_quiet(&self) -> bool {
        let noise = self.solver.settings.noise_std.is_some();
        let zero = self.solver.settings.lower_s <= 0.0 && self.solver.settings.upper_s >= 0.0;
        let quiet = |frame: usize| {
            let target = &self.window.targets[frame];
            let square = target.values.iter().map(|v| v * v).sum::<f64>() + target.rest_squared;
            let good = if self.dropped[frame] { 0 } else { self.window.modes[frame].good };
            let threshold = if noise { quiet_threshold(good as f64) } else { 0.0 };
            square * self.scale * self.scale <= threshold
        };
        zero && (0..self.settings.window).all(quiet)
    }

    /// The zero image, which a quiet window gets.
    fn rest(&mut self) -> Outcome {
        if !self.resting {
            self.image.clear();
            self.proof.clear();
            self.evaluation.image.fill(0.0);
            self.resting = true;
        }
        let mut square = 0.0;
        for (residual, target) in self.evaluation.residual.iter_mut().zip(&self.window.targets) {
            let own = target.values.iter().map(|v| v * v).sum::<f64>() + target.rest_squared;
            *residual = own.sqrt();
            square += own;
        }
        let primal = if self.window.delta.is_empty() { 0.5 * square } else { 0.0 };
        // the zero image was not shown to be optimal, only not to differ from it beyond noise
        Outcome { status: SequenceStatus::Direct, iterations: 0, primal, lower_bound: 0.0 }
    }

    /// Objective and residual in the caller's units per unit inside.
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

    /// Rounds of image, proof and evaluation.
    fn iterate(&mut self, start: Instant) -> Outcome {
        self.resting = false;
        let StreamSettings { target_gap, max_iterations, deadline, .. } = self.settings;
        let deadline = deadline.map_or(f64::INFINITY, |d| d.as_secs_f64());
        let beginning = self.pushed <= MEASURE_EVERY;
        let mut round = self.expected.max(FIRST_ROUND);
        let mut done = 0;
        let mut outcome = Outcome {
            status: SequenceStatus::Converged,
            iterations: 0,
            primal: f64::INFINITY,
            lower_bound: f64::NEG_INFINITY,
        };
        loop {
            if beginning || outcome.iterations == 0 && self.pushed.is_multiple_of(MEASURE_EVERY) {
                self.measure_step();
            }
            let left = max_iterations - outcome.iterations;
            let count = round.min((left as f64 / (1.0 + PROOF_SHARE)).ceil() as usize);
            self.run(count, self.step, Which::Image);
            done += count;
            self.proof.copy_from(&self.image);
            let proof = ((done as f64 * PROOF_SHARE) as usize).min(left - count).max(1);
            self.run(proof, self.step * PROOF_STEP, Which::Proof);
            outcome.iterations += count + proof;
            round = (done as f64 * GROWTH) as usize;
            self.expected = (done as f64 * BEGIN) as usize;
            let Self { solver, window, evaluation, image, proof, .. } = self;
            let problem = window.problem(solver);
            let bound = evaluation.lower_bound(solver.arch, &problem, proof);
            outcome.lower_bound = outcome.lower_bound.max(bound);
            outcome.primal = evaluation.primal(solver.arch, &problem, image);
            if outcome.gap() <= target_gap {
                return outcome;
            }
            if start.elapsed().as_secs_f64() >= deadline {
                return Outcome { status: SequenceStatus::Deadline, ..outcome };
            }
            if outcome.iterations >= max_iterations {
                return Outcome { status: SequenceStatus::IterationCap, ..outcome };
            }
        }
    }

    /// Iterations of one of the runs; the last one keeps its image as the candidate.
    fn run(&mut self, count: usize, tau: f64, which: Which) {
        let Self { solver, window, evaluation, image, proof, scratch, .. } = self;
        let state = match which {
            Which::Image => image,
            Which::Proof => proof,
        };
        let problem = window.problem(solver);
        for k in 0..count {
            let memory =
                Memory { columns: &mut scratch.columns, data_dual: &mut evaluation.data_dual };
            let last = k + 1 == count;
            let (arch, ops) = (solver.arch, &solver.single);
            fit::iterate(arch, ops, &problem, state, memory, [tau; 2], last);
        }
    }

    /// Sets the step from the norms of image and dual variables, or from the data before there are
    /// any.
    fn measure_step(&mut self) {
        let ops = &self.solver.single;
        let measured = step::measure(ops, &self.image);
        let problem = self.window.problem(&self.solver);
        if let Some(step) = measured.or_else(|| step::guess(&problem, ops, &self.image)) {
            self.step = WARM_STEP * step;
        }
    }
}
