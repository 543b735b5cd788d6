//! One file per command. A command returns what it found, as text and as JSON.

pub(crate) mod calibrate;
pub(crate) mod check;
pub(crate) mod convert;
pub(crate) mod demo;
pub(crate) mod denoise;
pub(crate) mod devices;
pub(crate) mod emulate;
pub(crate) mod forward;
pub(crate) mod jacobian;
pub(crate) mod live;
pub(crate) mod mesh;
pub(crate) mod plan;
mod reactive;
pub(crate) mod reconstruct;
pub(crate) mod record;
pub(crate) mod replay;
pub(crate) mod report;
pub(crate) mod simulate;
pub(crate) mod train;
mod view;
mod viewer;

use crate::error::CliError;
use eit_fem::{Solution, SolveReport};
use eit_skin::Progress;
use eit_skin::pipeline;
use eit_skin::scene::Scene;
use std::path::Path;

pub(crate) use eit_report::Answer;
use eit_report::output::ending;
use eit_report::{reconstruct::solve_json, with_warning};

/// One solve of `eit forward` and `eit jacobian`, `R` its report.
struct Solved<T, R = SolveReport> {
    elements: usize,
    wanted: T,
    report: R,
    warning: Option<String>,
    /// What was mended in the mesh file.
    notes: Vec<String>,
}

/// Meshes and solves for one conductivity; `take` reads what the command wants.
fn solve<T>(
    scene: &Scene,
    (mesh_file, conductivity_file): (Option<&Path>, Option<&Path>),
    progress: &mut Progress,
    take: impl FnOnce(&mut Solution<'_>) -> T,
) -> Result<Solved<T>, CliError> {
    let setup = pipeline::setup(scene, mesh_file, None, progress)?;
    let elements = setup.model.elements();
    let sigma = conductivity(scene, conductivity_file, elements)?;
    progress.stage("solve", || {
        let mut workspace = setup.model.workspace()?;
        let mut solution = setup.solve(&sigma, &mut workspace)?;
        let wanted = take(&mut solution);
        let report = solution.report();
        let warning = pipeline::certain(&report)?;
        Ok(Solved { elements, wanted, report, warning, notes: setup.notes.clone() })
    })
}

/// The conductivity to solve for: a file's, checked for length, or the scene's background.
fn conductivity(scene: &Scene, file: Option<&Path>, elements: usize) -> Result<Vec<f64>, CliError> {
    let Some(path) = file else { return Ok(vec![scene.skin.conductivity_s; elements]) };
    let table = per_element(path, elements)?;
    if table.imaginary.is_some() {
        let message = "complex values; a conductivity is real, and nothing in the scene stores charge \
                       (protocol.frequency_hz and a capacitance)";
        return Err(CliError::input(format!("{}: {message}", path.display())));
    }
    Ok(table.real.iter().copied().collect())
}

/// A file of one value per element, in file order.
fn per_element(path: &Path, elements: usize) -> Result<eit_hw::Recording, CliError> {
    let table =
        eit_hw::read_recording(path, None, &eit_hw::ReadOptions::default()).map_err(|e| {
            CliError::input(format!("conductivity, one siemens value per element: {e}"))
        })?;
    let found = table.real.len();
    if found != elements {
        return Err(CliError::input(format!(
            "{}: {found} values, but the mesh has {elements} elements: one conductivity each, in file \
             order",
            path.display(),
        )));
    }
    Ok(table)
}

/// Refuses an ending that the command does not write.
fn check_ending(path: &Path, known: &[&str]) -> Result<String, CliError> {
    let found = ending(path);
    if known.contains(&found.as_str()) {
        return Ok(found);
    }
    let message = format!("{}: --out must end in .{}", path.display(), known.join(" or ."));
    Err(CliError::input(message))
}
