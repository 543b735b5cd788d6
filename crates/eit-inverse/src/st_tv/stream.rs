//! An endless sequence, each frame on its own.

mod iterate;

use super::StTv;
use super::certificate::Evaluation;
use super::data::{Seen, Target};
use super::fit::DataSteps;
use super::flow::Flow;
use super::quiet::quiet_threshold;
use super::schedule::OUTGROWN;
use super::settings::{Fidelity, StreamSettings};
use super::single_frame::{Outcome, SingleFrame};
use super::state::State;
use super::step::MapScratch;
use crate::check::{check_length, check_positive, check_range};
use crate::{Certificate, InverseError, SequenceStatus};
use iterate::FIRST_ROUND;
use std::time::Instant;

/// Image of a frame and its certificate.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct StreamStep<'a> {
    /// Image of the frame, siemens, `[unknown]`.
    pub image: &'a [f64],
    /// Why the iteration stopped.
    pub status: SequenceStatus,
    /// Number of iterations of this push.
    pub iterations: usize,
    /// Bounds on the optimum of the frame.
    pub certificate: Certificate,
    /// `|W^1/2 (J x - dv)|` of the frame over its good channels.
    pub residual: f64,
    /// Whether the frame contains only noise or no data, so that no iteration was needed.
    pub quiet: bool,
    /// Run time of this push, seconds.
    pub seconds: f64,
}

/// Total variation of single frames, warm-started, without a term in time.
///
/// Every push keeps image and dual variables of the frame before, and iterates until the problem of the
/// frame is solved to the target gap or the budget is spent. The problem is exactly that of
/// [`StTv::solve`] on that one frame. After set-up nothing is allocated.
///
/// * Masked channels of a frame only change the rows of its data term. The factorisation for a new set
///   of masked channels costs `O(rank^3)` once.
/// * A frame that equals its reference, or differs from it by noise only, has the zero image, and
///   nothing is computed ([`StreamStep::quiet`]). Without `noise_std` this requires data that is exactly
///   zero.
#[derive(Debug, Clone)]
pub struct StTvStream {
    solver: StTv,
    settings: StreamSettings,
    state: State<f32>,
    data: DataSteps<f32>,
    map: MapScratch<f32>,
    flow: Flow<f32>,
    evaluation: Evaluation,
    /// Best image of a push, `[unknown][stride]`, and its residual.
    best: Vec<f64>,
    best_residual: Vec<f64>,
    scratch: Scratch,
    frame: SingleFrame,
    /// Whether the newest frame has no data.
    dropped: bool,
    /// Length of the first round of iterations of the next push.
    expected: usize,
    /// Iterations since the stream was at rest or its steps were reset.
    since_rest: usize,
    /// Iterations of this push.
    spent: usize,
    /// Factor on the steps of this push; larger if the bound improves faster than the image.
    boost: f64,
    /// Whether the next bound keeps the data dual: changes after each bound that was no better than the best.
    is_plain: bool,
    /// Squared norm of the linear image at the last step map.
    mapped: f64,
    smoothing: f64,
    /// Norm of a frame's data that corresponds to 1 internally; 0 before the first data.
    scale: f64,
    pushed: usize,
    image: Vec<f64>,
    /// Whether image and duals are zero, so that they need not be cleared.
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

impl StTvStream {
    /// Sets up a stream.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`] for a target gap that is not positive, or 0 iterations.
    pub fn new(solver: StTv, settings: StreamSettings) -> Result<Self, InverseError> {
        let StreamSettings { target_gap, max_iterations, .. } = settings;
        check_positive("target_gap", target_gap)?;
        check_range("max_iterations", 0.0, max_iterations > 0, "1 or above")?;
        let state = State::new(&solver.single, 1, false, solver.settings.bounded());
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
        let frame = SingleFrame {
            modes: [empty()],
            targets: [empty_target],
            delta: match solver.settings.fidelity {
                Fidelity::Penalised => None,
                Fidelity::Constrained { .. } => Some([0.0]),
            },
            weights: [0.0; 2],
            bounds: None,
        };
        let data = DataSteps::new(&frame.problem(&solver), &solver.single, &state, 1, target_gap);
        Ok(Self {
            data,
            map: MapScratch::new(&solver.single, &state),
            flow: Flow::new(&solver.single, &state),
            best: evaluation.image.clone(),
            best_residual: evaluation.residual.clone(),
            state,
            evaluation,
            scratch,
            frame,
            dropped: true,
            expected: FIRST_ROUND,
            since_rest: 0,
            spent: 0,
            boost: 1.0,
            is_plain: false,
            mapped: 0.0,
            smoothing: 0.0,
            scale: 0.0,
            pushed: 0,
            image: vec![0.0; solver.unknowns()],
            resting: true,
            solver,
            settings,
        })
    }

