//! One solve for `eit forward` and `eit jacobian`: real, or complex for reactive scenes.

use crate::cli::SolveArgs;
use crate::error::CliError;
use eit_fem::{AdmittivityReport, AdmittivitySolution, Complex64, Solution, SolveReport};
use eit_skin::reactive::{self, ReactiveSkin};
use eit_skin::{MeshOverride, Progress, Scene, Skin, rounding_warning};
use serde_json::{Value, json};
use std::path::Path;

/// Result of a solve; `R` is its report.
pub(super) struct Solved<T, R = SolveReport> {
    pub elements: usize,
    pub wanted: T,
    pub report: R,
    pub warning: Option<String>,
    /// Repairs made to the mesh file.
    pub notes: Vec<String>,
}

fn mesh(args: &SolveArgs) -> MeshOverride {
    MeshOverride { file: args.mesh.clone(), nodes: None }
}

/// Builds mesh and model and solves for one conductivity; `take` extracts what the command needs.
pub(super) fn real<T>(
    args: &SolveArgs,
    scene: &Scene,
    progress: &mut Progress,
    take: impl FnOnce(&mut Solution<'_>) -> T,
) -> Result<Solved<T>, CliError> {
    let accuracy = accuracy(args)?;
    let skin = Skin::set_up(scene, &mesh(args), progress)?;
    let elements = skin.model.elements();
    let sigma = match args.conductivity.as_deref() {
        None => skin.background_s(),
        Some(path) => conductivity(path, elements)?,
    };
    progress.stage("solve", || {
        let mut workspace = skin.model.workspace()?;
        let mut solution = match accuracy {
            None => skin.solve(&sigma, &mut workspace)?,
            Some(rounding) => skin.solve_to(&sigma, rounding, &mut workspace)?,
        };
        let wanted = take(&mut solution);
        let report = solution.report();
        let warning = rounding_warning(&report)?;
        Ok(Solved { elements, wanted, report, warning, notes: skin.notes.clone() })
    })
}

/// Returns `--accuracy` after checking its range.
fn accuracy(args: &SolveArgs) -> Result<Option<f64>, CliError> {
    match args.accuracy {
        Some(value) if !(value > 0.0 && value < 1.0) => {
            let why = "a fraction of the largest voltage, it must be above 0 and below 1";
            Err(CliError::input(format!("--accuracy {value}: {why}")))
        }
        accuracy => Ok(accuracy),
    }
}

/// The same for one admittivity.
pub(super) fn complex<T>(
    args: &SolveArgs,
    scene: &Scene,
    progress: &mut Progress,
    take: impl FnOnce(&mut AdmittivitySolution<'_>) -> T,
) -> Result<Solved<T, AdmittivityReport>, CliError> {
    if args.accuracy.is_some() {
        let why = "complex voltages are only solved in one way, whose report bounds their rounding";
        return Err(CliError::input(format!("--accuracy: {why}")));
    }
    let skin = ReactiveSkin::set_up(scene, &mesh(args), progress)?;
    let elements = skin.model.elements();
    let gamma = admittivity(&skin, args.conductivity.as_deref())?;
    progress.stage("solve", || {
        let mut workspace = skin.model.workspace()?;
        let mut solution = skin.model.solve(&gamma, &mut workspace)?;
        let wanted = take(&mut solution);
        let report = solution.report();
        let warning = reactive::rounding_warning(&report)?;
        Ok(Solved { elements, wanted, report, warning, notes: skin.notes.clone() })
    })
}

/// Reads conductivities from a file and checks their number.
fn conductivity(path: &Path, elements: usize) -> Result<Vec<f64>, CliError> {
    let table = per_element(path, elements)?;
    if table.imaginary.is_some() {
        let message = "complex values; a conductivity is real, and the scene stores no charge \
                       (protocol.frequency_hz and a capacitance)";
        return Err(CliError::input(format!("{}: {message}", path.display())));
    }
    Ok(table.real.into_iter().collect())
}

/// Returns the admittivity to solve for: the scene's background; conductivities from a file with the scene's
/// capacitance; or admittivities, if the file contains complex numbers.
fn admittivity(skin: &ReactiveSkin, file: Option<&Path>) -> Result<Vec<Complex64>, CliError> {
    let elements = skin.model.elements();
    let Some(path) = file else { return Ok(vec![skin.background; elements]) };
    let table = per_element(path, elements)?;
    Ok(match table.imaginary {
        Some(imaginary) => {
            let parts = table.real.into_iter().zip(imaginary);
            parts.map(|(re, im)| Complex64::new(re, im)).collect()
        }
        None => table.real.into_iter().map(|s| skin.admittivity_of(s)).collect(),
    })
}

/// Reads a file with one value per element, in file order.
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

/// Returns the report of a complex solve as JSON.
pub(super) fn complex_json(report: &AdmittivityReport) -> Value {
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
