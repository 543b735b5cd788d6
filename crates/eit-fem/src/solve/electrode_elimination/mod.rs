//! The forward problem in variables that stiff contacts cannot spoil, in `f64` or twice the precision.
//!
//! Eliminating each electrode potential, `U = mu + z I / length` with the mean `mu` of the skin's
//! potential over the electrode, leaves a problem on the skin alone:
//!
//! ```text
//! sigma-energy(u) + sum over electrodes 1/z integral of (u - mu)^2   with currents I into mu
//! voltages = m^T (E^T A^-1 E) I + sum m z I / length,   E: the means
//! ```
//!
//! A large `z` no longer enters the matrix but as a vanishing term, and cancels exactly in what is
//! measured between electrodes without current. A small `z` multiplies deviations from the mean
//! only, which are variables of their own ([`network`]). Both limits, `z = 0` (a shunt) and
//! infinite `z` (an ideal current source), are ordinary cases. What is left is the contrast of the
//! skin and the shape of its triangles, and against those numbers carry 32 digits where the bound in
//! `f64` does not suffice (a bound 1e5 times the error in the cases of `tests/accurate.rs`).
//!
//! **Bound.** With fields `x_k` of unit currents and their residuals `r_l = e_l - A x_l`, the
//! transfer value `mu_k` under current `l` is `e_k^T x_l + x_k^T r_l + (A^-1 r_k)^T r_l`. The second
//! term is computed and added; the third is the product of two errors. The bound is the size of the
//! second term and twice the rounding of every step in it, `gamma sum_b size_b (|t_k| a_l + a_k
//! |t_l|)` over branches with `t = e_b . x`, `a = |e_b| . |x|`. It takes the third term to
//! be below the second, which holds while the factor has right digits: a pivot that keeps fewer than
//! 30 of its 104 bits, or half of 52, is refused ([`crate::sparse::ldl`]).

mod network;
mod outcome;
mod run;
mod transfer;
mod variables;

pub(super) use outcome::Outcome;
pub(super) use run::solve;
