//! One sequence in the solver's internal units.

use super::batch::StTv;
use super::data::SequenceData;
use super::problem::Problem;
use super::settings::{Fidelity, Weights};
use crate::check::check_range;
use crate::{
    Certificate, DifferenceFrames, ImageSequence, InverseError, SequenceReport, SequenceStatus,
    TracePoint,
};
use eit_core::event;
use ndarray::Array2;
use std::time::Instant;

/// A sequence, scaled so that the largest singular value of the Jacobian and the root mean square of
/// the norms of its frames are 1. This avoids overflow and underflow in `f32` for any units.
pub(crate) struct Task<'a> {
    pub(crate) solver: &'a StTv,
    pub(crate) data: SequenceData,
    pub(crate) frames: usize,
    /// Constraint radius of each frame in these units; empty for penalised data.
    pub(crate) delta: Vec<f64>,
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) bounds: Option<[f64; 2]>,
    /// Norm of a frame's data that corresponds to 1 in these units; 0 if the zero sequence is optimal.
    pub(crate) scale: f64,
    /// Objective in the caller's units per internal unit.
    objective: f64,
}

/// Returns the constraint radius of each frame, by its good channels; empty for penalised data.
fn radii(solver: &StTv, fidelity: Fidelity, data: &SequenceData) -> Vec<f64> {
    let Fidelity::Constrained { delta } = fidelity else { return Vec::new() };
    let share = |&mode: &usize| data.modes[mode].count as f64 / solver.channels as f64;
    data.mode_of.iter().map(|mode| delta * share(mode).sqrt()).collect()
}

impl<'a> Task<'a> {
    pub(crate) fn new(
        solver: &'a StTv,
        weights: Weights,
        frames: &DifferenceFrames<'_>,
    ) -> Result<Self, InverseError> {
        let Weights { lambda_space, lambda_time, fidelity } = weights;
        let mut data = SequenceData::new(&solver.compression, frames)?;
        let count = data.targets.len();
        let settings = &solver.settings;
        let square = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
        let total: f64 = data.targets.iter().map(|t| square(&t.values)).sum();
        let delta = radii(solver, fidelity, &data);
        let mut inside = !delta.is_empty();
        for (frame, (&delta, target)) in delta.iter().zip(&data.targets).enumerate() {
            let least = target.rest_squared.sqrt();
            // a tiny remainder is rounding error of an exact fit
            if least > delta && least > 1e-10 * (total.sqrt() + least) {
                return Err(InverseError::DeltaTooSmall { frame, delta, least });
            }
            inside &= square(&target.values) + target.rest_squared <= delta * delta;
        }
        let zero_allowed = settings.lower_s <= 0.0 && settings.upper_s >= 0.0;
        let nearest = settings.lower_s.max(0.0).max(-settings.upper_s.min(0.0));
        let mut scale = (total / count as f64).sqrt().max(nearest * solver.unit);
        if zero_allowed && (inside || total == 0.0) {
            scale = 0.0;
        }
        let must = "below 1e150 in units of the noise";
        check_range("norm of the data", scale, scale.is_finite(), must)?;
        let one = if scale > 0.0 { scale } else { 1.0 };
        data.targets.iter_mut().for_each(|target| target.divide(one));
        let per_image = solver.unit / one;
        let largest = lambda_space.max(lambda_time);
        let (weight, objective) = match fidelity {
            Fidelity::Penalised => (1.0 / (solver.unit * one), one * one),
            Fidelity::Constrained { .. } => (1.0 / largest, largest / per_image),
        };
        Ok(Self {
            solver,
            data,
            frames: count,
            delta: delta.iter().map(|d| d / one).collect(),
            lambda_space: lambda_space * weight,
            lambda_time: lambda_time * weight,
            bounds: settings
                .bounded()
                .then_some([settings.lower_s * per_image, settings.upper_s * per_image]),
            scale,
            objective,
        })
    }

