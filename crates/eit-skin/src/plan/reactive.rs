//! The plan of a reactive scene: complex voltages and Jacobian, but no images.

use super::left_out::{LeftOut, listed};
use super::{PlanText, machine::Machine, stage_json, stage_lines, stages};
use crate::error::SkinError;
use crate::progress::Progress;
use crate::reactive::{ReactiveSkin, rounding_warning};
use eit_fem::AdmittivityReport;
use serde_json::json;

/// Builds what is needed for sizes, solves once for phases and pivot growth, and predicts the rest.
///
/// # Errors
///
/// A skin that cannot be solved.
pub fn of_reactive(skin: &ReactiveSkin, progress: &mut Progress) -> Result<PlanText, SkinError> {
    let report = progress.stage("voltages", || untouched(skin))?;
    let warning = rounding_warning(&report)?;
    let machine = progress.stage("this machine", || Ok::<_, SkinError>(Machine::measure()))?;
    let stages = stages::of_reactive(skin, &machine);
    let why = why_complex(skin);
    let left_out = left_out(skin, &report);
    let json = json!({
        "scene": skin.name,
        "complex": true,
        "complex_because": why,
        "mesh_notes": skin.notes,
        "stages": stages.iter().map(stage_json).collect::<Vec<_>>(),
        "left_out": left_out.iter().map(LeftOut::json).collect::<Vec<_>>(),
        "phase_span_deg": report.phase_span_deg,
        "growth": report.growth,
        "expected_loss": report.expected_loss,
        "warning": warning,
        "machine": machine,
        "built": progress.times(),
    });
    let mut lines = vec![why, format!("{}: what is done", skin.name)];
    lines.extend(stages.iter().flat_map(stage_lines));
    lines.push(format!("times on this machine: {}", machine.words()));
    lines.push(
        "expected error of the voltages: not computed (the mesh-free series does not support \
         capacitances); compare with a finer [mesh]"
            .to_owned(),
    );
    lines.push("left out".to_owned());
    lines.extend(left_out.iter().map(LeftOut::line));
    lines.extend(warning.map(|warning| format!("warning: {warning}")));
    Ok(PlanText { text: lines.join("\n"), json })
}

/// Report on the solve of the untouched skin.
fn untouched(skin: &ReactiveSkin) -> Result<AdmittivityReport, SkinError> {
    let background = vec![skin.background; skin.model.elements()];
    let mut workspace = skin.model.workspace()?;
    Ok(skin.model.solve(&background, &mut workspace)?.report())
}

/// States that complex numbers are used, and why.
fn why_complex(skin: &ReactiveSkin) -> String {
    let gamma = skin.background;
    format!(
        "complex arithmetic: capacitances carry current at {} Hz (the sheet has a susceptance \
         of {:.2e} S and a conductivity of {:.2e} S)",
        skin.frequency_hz, gamma.im, gamma.re
    )
}

fn left_out(skin: &ReactiveSkin, report: &AdmittivityReport) -> Vec<LeftOut> {
    let cost = skin.model.cost();
    let (m, products) = (skin.model.protocol().measurements(), cost.field_products);
    let mut list = vec![
        ("images", "reconstruction, U-nets and touches only support conductivities".to_owned()),
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
    listed(list)
}
