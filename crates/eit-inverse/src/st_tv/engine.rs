//! The iteration: a primal-dual method (Chambolle, Pock, *J. Math. Imaging Vis.* 40 (2011) 120)
//! whose primal step solves the data term exactly, over-relaxed.
//!
//! ```text
//! w   = x - T (D' q + D_t' q_t + p)
//! x^  = argmin data(x) + |x - w|^2_{T^-1} / 2,   see [`super::fit`]
//! x-  = 2 x^ - x
//! q^  = project((q + Sigma D x-) / (1 + Sigma gamma / radius))       radius = lambda_space size_g
//! q_t^ = project((q_t + Sigma D_t x-) / (1 + Sigma gamma / radius))  radius = lambda_time area
//! p^  = p + Sigma x- - Sigma clip(p / Sigma + x-, lower, upper)
//! (x, q, q_t, p) += rho ((x^, q^, q_t^, p^) - (x, q, q_t, p))
//! ```
//!
//! with the steps `T` and `Sigma` of a map (see [`super::step`]) and `rho` = 1.9. `gamma` smooths the
//! norms slightly (Huber), so that the duals of flat regions converge; its effect is far below the
//! requested gap.
//!
//! # One sweep
//! The operations after the data step of one iteration and before that of the next involve only the
//! neighbours of an unknown. Both therefore run in one sweep over blocks of unknowns: update the image
//! of a block; update the duals of the groups that it completes; compute `w`, and its contribution to
//! `V' w`, of the blocks that those groups complete. The basis, the largest array, is read from memory
//! once, and everything else is read once and written once.
//!
//! # Head and tail
//! The singular values of an electrode array decrease by a factor of a million from first to last.
//! Where `T s^2` is small, an explicit step works as well as the exact one. These directions, the
//! tail, enter as a constant force `V (s y)`, `y = s c - b`, which is updated every [`REFRESH`]
//! iterations, and the products run over the head only. The fixed point is the same.
//!
//! # Cost
//! Per iteration `4 n h T` flops in two dense products (`n` unknowns, `h` the rank of the head, `T`
//! frames, padded to a multiple of 8), and 5 arrays of `n T` values read, 4 of them written. For
//! 64 x 64 x 20 (`n` = 3228, `h` = 56 of 104, 80 with the step map of a proof) that is 14.5 Mflop and
//! 0.7 + 2.8 MB in `f32`. docs/PERFORMANCE.md compares the measured time with this minimum.
//!
//! The passes themselves are in `sweep`.

use super::fit::DataSteps;
use super::float::Float;
use super::operators::Operators;
use super::state::{REFRESH, State, Weights};
use super::sweep::{Analyse, Descend, Pull, Scaled, Sweep};
use pulp::Arch;

impl<T: Float> State<T> {
    /// Performs one iteration. With `keep` the unrelaxed image is stored as the candidate.
    pub(crate) fn iterate(
        &mut self,
        arch: Arch,
        ops: &Operators<T>,
        weights: &Weights,
        data: &mut DataSteps<T>,
        keep: bool,
    ) {
        if self.age >= REFRESH {
            self.refresh_tail(arch, ops, data);
        }
        if !self.prepared {
            arch.dispatch(Descend { state: self, ops });
        }
        data.apply(arch, &mut self.coefficients, self.stride);
        let steps = Scaled::new(weights);
        arch.dispatch(Sweep { state: self, ops, steps: &steps, keep });
        std::mem::swap(&mut self.coefficients, &mut self.next);
        self.prepared = true;
        self.age += 1;
    }

    /// Updates the force of the tail.
    fn refresh_tail(&mut self, arch: Arch, ops: &Operators<T>, data: &mut DataSteps<T>) {
        self.age = 0;
        if self.head < ops.padded_rank {
            self.prepared = false;
            arch.dispatch(Analyse { state: self, ops });
            data.pull(&mut self.next, self.stride, self.frames);
            arch.dispatch(Pull { state: self, ops });
        }
    }
}
