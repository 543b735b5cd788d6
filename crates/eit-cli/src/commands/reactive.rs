//! One solve of a scene that stores charge, for `eit forward` and `eit jacobian`.

use super::{Solved, per_element};
use crate::error::CliError;
use eit_fem::{AdmittivityReport, AdmittivitySolution, Complex64};
use eit_skin::Progress;
use eit_skin::pipeline::reactive::{self, ReactiveSetup};
use eit_skin::scene::Scene;
use serde_json::{Value, json};
use std::path::Path;

/// Meshes and solves for one admittivity; `take` reads what the command wants.
pub(super) fn solve<T>(
    scene: &Scene,
    (mesh_file, conductivity_file): (Option<&Path>, Option<&Path>),
    progress: &mut Progress,
    take: impl FnOnce(&mut AdmittivitySolution<'_>) -> T,
) -> Result<Solved<T, AdmittivityReport>, CliError> {
    let ReactiveSetup { model, notes, .. } = reactive::setup(scene, mesh_file, progress)?;
    let elements = model.elements();
    let gamma = admittivity(scene, conductivity_file, elements)?;
    progress.stage("solve", || {
        let mut workspace = model.workspace()?;
        let mut solution = model.solve(&gamma, &mut workspace)?;
        let wanted = take(&mut solution);
        let report = solution.report();
        let warning = reactive::certain(&report)?;
        Ok(Solved { elements, wanted, report, warning, notes })
    })
}

/// The admittivity to solve for: the scene's background; conductivities of a file beside the scene's
/// permittivity; or admittivities, where the file holds complex numbers.
fn admittivity(
    scene: &Scene,
    file: Option<&Path>,
    elements: usize,
) -> Result<Vec<Complex64>, CliError> {
    let Some(path) = file else {
        return Ok(vec![scene.admittivity_of(scene.skin.conductivity_s); elements]);
    };
    let table = per_element(path, elements)?;
    Ok(match &table.imaginary {
        Some(imaginary) => {
            let parts = table.real.iter().zip(imaginary);
            parts.map(|(re, im)| Complex64::new(*re, *im)).collect()
        }
        None => table.real.iter().map(|s| scene.admittivity_of(*s)).collect(),
    })
}

/// A complex solve for reports.
pub(super) fn solve_json(report: &AdmittivityReport) -> Value {
    json!({
        "unknowns": report.unknowns,
        "factor_entries": report.factor_entries,
        "field_solves": report.field_solves,
        "phase_span_deg": report.phase_span_deg,
        "growth": report.growth,
        "backward_error": report.backward_error,
        "expected_loss": report.expected_loss,
        "time_s": report.time_s,
    })
}
