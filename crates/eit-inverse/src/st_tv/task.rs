//! One sequence in the solver's internal units.

use super::batch::StTv;
use super::data::{SequenceData, Target};
use super::problem::Problem;
use super::settings::{Fidelity, Weights};
use super::units::{Units, radius};
use crate::check::check_range;
use crate::{
    Certificate, DifferenceFrames, ImageSequence, InverseError, SequenceReport, SequenceStatus,
    TracePoint,
};
use eit_core::event;
use ndarray::Array2;
use std::time::Instant;

/// A sequence in units in which the root mean square of the norms of its frames is 1.
pub(crate) struct Task<'a> {
    pub(crate) solver: &'a StTv,
    pub(crate) units: Units,
    /// Whether the zero sequence is known to be optimal.
    pub(crate) is_zero: bool,
    data: SequenceData,
    weights: Weights,
    /// Constraint radius of each frame; empty for penalised data.
    delta: Vec<f64>,
}

impl<'a> Task<'a> {
    pub(crate) fn new(
        solver: &'a StTv,
        weights: Weights,
        frames: &DifferenceFrames<'_>,
    ) -> Result<Self, InverseError> {
        let mut data = SequenceData::new(&solver.compression, frames)?;
        let total: f64 = data.targets.iter().map(Target::square).sum();
        let mut delta = Vec::new();
        let mut is_inside = weights.fidelity != Fidelity::Penalised;
        for (frame, (target, &mode)) in data.targets.iter().zip(&data.mode_of).enumerate() {
            let good = data.modes[mode].count;
            let norms = [target.rest_squared.sqrt(), total.sqrt()];
            if let Some(own) = radius(solver, weights.fidelity, (frame, good), norms)? {
                is_inside &= target.square() + target.rest_squared <= own * own;
                delta.push(own);
            }
        }
        let nearest = solver.settings.nearest_zero_s().abs();
        let is_zero = nearest == 0.0 && (is_inside || total == 0.0);
        let scale = (total / data.targets.len() as f64).sqrt().max(nearest * solver.unit);
        let one = if is_zero { 1.0 } else { scale };
        check_range("norm of the data", one, one.is_finite(), "below 1e150 in units of the noise")?;
        data.targets.iter_mut().for_each(|target| target.divide(one));
        delta.iter_mut().for_each(|delta| *delta /= one);
        Ok(Self { solver, units: Units::new(solver, weights, one), is_zero, data, weights, delta })
    }

    pub(crate) fn problem(&self, target_gap: f64) -> Problem<'_> {
        Problem {
            skin: &self.solver.skin,
            modes: &self.data.modes,
            mode_of: &self.data.mode_of,
            targets: &self.data.targets,
            delta: (!self.delta.is_empty()).then_some(self.delta.as_slice()),
            lambda_space: self.weights.lambda_space * self.units.weight,
            lambda_time: self.weights.lambda_time * self.units.weight,
            anchor: None,
            bounds: self.units.bounds,
            target_gap,
        }
    }

    /// Returns the zero sequence, for problems where it is known to be optimal.
    pub(crate) fn nothing(&self, start: Instant) -> ImageSequence {
        let squares = self.data.targets.iter().map(|target| target.square() + target.rest_squared);
        let residual: Vec<f64> = squares.map(f64::sqrt).collect();
        let value = match self.delta.is_empty() {
            true => 0.5 * residual.iter().map(|r| r * r).sum::<f64>(),
            false => 0.0,
        };
        let seconds = start.elapsed().as_secs_f64();
        let proof = TracePoint { seconds, iterations: 0, primal: value, lower_bound: value };
        let images = vec![0.0; residual.len() * self.solver.skin.operators.cells()];
        self.sequence(&images, &residual, vec![proof], SequenceStatus::Converged, start)
    }

    /// Converts images, over cells, and a trace from internal units to a sequence.
    pub(crate) fn sequence(
        &self,
        images: &[f64],
        residual: &[f64],
        mut trace: Vec<TracePoint>,
        status: SequenceStatus,
        start: Instant,
    ) -> ImageSequence {
        for point in &mut trace {
            point.primal *= self.units.objective;
            point.lower_bound *= self.units.objective;
        }
        let seconds = start.elapsed().as_secs_f64();
        let iterations = trace.last().map_or(0, |last| last.iterations);
        let certificate = trace
            .last()
            .map(|last| Certificate { primal: last.primal, lower_bound: last.lower_bound });
        let Certificate { primal, lower_bound } =
            certificate.unwrap_or(Certificate { primal: f64::INFINITY, lower_bound: 0.0 });
        if status == SequenceStatus::Converged {
            event!(DEBUG, "total variation converged", iterations = iterations, primal = primal);
        } else {
            event!(
                WARN,
                "total variation stopped before the wanted accuracy",
                iterations = iterations,
                primal = primal,
                lower_bound = lower_bound,
                seconds = seconds,
            );
        }
        let [lower, upper] = self.solver.settings.bounds_s();
        let (unknowns, places) = (self.solver.unknowns(), &self.solver.skin.operators.places);
        let value = |(frame, p): (usize, usize)| {
            // clip again, so that bounds hold exactly after scaling
            (images[frame * places.length + places.cells[p]] / self.units.image).clamp(lower, upper)
        };
        let is_linked = residual.len() > 1 && self.weights.lambda_time > 0.0;
        ImageSequence {
            images: Array2::from_shape_fn((residual.len(), unknowns), value),
            report: SequenceReport {
                method: if is_linked { "st-tv" } else { "tv" },
                status,
                iterations,
                seconds,
                residual: residual.iter().map(|r| r * self.units.one).collect(),
                certificate,
                trace,
            },
        }
    }
}
