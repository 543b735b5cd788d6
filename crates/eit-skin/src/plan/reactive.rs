//! The plan of a reactive scene: complex voltages and Jacobian, but no images.

use super::left_out::{LeftOut, listed};
use super::machine::Machine;
use super::rates::{ELEMENT_S, FACTOR_FLOPS_PER_S, SWEEP_FLOPS_PER_S};
use super::stage::{Stage, scale, store_rate};
use super::stages::mesh_stage;
use super::{PlanText, stage_lines};
use crate::error::SkinError;
use crate::progress::Progress;
use crate::reactive::{ReactiveSkin, rounding_warning};
use eit_fem::AdmittivityReport;
use serde_json::json;

/// Real multiplications and additions per complex one.
const COMPLEX_FLOPS: f64 = 4.0;

/// Builds what is needed for sizes, solves once for phases and pivot growth, and predicts the rest.
///
/// # Errors
///
/// A skin that cannot be solved.
pub fn of_reactive(skin: &ReactiveSkin, progress: &mut Progress) -> Result<PlanText, SkinError> {
    let report = progress.stage("voltages", || untouched(skin))?;
    let warning = rounding_warning(&report)?;
    let machine = progress.stage("this machine", || Ok::<_, SkinError>(Machine::measure()))?;
    let stages = stages(skin, &machine);
    let why = why_complex(skin);
    let left_out = left_out(skin, &report);
    let json = json!({
        "scene": skin.name,
        "complex": true,
        "complex_because": why,
        "mesh_notes": skin.notes,
        "stages": stages,
        "left_out": left_out,
        "phase_span_deg": report.phase_span_deg,
        "growth": report.growth,
        "expected_loss": report.expected_loss,
        "warning": warning,
        "machine": machine,
        "built": progress.times(),
    });
    let mut lines = vec![why, format!("{}: what is done", skin.name)];
    lines.extend(stages.iter().flat_map(stage_lines));
    lines.push(format!("times on this machine: {}", machine.description()));
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

/// Stages of a reactive scene. A complex product counts as four real ones; a matrix is assembled
/// twice, for real and imaginary parts.
fn stages(skin: &ReactiveSkin, machine: &Machine) -> Vec<Stage> {
    let model = &skin.model;
    let cost = model.cost();
    let (m, n) = (model.protocol().measurements() as f64, model.elements() as f64);
    let (entries, solves) = (cost.factor_entries as f64, cost.field_solves as f64);
    let factor = COMPLEX_FLOPS * cost.factor_flops;
    let sweep = COMPLEX_FLOPS * 2.0 * entries * solves;
    let bytes = 16.0 * m * n;
    let mut stages = vec![
        mesh_stage(skin.from_file, &skin.mesh),
        Stage {
            name: "forward, complex",
            size: format!("{} unknowns, factor {} entries", cost.unknowns, cost.factor_entries),
            flops: factor,
            bytes: 16.0 * entries,
            time_s: factor / FACTOR_FLOPS_PER_S + 2.0 * ELEMENT_S * n,
            why: "one symmetric factorisation gives all voltages: electrodes are eliminated last"
                .to_owned(),
        },
        Stage {
            name: "Jacobian, complex",
            size: format!("[{m}, {n}], {solves} fields, {} products", cost.field_products),
            // the product of two gradients takes 16 flops, for real ones 3
            flops: sweep + 16.0 / 3.0 * cost.product_flops,
            bytes,
            time_s: sweep / SWEEP_FLOPS_PER_S + bytes / store_rate(bytes),
            why:
                "only needed by `eit jacobian`: the derivative with respect to complex admittivity"
                    .to_owned(),
        },
    ];
    scale(&mut stages, machine);
    stages
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
