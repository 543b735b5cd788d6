//! Best image and bound of a frame.

use super::super::bound::Bound;
use super::super::certificate::Certificate;
use super::super::lanes::Project;
use super::super::problem::Problem;
use super::super::schedule::relative_gap;
use super::super::value::Candidate;

/// Best result of a frame so far, in internal units.
#[derive(Debug, Clone)]
pub(super) struct Record {
    pub(super) iterations: usize,
    pub(super) primal: f64,
    pub(super) lower_bound: f64,
    /// Change of the best image, over cells.
    pub(super) change: Vec<f64>,
    /// `|F' c - t|` of the best image, including the unexplained part of the data.
    pub(super) misfit: f64,
    /// Scaled data dual of the best bound, its flow, and the scale.
    pub(super) dual: Vec<f64>,
    pub(super) flow: [Vec<f64>; 2],
    pub(super) scale: f64,
    /// Whether the best bound was computed in `f64`.
    pub(super) is_double: bool,
    /// Rounding error of the last bound, relative to the smallest radius of the change.
    pub(super) rounding: f64,
    pub(super) candidate: Candidate,
    /// Best image, over cells.
    pub(super) images: Vec<f64>,
}

impl Record {
    pub(super) fn new(problem: &Problem<'_>) -> Self {
        let candidate = Candidate::new(problem);
        let groups = problem.skin.operators.groups;
        Self {
            iterations: 0,
            primal: f64::INFINITY,
            lower_bound: f64::NEG_INFINITY,
            change: candidate.change.clone(),
            misfit: 0.0,
            dual: candidate.coefficients.clone(),
            flow: std::array::from_fn(|_| vec![0.0; groups]),
            scale: 0.0,
            is_double: false,
            rounding: 0.0,
            images: candidate.images.clone(),
            candidate,
        }
    }

    /// Resets the record for a new frame.
    pub(super) fn clear(&mut self) {
        self.iterations = 0;
        (self.primal, self.lower_bound) = (f64::INFINITY, f64::NEG_INFINITY);
        self.change.fill(0.0);
        self.dual.fill(0.0);
        self.scale = 0.0;
        self.is_double = false;
        self.rounding = 0.0;
    }

    pub(super) fn gap(&self) -> f64 {
        relative_gap(self.primal, self.lower_bound)
    }

    /// Stores the candidate if it is the best.
    pub(super) fn take(&mut self) {
        if self.candidate.primal < self.primal {
            self.primal = self.candidate.primal;
            self.misfit = self.candidate.misfit[0];
            std::mem::swap(&mut self.change, &mut self.candidate.change);
            std::mem::swap(&mut self.images, &mut self.candidate.images);
        }
    }

    pub(super) fn take_proof<T: Project>(&mut self, bound: Bound, certificate: &Certificate<T>) {
        self.rounding = bound.rounding;
        if bound.value > self.lower_bound {
            self.lower_bound = bound.value;
            self.scale = bound.scale;
            self.is_double = T::EPSILON == f64::EPSILON;
            let rows = self.dual.iter_mut().zip(&certificate.dual);
            rows.for_each(|(own, y)| *own = bound.scale * y);
            certificate.flow_into(&mut self.flow);
        }
    }
}