    /// Returns whether frames are linked in time.
    pub(crate) fn linked(&self) -> bool {
        self.frames > 1 && self.lambda_time > 0.0
    }

    pub(crate) fn problem(&self, target_gap: f64) -> Problem<'_> {
        Problem {
            skin: &self.solver.skin,
            modes: &self.data.modes,
            mode_of: &self.data.mode_of,
            targets: &self.data.targets,
            delta: (!self.delta.is_empty()).then_some(self.delta.as_slice()),
            lambda_space: self.lambda_space,
            lambda_time: self.lambda_time,
            anchor: None,
            bounds: self.bounds,
            target_gap,
        }
    }

    /// Returns the zero sequence, for problems where it is known to be optimal.
    pub(crate) fn nothing(&self, start: Instant) -> ImageSequence {
        let square = |values: &[f64]| values.iter().map(|v| v * v).sum::<f64>();
        let norm = |f: usize| {
            let target = &self.data.targets[f];
            (square(&target.values) + target.rest_squared).sqrt()
        };
        let residual: Vec<f64> = (0..self.frames).map(norm).collect();
        let value = if self.delta.is_empty() { 0.5 * square(&residual) } else { 0.0 };
        ImageSequence {
            images: Array2::zeros((self.frames, self.solver.unknowns())),
            report: SequenceReport {
                method: self.name(),
                status: SequenceStatus::Converged,
                iterations: 0,
                seconds: start.elapsed().as_secs_f64(),
                residual,
                certificate: Some(Certificate { primal: value, lower_bound: value }),
                trace: Vec::new(),
            },
        }
    }

    pub(crate) fn name(&self) -> &'static str {
        if self.linked() { "st-tv" } else { "tv" }
    }

    /// Converts images, over cells, and a trace from internal units to a sequence.
    pub(crate) fn sequence(
        &self,
        images: &[f64],
        residual: &[f64],
        trace: &[TracePoint],
        status: SequenceStatus,
        start: Instant,
    ) -> ImageSequence {
        let unit = self.objective;
        let scaled = |point: &TracePoint| TracePoint {
            primal: point.primal * unit,
            lower_bound: point.lower_bound * unit,
            ..*point
        };
        let trace: Vec<TracePoint> = trace.iter().map(scaled).collect();
        let last = trace.last().copied();
        let per_image = self.scale / self.solver.unit;
        let [lower, upper] = [self.solver.settings.lower_s, self.solver.settings.upper_s];
        let (unknowns, places) = (self.solver.unknowns(), &self.solver.skin.operators.places);
        let value = |(frame, p): (usize, usize)| {
            // clip again, so that bounds hold exactly after scaling
            (images[frame * places.length + places.cells[p]] * per_image).clamp(lower, upper)
        };
        let iterations = last.map_or(0, |point| point.iterations);
        let bounds = last.map(|TracePoint { primal, lower_bound, .. }| (primal, lower_bound));
        let (primal, lower_bound) = bounds.unwrap_or((f64::INFINITY, 0.0));
        if status == SequenceStatus::Converged {
            event!(DEBUG, "total variation converged", iterations = iterations, primal = primal);
        } else {
            event!(
                WARN,
                "total variation stopped before the wanted accuracy",
                iterations = iterations,
                primal = primal,
                lower_bound = lower_bound,
                seconds = start.elapsed().as_secs_f64(),
            );
        }
        ImageSequence {
            images: Array2::from_shape_fn((self.frames, unknowns), value),
            report: SequenceReport {
                method: self.name(),
                status,
                iterations,
                seconds: start.elapsed().as_secs_f64(),
                residual: residual.iter().map(|r| r * self.scale).collect(),
                certificate: last.map(|TracePoint { primal, lower_bound, .. }| Certificate {
                    primal,
                    lower_bound,
                }),
                trace,
            },
        }
    }
}
