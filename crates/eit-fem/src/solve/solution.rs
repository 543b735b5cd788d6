//! Results of one forward solve: electrode potentials, voltages, fields and report.
//!
//! Electrodes come last in the elimination order, so the trailing block of the factor gives the
//! transfer matrix from electrode currents to electrode potentials. All voltages are sums over it.
//! Fields inside the skin are solved on first use.
//!
//! After the first solve with a workspace, [`ForwardModel::solve`], [`Solution::measurements_into`]
//! and [`Solution::jacobian_into`] do not allocate.
//!
//! Derivatives are in [`super::jacobians`].

use super::electrode_elimination::{self, Outcome};
use super::nodal_assembly::{loss, nodal_assembly_suffices, spread};
use super::report::{SolvePath, SolveReport};
use super::workspace::Workspace;
use crate::derivatives::conductivity::Block;
use crate::derivatives::solved_fields::{Potentials, SolvedFields};
use crate::error::FemError;
use crate::model::{ForwardModel, Geometry};
use ndarray::{Array1, Array2};
use std::time::{Duration, Instant};

/// Accuracy for models with shunts or ideal current sources if none is requested.
const LIMIT_ACCURACY: f64 = 1e-9;

/// Solution of the forward problem for one conductivity.
///
/// ```
/// use eit_fem::{ForwardModel, PairProtocol};
/// use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
///
/// # let skin = SkinShape::Disc { radius_m: 0.1 };
/// # let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
/// # let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.02))?;
/// # let model = ForwardModel::new(&mesh, &PairProtocol::default().protocol()?, &[1e3; 16])?;
/// let mut workspace = model.workspace()?;
/// let mut solution = model.solve(&vec![1e-5; model.elements()], &mut workspace)?;
/// assert_eq!(solution.measurements().len(), 208);
/// assert!(solution.report().backward_error < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Solution<'a> {
    pub(super) model: &'a ForwardModel,
    geometry: &'a Geometry,
    workspace: &'a mut Workspace,
    fields_solved: bool,
    backward_error: Option<f64>,
    /// Result of electrode elimination, if that path was taken.
    eliminated: Option<Outcome>,
    time: Duration,
}

impl<'a> Solution<'a> {
    /// Assembles and factorises for a validated conductivity.
    pub(crate) fn new(
        model: &'a ForwardModel,
        geometry: &'a Geometry,
        conductivity_s: &[f64],
        workspace: &'a mut Workspace,
        required_accuracy: Option<f64>,
    ) -> Result<Self, FemError> {
        let start = Instant::now();
        workspace.check(model)?;
        workspace.conductivity_s.copy_from_slice(conductivity_s);
        let suffices =
            nodal_assembly_suffices(model, geometry, conductivity_s, workspace, required_accuracy)?;
        let eliminated = if suffices {
            None
        } else {
            let required = required_accuracy.unwrap_or(LIMIT_ACCURACY);
            Some(electrode_elimination::solve(
                model,
                geometry,
                conductivity_s,
                workspace,
                required,
            )?)
        };
        let (fields_solved, backward_error) =
            (eliminated.is_some(), eliminated.as_ref().map(|a| a.backward_error));
        let time = start.elapsed();
        let solution =
            Self { model, geometry, workspace, fields_solved, backward_error, eliminated, time };
        if let (Some(required), Some(_)) = (required_accuracy, &solution.eliminated) {
            let reached = solution.error_bounds().0;
            if reached > required || reached.is_nan() {
                return Err(FemError::AccuracyNotReached { reached, required });
            }
        }
        Ok(solution)
    }

    /// Bounds of the largest error relative to the largest voltage, and of the largest relative
    /// error of any voltage.
    fn error_bounds(&self) -> (f64, f64) {
        let count = self.model.protocol().measurements();
        let sizes = (0..count).map(|datum| self.voltage(datum).abs());
        let (least, most) = sizes.fold((f64::INFINITY, 0.0_f64), |(l, m), v| (l.min(v), m.max(v)));
        match &self.eliminated {
            None => {
                let loss = self.expected_loss();
                (loss, loss * most / least)
            }
            Some(a) => {
                let largest = a.bounds_v.iter().fold(0.0_f64, |m, b| m.max(*b));
                let ratios = a.bounds_v.iter().zip(&a.voltages_v).map(|(b, v)| b / v.abs());
                (largest / most, ratios.fold(0.0, f64::max))
            }
        }
    }

    /// Returns an error bound for each voltage, volt, in protocol order. With electrodes eliminated
    /// it follows from residuals and rounding. With nodal assembly it is the estimate
    /// [`SolveReport::expected_loss`] times the largest voltage.
    pub fn measurement_bounds(&self) -> Array1<f64> {
        let voltages = self.measurements();
        match &self.eliminated {
            Some(a) => Array1::from(a.bounds_v.clone()),
            None => {
                let largest = voltages.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                Array1::from_elem(voltages.len(), self.expected_loss() * largest)
            }
        }
    }

    /// Returns the voltages in protocol order, volt.
    pub fn measurements(&self) -> Array1<f64> {
        (0..self.model.protocol().measurements()).map(|datum| self.voltage(datum)).collect()
    }

