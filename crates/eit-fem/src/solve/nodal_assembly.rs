//! Nodal assembly: the textbook matrix of node and electrode potentials in `f64`, and an estimate
//! of its rounding error.

use super::workspace::Workspace;
use crate::element::ElementOrder;
use crate::error::FemError;
use crate::model::{ForwardModel, Geometry};

/// Solves by nodal assembly if the contacts allow it, and returns whether that meets the required
/// accuracy.
pub(super) fn nodal_assembly_suffices(
    model: &ForwardModel,
    geometry: &Geometry,
    conductivity_s: &[f64],
    workspace: &mut Workspace,
    required_accuracy: Option<f64>,
) -> Result<bool, FemError> {
    if geometry.has_limits() {
        return Ok(false);
    }
    let solved = assembled(model, geometry, conductivity_s, workspace);
    let Some(required) = required_accuracy else { return solved.map(|()| true) };
    if model.dofs.order == ElementOrder::Linear {
        // if nodal assembly fails, electrode elimination may still succeed
        return Ok(solved.is_ok_and(|()| loss(model, workspace) <= required));
    }
    solved?;
    let expected = loss(model, workspace);
    if expected <= required {
        Ok(true)
    } else {
        Err(FemError::NodalAssemblyOnly { expected, required })
    }
}

/// Assembles, factorises and computes electrode potentials in the workspace.
fn assembled(
    model: &ForwardModel,
    geometry: &Geometry,
    conductivity_s: &[f64],
    workspace: &mut Workspace,
) -> Result<(), FemError> {
    geometry.fill_matrix(&model.assembly, conductivity_s, &mut workspace.nodal.matrix);
    workspace.nodal.solve_electrodes(model, 1.0)?;
    workspace.nodal.check_potentials(|v| v)
}

/// Estimates the error of the voltages due to rounding in the assembled matrix.
pub(super) fn loss(model: &ForwardModel, workspace: &Workspace) -> f64 {
    1000.0 * f64::EPSILON * workspace.nodal.spread(model)
}