    /// Takes a frame of difference data `[measurement]` with its good channels (`None`: all) and returns
    /// its image.
    ///
    /// # Errors
    /// Returns an error for wrong lengths, a non-finite value of a good channel (the frame index counts
    /// pushes from 0), and a `delta` that no image can satisfy. The stream is then unchanged.
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
        self.pushed += 1;
        self.state.disturb();
        self.dropped = false;
        std::mem::swap(&mut self.frame.modes[0], &mut self.scratch.mode);
        self.fit_scale();
        let one = self.one();
        self.scratch.target.divide(one);
        std::mem::swap(&mut self.frame.targets[0], &mut self.scratch.target);
        Ok(self.finish(start))
    }

    /// Records a dropped frame: without data its image is zero, or the value next to zero within the bounds.
    pub fn push_dropped(&mut self) -> StreamStep<'_> {
        let start = Instant::now();
        self.pushed += 1;
        self.state.disturb();
        self.dropped = true;
        self.frame.modes[0].clear();
        self.frame.targets[0].clear();
        self.finish(start)
    }

    fn value(&self, unknown: usize) -> f64 {
        let per_image = self.scale / self.solver.unit;
        let settings = &self.solver.settings;
        let value = self.best[unknown * self.state.stride] * per_image;
        value.clamp(settings.lower_s, settings.upper_s)
    }

    /// Transforms a frame and its channels into the scratch memory, in the caller's units. Reuses the
    /// factorisation of the newest frame if the channels are the same.
    fn stage(&mut self, dv: &[f64]) -> Result<(), InverseError> {
        let Self { solver, frame, scratch, .. } = self;
        let Scratch { mode, target, good, whitened } = scratch;
        let last = &frame.modes[0];
        if last.fits(&solver.compression, |i| good[i]) {
            mode.copy_from(last);
        } else {
            mode.set(&solver.compression, |i| good[i]);
        }
        for (i, value) in whitened.iter_mut().enumerate() {
            // masked values may be NaN
            *value = if mode.good[i] { solver.compression.root_weights[i] * dv[i] } else { 0.0 };
        }
        mode.take(&solver.compression, whitened, 1.0, target);
        let Scratch { mode, target, .. } = &self.scratch;
        let Some(delta) = self.delta(mode) else { return Ok(()) };
        let least = target.rest_squared.sqrt();
        // a tiny remainder is rounding error of an exact fit
        if least > delta && least > 1e-10 * (target.norm() + least) {
            return Err(InverseError::DeltaTooSmall { frame: self.pushed, delta, least });
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
            Some(_) => (self.frame.modes[0].count as f64).sqrt(),
            None => 0.0,
        };
        let norm = target.norm().max(noise);
        if self.scale > 0.0 && norm <= OUTGROWN * self.scale {
            return;
        }
        if self.scale > 0.0 {
            self.state.clear();
            self.since_rest = 0;
        }
        self.scale = norm;
    }

    /// Iterates and returns the image.
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
        if quiet {
            self.image.fill(0.0);
        } else {
            for unknown in 0..self.solver.unknowns() {
                self.image[unknown] = self.value(unknown);
            }
        }
        let (objective, one) = self.units();
        StreamStep {
            image: &self.image,
            status: outcome.status,
            iterations: outcome.iterations,
            certificate: Certificate {
                primal: outcome.primal * objective,
                lower_bound: outcome.lower_bound * objective,
            },
            residual: self.best_residual[0] * one,
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
        self.frame.weights = [settings.lambda_space * weight, settings.lambda_time * weight];
        self.frame.bounds = bounds;
        let delta = self.delta(&self.frame.modes[0]).unwrap_or_default() / one;
        self.frame.delta = self.frame.delta.map(|_| [delta]);
    }

    /// Returns the internal unit of the data.
    fn one(&self) -> f64 {
        if self.scale > 0.0 { self.scale } else { 1.0 }
    }

    /// Returns whether the frame contains only noise or no data.
    fn is_quiet(&self) -> bool {
        let noise = self.solver.settings.noise_std.is_some();
        let zero = self.solver.settings.lower_s <= 0.0 && self.solver.settings.upper_s >= 0.0;
        let target = &self.frame.targets[0];
        let square = target.values.iter().map(|v| v * v).sum::<f64>() + target.rest_squared;
        let good = if self.dropped { 0 } else { self.frame.modes[0].count };
        let threshold = if noise { quiet_threshold(good as f64) } else { 0.0 };
        zero && square * self.scale * self.scale <= threshold
    }

    /// Sets the zero image, the result of a quiet frame.
    fn rest(&mut self) -> Outcome {
        if !self.resting {
            self.state.clear();
            self.best.fill(0.0);
            self.resting = true;
        }
        self.since_rest = 0;
        let target = &self.frame.targets[0];
        let square = target.values.iter().map(|v| v * v).sum::<f64>() + target.rest_squared;
        self.best_residual[0] = square.sqrt();
        let primal = if self.frame.delta.is_none() { 0.5 * square } else { 0.0 };
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
}