    /// Writes [`Solution::measurements`] into the caller's memory. Does not allocate.
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
        if let Some(outcome) = &self.eliminated {
            return outcome.voltages_v[datum];
        }
        let [stimulation, pattern] = self.model.protocol().data()[datum].map(|i| i as usize);
        let electrodes = self.model.protocol().electrodes();
        let potentials = &self.workspace.electrode_potentials[stimulation * electrodes..];
        let weights = &self.model.patterns.measurements[pattern];
        weights.iter().map(|&(l, weight)| weight * potentials[l as usize]).sum()
    }

    /// Returns the electrode potentials, [stimulation, electrode], volt. Each row sums to zero.
    pub fn electrode_potentials(&self) -> Array2<f64> {
        let electrodes = self.model.protocol().electrodes();
        let stimulations = self.model.patterns.stimulations_a.len();
        let values = &self.workspace.electrode_potentials;
        Array2::from_shape_fn((stimulations, electrodes), |(s, l)| values[s * electrodes + l])
    }

    /// Returns the potentials at the mesh nodes (not at the midside nodes of quadratic elements),
    /// [stimulation, node], volt, with the same reference as [`Solution::electrode_potentials`].
    pub fn node_potentials(&mut self) -> Array2<f64> {
        self.solve_fields();
        let model = self.model;
        let solves = model.fields.basis.nrows();
        let electrodes = model.protocol().electrodes();
        let stimulations = model.patterns.stimulations_a.len();
        let mut result = Array2::zeros((stimulations, model.dofs.midside_nodes.mesh_nodes()));
        for (s, mut row) in result.rows_mut().into_iter().enumerate() {
            // difference between the two references: the potential of the ground electrode or, with
            // electrodes eliminated, the mean potential of the skin under it
            let ground_v = match &self.eliminated {
                None => self.workspace.electrode_potentials[(s + 1) * electrodes - 1],
                Some(outcome) => outcome.levels_v[s],
            };
            let (field, factor) = model.fields.stimulations[s];
            let weights = &model.fields.combinations[field as usize];
            for (value, &unknown) in row.iter_mut().zip(&model.dofs.unknown_of_node) {
                let at = unknown as usize * solves;
                let u = &self.workspace.potentials[at..at + solves];
                *value = ground_v
                    + factor * weights.iter().map(|&(r, c)| c * u[r as usize]).sum::<f64>();
            }
        }
        result
    }

    /// Returns the fields and state that derivatives are computed from, and working memory for
    /// blocks of elements. Solves the fields on first use.
    pub(super) fn solved_fields(&mut self) -> (SolvedFields<'_>, &mut Block) {
        self.solve_fields();
        let low = self.eliminated.as_ref().and_then(Outcome::low);
        let Workspace { potentials, conductivity_s, block, .. } = &mut *self.workspace;
        let solved = SolvedFields {
            model: self.model,
            geometry: self.geometry,
            potentials: Potentials { values: potentials, low },
            conductivity_s,
        };
        (solved, block)
    }

    /// Returns path, size, accuracy and time of the solve. The first call solves the fields if
    /// needed and multiplies each by the matrix (2 flops and 12 bytes per entry); later calls reuse
    /// the result.
    pub fn report(&mut self) -> SolveReport {
        self.solve_fields();
        let backward_error = match self.backward_error {
            Some(known) => known,
            None => *self.backward_error.insert(self.backward_error()),
        };
        let (error_bound, value_error_bound) = self.error_bounds();
        let (path, factor_entries, condition) = match &self.eliminated {
            None => {
                let entries = self.model.cholesky.factor_entries();
                (SolvePath::NodalAssembly, entries, spread(self.model, self.workspace))
            }
            Some(a) => {
                let path = if a.extended {
                    SolvePath::ExtendedPrecision
                } else {
                    SolvePath::ElectrodesEliminated
                };
                (path, a.factor_entries, a.condition)
            }
        };
        SolveReport {
            path,
            unknowns: self.model.unknowns(),
            factor_entries,
            field_solves: self.model.fields.basis.nrows(),
            backward_error,
            expected_loss: self.expected_loss(),
            error_bound,
            value_error_bound,
            condition,
            time_s: self.time.as_secs_f64(),
        }
    }

    fn solve_fields(&mut self) {
        if self.fields_solved {
            return;
        }
        let start = Instant::now();
        let basis = &self.model.fields.basis;
        let (solves, nodes) = (basis.nrows(), self.model.dofs.nodes());
        let Workspace { potentials, factor, .. } = &mut *self.workspace;
        for (k, row) in potentials[nodes * solves..].chunks_exact_mut(solves).enumerate() {
            row.iter_mut().zip(basis.column(k)).for_each(|(x, i)| *x = *i);
        }
        self.model.cholesky.solve_checked(factor, potentials, solves);
        self.fields_solved = true;
        self.time += start.elapsed();
    }

    fn expected_loss(&self) -> f64 {
        match &self.eliminated {
            None => loss(self.model, self.workspace),
            Some(_) => self.error_bounds().0,
        }
    }

    fn backward_error(&self) -> f64 {
        let basis = &self.model.fields.basis;
        let (solves, nodes) = (basis.nrows(), self.model.dofs.nodes());
        let unknowns = self.model.unknowns();
        let mut x = vec![0.0; unknowns];
        let (mut product, mut size) = (x.clone(), x.clone());
        let mut worst = 0.0_f64;
        for r in 0..solves {
            for (x, row) in x.iter_mut().zip(self.workspace.potentials.chunks_exact(solves)) {
                *x = row[r];
            }
            let values = &self.workspace.matrix;
            self.model.assembly.pattern.multiply(values, &x, &mut product, &mut size);
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
