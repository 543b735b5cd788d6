//! Which numbers a sparse matrix may hold.

use super::arithmetic::Arithmetic;

/// Numbers of a sparse matrix: `f64` and, with feature `complex`, `Complex64`. Sealed: nothing else
/// is one.
pub trait Scalar: Arithmetic {}

impl Scalar for f64 {}

#[cfg(feature = "complex")]
impl Scalar for faer::c64 {}
