//! Memory of one forward solve, and the sums over the transfer matrix that fill part of it.

use crate::forward::ForwardModel;
use crate::scalar::Scalar;
use crate::solver::Factor;
use crate::{FemError, Protocol, jacobian};
use faer::{Mat, MatRef};
use ndarray::ArrayView2;
use std::fmt;

/// Non-zero entries (electrode, value) of a protocol's patterns, row by row.
#[derive(Debug)]
pub(crate) struct Patterns {
    pub stimulations_a: Vec<Vec<(u32, f64)>>,
    pub measurements: Vec<Vec<(u32, f64)>>,
}

impl Patterns {
    /// Of a protocol.
    pub fn new(protocol: &Protocol) -> Self {
        let sparse = |rows: ArrayView2<f64>| {
            rows.rows()
                .into_iter()
                .map(|row| (0u32..).zip(row.iter().copied()).filter(|e| e.1 != 0.0).collect())
                .collect()
        };
        Self {
            stimulations_a: sparse(protocol.stimulations_a()),
            measurements: sparse(protocol.measurement_patterns()),
        }
    }

    /// Electrode potentials [stimulation, electrode] from the potentials for unit currents
    /// [electrode but ground, electrode but ground]; rows sum to zero.
    pub fn electrode_potentials<T: Scalar>(&self, transfer: MatRef<'_, T>, potentials: &mut [T]) {
        let ground = transfer.nrows();
        let rows = potentials.chunks_exact_mut(ground + 1);
        for (row, currents) in rows.zip(&self.stimulations_a) {
            row.fill(T::from(0.0));
            for &(k, current_a) in currents.iter().filter(|c| (c.0 as usize) < ground) {
                for (l, potential) in row[..ground].iter_mut().enumerate() {
                    *potential += transfer[(l, k as usize)] * current_a;
                }
            }
            let mut sum = T::from(0.0);
            row.iter().for_each(|potential| sum += *potential);
            let mean = sum / row.len() as f64;
            row.iter_mut().for_each(|potential| *potential -= mean);
        }
    }
}

/// Memory of one solve; make one per thread and reuse it.
///
/// It holds nothing of a model but sizes, so models of equal sizes may share one.
pub struct Workspace {
    pub(crate) factor: Factor,
    /// Electrode potentials for unit currents [electrode but ground, electrode but ground].
    pub(crate) transfer: Mat<f64>,
    /// Electrode potentials [stimulation, electrode], row-major.
    pub(crate) electrode_potentials: Vec<f64>,
    /// Potentials [unknown, basis pattern], row-major.
    pub(crate) potentials: Vec<f64>,
    pub(crate) block: jacobian::Block,
    /// Conductivity of each element of the latest solve, siemens.
    pub(crate) conductivity_s: Vec<f64>,
}

impl fmt::Debug for Workspace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (matrix_entries, factor_entries, scratch_entries) = self.factor.sizes();
        f.debug_struct("Workspace")
            .field("matrix_entries", &matrix_entries)
            .field("factor_entries", &factor_entries)
            .field("scratch_entries", &scratch_entries)
            .finish_non_exhaustive()
    }
}

impl Workspace {
    /// For a model.
    pub(crate) fn new(model: &ForwardModel) -> Result<Self, FemError> {
        let electrodes = model.protocol().electrodes();
        let stimulations = model.patterns.stimulations_a.len();
        Ok(Self {
            factor: model.solver.factor(&model.assembly)?,
            transfer: Mat::zeros(electrodes - 1, electrodes - 1),
            electrode_potentials: vec![0.0; stimulations * electrodes],
            potentials: vec![0.0; model.unknowns() * model.fields.basis.nrows()],
            block: jacobian::Block::new(model),
            conductivity_s: vec![0.0; model.elements()],
        })
    }

    /// Every size that a solve of `model` relies on.
    pub(crate) fn check(&self, model: &ForwardModel) -> Result<(), FemError> {
        let electrodes = model.protocol().electrodes();
        let (values, factor, scratch) = self.factor.sizes();
        let stimulations = model.patterns.stimulations_a.len();
        let checks = [
            ("workspace of another model: its matrix", values, model.assembly.entry_count()),
            ("workspace of another model: its factor", factor, model.solver.factor_entries()),
            ("workspace of another model: its scratch", scratch, model.solver.scratch_entries()),
            ("workspace of another model: its electrodes", self.transfer.nrows() + 1, electrodes),
            (
                "workspace of another model: its electrode potentials",
                self.electrode_potentials.len(),
                stimulations * electrodes,
            ),
            (
                "workspace of another model: its fields",
                self.potentials.len(),
                model.unknowns() * model.fields.basis.nrows(),
            ),
            (
                "workspace of another model: its elements",
                self.conductivity_s.len(),
                model.elements(),
            ),
            (
                "workspace of another model: its gradients",
                self.block.size(),
                jacobian::Block::size_for(model),
            ),
        ];
        match checks.into_iter().find(|(_, found, wanted)| found != wanted) {
            None => Ok(()),
            Some((what, found, wanted)) => Err(FemError::WrongLength { what, found, wanted }),
        }
    }

    /// That no electrode potential overflowed.
    pub(crate) fn check_potentials(&self) -> Result<(), FemError> {
        let electrodes = self.transfer.nrows() + 1;
        match self.electrode_potentials.iter().position(|v| !v.is_finite()) {
            None => Ok(()),
            Some(at) => Err(FemError::NonFinitePotential {
                stimulation: at / electrodes,
                electrode: at % electrodes + 1,
                value_v: self.electrode_potentials[at],
            }),
        }
    }

    /// Electrode potentials of every stimulation from the transfer matrix; rows sum to zero.
    pub(crate) fn fill_electrode_potentials(&mut self, patterns: &Patterns) {
        patterns.electrode_potentials(self.transfer.as_ref(), &mut self.electrode_potentials);
    }
}
