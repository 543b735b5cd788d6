//! The problem that every front end solves, in the solver's internal units.
//!
//! ```text
//! penalised:    min  sum_t |A_t x_t - b_t|^2 / 2 + variation
//! constrained:  min  variation   with   |A_t x_t - b_t| <= delta_t
//! variation =   lambda_space sum |D x_t|_{2,1} + lambda_time sum_t |x_t - x_{t-1}|_1 + lambda_anchor |x_0 - x^|_1
//! both:         lower <= x <= upper
//! ```
//!
//! with changes in time weighted by area. A whole sequence has links in time and no anchor; a causal frame is a
//! sequence of one frame with an anchor `x^`, the image before it; a frame on its own has neither.

use super::data::{Seen, Target};
use super::differences::ScaledRows;
use super::gradient::Gradient;
use super::laplacian::Laplacian;
use super::operators::Operators;
use crate::InverseError;
use faer::MatRef;

/// What evaluations in `f64` need of a skin.
#[derive(Debug, Clone)]
pub(crate) struct Skin {
    pub(crate) operators: Operators<f64>,
    pub(crate) laplacian: Laplacian,
    pub(crate) parts: Parts,
    /// Singular values of the whole protocol, descending.
    pub(crate) singular: Vec<f64>,
}

impl Skin {
    pub(crate) fn new(
        gradient: &Gradient,
        scaled: &ScaledRows,
        basis: MatRef<'_, f64>,
        singular: &[f64],
    ) -> Result<Self, InverseError> {
        let parts = Parts::new(gradient, basis);
        Ok(Self {
            operators: Operators::new(basis, gradient, scaled),
            laplacian: Laplacian::new(scaled, &parts.label, parts.sizes.len())?,
            parts,
            singular: singular.to_vec(),
        })
    }
}

/// Problem in the solver's internal units.
#[derive(Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub(crate) skin: &'a Skin,
    pub(crate) modes: &'a [Seen],
    /// `[frame]`.
    pub(crate) mode_of: &'a [usize],
    /// `[frame]`.
    pub(crate) targets: &'a [Target],
    /// Radius of the data constraint of each frame, including the unexplained rest of its data; `None` for penalised
    /// data.
    pub(crate) delta: Option<&'a [f64]>,
    pub(crate) lambda_space: f64,
    pub(crate) lambda_time: f64,
    pub(crate) anchor: Option<Anchor<'a>>,
    pub(crate) bounds: Option<[f64; 2]>,
    pub(crate) target_gap: f64,
}

/// The image before a single frame.
#[derive(Clone, Copy)]
pub(crate) struct Anchor<'a> {
    pub(crate) lambda: f64,
    /// `x^`, over cells.
    pub(crate) image: &'a [f64],
    /// `b - A x^`, `[row of F']`.
    pub(crate) beta: &'a [f64],
}

impl<'a> Problem<'a> {
    pub(crate) fn frames(&self) -> usize {
        self.targets.len()
    }

    /// Returns whether frames are linked in time.
    pub(crate) fn linked(&self) -> bool {
        self.frames() > 1 && self.lambda_time > 0.0
    }

    pub(crate) fn mode(&self, frame: usize) -> &'a Seen {
        &self.modes[self.mode_of[frame]]
    }

    /// Returns whether the first frame is linked to the anchor, which otherwise is only where changes are counted from.
    pub(crate) fn is_held(&self) -> bool {
        self.anchor.is_some_and(|anchor| anchor.lambda > 0.0)
    }

    /// Returns `b - A x^` of a frame, without an anchor `b`.
    pub(crate) fn beta(&self, frame: usize) -> &'a [f64] {
        match self.anchor {
            Some(anchor) => anchor.beta,
            None => &self.targets[frame].values,
        }
    }

    /// Returns the squared radius of the data constraint of a frame for the data that an image can explain.
    pub(crate) fn ball(&self, frame: usize) -> Option<f64> {
        let delta = self.delta?[frame];
        Some((delta * delta - self.targets[frame].rest_squared).max(0.0))
    }

    /// Returns whether the data of all frames separates by ranks.
    pub(crate) fn is_diagonal(&self) -> bool {
        self.delta.is_none() && self.mode_of.iter().all(|&mode| self.modes[mode].is_whole)
    }
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
    fn new(gradient: &Gradient, basis: MatRef<'_, f64>) -> Self {
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
