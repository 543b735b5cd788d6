//! Forward solve with electrodes eliminated analytically, in `f64` or twice the precision.
//!
//! Each electrode potential is `U = mu + z I / length`, where `mu` is the mean potential of the
//! skin over the electrode. Eliminating the electrode potentials leaves a problem on the skin
//! alone:
//!
//! ```text
//! sigma-energy(u) + sum over electrodes 1/z integral of (u - mu)^2   with currents I into mu
//! voltages = m^T (E^T A^-1 E) I + sum m z I / length,   E: the means
//! ```
//!
//! A large `z` enters the matrix only as a vanishing term, and cancels exactly in voltages between
//! electrodes that carry no current. A small `z` affects only the deviations from the mean, which
//! are separate variables ([`network`]). Both limits, `z = 0` (a shunt) and infinite `z` (an ideal
//! current source), need no special treatment. The remaining sources of error are the contrast of
//! the skin and the shape of its triangles. If the error bound in `f64` is too large for them, the
//! solve is repeated with 32 digits. (The bound is 1e5 times the error in the cases of
//! `tests/all/accurate.rs`.)
//!
//! **Bound.** Let `x_k` be the fields of unit currents and `r_l = e_l - A x_l` their residuals. The
//! transfer value `mu_k` under current `l` is `e_k^T x_l + x_k^T r_l + (A^-1 r_k)^T r_l`. The
//! second term is computed and added; the third is the product of two errors. The bound is the size
//! of the second term plus twice the rounding of every step in it, `gamma sum_b size_b (|t_k| a_l +
//! a_k |t_l|)` over branches `b` with `t = e_b . x` and `a = |e_b| . |x|`. It assumes that the
//! third term is smaller than the second. This holds as long as the factor has correct digits:
//! pivots with fewer than 30 of 104 bits left (`f64`: fewer than half of 52) are rejected
//! ([`crate::sparse::ldl`]).

mod network;
mod outcome;
mod run;
mod transfer;
mod variables;

pub(super) use outcome::Outcome;
pub(super) use run::solve;
