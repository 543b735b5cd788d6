//! Number types of sparse matrices.

use super::arithmetic::Arithmetic;

/// Number type of a sparse matrix: `f64` and, with feature `complex`, `Complex64`. Sealed.
pub trait Scalar: Arithmetic {}

impl Scalar for f64 {}

#[cfg(feature = "complex")]
impl Scalar for faer::c64 {}
