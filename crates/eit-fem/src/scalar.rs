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

    /// `self - a b`, fused where the machine has that.
    fn less_product(self, a: Self, b: Self) -> Self;

    /// Square root of a pivot; `None` unless it is finite and in the half plane around `direction`.
    fn pivot_root(self, direction: Self) -> Option<Self>;

    /// `1 / self`.
    fn inverse(self) -> Self;
}

impl Scalar for f64 {
    fn modulus(self) -> f64 {
        self.abs()
    }

    #[inline(always)]
    fn less_product(self, a: Self, b: Self) -> Self {
        (-a).mul_add(b, self)
    }

    #[inline(always)]
    fn pivot_root(self, direction: Self) -> Option<Self> {
        let sound = self * direction > 0.0 && self.abs() < Self::INFINITY;
        sound.then(|| self.sqrt())
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        1.0 / self
    }
}

#[cfg(feature = "complex")]
impl Scalar for faer::c64 {
    fn modulus(self) -> f64 {
        self.norm()
    }

    #[inline(always)]
    fn less_product(self, a: Self, b: Self) -> Self {
        let re = (-a.re).mul_add(b.re, a.im.mul_add(b.im, self.re));
        let im = (-a.re).mul_add(b.im, (-a.im).mul_add(b.re, self.im));
        Self::new(re, im)
    }

    #[inline(always)]
    fn pivot_root(self, direction: Self) -> Option<Self> {
        let sound = (self * direction.conj()).re > 0.0 && self.is_finite();
        sound.then(|| square_root(self))
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        self.inv()
    }
}

/// The root in the right half plane, without sines and cosines; real numbers keep every bit.
#[cfg(feature = "complex")]
fn square_root(number: faer::c64) -> faer::c64 {
    let size = number.norm();
    if number.re >= 0.0 {
        let re = (0.5 * (size + number.re)).sqrt();
        return faer::c64::new(re, 0.5 * number.im / re);
    }
    let im = (0.5 * (size - number.re)).sqrt().copysign(number.im);
    faer::c64::new(0.5 * number.im / im, im)
}

#[cfg(all(test, feature = "complex"))]
mod tests {
    use super::*;
    use faer::c64;

    #[test]
    fn roots_in_every_quadrant() {
        for number in [(4.0, 0.0), (3.0, 4.0), (3.0, -4.0), (-3.0, 4.0), (-3.0, -4.0), (0.0, 2.0)] {
            let number = c64::new(number.0, number.1);
            let root = square_root(number);
            // a few roundings
            assert!((root * root - number).norm() < 8.0 * f64::EPSILON * number.norm(), "{number}");
            assert!(root.re > 0.0);
        }
        // (9/4)^2: exact
        assert_eq!(square_root(c64::new(5.0625, 0.0)), c64::new(2.25, 0.0));
    }

    #[test]
    fn pivots_on_the_wrong_side_have_no_root() {
        let direction = c64::cis(0.7);
        assert!(c64::cis(-0.8).pivot_root(direction).is_some());
        assert!(c64::cis(-0.9).pivot_root(direction).is_none());
        assert!(c64::new(f64::NAN, 1.0).pivot_root(direction).is_none());
        assert!(c64::new(0.0, 0.0).pivot_root(direction).is_none());
    }
}
