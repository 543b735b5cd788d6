//! Solved fields and the state they belong to: what every derivative is summed from.

use crate::model::{ForwardModel, Geometry};

/// Solved fields and the state they belong to.
pub(crate) struct SolvedFields<'a> {
    pub model: &'a ForwardModel,
    pub geometry: &'a Geometry,
    pub potentials: Potentials<'a>,
    pub conductivity_s: &'a [f64],
}

/// Potentials [unknown, solve], and what extended precision has beyond their last digit.
#[derive(Clone, Copy)]
pub(crate) struct Potentials<'a> {
    pub values: &'a [f64],
    pub low: Option<&'a [f64]>,
}
