//! Working memory of a forward solve.

use crate::derivatives::conductivity::Block;
use crate::error::FemError;
use crate::model::ForwardModel;
use crate::protocol::PatternEntries;
use crate::sparse::Factor;
use faer::Mat;
use std::fmt;

/// Working memory of a forward solve. Create one per thread and reuse it.
///
/// It depends only on the sizes of a model, so models of equal sizes may share one.
#[derive(Clone)]
pub struct Workspace {
    /// Values of the system matrix.
    pub(crate) matrix: Vec<f64>,
    pub(crate) factor: Factor,
    /// Electrode potentials for unit currents, [electrode except ground, electrode except ground].
    pub(crate) transfer: Mat<f64>,
    /// Electrode potentials, [stimulation, electrode], row-major.
    pub(crate) electrode_potentials: Vec<f64>,
    /// Potentials, [unknown, basis pattern], row-major.
    pub(crate) potentials: Vec<f64>,
    pub(crate) block: Block,
    /// Conductivity of each element in the latest solve, siemens.
    pub(crate) conductivity_s: Vec<f64>,
}

impl fmt::Debug for Workspace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (factor_entries, scratch_entries) = self.factor.sizes();
        f.debug_struct("Workspace")
            .field("matrix_entries", &self.matrix.len())
            .field("factor_entries", &factor_entries)
            .field("scratch_entries", &scratch_entries)
            .finish_non_exhaustive()
    }
}

impl Workspace {
    /// Allocates the memory for a model.
    pub(crate) fn new(model: &ForwardModel) -> Result<Self, FemError> {
        let electrodes = model.protocol().electrodes();
        let stimulations = model.patterns.stimulations_a.len();
        Ok(Self {
            matrix: vec![0.0; model.assembly.pattern.entries()],
            factor: model.cholesky.memory()?,
            transfer: Mat::zeros(electrodes - 1, electrodes - 1),
            electrode_potentials: vec![0.0; stimulations * electrodes],
            potentials: vec![0.0; model.unknowns() * model.fields.basis.nrows()],
            block: Block::new(model),
            conductivity_s: vec![0.0; model.elements()],
        })
    }

    /// Checks every size that a solve of `model` relies on.
    pub(crate) fn check(&self, model: &ForwardModel) -> Result<(), FemError> {
        let electrodes = model.protocol().electrodes();
        let (factor, scratch) = self.factor.sizes();
        let (matrix, entries) = (self.matrix.len(), model.assembly.pattern.entries());
        let stimulations = model.patterns.stimulations_a.len();
        let checks = [
            ("workspace of another model: its matrix", matrix, entries),
            ("workspace of another model: its factor", factor, model.cholesky.factor_entries()),
            ("workspace of another model: its scratch", scratch, model.cholesky.scratch_entries()),
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
                Block::size_for(model),
            ),
        ];
        match checks.into_iter().find(|(_, found, wanted)| found != wanted) {
            None => Ok(()),
            Some((what, found, wanted)) => Err(FemError::WrongLength { what, found, wanted }),
        }
    }

    /// Checks that no electrode potential overflowed.
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

    /// Computes the electrode potentials of every stimulation from the transfer matrix. Rows sum to
    /// zero.
    pub(crate) fn fill_electrode_potentials(&mut self, patterns: &PatternEntries) {
        patterns.electrode_potentials(self.transfer.as_ref(), &mut self.electrode_potentials);
    }
}
