//! The iteration: a primal-dual method (Chambolle, Pock, *J. Math. Imaging Vis.* 40 (2011) 120)
//! whose primal step solves the data term exactly, over-relaxed.
//!
//! ```text
//! w   = x - tau (D' q + D_t' q_t + p)
//! x^  = w + V (c' - V' w),     c' = argmin data(c) + |c - V' w|^2 / (2 tau)
//! x-  = 2 x^ - x
//! q^  = project(q + sigma D x-)        onto |q_g| <= lambda_space size_g
//! q_t^ = project(q_t + sigma D_t x-)   onto |q_t| <= lambda_time area
//! p^  = p + sigma x- - sigma clip(p / sigma + x-, lower, upper)
//! (x, q, q_t, p) += rho ((x^, q^, q_t^, p^) - (x, q, q_t, p))
//! ```
//!
//! with `sigma tau (|D|^2 + 4 + 1) <= 1` (the 4 where the sequence has more than one frame, the 1
//! where there are bounds) and `rho` = 1.9.
//!
//! # One sweep
//! What follows the data step of one iteration and what comes before that of the next needs of an
//! unknown only its neighbours. So both run in one sweep over blocks of unknowns: a block gets its
//! image; the groups that it completes get their duals; the blocks which those complete get their
//! `w` and give their share of `V' w`. The basis, the largest array, comes from memory once, and
//! everything else once to be read and once to be written.
//!
//! # Head and tail
//! Singular values of an electrode array fall by a million from the first to the last. Where
//! `tau s^2` is small an explicit step serves as well as the exact one: these directions, the tail,
//! enter as a constant force `V (s y)`, `y = s c - b`, that is brought up to date every
//! [`REFRESH`] iterations, and the products run over the head alone. The fixed point is the same.
//!
//! # Cost
//! Per iteration `4 n h T` flops in two dense products (`n` unknowns, `h` the head's rank, `T`
//! frames, padded to a multiple of 8) and 5 arrays of `n T` values, read, 4 of them written. For
//! 64 x 64 x 20 (`n` = 3228, `h` = 56 of 104, 80 in a proof) that is 14.5 Mflop and 0.7 + 2.8 MB in
//! `f32`.
//! docs/PERFORMANCE.md has the measured time against that floor.
//!
//! The passes themselves are in `sweep`.

use super::float::Float;
use super::kernel::RANKS;
use super::operators::Operators;
use super::state::{State, Steps};
use super::sweep::{Analyse, Descend, Pull, Scaled, Sweep};
use pulp::Arch;

impl<T: Float> State<T> {
    /// Brings the tail up to date, with a head of these ranks. `fit` replaces the coefficients
    /// `[rank][stride]` of the image, of which those of the tail are given, by their force.
    pub(crate) fn refresh_tail(
        &mut self,
        arch: Arch,
        ops: &Operators<T>,
        head: usize,
        fit: impl FnOnce(&mut [T], usize),
    ) {
        self.head = head.next_multiple_of(RANKS).min(ops.padded_rank);
        self.age = 0;
        self.prepared = None;
        if self.head < ops.padded_rank {
            arch.dispatch(Analyse { state: self, ops });
            fit(&mut self.next, self.stride);
            arch.dispatch(Pull { state: self, ops });
        }
    }

    /// One iteration. `fit` replaces the head's coefficients `[rank][stride]` of `w` by the change
    /// that the data asks for. With `keep` the unrelaxed image is kept as the candidate. `next_tau` is
    /// the primal step of the iteration to come; another one costs a sweep more.
    pub(crate) fn iterate(
        &mut self,
        arch: Arch,
        ops: &Operators<T>,
        steps: &Steps,
        next_tau: f64,
        keep: bool,
        mut fit: impl FnMut(&mut [T], usize),
    ) {
        if self.prepared != Some(steps.tau) {
            arch.dispatch(Descend { state: self, ops, tau: T::from_f64(steps.tau) });
        }
        fit(&mut self.coefficients, self.stride);
        let next_tau_scaled = T::from_f64(next_tau);
        let steps = Scaled::new(steps);
        arch.dispatch(Sweep { state: self, ops, steps: &steps, next_tau: next_tau_scaled, keep });
        std::mem::swap(&mut self.coefficients, &mut self.next);
        self.prepared = Some(next_tau);
        self.age += 1;
    }
}
