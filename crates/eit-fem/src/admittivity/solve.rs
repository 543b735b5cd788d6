//! Solves of an [`AdmittivityModel`].

use super::model::AdmittivityModel;
use super::phases::Phases;
use super::solution::AdmittivitySolution;
use super::workspace::AdmittivityWorkspace;
use crate::error::FemError;
use ndarray::{Array1, Array2};
use num_complex::Complex64;

impl AdmittivityModel {
    /// Allocates memory for solves of this model.
    ///
    /// # Errors
    /// [`FemError::OutOfMemory`].
    pub fn workspace(&self) -> Result<AdmittivityWorkspace, FemError> {
        AdmittivityWorkspace::new(self)
    }

    /// Assembles and factorises for one admittivity per element, siemens.
    ///
    /// Elements may conduct, store charge, or both. Real parts must be zero or above, and an
    /// element's two parts must not both be zero. A purely capacitive skin is as well posed as a
    /// purely conductive one.
    ///
    /// # Errors
    /// A wrong number of values; a value that is zero, is not finite or has a negative real part;
    /// inductive and capacitive elements or contacts that may cancel; values that span too many
    /// decades; a workspace of another model; potentials that overflow.
    pub fn solve<'a>(
        &'a self,
        admittivity_s: &[Complex64],
        workspace: &'a mut AdmittivityWorkspace,
    ) -> Result<AdmittivitySolution<'a>, FemError> {
        self.check_admittivity(admittivity_s)?;
        let phases = self.phases.with(Phases::of(admittivity_s));
        AdmittivitySolution::new(self, admittivity_s, phases, workspace)
    }

    /// Returns the voltages in protocol order for one admittivity per element. Allocates a
    /// workspace.
    ///
    /// # Errors
    /// Those of [`AdmittivityModel::solve`].
    pub fn forward(&self, admittivity_s: &[Complex64]) -> Result<Array1<Complex64>, FemError> {
        Ok(self.solve(admittivity_s, &mut self.workspace()?)?.measurements())
    }

    /// Returns the Jacobian, [measurement, element], volt per siemens. Allocates a workspace.
    ///
    /// # Errors
    /// Those of [`AdmittivityModel::solve`].
    pub fn jacobian(&self, admittivity_s: &[Complex64]) -> Result<Array2<Complex64>, FemError> {
        Ok(self.solve(admittivity_s, &mut self.workspace()?)?.jacobian())
    }
}
