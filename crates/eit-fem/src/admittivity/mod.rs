//! Forward problem with complex admittivity, for skins that store charge.
//!
//! At one frequency, a sheet of conductivity `sigma` (siemens per square) and capacitance `c`
//! (farad per square) has the admittivity `gamma = sigma + i omega c`. With complex contact
//! impedances `z`, the phasors obey the equations of the [real model](crate::ForwardModel) with
//! `gamma` in place of `sigma`. Phases are relative to the drive current. The time dependence is
//! `exp(i omega t)`, so capacitors have a positive susceptance.
//!
//! The matrix is linear in `gamma` and `1/z`, so the code of the real model assembles its real and
//! imaginary parts on the same pattern, ordering and symbolic factorisation. The matrix is complex
//! symmetric, not Hermitian: neither the factorisation ([`crate::sparse::Cholesky`]) nor the
//! adjoint ([`jacobian`]) conjugates anything. Voltages are holomorphic in every admittivity.
//!
//! **Why no pivoting.** The phases of all admittances span less than 180 degrees ([`phases`]), and
//! so do the phases of all pivots: Schur complements stay within the sector of the numerical range.
//! For passive skins (conductances and capacitors, 90 degrees) no entry grows by more than a factor
//! of three (N. J. Higham, "Factorizing complex symmetric matrices with positive definite real and
//! imaginary parts", Math. Comp. 67, 1998, conjectures two; A. George, Kh. D. Ikramov, A. B.
//! Kucherov, "On the growth factor in Gaussian elimination for generalized Higham matrices", Numer.
//! Linear Algebra Appl. 9, 2002, prove three). Every report measures the growth.
//!
//! **Why no iterative refinement.** In a passive skin, growth is at most three. The remaining loss
//! comes from rounding during assembly, which refinement cannot remove.

mod jacobian;
mod model;
mod phases;
mod solution;
mod solve;
mod workspace;

pub use model::{AdmittivityModel, admittivity};
pub use solution::{AdmittivityReport, AdmittivitySolution};
pub use workspace::AdmittivityWorkspace;
