//! The plan of a scene that stores charge: complex voltages and Jacobian, and no images.

use super::stages;
use super::{LeftOut, Plan, stage_json, stage_lines};
use crate::error::SkinError;
use crate::pipeline::reactive::{self, ReactiveSetup};
use crate::plan::machine::Machine;
use crate::progress::Progress;
use crate::scene::Scene;
use eit_fem::{AdmittivityModel, AdmittivityReport};
use serde_json::json;

/// Builds what sizes need, solves once for the phases and the growth, predicts the rest.
pub fn plan(
    scene: &Scene,
    method: Option<&str>,
    progress: &mut Progress,
) -> Result<Plan, SkinError> {
    if method.is_some() {
        scene.refuse_reactive()?;
    }
    let setup = reactive::setup(scene, None, progress)?;
    let report = progress.stage("voltages", || untouched(scene, &setup.model))?;
    let warning = reactive::certain(&report)?;
    let machine = progress.stage("this machine", || Ok::<_, SkinError>(Machine::measure()))?;
    let stages = stages::of_reactive(scene, &setup, &machine);
    let why = why_complex(scene);
    let left_out = left_out(&setup, &report);
    let json = json!({
        "scene": scene.name,
        "complex": true,
        "complex_because": why,
        "mesh_notes": setup.notes,
        "stages": stages.iter().map(stage_json).collect::<Vec<_>>(),
        "left_out": left_out.iter().map(|(what, why)| json!({"what": what, "why": why}))
            .collect::<Vec<_>>(),
        "phase_span_deg": report.phase_span_deg,
        "growth": report.growth,
        "expected_loss": report.expected_loss,
        "warning": warning,
        "machine": machine,
        "built": progress.times(),
    });
    let mut lines = vec![why, format!("{}: what is done", scene.name)];
    lines.extend(stages.iter().flat_map(stage_lines));
    lines.push(format!("times on this machine: {}", machine.words()));
    lines.push(
        "expected error of the voltages: not computed (the mesh-free series is for skins that store no \
         charge); compare with a finer [mesh]"
            .to_owned(),
    );
    lines.push("left out".to_owned());
    lines.extend(left_out.iter().map(|(what, why)| format!("  {what:<22} {why}")));
    lines.extend(warning.map(|warning| format!("warning: {warning}")));
    Ok(Plan { text: lines.join("\n"), json })
}

/// How the solve of the untouched skin went.
fn untouched(scene: &Scene, model: &AdmittivityModel) -> Result<AdmittivityReport, SkinError> {
    let background = vec![scene.admittivity_of(scene.skin.conductivity_s); model.elements()];
    let mut workspace = model.workspace()?;
    Ok(model.solve(&background, &mut workspace)?.report())
}

/// That complex numbers are used, and why.
fn why_complex(scene: &Scene) -> String {
    let gamma = scene.admittivity_of(scene.skin.conductivity_s);
    format!(
        "complex arithmetic: capacitances carry current at {} Hz (the skin has {:.2e} S beside {:.2e} S \
         of conductivity)",
        scene.frequency_hz(),
        gamma.im,
        gamma.re
    )
}

fn left_out(setup: &ReactiveSetup, report: &AdmittivityReport) -> LeftOut {
    let cost = setup.model.cost();
    let (m, products) = (setup.model.protocol().measurements(), cost.field_products);
    let mut list = vec![
        ("images", "reconstruction, nets and touches take conductivities only".to_owned()),
        (
            "pivoting",
            format!(
                "phases of conductors and capacitors span {:.1} degrees: rounding grows {:.2}-fold, \
                 never threefold",
                report.phase_span_deg, report.growth
            ),
        ),
        (
            "conjugates",
            "the matrix is symmetric, not Hermitian: the adjoint is the transpose".to_owned(),
        ),
        (
            "forward sweeps",
            "currents enter at electrodes only, which are eliminated last".to_owned(),
        ),
    ];
    if m > products {
        let why = format!("{} of {m} rows are multiples of others (reciprocity)", m - products);
        list.push(("Jacobian products", why));
    }
    list
}
