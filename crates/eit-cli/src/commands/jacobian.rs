//! `eit jacobian`

use super::{Answer, check_ending, solve};
use crate::cli::JacobianArgs;
use crate::error::CliError;
use crate::progress;
use eit_report::output::{OutFile, write_npy};
use eit_report::reconstruct::solve_json;
use eit_report::with_warning;
use eit_skin::scene::Scene;
use serde_json::json;

/// Solves and writes the Jacobian; a complex one for reactive scenes.
pub(crate) fn run(args: &JacobianArgs) -> Result<Answer, CliError> {
    check_ending(&args.out, &["npy"])?;
    let scene = Scene::load(&args.solve.scene)?;
    let out = OutFile::new(&args.out)?;
    if scene.is_reactive() {
        return complex(args, &scene, out);
    }
    let mut progress = progress::terminal();
    let solved = solve::real(&args.solve, &scene, &mut progress, |solution| solution.jacobian())?;
    let (jacobian, report) = (&solved.wanted, &solved.report);
    out.write(|writer| write_npy(jacobian, writer))?;
    let [rows, columns] = [jacobian.nrows(), jacobian.ncols()];
    let text = format!(
        "[{rows} measurements, {columns} elements] in V/S from {} field solves; backward error \
         {:.1e}\nwritten: {}",
        report.field_solves,
        report.backward_error,
        args.out.display()
    );
    let json = json!({
        "scene": scene.name,
        "out": args.out.display().to_string(),
        "shape": [rows, columns],
        "warning": solved.warning,
        "mesh_notes": solved.notes,
        "solve": solve_json(report),
        "stages": progress.times(),
    });
    Ok(Answer { text: with_warning(text, solved.warning.as_ref()), json })
}

/// The holomorphic derivative of complex voltages with respect to complex admittivities.
fn complex(args: &JacobianArgs, scene: &Scene, out: OutFile) -> Result<Answer, CliError> {
    let mut progress = progress::terminal();
    let solved = solve::complex(&args.solve, scene, &mut progress, |solution| solution.jacobian())?;
    let (jacobian, report) = (&solved.wanted, &solved.report);
    out.write(|writer| write_npy(jacobian, writer))?;
    let [rows, columns] = [jacobian.nrows(), jacobian.ncols()];
    let text = format!(
        "[{rows} measurements, {columns} elements], complex, in V/S at {} Hz from {} field solves; \
         backward error {:.1e}, growth {:.2}\nwritten: {}",
        scene.frequency_hz(),
        report.field_solves,
        report.backward_error,
        report.growth,
        args.out.display()
    );
    let json = json!({
        "scene": scene.name,
        "out": args.out.display().to_string(),
        "complex": true,
        "frequency_hz": scene.frequency_hz(),
        "shape": [rows, columns],
        "warning": solved.warning,
        "mesh_notes": solved.notes,
        "solve": solve::complex_json(report),
        "stages": progress.times(),
    });
    Ok(Answer { text: with_warning(text, solved.warning.as_ref()), json })
}
