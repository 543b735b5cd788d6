//! Numbers of one forward solve: electrode potentials, voltages, fields, certificate.
//!
//! With the electrodes eliminated last, the trailing block of the factor gives the transfer
//! matrix from electrode currents to electrode potentials, and all voltages are sums over it.
//! Fields inside the skin are solved for when something first asks for them.
//!
//! After the first solve with a workspace, [`ForwardModel::solve`],
//! [`Solution::measurements_into`] and [`Solution::jacobian_into`] allocate nothing of their own.

use crate::forward::ForwardModel;
use crate::geometry::Geometry;
use crate::{FemError, Workspace, jacobian};
use ndarray::{Array1, Array2, ArrayViewMut2};
use std::time::{Duration, Instant};

/// The solved forward problem of one conductivity.
#[derive(Debug)]
pub struct Solution<'a> {
    model: &'a ForwardModel,
    geometry: &'a Geometry,
    workspace: &'a mut Workspace,
    fields_solved: bool,
    backward_error: Option<f64>,
    time: Duration,
}

/// How a forward solve went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveReport {
    /// Node and electrode potentials.
    pub unknowns: usize,
    /// Stored entries of the Cholesky factor.
    pub factor_entries: usize,
    /// Fields solved: the rank of the protocol's patterns.
    pub field_solves: usize,
    /// Largest componentwise backward error `|A x - b|_i / (|A| |x| + |b|)_i` of the fields
    /// (Oettli and Prager 1964): 1e-16 is as exact as the matrix itself.
    pub backward_error: f64,
    /// What rounding in the assembled matrix may have cost the voltages, relative to the largest:
    /// `1000 eps max(a_ii) / min(a_ii)` over the diagonal. An estimate from the spread of
    /// conductances, which the backward error cannot see; above the true error in every reference
    /// case of `tests/reference.rs`, often far above it. Near 1 no digit is certain.
    pub expected_loss: f64,
    /// Time of assembly, factorisation and fields, seconds.
    pub time_s: f64,
}

impl<'a> Solution<'a> {
    /// Assembles and factorises for a conductivity that has been checked.
    pub(crate) fn new(
        model: &'a ForwardModel,
        geometry: &'a Geometry,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
    ) -> Result<Self, FemError> {
        let start = Instant::now();
        workspace.check(model)?;
        model.assembly.fill(geometry, conductivity_s, &mut workspace.factor.values);
        model.solver.factorise(&model.assembly, &mut workspace.factor)?;
        workspace.transfer.fill(0.0);
        workspace.transfer.diagonal_mut().column_vector_mut().fill(1.0);
        model.solver.solve_electrodes(&workspace.factor, workspace.transfer.as_mut());
        workspace.fill_electrode_potentials(&model.patterns);
        workspace.check_potentials()?;
        let time = start.elapsed();
        Ok(Self { model, geometry, workspace, fields_solved: false, backward_error: None, time })
    }

    /// Voltages in protocol order, volt.
    pub fn measurements(&self) -> Array1<f64> {
        (0..self.model.protocol().measurements()).map(|datum| self.voltage(datum)).collect()
    }

    /// [`Solution::measurements`] into memory of the caller; allocates nothing.
    ///
    /// # Errors
    /// [`FemError::WrongLength`] if there is not one value per measurement.
    pub fn measurements_into(&self, voltages_v: &mut [f64]) -> Result<(), FemError> {
        let (found, wanted) = (voltages_v.len(), self.model.protocol().measurements());
        if found != wanted {
            let what = "voltages (one per measurement)";
            return Err(FemError::WrongLength { what, found, wanted });
        }
        voltages_v.iter_mut().enumerate().for_each(|(datum, v)| *v = self.voltage(datum));
        Ok(())
    }

    fn voltage(&self, datum: usize) -> f64 {
        let [stimulation, pattern] = self.model.protocol().data()[datum].map(|i| i as usize);
        let electrodes = self.model.protocol().electrodes();
        let potentials = &self.workspace.electrode_potentials[stimulation * electrodes..];
        let weights = &self.model.patterns.measurements[pattern];
        weights.iter().map(|&(l, weight)| weight * potentials[l as usize]).sum()
    }

    /// Electrode potentials [stimulation, electrode], volt; each row sums to zero.
    pub fn electrode_potentials(&self) -> Array2<f64> {
        let electrodes = self.model.protocol().electrodes();
        let stimulations = self.model.patterns.stimulations_a.len();
        let values = &self.workspace.electrode_potentials;
        Array2::from_shape_fn((stimulations, electrodes), |(s, l)| values[s * electrodes + l])
    }

