//! Solved fields and their model state, from which every derivative is computed.

use crate::model::{ForwardModel, Geometry};

/// Solved fields with the model, geometry and conductivity they belong to.
pub(crate) struct SolvedFields<'a> {
    pub model: &'a ForwardModel,
    pub geometry: &'a Geometry,
    pub potentials: Potentials<'a>,
    pub conductivity_s: &'a [f64],
}

/// Potentials, [unknown, solve]. `low` holds the low-order parts if they were solved in extended
/// precision.
#[derive(Clone, Copy)]
pub(crate) struct Potentials<'a> {
    pub values: &'a [f64],
    pub low: Option<&'a [f64]>,
}
