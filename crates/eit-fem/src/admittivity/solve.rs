//! What an [`AdmittivityModel`] is asked for.

use super::model::AdmittivityModel;
use super::phases::Phases;
use super::solution::AdmittivitySolution;
use super::workspace::AdmittivityWorkspace;
use crate::error::FemError;
use ndarray::{Array1, Array2};
use num_complex::Complex64;

impl AdmittivityModel {
    /// Memory for solves of this model.
    ///
    /// # Errors
    /// [`FemError::OutOfMemory`].
    pub fn workspace(&self) -> Result<AdmittivityWorkspace, FemError> {
        AdmittivityWorkspace::new(self)
    }

    /// Assembles and factorises for one admittivity per element, siemens.
    ///
    /// Elements may conduct, store charge, or both: real parts are zero or above, and neither part
    /// has to be there in every element. With capacitors alone (no conductance at all) the skin is
    /// as well posed as with conductors alone.
    ///
    /// # Errors
    /// A wrong number of values; a value that is zero, not finite or negative in its real part;
    /// inductive beside capacitive elements or contacts that cancel; a workspace of another model;
    /// potentials that overflow.
    pub fn solve<'a>(
        &'a self,
        admittivity_s: &[Complex64],
        workspace: &'a mut AdmittivityWorkspace,
    ) -> Result<AdmittivitySolution<'a>, FemError> {
        self.check_admittivity(admittivity_s)?;
        let phases = self.phases.with(Phases::of(admittivity_s));
        AdmittivitySolution::new(self, admittivity_s, phases, workspace)
    }

    /// Voltages of every measurement for one admittivity per element; allocates a workspace.
    ///
    /// # Errors
    /// Those of [`AdmittivityModel::solve`].
    pub fn forward(&self, admittivity_s: &[Complex64]) -> Result<Array1<Complex64>, FemError> {
        Ok(self.solve(admittivity_s, &mut self.workspace()?)?.measurements())
    }

    /// Jacobian [measurement, element], volt per siemens; allocates a workspace.
    ///
    /// # Errors
    /// Those of [`AdmittivityModel::solve`].
    pub fn jacobian(&self, admittivity_s: &[Complex64]) -> Result<Array2<Complex64>, FemError> {
        Ok(self.solve(admittivity_s, &mut self.workspace()?)?.jacobian())
    }
}
