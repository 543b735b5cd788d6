//! `eit forward`

use super::{Answer, check_ending, conductivity, solve_json};
use crate::cli::ForwardArgs;
use crate::error::CliError;
use crate::output::{OutFile, write_csv, write_npy};
use crate::pipeline;
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
    let setup = pipeline::setup(&scene, args.mesh.as_deref(), None, &mut progress)?;
    let sigma = conductivity(&scene, args.conductivity.as_deref(), setup.model.elements())?;
    let (voltages, report) = progress.stage("forward", || {
        let mut workspace = setup.model.workspace()?;
        let mut solution = setup.model.solve(&sigma, &mut workspace)?;
        Ok::<_, CliError>((solution.measurements(), solution.report()))
    })?;
    let warning = pipeline::certain(&report)?;
    out.write(|writer| match format.as_str() {
        "npy" => write_npy(&voltages, writer),
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
    let text = [Some(text), warning.clone().map(|w| format!("warning: {w}"))];
    let text = text.into_iter().flatten().collect::<Vec<_>>().join("\n");
    let json = json!({
        "scene": scene.name,
        "out": args.out.display().to_string(),
        "measurements": voltages.len(),
        "elements": setup.model.elements(),
        "largest_v": largest,
        "warning": warning,
        "solve": solve_json(&report),
        "stages": progress.times(),
    });
    Ok(Answer { text, json })
}
