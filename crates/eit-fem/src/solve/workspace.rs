//! Working memory of a forward solve.

use crate::derivatives::conductivity::Block;
use crate::error::FemError;
use crate::model::ForwardModel;
use crate::solve::nodal::Nodal;
use std::fmt;

/// Working memory of a forward solve. Create one per thread and reuse it.
///
/// It depends only on the sizes of a model, so models of equal sizes may share one.
#[derive(Clone)]
pub struct Workspace {
    pub(crate) nodal: Nodal<f64>,
    pub(crate) block: Block,
    /// Conductivity of each element in the latest solve, siemens.
    pub(crate) conductivity_s: Vec<f64>,
}

impl fmt::Debug for Workspace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (factor_entries, scratch_entries) = self.nodal.factor.sizes();
        f.debug_struct("Workspace")
            .field("matrix_entries", &self.nodal.matrix.len())
            .field("factor_entries", &factor_entries)
            .field("scratch_entries", &scratch_entries)
            .finish_non_exhaustive()
    }
}

impl Workspace {
    /// Allocates the memory for a model.
    pub(crate) fn new(model: &ForwardModel) -> Result<Self, FemError> {
        Ok(Self {
            nodal: Nodal::new(model)?,
            block: Block::new(model),
            conductivity_s: vec![0.0; model.elements()],
        })
    }

    /// Checks every size that a solve of `model` relies on.
    pub(crate) fn check(&self, model: &ForwardModel) -> Result<(), FemError> {
        self.nodal.check(model, self.conductivity_s.len(), self.block.sizes(model))
    }
}
