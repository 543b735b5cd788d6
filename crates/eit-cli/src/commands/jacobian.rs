//! `eit jacobian`

use super::{Answer, check_ending, conductivity, solve_json};
use crate::cli::JacobianArgs;
use crate::error::CliError;
use crate::output::{OutFile, write_npy};
use crate::pipeline;
use crate::progress::Progress;
use crate::scene::Scene;
use serde_json::json;

/// Solves, writes the Jacobian.
pub(crate) fn run(args: &JacobianArgs) -> Result<Answer, CliError> {
    check_ending(&args.out, &["npy"])?;
    let scene = Scene::load(&args.scene)?;
    let out = OutFile::new(&args.out)?;
    let mut progress = Progress::default();
    let setup = pipeline::setup(&scene, args.mesh.as_deref(), None, &mut progress)?;
    let sigma = conductivity(&scene, args.conductivity.as_deref(), setup.model.elements())?;
    let (jacobian, report) = progress.stage("forward and Jacobian", || {
        let mut workspace = setup.model.workspace()?;
        let mut solution = setup.model.solve(&sigma, &mut workspace)?;
        Ok::<_, CliError>((solution.jacobian(), solution.report()))
    })?;
    let warning = pipeline::certain(&report)?;
    out.write(|writer| write_npy(&jacobian, writer))?;
    let [rows, columns] = [jacobian.nrows(), jacobian.ncols()];
    let text = format!(
        "[{rows} measurements, {columns} elements] in V/S from {} field solves; backward error \
         {:.1e}\nwritten: {}",
        report.field_solves,
        report.backward_error,
        args.out.display()
    );
    let text = [Some(text), warning.clone().map(|w| format!("warning: {w}"))];
    let text = text.into_iter().flatten().collect::<Vec<_>>().join("\n");
    let json = json!({
        "scene": scene.name,
        "out": args.out.display().to_string(),
        "shape": [rows, columns],
        "warning": warning,
        "solve": solve_json(&report),
        "stages": progress.times(),
    });
    Ok(Answer { text, json })
}
