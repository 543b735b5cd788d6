//! Results of one solve with complex admittivity: voltages, fields, Jacobian and report.
//!
//! As in the real model, voltages come from the trailing block of the factor, and fields are solved
//! on first use. After the first solve with a workspace, [`AdmittivityModel::solve`],
//! [`AdmittivitySolution::measurements_into`] and [`AdmittivitySolution::jacobian_into`] do not
//! allocate.

use super::jacobian;
use super::model::AdmittivityModel;
use super::phases::Phases;
use super::workspace::AdmittivityWorkspace;
use crate::error::FemError;
use crate::sparse::SparseError;
use ndarray::{Array1, Array2, ArrayViewMut2};
use num_complex::Complex64;
use std::time::{Duration, Instant};

/// Solution of the forward problem for one admittivity.
#[derive(Debug)]
pub struct AdmittivitySolution<'a> {
    model: &'a AdmittivityModel,
    workspace: &'a mut AdmittivityWorkspace,
    phases: Phases,
    fields_solved: bool,
    /// Backward error and growth, once computed.
    quality: Option<(f64, f64)>,
    time: Duration,
}

/// Size, accuracy and time of a solve with complex admittivity.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct AdmittivityReport {
    /// Number of unknowns: node and electrode potentials.
    pub unknowns: usize,
    /// Number of stored entries of the factor, 16 bytes each.
    pub factor_entries: usize,
    /// Number of fields solved: the rank of the protocol's patterns.
    pub field_solves: usize,
    /// Range of the phases of admittivities and contact admittances, degrees. It is 0 if everything
    /// is resistive and at most 90 without inductors. Near 180 (resonance) the growth is unbounded.
    pub phase_span_deg: f64,
    /// Largest factor by which elimination without pivoting may amplify rounding: the largest `(|L|
    /// |L^T|)_ii / |a_ii|`. It is 1 if everything is resistive and below 3 without inductors.
    pub growth: f64,
    /// Largest componentwise backward error `|A x - b|_i / (|A| |x| + |b|)_i` of the fields
    /// (Oettli and Prager 1964). At 1e-16, the solve is as accurate as the matrix entries.
    pub backward_error: f64,
    /// Estimated rounding error of the voltages, relative to the largest: `1000 eps growth max
    /// |a_ii| / min |a_ii|` over the diagonal. Compare
    /// [`SolveReport::expected_loss`](crate::SolveReport::expected_loss).
    pub expected_loss: f64,
    /// Time of assembly, factorisation and fields, seconds.
    pub time_s: f64,
}

impl<'a> AdmittivitySolution<'a> {
    /// Assembles and factorises for a validated admittivity.
    pub(super) fn new(
        model: &'a AdmittivityModel,
        admittivity_s: &[Complex64],
        phases: Phases,
        workspace: &'a mut AdmittivityWorkspace,
    ) -> Result<Self, FemError> {
        let start = Instant::now();
        workspace.check(model)?;
        let direction = phases.direction()?;
        workspace.assemble(model, admittivity_s);
        workspace.nodal.solve_electrodes(&model.real, direction).map_err(|error| match error {
            SparseError::BadPivot { unknown, unknowns } => {
                FemError::PivotOutOfPhase { unknown, unknowns }
            }
            other => other.into(),
        })?;
        workspace.nodal.check_potentials(Complex64::norm)?;
        let time = start.elapsed();
        Ok(Self { model, workspace, phases, fields_solved: false, quality: None, time })
    }

    /// Returns the voltages in protocol order, volt.
    pub fn measurements(&self) -> Array1<Complex64> {
        (0..self.model.protocol().measurements()).map(|datum| self.voltage(datum)).collect()
    }

    /// Writes [`AdmittivitySolution::measurements`] into the caller's memory. Does not allocate.
    ///
    /// # Errors
    /// [`FemError::WrongLength`] if there is not one value per measurement.
    pub fn measurements_into(&self, voltages_v: &mut [Complex64]) -> Result<(), FemError> {
        let wanted = self.model.protocol().measurements();
        FemError::check_length("voltages (one per measurement)", voltages_v.len(), wanted)?;
        voltages_v.iter_mut().enumerate().for_each(|(datum, v)| *v = self.voltage(datum));
        Ok(())
    }

    fn voltage(&self, datum: usize) -> Complex64 {
        self.workspace.nodal.voltage(&self.model.real, datum)
    }

    /// Returns the electrode potentials, [stimulation, electrode], volt. Each row sums to zero.
    pub fn electrode_potentials(&self) -> Array2<Complex64> {
        self.workspace.nodal.electrode_potentials(&self.model.real)
    }

    /// Returns the potentials at the nodes of the skin, [stimulation, node], volt, with the same
    /// reference as [`AdmittivitySolution::electrode_potentials`].
    pub fn node_potentials(&mut self) -> Array2<Complex64> {
        self.solve_fields();
        self.workspace.nodal.node_potentials(&self.model.real, None)
    }

    /// Returns the Jacobian, [measurement, element], in volt per siemens: the holomorphic
    /// derivative of each voltage with respect to the admittivity of each element. To first order,
    /// a change `d` of the complex admittivity changes the voltages by `J d`.
    pub fn jacobian(&mut self) -> Array2<Complex64> {
        let shape = (self.model.protocol().measurements(), self.model.elements());
        let mut jacobian = Array2::zeros(shape);
        self.fill_jacobian(jacobian.view_mut());
        jacobian
    }

    /// Writes [`AdmittivitySolution::jacobian`] into the caller's memory.
    ///
    /// # Errors
    /// [`FemError::WrongLength`] if the shape is not [measurement, element].
    pub fn jacobian_into(
        &mut self,
        jacobian: ArrayViewMut2<'_, Complex64>,
    ) -> Result<(), FemError> {
        let (rows, columns) = (self.model.protocol().measurements(), self.model.elements());
        FemError::check_length("rows of the Jacobian", jacobian.nrows(), rows)?;
        FemError::check_length("columns of the Jacobian", jacobian.ncols(), columns)?;
        self.fill_jacobian(jacobian);
        Ok(())
    }

    fn fill_jacobian(&mut self, jacobian: ArrayViewMut2<'_, Complex64>) {
        self.solve_fields();
        let AdmittivityWorkspace { nodal, block, .. } = &mut *self.workspace;
        jacobian::fill(&self.model.real, &nodal.potentials, block, jacobian);
    }

    /// Returns size, accuracy and time of the solve. The first call solves the fields if needed,
    /// multiplies each by the matrix and reads the factor once; later calls reuse the result.
    pub fn report(&mut self) -> AdmittivityReport {
        self.solve_fields();
        let (real, nodal) = (&self.model.real, &self.workspace.nodal);
        let (backward_error, growth) = match self.quality {
            Some(known) => known,
            None => {
                let growth = real.cholesky.growth(&nodal.matrix, &nodal.factor);
                *self.quality.insert((nodal.backward_error(real), growth))
            }
        };
        AdmittivityReport {
            unknowns: real.unknowns(),
            factor_entries: real.cholesky.factor_entries(),
            field_solves: real.fields.basis.nrows(),
            phase_span_deg: self.phases.span().to_degrees(),
            growth,
            backward_error,
            expected_loss: 1000.0 * f64::EPSILON * growth * nodal.spread(real),
            time_s: self.time.as_secs_f64(),
        }
    }

    fn solve_fields(&mut self) {
        if self.fields_solved {
            return;
        }
        let start = Instant::now();
        self.workspace.nodal.solve_fields(&self.model.real);
        self.fields_solved = true;
        self.time += start.elapsed();
    }
}
