//! Solvers that need a whole recording: weights and hyperparameters are chosen from it, and its
//! frames are solved together.

use super::super::work_precision::{Convergence, SolverDescription, Spread, WorkPrecisionCurve};
use super::problem::{InverseProblem, SolverRun};
use crate::comparison::ReconstructionModel;
use crate::comparison::{BoundedMethod, ImageSequence, Solver};
use crate::error::ReportError;
use eit_inverse::{DifferenceFrames, SequenceStatus, Stop};
use eit_skin::method::Method;
use eit_skin::scene::Rule;
use ndarray::Array2;
use std::time::{Duration, Instant};

/// Runs a method on the mesh elements.
pub(super) fn on_elements(
    problem: &InverseProblem<'_>,
    method: Method,
    rule: Rule,
) -> Result<WorkPrecisionCurve, ReportError> {
    let (model, frames) = (problem.finest(), problem.frames());
    let is_absolute = method == Method::GaussNewtonAbsolute;
    let fitted = problem.fit(model, BoundedMethod::free(method), rule);
    let mut solver = Solver::new(model, &fitted, method)?;
    let values = fitted.differences();
    let differences = DifferenceFrames::all_good(values.view());
    let mut seconds = Vec::new();
    let ImageSequence { pixels, report } = loop {
        let start = Instant::now();
        let made = solver.run(&differences, &Stop::default())?;
        seconds.push(start.elapsed().as_secs_f64());
        let enough = if is_absolute { 1 } else { problem.size.direct_runs };
        if seconds.len() >= enough {
            break made;
        }
    };
    let floor_s = match is_absolute {
        true => problem.roofline.absolute(model, report.iterations as f64 / frames as f64),
        false => problem.roofline.on_elements(model, solver.rank, frames),
    };
    let convergence =
        Convergence { iterations: report.iterations, status: report.status, gap: None };
    let time = Spread::of(seconds, frames);
    let run = SolverRun { time, floor_s, convergence, target_gap: None };
    let description = SolverDescription::own(method.name(), None, false).with_rule(rule);
    problem.curve(description, solver.cost, pixels, &run)
}

/// Runs total variation to each target gap, always from a cold start.
pub(super) fn total_variation(
    problem: &InverseProblem<'_>,
    model: &ReconstructionModel,
    method: BoundedMethod,
) -> Result<WorkPrecisionCurve, ReportError> {
    let fitted = problem.fit(model, method, Rule::NoiseFigure);
    let mut solver = Solver::new(model, &fitted, method.method)?;
    let (values, frames) = (fitted.differences(), problem.frames());
    let differences = DifferenceFrames::all_good(values.view());
    let deadline = Some(Duration::from_secs_f64(problem.size.deadline_s));
    let (mut points, mut images) = (Vec::new(), Array2::zeros((0, 0)));
    for &target_gap in problem.size.gaps {
        let stop = Stop { target_gap, deadline, max_iterations: usize::MAX };
        let mut seconds = Vec::new();
        let ImageSequence { pixels, report } = loop {
            let made = solver.run(&differences, &stop)?;
            seconds.push(made.report.seconds);
            if !once_more(problem, &seconds) {
                break made;
            }
        };
        let iterations = report.iterations as f64;
        let floor_s = problem.roofline.total_variation(model, frames, iterations) / frames as f64;
        let convergence = Convergence {
            iterations: report.iterations,
            status: report.status,
            gap: report.certificate.map(|certificate| certificate.relative_gap()),
        };
        let time = Spread::of(seconds, frames);
        let run = SolverRun { time, floor_s, convergence, target_gap: Some(target_gap) };
        images = problem.on_finest(model, pixels.view())?;
        points.push(problem.point(&images, &run)?);
        if report.status == SequenceStatus::Deadline {
            break;
        }
    }
    let solver_of = SolverDescription::own(method.name(), Some(model.raster.pixels()), false);
    Ok(WorkPrecisionCurve { solver: solver_of, cost: solver.cost, points, images })
}

/// Whether a run is short enough to repeat.
fn once_more(problem: &InverseProblem<'_>, seconds: &[f64]) -> bool {
    let size = problem.size;
    seconds.len() < size.runs && seconds.iter().sum::<f64>() < size.repeat_below_s
}
