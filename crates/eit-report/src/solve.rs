//! Voltages or the Jacobian of a scene: one solve, real, or complex for reactive scenes.

use crate::error::ReportError;
use crate::output::{OutFile, ending, write_csv, write_npy};
use crate::reconstruct::solve_json;
use crate::settings::{Solution, SolveSettings};
use crate::{Answer, with_warning};
use eit_fem::Complex64;
use eit_hw::{ReadOptions, Recording, read_recording};
use eit_skin::reactive::{self, ReactiveSkin};
use eit_skin::{MeshOverride, Progress, Scene, Skin, rounding_warning};
use ndarray::{Array2, ArrayD};
use serde_json::{Value, json};
use std::path::Path;

/// Solves, writes what is wanted and reports it. Voltages are written as `.npy`, or as one row of CSV in which real and
/// imaginary parts alternate; a Jacobian as `.npy`. That of complex voltages is their holomorphic derivative with
/// respect to complex admittivities.
///
/// # Errors
///
/// An invalid scene or conductivity, a rounding error that leaves no digit, and a file that cannot be written.
pub fn run(settings: &SolveSettings, progress: &mut Progress) -> Result<Answer, ReportError> {
    let (solved, json) = solve(settings, progress)?;
    let Solved { values, at, unknowns, elements, field_solves, .. } = &solved;
    let is_complex = matches!(values, Values::Complex(_));
    let (text, more) = match settings.wanted {
        Solution::Voltages => {
            let (count, largest) = match values {
                Values::Real(v) => (v.len(), v.iter().fold(0.0_f64, |m, v| m.max(v.abs()))),
                Values::Complex(v) => (v.len(), v.iter().fold(0.0_f64, |m, v| m.max(v.norm()))),
            };
            let kind = if is_complex { "complex " } else { "" };
            let size = format!("largest {largest:.4e} V, from {unknowns} unknowns");
            let json = json!({ "measurements": count, "elements": elements, "largest_v": largest });
            (format!("{count} {kind}voltages{at}, {size}"), json)
        }
        Solution::Jacobian => {
            let shape = match values {
                Values::Real(jacobian) => jacobian.shape(),
                Values::Complex(jacobian) => jacobian.shape(),
            };
            let kind = if is_complex { ", complex," } else { "" };
            let size = format!("[{} measurements, {} elements]", shape[0], shape[1]);
            let text = format!("{size}{kind} in V/S{at} from {field_solves} field solves");
            (text, json!({ "shape": shape }))
        }
    };
    let text = format!("{text}; {}\nwritten: {}", solved.errors, settings.out.display());
    let text = with_warning(text, solved.warning.as_ref());
    Ok(Answer { text, json: joined(json, more) })
}

/// Returns a JSON object with further fields.
pub(crate) fn joined(mut json: Value, more: Value) -> Value {
    if let (Some(fields), Value::Object(more)) = (json.as_object_mut(), more) {
        fields.extend(more);
    }
    json
}

enum Values {
    Real(ArrayD<f64>),
    Complex(ArrayD<Complex64>),
}

/// Result of a solve, and what its report says.
struct Solved {
    values: Values,
    /// Frequency of complex values, for people.
    at: String,
    elements: usize,
    unknowns: usize,
    field_solves: usize,
    /// Numerical errors, for people.
    errors: String,
    report: Value,
    warning: Option<String>,
    /// Repairs made to the mesh file.
    notes: Vec<String>,
}

/// Solves for one conductivity and writes what is wanted; returns what both answers have, too.
fn solve(
    settings: &SolveSettings,
    progress: &mut Progress,
) -> Result<(Solved, Value), ReportError> {
    let path = &settings.out;
    let scene = Scene::load(&settings.scene)?;
    let out = OutFile::new(path)?;
    let solved = match scene.is_reactive() {
        true => complex(settings, &scene, progress)?,
        false => real(settings, &scene, progress)?,
    };
    out.write(|writer| match (&solved.values, ending(path).as_str()) {
        (Values::Real(values), "npy") => write_npy(values, writer),
        (Values::Complex(values), "npy") => write_npy(values, writer),
        (Values::Real(values), _) => write_csv(row(values.iter().copied()).view(), writer),
        (Values::Complex(values), _) => {
            write_csv(row(values.iter().flat_map(|v| [v.re, v.im])).view(), writer)
        }
    })?;
    let json = json!({
        "scene": scene.name,
        "out": path.display().to_string(),
        "warning": solved.warning,
        "mesh_notes": solved.notes,
        "solve": solved.report,
        "stages": progress.times(),
    });
    let complex = json!({ "complex": true, "frequency_hz": scene.frequency_hz() });
    Ok((solved, if scene.is_reactive() { joined(json, complex) } else { json }))
}

fn row(values: impl Iterator<Item = f64>) -> Array2<f64> {
    ndarray::Array1::from_iter(values).insert_axis(ndarray::Axis(0))
}

