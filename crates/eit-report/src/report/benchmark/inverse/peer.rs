//! Data passed to the Python peers, and evaluation of their images.

use super::super::super::solver::{BoundedMethod, SetUpCost, Solver};
use super::super::peers::{PeerImages, PeerInverseProblem};
use super::super::work_precision::{Convergence, SolverDescription, Spread, WorkPrecisionCurve};
use super::problem::{InverseProblem, SolverRun};
use crate::error::ReportError;
use eit_skin::Progress;
use eit_skin::scene::Rule;
use ndarray::Array1;

/// Returns the one-step matrix, and the total-variation problem with the weights chosen by our
/// solver.
pub(super) fn peer_problem(
    problem: &InverseProblem<'_>,
    method: BoundedMethod,
) -> Result<PeerInverseProblem, ReportError> {
    let model = problem.finest();
    let frames = &problem.recording.simulated.frames;
    let own = problem.fit_with(model, model.settings().clone());
    let imaging = own.one_step(&mut Progress::silent())?;
    let on_pixels = imaging.difference.on_raster(model.raster.pixel_from_element())?;
    let fitted = problem.fit(model, method, Rule::NoiseFigure);
    let Some(solver) = Solver::new(model, &fitted, method.method)?.into_total_variation() else {
        return Err(ReportError::Failure("no solver of total variation".to_owned()));
    };
    let settings = solver.settings();
    let noise = settings.noise_std.clone().unwrap_or_else(|| vec![1.0; frames.used.len()]);
    let mut whitened_jacobian = model.linearised.pixel_jacobian(&model.raster, &frames.used)?;
    for (mut row, noise) in whitened_jacobian.rows_mut().into_iter().zip(&noise) {
        row.mapv_inplace(|j| j / noise);
    }
    let differences = fitted.differences();
    let whitened_differences = &differences / &Array1::from(noise);
    let side = model.raster.pixel_m();
    Ok(PeerInverseProblem {
        matrix: on_pixels.reconstruction_matrix(),
        differences,
        whitened_jacobian,
        whitened_differences,
        mask: model.raster.mask().mapv(|inside| f64::from(u8::from(inside))),
        weights: [settings.lambda_space * side, settings.lambda_time * side * side],
    })
}

/// Evaluates a peer's images in the same way as ours.
pub(super) fn peer_curve(
    problem: &InverseProblem<'_>,
    found: PeerImages,
) -> Result<WorkPrecisionCurve, ReportError> {
    let PeerImages { name, seconds, images } = found;
    let pixels = Some(problem.finest().raster.pixels());
    let solver = SolverDescription { is_peer: true, ..SolverDescription::own(name, pixels, false) };
    let run = SolverRun {
        time: Spread::of(seconds, images.nrows()),
        floor_s: f64::NAN,
        convergence: Convergence::DIRECT,
        target_gap: None,
    };
    let cost = SetUpCost { set_up_s: 0.0, choice_s: 0.0, choice: "as ours".to_owned() };
    problem.curve(solver, cost, images, &run)
}
