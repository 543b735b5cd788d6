//! Data of the frame that a stream solves.

use super::StTv;
use super::data::{Seen, Target};
use super::problem::{DataTerm, Problem};
use super::schedule::relative_gap;
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
        relative_gap(self.primal, self.lower_bound)
    }
}

/// Data and weights of one frame in internal units.
#[derive(Debug, Clone)]
pub(super) struct SingleFrame {
    pub(super) modes: [Seen; 1],
    pub(super) targets: [Target; 1],
    /// `None` for penalised data.
    pub(super) delta: Option<[f64; 1]>,
    pub(super) weights: [f64; 2],
    pub(super) bounds: Option<[f64; 2]>,
}

impl SingleFrame {
    pub(super) fn problem<'a>(&'a self, solver: &'a StTv) -> Problem<'a> {
        let [lambda_space, lambda_time] = self.weights;
        Problem {
            ops: &solver.double,
            laplacian: &solver.laplacian,
            parts: &solver.parts,
            singular: &solver.compression.singular,
            modes: &self.modes,
            mode_of: &[0],
            targets: &self.targets,
            data_term: match &self.delta {
                None => DataTerm::Penalised,
                Some(delta) => DataTerm::Constrained(delta),
            },
            lambda_space,
            lambda_time,
            bounds: self.bounds,
        }
    }
}
