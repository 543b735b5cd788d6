//! Best image and best lower bound so far.

use super::problem::Problem;
use super::value::Candidate;

/// Best result so far, in internal units.
#[derive(Debug, Clone)]
pub(crate) struct Record {
    pub(crate) iterations: usize,
    pub(crate) primal: f64,
    pub(crate) lower_bound: f64,
    /// Best images and their change from the anchor, over cells.
    pub(crate) images: Vec<f64>,
    pub(crate) change: Vec<f64>,
    /// `|A x - b|` of each frame of the best images, with the unexplained part of the data.
    pub(crate) misfit: Vec<f64>,
    pub(crate) candidate: Candidate,
}

impl Record {
    pub(crate) fn new(problem: &Problem<'_>) -> Self {
        let candidate = Candidate::new(problem);
        Self {
            iterations: 0,
            primal: f64::INFINITY,
            lower_bound: f64::NEG_INFINITY,
            images: candidate.images.clone(),
            change: candidate.change.clone(),
            misfit: candidate.misfit.clone(),
            candidate,
        }
    }

    /// Resets the record for a new problem.
    pub(crate) fn clear(&mut self) {
        self.iterations = 0;
        (self.primal, self.lower_bound) = (f64::INFINITY, f64::NEG_INFINITY);
        self.change.fill(0.0);
    }

    /// Returns the relative gap; 0 where rounding puts the bound above the objective.
    pub(crate) fn gap(&self) -> f64 {
        match self.primal - self.lower_bound {
            gap if gap <= 0.0 => 0.0,
            gap => gap / self.primal.abs(),
        }
    }

    /// Keeps the images of the candidate if they are the best.
    pub(crate) fn take(&mut self) {
        if self.candidate.primal < self.primal {
            self.primal = self.candidate.primal;
            self.images.copy_from_slice(&self.candidate.images);
            self.change.copy_from_slice(&self.candidate.change);
            self.misfit.copy_from_slice(&self.candidate.misfit);
        }
    }

    /// Keeps a lower bound and returns true if it is the best.
    pub(crate) fn take_bound(&mut self, bound: f64) -> bool {
        let is_better = bound > self.lower_bound;
        self.lower_bound = self.lower_bound.max(bound);
        is_better
    }
}
