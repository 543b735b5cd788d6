//! What a [`ForwardModel`] is asked for.

use super::solution::Solution;
use super::workspace::Workspace;
use crate::error::FemError;
use crate::model::checks::{check_accuracy, check_conductivity};
use crate::model::{ForwardModel, Geometry};
use ndarray::{Array1, Array2};

impl ForwardModel {
    /// Memory for solves of this model.
    ///
    /// # Errors
    /// [`FemError::OutOfMemory`].
    pub fn workspace(&self) -> Result<Workspace, FemError> {
        Workspace::new(self)
    }

    /// Assembles and factorises for one conductivity per element, siemens.
    ///
    /// # Errors
    /// A wrong number of values, a value that is not finite and above zero, a workspace of
    /// another model, a matrix that rounding has made indefinite, potentials that overflow.
    pub fn solve<'a>(
        &'a self,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        check_conductivity(self.elements(), conductivity_s)?;
        Solution::new(self, &self.geometry, conductivity_s, workspace, None)
    }

    /// [`ForwardModel::solve`] to a required accuracy of the voltages, relative to the largest.
    ///
    /// The cheapest path that meets it is taken: nodal assembly where
    /// [`SolveReport::expected_loss`](crate::SolveReport::expected_loss) suffices; else means and
    /// deviations on electrodes (module `solve::electrode_elimination`), first in `f64`, which contact impedances cannot
    /// spoil, then in twice the precision, for contrast and flat triangles. Both also serve shunts and
    /// ideal current sources, have a bound for every voltage, and allocate. At 2 000 nodes they cost
    /// about 50 and 200 times the first path (18 and 75 ms on a loaded machine), at 20 000 20 and 100
    /// times.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`]; an accuracy that is not between `4 eps` and 1;
    /// [`FemError::AccuracyNotReached`]; electrodes without a node of their own; with quadratic
    /// elements [`FemError::NodalAssemblyOnly`] where the first path does not suffice.
    pub fn solve_to<'a>(
        &'a self,
        conductivity_s: &[f64],
        required_accuracy: f64,
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        check_conductivity(self.elements(), conductivity_s)?;
        check_accuracy(required_accuracy)?;
        Solution::new(self, &self.geometry, conductivity_s, workspace, Some(required_accuracy))
    }

    /// Voltages of every measurement for one conductivity per element; allocates a workspace.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`].
    pub fn forward(&self, conductivity_s: &[f64]) -> Result<Array1<f64>, FemError> {
        Ok(self.solve(conductivity_s, &mut self.workspace()?)?.measurements())
    }

    /// Jacobian [measurement, element], volt per siemens; allocates a workspace.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`].
    pub fn jacobian(&self, conductivity_s: &[f64]) -> Result<Array2<f64>, FemError> {
        Ok(self.solve(conductivity_s, &mut self.workspace()?)?.jacobian())
    }

    /// [`ForwardModel::solve`] on a geometry of [`ForwardModel::deform`].
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`], and a geometry of another model.
    pub fn solve_deformed<'a>(
        &'a self,
        geometry: &'a Geometry,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        geometry.check(&self.dofs, &self.assembly)?;
        check_conductivity(self.elements(), conductivity_s)?;
        Solution::new(self, geometry, conductivity_s, workspace, None)
    }

    /// [`ForwardModel::solve_to`] on a geometry of [`ForwardModel::deform`].
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve_to`], and a geometry of another model.
    pub fn solve_deformed_to<'a>(
        &'a self,
        geometry: &'a Geometry,
        conductivity_s: &[f64],
        required_accuracy: f64,
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        geometry.check(&self.dofs, &self.assembly)?;
        check_conductivity(self.elements(), conductivity_s)?;
        check_accuracy(required_accuracy)?;
        Solution::new(self, geometry, conductivity_s, workspace, Some(required_accuracy))
    }
}
