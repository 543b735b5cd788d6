//! Nodal assembly: the matrix of node and electrode potentials in `f64`, as textbooks have it, and what
//! that may have cost.

use super::workspace::Workspace;
use crate::element::ElementOrder;
use crate::error::FemError;
use crate::model::{ForwardModel, Geometry};

/// Solves by nodal assembly, if the contacts allow it, and says whether that meets the accuracy.
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
        // what stops nodal assembly may not stop electrode elimination
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

/// Assembly, factorisation and electrode potentials in the workspace.
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

/// What rounding in the assembled matrix may have cost the voltages.
pub(super) fn loss(model: &ForwardModel, workspace: &Workspace) -> f64 {
    1000.0 * f64::EPSILON * spread(model, workspace)
}

/// Largest over smallest entry of the assembled diagonal.
pub(super) fn spread(model: &ForwardModel, workspace: &Workspace) -> f64 {
    let diagonal = model.assembly.pattern.diagonal().map(|entry| workspace.matrix[entry]);
    let (least, most) =
        diagonal.fold((f64::INFINITY, 0.0_f64), |(least, most), d| (least.min(d), most.max(d)));
    most / least
}
