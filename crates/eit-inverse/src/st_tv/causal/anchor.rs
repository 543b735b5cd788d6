//! The image to which a frame is linked, in internal units, and how it takes the image of a frame.

use super::CausalStream;
use crate::SequenceStatus;

/// Number of frames between two complete computations of `V' x^`.
const RENEW: usize = 256;

impl CausalStream {
    /// Computes the anchor and its coefficients from the image.
    pub(super) fn set_anchor(&mut self) {
        let per_image = self.units().image;
        for (&cell, x) in self.solver.skin.operators.places.cells.iter().zip(&self.image) {
            self.anchor[cell] = x * per_image;
        }
        self.renew_coefficients();
        self.frames.renew_map();
    }

    fn renew_coefficients(&mut self) {
        let exact = &self.solver.skin.operators;
        exact.analyse(&self.anchor, exact.padded, &mut self.sums, &mut self.coefficients);
    }

    /// Computes the innovation `t - F' V' x^`.
    pub(super) fn innovate(&mut self) {
        let rank = self.solver.rank();
        self.seen.apply(&self.coefficients[..rank], &mut self.beta[..rank]);
        let rows = self.beta.iter_mut().zip(&self.target.values).take(self.seen.rows);
        rows.for_each(|(beta, t)| *beta = t - *beta);
    }

    /// Makes the new image the anchor.
    pub(super) fn report(&mut self, status: SequenceStatus) {
        // without a feasible image, for example after a deadline, the previous image is held
        let record = &self.frames.record;
        if !record.primal.is_finite() {
            return;
        }
        let per_image = self.units().image;
        let [lower, upper] = self.solver.settings.bounds_s();
        let exact = &self.solver.skin.operators;
        for (&cell, out) in exact.places.cells.iter().zip(&mut self.image) {
            let d = record.change[cell];
            if d != 0.0 {
                self.anchor[cell] += d;
                // clip again, so that bounds hold exactly after scaling
                *out = (self.anchor[cell] / per_image).clamp(lower, upper);
            }
        }
        if self.pushed.is_multiple_of(RENEW) || status != SequenceStatus::Converged {
            return self.renew_coefficients();
        }
        exact.analyse(&record.change, exact.padded, &mut self.sums, &mut self.moved);
        let changes = self.coefficients.iter_mut().zip(&self.moved);
        changes.for_each(|(c, d)| *c += d);
    }
}
