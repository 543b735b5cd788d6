//! `eit forward`

use super::{Answer, check_ending, solve, solve_json, with_warning};
use crate::cli::ForwardArgs;
use crate::error::CliError;
use crate::output::{OutFile, write_csv, write_npy};
use crate::progress::Progress;
use crate::scene::Scene;
use ndarray::Axis;
use serde_json::json;

/// Solves, reports, writes voltages.
pub(crate) fn run(args: &ForwardArgs) -> Result<Answer, CliError> {
    let format = check_ending(&args.out, &["npy", "csv"])?;
    let scene = Scene::load(&args.scene)?;
    let out = OutFile::new(&args.out)?;
    let mut progress = Progress::default();
    let files = (args.mesh.as_deref(), args.conductivity.as_deref());
    let solved = solve(&scene, files, &mut progress, |solution| solution.measurements())?;
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
