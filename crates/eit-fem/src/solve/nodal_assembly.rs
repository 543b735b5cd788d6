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
    geometry.fill_matrix(&model.assembly, conductivity_s, &mut workspace.matrix);
    model.cholesky.factorise(&workspace.matrix, &mut workspace.factor, 1.0)?;
    workspace.transfer.fill(0.0);
    workspace.transfer.diagonal_mut().column_vector_mut().fill(1.0);
    model.cholesky.solve_trailing(&workspace.factor, workspace.transfer.as_mut());
    workspace.fill_electrode_potentials(&model.patterns);
    workspace.check_potentials()
}

/// Estimates the error of the voltages due to rounding in the assembled matrix.
pub(super) fn loss(model: &ForwardModel, workspace: &Workspace) -> f64 {
    1000.0 * f64::EPSILON * spread(model, workspace)
}

/// Ratio of the largest to the smallest entry of the assembled diagonal.
pub(super) fn spread(model: &ForwardModel, workspace: &Workspace) -> f64 {
    let diagonal = model.assembly.pattern.diagonal().map(|entry| workspace.matrix[entry]);
    let (least, most) =
        diagonal.fold((f64::INFINITY, 0.0_f64), |(least, most), d| (least.min(d), most.max(d)));
    most / least
}
