//! Data of the sliding window of a stream.

use super::StTv;
use super::data::{Seen, Target};
use super::problem::{DataTerm, Problem};
use crate::SequenceStatus;

/// Result of the iteration of a push, in internal units.
#[derive(Clone)]
pub(super) struct Outcome {
    pub(super) status: SequenceStatus,
    pub(super) iterations: usize,
    pub(super) primal: f64,
    pub(super) lower_bound: f64,
}

impl Outcome {
    pub(super) fn gap(&self) -> f64 {
        match self.primal - self.lower_bound {
            gap if gap <= 0.0 => 0.0,
            gap => gap / self.primal.abs(),
        }
    }
}

/// Data and weights of the window in internal units.
#[derive(Debug, Clone)]
pub(super) struct Window {
    /// `[frame]`.
    pub(super) modes: Vec<Seen>,
    pub(super) mode_of: Vec<usize>,
    pub(super) targets: Vec<Target>,
    /// Empty for penalised data.
    pub(super) delta: Vec<f64>,
    pub(super) weights: [f64; 2],
    pub(super) bounds: Option<[f64; 2]>,
}

impl Window {
    pub(super) fn data_term(&self) -> DataTerm<'_> {
        if self.delta.is_empty() { DataTerm::Penalised } else { DataTerm::Constrained(&self.delta) }
    }

    pub(super) fn problem<'a>(&'a self, solver: &'a StTv) -> Problem<'a> {
        let [lambda_space, lambda_time] = self.weights;
        Problem {
            ops: &solver.double,
            laplacian: &solver.laplacian,
            parts: &solver.parts,
            singular: &solver.compression.singular,
            modes: &self.modes,
            mode_of: &self.mode_of,
            targets: &self.targets,
            data_term: self.data_term(),
            lambda_space,
            lambda_time,
            bounds: self.bounds,
        }
    }
}
