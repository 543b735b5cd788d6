//! `eit forward`

use super::{Answer, check_ending, solve};
use crate::cli::ForwardArgs;
use crate::error::CliError;
use crate::progress;
use eit_fem::Complex64;
use eit_report::output::{OutFile, write_csv, write_npy};
use eit_report::reconstruct::solve_json;
use eit_report::with_warning;
use eit_skin::scene::Scene;
use ndarray::{Array1, Array2, Axis};
use serde_json::json;

/// Solves, reports and writes voltages; complex ones for reactive scenes.
pub(crate) fn run(args: &ForwardArgs) -> Result<Answer, CliError> {
    let format = check_ending(&args.out, &["npy", "csv"])?;
    let scene = Scene::load(&args.solve.scene)?;
    let out = OutFile::new(&args.out)?;
    if scene.is_reactive() {
        return complex(args, &scene, &format, out);
    }
    let mut progress = progress::terminal();
    let solved =
        solve::real(&args.solve, &scene, &mut progress, |solution| solution.measurements())?;
    let (voltages, report) = (&solved.wanted, &solved.report);
    out.write(|writer| match format.as_str() {
        "npy" => write_npy(voltages, writer),
        _ => write_csv(voltages.view().insert_axis(Axis(0)), writer),
    })?;
    let largest = voltages.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let text = format!(
        "{} voltages, largest {largest:.4e} V, from {} unknowns; backward error {:.1e}\nwritten: {}",
        voltages.len(),
        report.unknowns,
        report.backward_error,
        args.out.display()
    );
    let json = json!({
        "scene": scene.name,
        "out": args.out.display().to_string(),
        "measurements": voltages.len(),
        "elements": solved.elements,
        "largest_v": largest,
        "warning": solved.warning,
        "mesh_notes": solved.notes,
        "solve": solve_json(report),
        "stages": progress.times(),
    });
    Ok(Answer { text: with_warning(text, solved.warning.as_ref()), json })
}

/// Complex voltages: `.npy` of complex numbers, or one row of CSV with alternating real and imaginary parts.
fn complex(
    args: &ForwardArgs,
    scene: &Scene,
    format: &str,
    out: OutFile,
) -> Result<Answer, CliError> {
    let mut progress = progress::terminal();
    let solved =
        solve::complex(&args.solve, scene, &mut progress, |solution| solution.measurements())?;
    let (voltages, report) = (&solved.wanted, &solved.report);
    out.write(|writer| match format {
        "npy" => write_npy(voltages, writer),
        _ => write_csv(parts(voltages).view(), writer),
    })?;
    let largest = voltages.iter().fold(0.0_f64, |m, v| m.max(v.norm()));
    let text = format!(
        "{} complex voltages at {} Hz, largest {largest:.4e} V, from {} unknowns; backward error \
         {:.1e}, growth {:.2}\nwritten: {}",
        voltages.len(),
        scene.frequency_hz(),
        report.unknowns,
        report.backward_error,
        report.growth,
        args.out.display()
    );
    let json = json!({
        "scene": scene.name,
        "out": args.out.display().to_string(),
        "complex": true,
        "frequency_hz": scene.frequency_hz(),
        "measurements": voltages.len(),
        "elements": solved.elements,
        "largest_v": largest,
        "warning": solved.warning,
        "mesh_notes": solved.notes,
        "solve": solve::complex_json(report),
        "stages": progress.times(),
    });
    Ok(Answer { text: with_warning(text, solved.warning.as_ref()), json })
}

/// Writes one row with alternating real and imaginary parts.
fn parts(voltages: &Array1<Complex64>) -> Array2<f64> {
    let parts: Array1<f64> = voltages.iter().flat_map(|v| [v.re, v.im]).collect();
    parts.insert_axis(Axis(0))
}
