//! Cost of removing electrode movement from the data.

use super::rates::{PRODUCT_FLOPS_PER_S, SWEEP_FLOPS_PER_S};
use super::stage::{Stage, store_rate};
use crate::skin::Skin;
use eit_mesh::Electrode;

/// Time for displacement derivatives, in seconds per node and displacement, with rim electrodes only, and
/// with patches, whose directions differ. Fitted on a loaded machine, at 2 000 to 12 000 nodes.
const RIM_MOVEMENT_S: f64 = 3e-8;
const PATCH_MOVEMENT_S: f64 = 1.6e-7;
/// Number of times the Jacobian is written: divided by voltages, by the noise, without the displacements.
const COPIES: f64 = 3.0;
/// Returns the stage; `None` if electrodes do not move.
pub(crate) fn of(skin: &Skin) -> Option<Stage> {
    let movement_m = skin.settings.reconstruction.electrode_movement_m?;
    let (m, n) = (skin.protocol.measurements() as f64, skin.model.elements() as f64);
    let unknowns = 2.0 * skin.protocol.electrodes() as f64;
    // projecting each column on the directions and back, and computing those directions
    let taken = 4.0 * m * unknowns * n + 10.0 * m * unknowns * unknowns;
    let copies_s = COPIES * 8.0 * m * n / store_rate(8.0 * m * n);
    Some(Stage {
        name: "electrode movement",
        size: format!("[{m}, {unknowns}], taken out of [{m}, {n}]"),
        flops: solve_flops(skin) + taken,
        bytes: 8.0 * m * n,
        time_s: jacobian_s(skin) + taken / PRODUCT_FLOPS_PER_S + copies_s,
        why: format!(
            "each electrode may move by {:.2} mm along and across its rim: nuisance parameters",
            1e3 * movement_m
        ),
    })
}

/// Solving for voltages and fields once more.
fn solve_flops(skin: &Skin) -> f64 {
    let cost = skin.model.cost();
    cost.factor_flops + 2.0 * cost.factor_entries as f64 * cost.field_solves as f64
}

/// Time for the derivatives with respect to displacements, seconds.
pub(super) fn jacobian_s(skin: &Skin) -> f64 {
    let is_patch = |electrode: &Electrode| matches!(electrode, Electrode::Patch(_));
    let search_s = match skin.mesh.electrodes().iter().any(is_patch) {
        true => PATCH_MOVEMENT_S,
        false => RIM_MOVEMENT_S,
    };
    let nodes = skin.mesh.surface().nodes().len() as f64;
    let unknowns = 2.0 * skin.protocol.electrodes() as f64;
    solve_flops(skin) / SWEEP_FLOPS_PER_S + search_s * nodes * unknowns
}