fn real(
    settings: &SolveSettings,
    scene: &Scene,
    progress: &mut Progress,
) -> Result<Solved, ReportError> {
    if let Some(rounding) =
        settings.accuracy.filter(|rounding| !(*rounding > 0.0 && *rounding < 1.0))
    {
        let wanted = "above 0 and below 1, a fraction of the largest voltage";
        return Err(ReportError::input(format!("--accuracy {rounding}: it must be {wanted}")));
    }
    let mesh = MeshOverride { file: settings.mesh.clone(), nodes: None };
    let skin = Skin::set_up(scene, &mesh, progress)?;
    let elements = skin.model.elements();
    let sigma = match settings.conductivity.as_deref() {
        None => skin.background_s(),
        Some(path) => conductivity(path, elements)?,
    };
    progress.stage("solve", || {
        let mut workspace = skin.model.workspace()?;
        let mut solution = match settings.accuracy {
            None => skin.solve(&sigma, &mut workspace)?,
            Some(rounding) => skin.solve_to(&sigma, rounding, &mut workspace)?,
        };
        let values = Values::Real(match settings.wanted {
            Solution::Voltages => solution.measurements().into_dyn(),
            Solution::Jacobian => solution.jacobian().into_dyn(),
        });
        let report = solution.report();
        Ok(Solved {
            values,
            at: String::new(),
            elements,
            unknowns: report.unknowns,
            field_solves: report.field_solves,
            errors: format!("backward error {:.1e}", report.backward_error),
            report: solve_json(&report),
            warning: rounding_warning(&report)?,
            notes: skin.notes.clone(),
        })
    })
}

fn complex(
    settings: &SolveSettings,
    scene: &Scene,
    progress: &mut Progress,
) -> Result<Solved, ReportError> {
    if settings.accuracy.is_some() {
        let why = "complex voltages are only solved in one way, whose report bounds their rounding";
        return Err(ReportError::input(format!("--accuracy: {why}")));
    }
    let mesh = MeshOverride { file: settings.mesh.clone(), nodes: None };
    let skin = ReactiveSkin::set_up(scene, &mesh, progress)?;
    let gamma = admittivity(&skin, settings.conductivity.as_deref())?;
    progress.stage("solve", || {
        let mut workspace = skin.model.workspace()?;
        let mut solution = skin.model.solve(&gamma, &mut workspace)?;
        let values = Values::Complex(match settings.wanted {
            Solution::Voltages => solution.measurements().into_dyn(),
            Solution::Jacobian => solution.jacobian().into_dyn(),
        });
        let report = solution.report();
        let (backward, growth) = (report.backward_error, report.growth);
        Ok(Solved {
            values,
            at: format!(" at {} Hz", skin.frequency_hz),
            elements: gamma.len(),
            unknowns: report.unknowns,
            field_solves: report.field_solves,
            errors: format!("backward error {backward:.1e}, growth {growth:.2}"),
            report: json!({
                "unknowns": report.unknowns,
                "factor_entries": report.factor_entries,
                "field_solves": report.field_solves,
                "phase_span_deg": report.phase_span_deg,
                "growth": growth,
                "backward_error": backward,
                "expected_loss": report.expected_loss,
                "time_s": report.time_s,
            }),
            warning: reactive::rounding_warning(&report)?,
            notes: skin.notes.clone(),
        })
    })
}

/// Reads conductivities from a file and checks their number.
fn conductivity(path: &Path, elements: usize) -> Result<Vec<f64>, ReportError> {
    let table = per_element(path, elements)?;
    if table.imaginary.is_some() {
        let message = "complex values; a conductivity is real, and the scene stores no charge \
                       (protocol.frequency_hz and a capacitance)";
        return Err(ReportError::input(format!("{}: {message}", path.display())));
    }
    Ok(table.real.into_iter().collect())
}

/// Returns the admittivity to solve for: the scene's background; conductivities from a file with the scene's
/// capacitance; or admittivities, if the file contains complex numbers.
fn admittivity(skin: &ReactiveSkin, file: Option<&Path>) -> Result<Vec<Complex64>, ReportError> {
    let elements = skin.model.elements();
    let Some(path) = file else { return Ok(vec![skin.background; elements]) };
    let table = per_element(path, elements)?;
    let real = table.real.into_iter();
    Ok(match table.imaginary {
        Some(imaginary) => real.zip(imaginary).map(|(re, im)| Complex64::new(re, im)).collect(),
        None => real.map(|s| skin.admittivity_of(s)).collect(),
    })
}

/// Reads a file with one value per element, in file order.
fn per_element(path: &Path, elements: usize) -> Result<Recording, ReportError> {
    let table = read_recording(path, None, &ReadOptions::default()).map_err(|e| {
        ReportError::input(format!("conductivity, one siemens value per element: {e}"))
    })?;
    let found = table.real.len();
    if found != elements {
        let wanted = "one conductivity each, in file order";
        return Err(ReportError::input(format!(
            "{}: {found} values, but the mesh has {elements} elements: {wanted}",
            path.display(),
        )));
    }
    Ok(table)
}
