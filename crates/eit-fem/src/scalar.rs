//! The two kinds of numbers that potentials are made of.

use faer::traits::ComplexField;
use std::ops::{Div, Mul};

/// `f64`, and `c64` where admittivities are complex.
///
/// Products are plain: nothing is conjugated, so that a symmetric matrix stays one.
pub(crate) trait Scalar:
    ComplexField + Copy + From<f64> + Mul<f64, Output = Self> + Div<f64, Output = Self>
{
    /// Absolute value.
    fn modulus(self) -> f64;
}

impl Scalar for f64 {
    fn modulus(self) -> f64 {
        self.abs()
    }
}

#[cfg(feature = "complex")]
impl Scalar for faer::c64 {
    fn modulus(self) -> f64 {
        self.norm()
    }
}