    /// Potentials inside the skin [stimulation, node], volt, on the scale of
    /// [`Solution::electrode_potentials`].
    pub fn node_potentials(&mut self) -> Array2<f64> {
        self.solve_fields();
        let model = self.model;
        let solves = model.fields.basis.nrows();
        let electrodes = model.protocol().electrodes();
        let stimulations = model.patterns.stimulations_a.len();
        let mut result = Array2::zeros((stimulations, model.unknown_of_node.len()));
        for (s, mut row) in result.rows_mut().into_iter().enumerate() {
            // the ground electrode's potential is the constant between the two scales
            let ground_v = self.workspace.electrode_potentials[(s + 1) * electrodes - 1];
            let (field, factor) = model.fields.stimulations[s];
            let weights = &model.fields.combinations[field as usize];
            for (value, &unknown) in row.iter_mut().zip(&model.unknown_of_node) {
                let at = unknown as usize * solves;
                let u = &self.workspace.potentials[at..at + solves];
                *value = ground_v
                    + factor * weights.iter().map(|&(r, c)| c * u[r as usize]).sum::<f64>();
            }
        }
        result
    }

    /// Jacobian [measurement, element] in volt per siemens: the derivative of each voltage with
    /// respect to the conductivity of each element,
    /// `-area grad u_stimulation . grad u_measurement` with the adjoint field of the measurement
    /// pattern driven by one ampere (Geselowitz 1971; Polydorides and Lionheart 2002).
    pub fn jacobian(&mut self) -> Array2<f64> {
        let shape = (self.model.protocol().measurements(), self.model.elements());
        let mut jacobian = Array2::zeros(shape);
        self.fill_jacobian(jacobian.view_mut());
        jacobian
    }

    /// [`Solution::jacobian`] into memory of the caller.
    ///
    /// # Errors
    /// [`FemError::WrongLength`] if the shape is not [measurement, element].
    pub fn jacobian_into(&mut self, jacobian: ArrayViewMut2<'_, f64>) -> Result<(), FemError> {
        let model = self.model;
        let checks = [
            ("rows of the Jacobian", jacobian.nrows(), model.protocol().measurements()),
            ("columns of the Jacobian", jacobian.ncols(), model.elements()),
        ];
        for (what, found, wanted) in checks {
            if found != wanted {
                return Err(FemError::WrongLength { what, found, wanted });
            }
        }
        self.fill_jacobian(jacobian);
        Ok(())
    }

    fn fill_jacobian(&mut self, jacobian: ArrayViewMut2<'_, f64>) {
        self.solve_fields();
        let Workspace { potentials, block, .. } = &mut *self.workspace;
        jacobian::fill(self.model, self.geometry, potentials, block, jacobian);
    }

    /// How the solve went. The first call solves the fields, if nothing has needed them yet, and
    /// multiplies each by the matrix (2 flops and 12 bytes an entry); later calls copy the result.
    pub fn report(&mut self) -> SolveReport {
        self.solve_fields();
        let backward_error = match self.backward_error {
            Some(known) => known,
            None => *self.backward_error.insert(self.backward_error()),
        };
        SolveReport {
            unknowns: self.model.unknowns(),
            factor_entries: self.model.solver.factor_entries(),
            field_solves: self.model.fields.basis.nrows(),
            backward_error,
            expected_loss: self.expected_loss(),
            time_s: self.time.as_secs_f64(),
        }
    }

    fn solve_fields(&mut self) {
        if self.fields_solved {
            return;
        }
        let start = Instant::now();
        let basis = &self.model.fields.basis;
        let (solves, nodes) = (basis.nrows(), self.model.unknown_of_node.len());
        let Workspace { potentials, factor, .. } = &mut *self.workspace;
        for (k, row) in potentials[nodes * solves..].chunks_exact_mut(solves).enumerate() {
            row.iter_mut().zip(basis.column(k)).for_each(|(x, i)| *x = *i);
        }
        self.model.solver.solve_fields(factor, potentials, solves);
        self.fields_solved = true;
        self.time += start.elapsed();
    }

    fn expected_loss(&self) -> f64 {
        let assembly = &self.model.assembly;
        let values = &self.workspace.factor.values;
        // rows ascend within a column of the lower triangle: its first entry is the diagonal
        let diagonal =
            assembly.column_starts[..self.model.unknowns()].iter().map(|&k| values[k as usize]);
        let (least, most) =
            diagonal.fold((f64::INFINITY, 0.0_f64), |(least, most), d| (least.min(d), most.max(d)));
        1000.0 * f64::EPSILON * most / least
    }

    fn backward_error(&self) -> f64 {
        let basis = &self.model.fields.basis;
        let (solves, nodes) = (basis.nrows(), self.model.unknown_of_node.len());
        let unknowns = self.model.unknowns();
        let mut x = vec![0.0; unknowns];
        let (mut product, mut size) = (x.clone(), x.clone());
        let mut worst = 0.0_f64;
        for r in 0..solves {
            for (x, row) in x.iter_mut().zip(self.workspace.potentials.chunks_exact(solves)) {
                *x = row[r];
            }
            let values = &self.workspace.factor.values;
            self.model.assembly.multiply(values, &x, &mut product, &mut size);
            for i in 0..unknowns {
                let b = if i < nodes { 0.0 } else { basis[[r, i - nodes]] };
                let scale = size[i] + b.abs();
                if scale > 0.0 {
                    worst = worst.max((product[i] - b).abs() / scale);
                }
            }
        }
        worst
    }
}
