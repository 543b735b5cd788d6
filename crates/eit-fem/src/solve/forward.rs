//! Solves of a [`ForwardModel`].

use super::solution::Solution;
use super::workspace::Workspace;
use crate::error::FemError;
use crate::model::checks::{check_accuracy, check_conductivity};
use crate::model::{ForwardModel, Geometry};
use ndarray::{Array1, Array2};

impl ForwardModel {
    /// Allocates memory for solves of this model.
    ///
    /// # Errors
    /// [`FemError::OutOfMemory`].
    pub fn workspace(&self) -> Result<Workspace, FemError> {
        Workspace::new(self)
    }

    /// Assembles and factorises for one conductivity per element, siemens.
    ///
    /// # Errors
    /// A wrong number of values; a value that is not finite and above zero; a workspace of another
    /// model; a matrix that is indefinite because of rounding; potentials that overflow.
    pub fn solve<'a>(
        &'a self,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        self.solve_deformed(&self.geometry, conductivity_s, workspace)
    }

    /// Solves to a required accuracy of the voltages, relative to the largest voltage.
    ///
    /// Uses the cheapest path that meets the requirement:
    ///
    /// 1. Nodal assembly, if [`SolveReport::expected_loss`](crate::SolveReport::expected_loss) is
    ///    small enough.
    /// 2. Electrode elimination in `f64` (module `solve::electrode_elimination`), which is accurate
    ///    for any contact impedance.
    /// 3. Electrode elimination in twice the precision, for high contrast and flat triangles.
    ///
    /// The last two also handle shunts and ideal current sources, give a bound for every voltage,
    /// and allocate. At 2 000 nodes they cost about 50 and 200 times as much as the first (18 and
    /// 75 ms on a loaded machine), at 20 000 nodes 20 and 100 times.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`]; an accuracy outside `4 eps` to 1;
    /// [`FemError::AccuracyNotReached`]; electrodes without a node of their own; with quadratic
    /// elements [`FemError::NodalAssemblyOnly`] if nodal assembly is not accurate enough.
    pub fn solve_to<'a>(
        &'a self,
        conductivity_s: &[f64],
        required_accuracy: f64,
        workspace: &'a mut Workspace,
    ) -> Result<Solution<'a>, FemError> {
        self.solve_deformed_to(&self.geometry, conductivity_s, required_accuracy, workspace)
    }

    /// Returns the voltages in protocol order for one conductivity per element. Allocates a
    /// workspace.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`].
    pub fn forward(&self, conductivity_s: &[f64]) -> Result<Array1<f64>, FemError> {
        Ok(self.solve(conductivity_s, &mut self.workspace()?)?.measurements())
    }

    /// Returns the Jacobian, [measurement, element], volt per siemens. Allocates a workspace.
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`].
    pub fn jacobian(&self, conductivity_s: &[f64]) -> Result<Array2<f64>, FemError> {
        Ok(self.solve(conductivity_s, &mut self.workspace()?)?.jacobian())
    }

    /// Same as [`ForwardModel::solve`], on a geometry set by [`ForwardModel::deform`].
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve`]; a geometry of another model.
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

    /// Same as [`ForwardModel::solve_to`], on a geometry set by [`ForwardModel::deform`].
    ///
    /// # Errors
    /// Those of [`ForwardModel::solve_to`]; a geometry of another model.
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
