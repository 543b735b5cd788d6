//! Problem definition shared by the iteration and its evaluation.

use super::data::{Seen, Target};
use super::gradient::Gradient;
use super::laplacian::Laplacian;
use super::operators::Operators;
use faer::MatRef;

/// Data term, in the objective or as constraints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum DataTerm<'a> {
    /// `sum_t |A x_t - b_t|^2 / 2` in the objective.
    Penalised,
    /// `|A x_t - b_t| <= delta_t`, `[frame]`, including the unexplained `rest` of the data.
    Constrained(&'a [f64]),
}

/// Problem in the solver's internal units.
#[derive(Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub(crate) ops: &'a Operators<f64>,
    pub(crate) laplacian: &'a Laplacian,
    pub(crate) parts: &'a Parts,
    /// Singular values of the whole protocol, descending.
    pub(crate) singular: &'a [f64],
    pub(crate) modes: &'a [Seen],
    /// `[frame]`.
    pub(crate) mode_of: &'a [usize],
    /// `[frame]`.
    pub(crate) targets: &'a [Target],
    pub(crate) data_term: DataTerm<'a>,
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) bounds: Option<[f64; 2]>,
}

/// Connected parts of the skin.
#[derive(Debug, Clone)]
pub(crate) struct Parts {
    /// `[unknown]`.
    pub(crate) label: Vec<u32>,
    /// Number of unknowns of each part.
    pub(crate) sizes: Vec<f64>,
    /// `V' 1` of each part, `[part][rank]`.
    pub(crate) sensitivity: Vec<Vec<f64>>,
}

impl Parts {
    pub(crate) fn new(gradient: &Gradient, basis: MatRef<'_, f64>) -> Self {
        let (label, count) = gradient.parts();
        let mut sizes = vec![0.0; count];
        let mut sensitivity = vec![vec![0.0; basis.ncols()]; count];
        for (p, &part) in label.iter().enumerate() {
            sizes[part as usize] += 1.0;
            let sums = &mut sensitivity[part as usize];
            sums.iter_mut().zip(basis.row(p).iter()).for_each(|(sum, v)| *sum += v);
        }
        Self { label, sizes, sensitivity }
    }
}
