//! The problem of one frame of a causal stream, its solution, and what is reported of it.

use super::super::frame::{End, Limits, Problem};
use super::super::iterate::dot;
use super::super::map::Weights;
use super::super::settings::CausalStep;
use super::super::value::{Coefficients, Record, unchanged, vanished};
use super::CausalStream;
use crate::st_tv::quiet::quiet_threshold;
use crate::st_tv::schedule::{MAP_EVERY, SINGLE_PRECISION_GAP, SMOOTHING};
use crate::st_tv::settings::Fidelity;
use crate::{Certificate, InverseError, SequenceStatus};
use std::time::Instant;

/// An innovation larger than usual by this factor is an event, for which a new map is computed.
const EVENT: f64 = 1.5;
/// Factor on the step with bounds: at 32 x 32 a third takes 76 iterations, 1 takes 98, a tenth 117.
const BOUNDED_STEP: f64 = 0.3;
/// Smallest ratio of the image's scale from one map to the next.
const FORGET: f64 = 0.9;
/// Number of `f32` iterations after which a frame continues in `f64`.
const GIVE_UP: usize = 400;
/// Number of frames between two complete computations of `V' x^`.
const RENEW: usize = 256;

/// Number of consecutive frames of pure noise after which the skin counts as at rest; as in a window.
const REST_AFTER: usize = 8;

impl CausalStream {
    /// Returns whether the skin is at rest; counts quiet frames.
    pub(super) fn is_quiet(&mut self) -> bool {
        let settings = &self.solver.settings;
        let is_zero = self.image.iter().all(|x| *x == 0.0);
        let values = self.target.values.iter().map(|t| t * t).sum::<f64>();
        let square = (values + self.target.rest_squared) * self.one() * self.one();
        let threshold = match settings.noise_std {
            Some(_) => quiet_threshold(self.seen.count as f64),
            None => 0.0,
        };
        let is_noise = square <= threshold;
        self.quiet_frames = if is_noise { self.quiet_frames + 1 } else { 0 };
        let zero_allowed = settings.lower_s <= 0.0 && settings.upper_s >= 0.0;
        is_noise && zero_allowed && (is_zero || self.quiet_frames >= REST_AFTER)
    }

