//! Results of one forward solve: electrode potentials, voltages, fields and report.
//!
//! Fields inside the skin are solved on first use.
//!
//! After the first solve with a workspace, [`ForwardModel::solve`], [`Solution::measurements_into`]
//! and [`Solution::jacobian_into`] do not allocate.
//!
//! Derivatives are in [`super::jacobians`].

use super::electrode_elimination::{self, Outcome};
use super::nodal_assembly::{loss, nodal_assembly_suffices};
use super::report::{SolvePath, SolveReport};
use super::workspace::Workspace;
use crate::derivatives::conductivity::Block;
use crate::derivatives::solved_fields::{Potentials, SolvedFields};
use crate::error::FemError;
use crate::model::{ForwardModel, Geometry};
use ndarray::{Array1, Array2};
use std::time::{Duration, Instant};

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
            // a model with shunts or ideal current sources needs some accuracy
            let required = required_accuracy.unwrap_or(1e-9);
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
        let wanted = self.model.protocol().measurements();
        FemError::check_length("voltages (one per measurement)", voltages_v.len(), wanted)?;
        voltages_v.iter_mut().enumerate().for_each(|(datum, v)| *v = self.voltage(datum));
        Ok(())
    }

    fn voltage(&self, datum: usize) -> f64 {
        match &self.eliminated {
            Some(outcome) => outcome.voltages_v[datum],
            None => self.workspace.nodal.voltage(self.model, datum),
        }
    }

    /// Returns the electrode potentials, [stimulation, electrode], volt. Each row sums to zero.
    pub fn electrode_potentials(&self) -> Array2<f64> {
        self.workspace.nodal.electrode_potentials(self.model)
    }

    /// Returns the potentials at the mesh nodes (not at the midside nodes of quadratic elements),
    /// [stimulation, node], volt, with the same reference as [`Solution::electrode_potentials`].
    pub fn node_potentials(&mut self) -> Array2<f64> {
        self.solve_fields();
        // with electrodes eliminated, fields are relative to the mean potential of the skin under
        // the ground electrode
        let levels = self.eliminated.as_ref().map(|outcome| outcome.levels_v.as_slice());
        self.workspace.nodal.node_potentials(self.model, levels)
    }

    /// Returns the fields and state that derivatives are computed from, and working memory for
    /// blocks of elements. Solves the fields on first use.
    pub(super) fn solved_fields(&mut self) -> (SolvedFields<'_>, &mut Block) {
        self.solve_fields();
        let low = self.eliminated.as_ref().and_then(Outcome::low);
        let Workspace { nodal, conductivity_s, block } = &mut *self.workspace;
        let solved = SolvedFields {
            model: self.model,
            geometry: self.geometry,
            potentials: Potentials { values: &nodal.potentials, low },
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
            None => *self.backward_error.insert(self.workspace.nodal.backward_error(self.model)),
        };
        let (error_bound, value_error_bound) = self.error_bounds();
        let (path, factor_entries, condition) = match &self.eliminated {
            None => {
                let entries = self.model.cholesky.factor_entries();
                (SolvePath::NodalAssembly, entries, self.workspace.nodal.spread(self.model))
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
        self.workspace.nodal.solve_fields(self.model);
        self.fields_solved = true;
        self.time += start.elapsed();
    }

    fn expected_loss(&self) -> f64 {
        match &self.eliminated {
            None => loss(self.model, self.workspace),
            Some(_) => self.error_bounds().0,
        }
    }
}
