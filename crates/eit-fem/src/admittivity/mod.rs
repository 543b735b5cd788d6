//! Forward problem of a skin that stores charge: from complex admittivity to complex voltages.
//!
//! At one frequency a sheet of conductivity `sigma` (siemens per square) and capacitance `c` (farad
//! per square) has the admittivity `gamma = sigma + i omega c`, an electrode the contact impedance
//! `z`, and phasors obey the equations of [`forward`](crate::ForwardModel) with `gamma` for `sigma`.
//! Voltages are against the phase of the drive current; time runs as `exp(i omega t)`, so
//! capacitors have a positive susceptance.
//!
//! The matrix is linear in `gamma` and `1/z`: its real and imaginary parts are assembled by the
//! code of the real model, on the same pattern, ordering and symbolic factor. It is complex
//! symmetric, not Hermitian: so are its factorisation ([`crate::sparse::Cholesky`]) and its adjoint
//! ([`jacobian`]), in which nothing is conjugated. Voltages are holomorphic in every admittivity.
//!
//! **Why no pivoting.** Phases of all admittances lie within less than half a turn ([`phases`]), and
//! so do those of every pivot: Schur complements keep the sector of the numerical range. For passive
//! skins (conductances and capacitors: a quarter turn) no entry grows by more than a factor of three
//! (N. J. Higham, "Factorizing complex symmetric matrices with positive definite real and imaginary
//! parts", Math. Comp. 67, 1998, conjectures two; A. George, Kh. D. Ikramov, A. B. Kucherov, "On the
//! growth factor in Gaussian elimination for generalized Higham matrices", Numer. Linear Algebra
//! Appl. 9, 2002, prove three). Growth is measured with every report.
//!
//! There is no iterative refinement: without pivoting nothing grows by more than three in a passive
//! skin, and the loss that remains is the assembly's, which no refinement sees.

mod jacobian;
mod model;
mod phases;
mod solution;
mod solve;
mod workspace;

pub use model::{AdmittivityModel, admittivity};
pub use solution::{AdmittivityReport, AdmittivitySolution};
pub use workspace::AdmittivityWorkspace;
