//! Dual point of the best bound of a frame.

use super::super::bound::Bound;
use super::super::certificate::Certificate;
use super::super::lanes::Project;
use super::super::problem::Problem;

/// Dual point in internal units.
#[derive(Debug, Clone)]
pub(super) struct Proof {
    /// Data dual, scaled; flow before scaling, and the scale.
    pub(super) dual: Vec<f64>,
    pub(super) flow: [Vec<f64>; 2],
    pub(super) scale: f64,
    /// Whether the bound was computed in `f64`.
    pub(super) is_double: bool,
    /// Rounding error of the last bound, relative to the smallest radius of the change.
    pub(super) rounding: f64,
}

impl Proof {
    pub(super) fn new(problem: &Problem<'_>) -> Self {
        let exact = &problem.skin.operators;
        Self {
            dual: vec![0.0; exact.padded],
            flow: std::array::from_fn(|_| vec![0.0; exact.groups]),
            scale: 0.0,
            is_double: false,
            rounding: 0.0,
        }
    }

    pub(super) fn clear(&mut self) {
        self.dual.fill(0.0);
        (self.scale, self.is_double, self.rounding) = (0.0, false, 0.0);
    }

    /// Keeps the duals of a bound that is better than the best so far.
    pub(super) fn take<T: Project>(
        &mut self,
        bound: Bound,
        best: f64,
        certificate: &Certificate<T>,
    ) {
        self.rounding = bound.rounding;
        if bound.value > best {
            self.scale = bound.scale;
            self.is_double = T::EPSILON == f64::EPSILON;
            let rows = self.dual.iter_mut().zip(&certificate.dual);
            rows.for_each(|(own, y)| *own = bound.scale * y);
            certificate.flow_into(&mut self.flow);
        }
    }
}