    /// Returns the zero image of a skin at rest.
    pub(super) fn rest(&mut self, start: Instant) -> CausalStep<'_> {
        self.record.clear();
        if self.image.iter().any(|x| *x != 0.0) {
            self.restart();
        }
        let values = self.target.values.iter().map(|t| t * t).sum::<f64>();
        let square = (values + self.target.rest_squared) * self.one() * self.one();
        let primal = if self.ball().is_some() { 0.0 } else { 0.5 * square };
        CausalStep {
            image: &self.image,
            status: SequenceStatus::Direct,
            iterations: 0,
            // the zero image is not proven optimal, but the data agrees with it to within the noise
            certificate: Certificate { primal, lower_bound: 0.0 },
            residual: square.sqrt(),
            quiet: true,
            in_double: false,
            seconds: start.elapsed().as_secs_f64(),
        }
    }

    /// Returns the weights in internal units.
    fn weights(&self) -> Weights {
        let settings = &self.solver.settings;
        let per_weight = match settings.fidelity {
            Fidelity::Penalised => 1.0 / (self.solver.unit * self.one()),
            Fidelity::Constrained { .. } => 1.0 / self.largest_weight(),
        };
        Weights {
            lambda_space: settings.lambda_space * per_weight,
            lambda_time: settings.lambda_time * self.settings.time_share * per_weight,
            image: self.image_scale,
            gamma: SMOOTHING * self.settings.target_gap * self.image_scale,
            step: if settings.bounded() { BOUNDED_STEP } else { 1.0 },
        }
    }

    /// Computes the innovation `t - F' V' x^`; returns its norm.
    fn innovate(&mut self) -> f64 {
        let rank = self.solver.rank();
        let rows = self.seen.transposed.chunks_exact(rank).zip(&self.target.values);
        let mut square = 0.0;
        for (k, (row, t)) in rows.enumerate().take(self.seen.rows) {
            let model = match self.seen.is_whole {
                true => row[k] * self.coefficients[k],
                false => dot(row, &self.coefficients[..rank]),
            };
            self.beta[k] = t - model;
            square += self.beta[k].powi(2);
        }
        square.sqrt()
    }

    pub(super) fn solve(&mut self, start: Instant) -> Result<End, InverseError> {
        let size = self.innovate();
        let is_event = size > EVENT * self.usual || self.pushed <= 2;
        let is_stale = self.map_age >= MAP_EVERY || is_event;
        self.map_age = if is_stale { 1 } else { self.map_age + 1 };
        let step = 0.1 * (size.min(2.0 * self.usual) - self.usual);
        self.usual = if self.pushed <= 2 { size } else { self.usual + step };
        self.record.clear();
        let weights = self.weights();
        let [lower, upper] = self.bounds_s();
        let per_image = self.solver.unit / self.one();
        let bounds =
            self.solver.settings.bounded().then_some([lower * per_image, upper * per_image]);
        let ball = self.ball();
        let deadline = self.settings.deadline.map_or(f64::INFINITY, |d| d.as_secs_f64());
        let iterations = self.settings.max_iterations;
        let least = self.recent[0].min(self.recent[1]);
        let (single, double) = (&mut self.single, &mut self.double);
        let mut problem = Problem {
            arch: self.solver.arch,
            seen: &self.seen,
            target: &self.target,
            beta: &self.beta,
            weights,
            bounds,
            ball,
            target_gap: self.settings.target_gap,
            shown: 0.0,
            anchor: &self.anchor,
            exact: &self.double_setting,
        };
        let mut limits = Limits {
            iterations,
            start,
            deadline,
            give_up: GIVE_UP,
            first_look: least.saturating_sub(4),
        };
        let record = &mut self.record;
        // the previous image is a candidate, often the best one without motion
        let unchanged = unchanged(&problem, record);
        let is_zero_allowed = lower <= 0.0 && upper >= 0.0;
        if is_zero_allowed && vanished(&problem, record, &self.coefficients) {
            record.lower_bound = 0.0;
            return Ok(End::Vanished);
        }
        if unchanged == 0.0 {
            (record.primal, record.lower_bound) = (0.0, 0.0);
            return Ok(End::Proven);
        }
        let is_single = self.settings.target_gap >= SINGLE_PRECISION_GAP;
        let mut end = End::GaveUp;
        if is_single {
            let setting = &self.single_setting;
            single.begin(setting, &problem);
            if is_stale {
                self.image_scale =
                    single.set_first_map(setting, &mut problem, FORGET, unchanged)?;
            }
            end = single.run(setting, &mut problem, record, &limits)?;
        }
        if end == End::GaveUp {
            limits.give_up = usize::MAX;
            let setting = &self.double_setting;
            double.begin(setting, &problem);
            if is_single {
                double.take(&single.fields);
            }
            let scale = double.set_first_map(setting, &mut problem, FORGET, unchanged)?;
            if !is_single {
                self.image_scale = scale;
            }
            end = double.run(setting, &mut problem, record, &limits)?;
            if is_single {
                single.take(&double.fields);
                // the map in the other type belongs to an earlier iterate
                self.map_age = MAP_EVERY;
            }
        }
        self.recent = [self.recent[1], self.record.iterations];
        Ok(end)
    }

    /// Makes the new image the anchor.
    pub(super) fn report(&mut self, end: End) {
        // without a feasible image, for example after a deadline, the previous image is held
        if !self.record.primal.is_finite() {
            return;
        }
        let per_image = self.one() / self.solver.unit;
        let [lower, upper] = self.bounds_s();
        for (&cell, out) in self.double_setting.places.cells.iter().zip(&mut self.image) {
            let d = self.record.change[cell];
            if d != 0.0 {
                self.anchor[cell] += d;
                // clip again, so that bounds hold exactly after scaling
                *out = (self.anchor[cell] * per_image).clamp(lower, upper);
            }
        }
        if self.pushed.is_multiple_of(RENEW) || end != End::Proven {
            self.renew_coefficients();
        } else {
            let setting = &self.double_setting;
            let Record { change, sums, coefficients: out, .. } = &mut self.record;
            self.solver.arch.dispatch(Coefficients { setting, change, sums, out });
            let changes = self.coefficients.iter_mut().zip(&self.record.coefficients);
            changes.for_each(|(c, d)| *c += d);
        }
    }

    pub(super) fn step(&self, end: End, start: Instant) -> CausalStep<'_> {
        let one = self.one();
        let objective = match self.ball() {
            None => one * one,
            Some(_) => self.largest_weight() * one / self.solver.unit,
        };
        CausalStep {
            image: &self.image,
            status: match end {
                End::Proven => SequenceStatus::Converged,
                End::Deadline => SequenceStatus::Deadline,
                End::Vanished => SequenceStatus::Stalled,
                End::Cap | End::GaveUp => SequenceStatus::IterationCap,
            },
            iterations: self.record.iterations,
            certificate: Certificate {
                primal: self.record.primal * objective,
                lower_bound: self.record.lower_bound * objective,
            },
            residual: self.record.misfit * one,
            quiet: false,
            in_double: self.record.is_double,
            seconds: start.elapsed().as_secs_f64(),
        }
    }
}
