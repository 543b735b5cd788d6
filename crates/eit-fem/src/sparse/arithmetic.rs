//! Real and complex arithmetic for the factorisation.
//!
//! A factorisation stores rows of numbers in planes of `f64`: one plane, or real parts and then
//! imaginary parts. Multiplying by a factor is then the same operation on a whole plane, and values
//! need no shuffling between memory and registers. Interleaved parts took a third more time.
//! `plane` is the distance from a value to its imaginary part.
//!
//! The file is long because the trait and its two implementations belong together.

use faer::traits::ComplexField;
use std::iter::Sum;
use std::ops::{Div, Mul};

/// Number type of a factorisation: `f64`, or `c64` for complex admittivities.
///
/// Products never conjugate, so a symmetric matrix stays symmetric.
pub trait Arithmetic:
    ComplexField + Copy + From<f64> + Mul<f64, Output = Self> + Div<f64, Output = Self> + Sum
{
    /// Number of planes per row.
    const PLANES: usize;

    /// Whether the sums of a tile of four columns by eight rows, with the other operands, fit into
    /// sixteen 256-bit registers.
    const WIDE_TILES: bool;

    /// Several numbers in registers.
    type Lanes<const R: usize>: Copy;

    /// Reads one number of a row.
    fn read(from: &[f64], at: usize, plane: usize) -> Self;

    /// Writes the number at the start of a row.
    fn write(self, to: &mut [f64], plane: usize);

    /// Copies numbers into a row.
    fn spread(numbers: &[Self], to: &mut [f64], plane: usize);

    /// Copies numbers out of a row.
    fn gather(from: &[f64], plane: usize, numbers: &mut [Self]);

    /// Loads the first numbers of a row.
    fn load<const R: usize>(from: &[f64], plane: usize) -> Self::Lanes<R>;

    /// Stores numbers at the start of a row.
    fn store<const R: usize>(lanes: &Self::Lanes<R>, to: &mut [f64], plane: usize);

    /// Puts numbers into registers.
    fn lanes<const R: usize>(numbers: [Self; R]) -> Self::Lanes<R>;

    /// Returns the number at index `at`.
    fn lane<const R: usize>(lanes: &Self::Lanes<R>, at: usize) -> Self;

    /// [`Self::less_product`] for each number: `sums -= factor row`.
    fn less_products<const R: usize>(sums: &mut Self::Lanes<R>, factor: Self, row: &Self::Lanes<R>);

    /// Multiplies each number: `lanes *= factor`.
    fn scale<const R: usize>(lanes: &mut Self::Lanes<R>, factor: Self);

    /// Absolute value.
    fn modulus(self) -> f64;

    /// Returns `self - a b`, with fused multiply-add if the machine has it.
    fn less_product(self, a: Self, b: Self) -> Self;

    /// Returns the square root of a pivot, or `None` unless the pivot is finite and in the half
    /// plane around `direction`.
    fn pivot_root(self, direction: Self) -> Option<Self>;

    /// Returns `1 / self`.
    fn inverse(self) -> Self;
}

impl Arithmetic for f64 {
    const PLANES: usize = 1;

    const WIDE_TILES: bool = true;

    type Lanes<const R: usize> = [Self; R];

    #[inline(always)]
    fn read(from: &[Self], at: usize, _plane: usize) -> Self {
        from[at]
    }

    #[inline(always)]
    fn write(self, to: &mut [Self], _plane: usize) {
        to[0] = self;
    }

    #[inline(always)]
    fn spread(numbers: &[Self], to: &mut [Self], _plane: usize) {
        to[..numbers.len()].copy_from_slice(numbers);
    }

    #[inline(always)]
    fn gather(from: &[Self], _plane: usize, numbers: &mut [Self]) {
        numbers.copy_from_slice(&from[..numbers.len()]);
    }

    #[inline(always)]
    fn load<const R: usize>(from: &[Self], _plane: usize) -> [Self; R] {
        plane_of(from)
    }

    #[inline(always)]
    fn store<const R: usize>(lanes: &[Self; R], to: &mut [Self], _plane: usize) {
        to[..R].copy_from_slice(lanes);
    }

    #[inline(always)]
    fn lanes<const R: usize>(numbers: [Self; R]) -> [Self; R] {
        numbers
    }

    #[inline(always)]
    fn lane<const R: usize>(lanes: &[Self; R], at: usize) -> Self {
        lanes[at]
    }

    #[inline(always)]
    fn less_products<const R: usize>(sums: &mut [Self; R], factor: Self, row: &[Self; R]) {
        for r in 0..R {
            sums[r] = sums[r].less_product(factor, row[r]);
        }
    }

    #[inline(always)]
    fn scale<const R: usize>(lanes: &mut [Self; R], factor: Self) {
        lanes.iter_mut().for_each(|x| *x *= factor);
    }

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

#[inline(always)]
fn plane_of<const R: usize>(from: &[f64]) -> [f64; R] {
    let mut values = [0.0; R];
    values.copy_from_slice(&from[..R]);
    values
}

#[cfg(feature = "complex")]
impl Arithmetic for faer::c64 {
    const PLANES: usize = 2;

    const WIDE_TILES: bool = false;

    /// Real parts, then imaginary parts.
    type Lanes<const R: usize> = [[f64; R]; 2];

    #[inline(always)]
    fn read(from: &[f64], at: usize, plane: usize) -> Self {
        Self::new(from[at], from[at + plane])
    }

    #[inline(always)]
    fn write(self, to: &mut [f64], plane: usize) {
        (to[0], to[plane]) = (self.re, self.im);
    }

    #[inline(always)]
    fn spread(numbers: &[Self], to: &mut [f64], plane: usize) {
        let (re, im) = to.split_at_mut(plane);
        for ((number, re), im) in numbers.iter().zip(re).zip(im) {
            (*re, *im) = (number.re, number.im);
        }
    }

    #[inline(always)]
    fn gather(from: &[f64], plane: usize, numbers: &mut [Self]) {
        let (re, im) = from.split_at(plane);
        for ((number, re), im) in numbers.iter_mut().zip(re).zip(im) {
            *number = Self::new(*re, *im);
        }
    }

    #[inline(always)]
    fn load<const R: usize>(from: &[f64], plane: usize) -> [[f64; R]; 2] {
        [plane_of(from), plane_of(&from[plane..])]
    }

    #[inline(always)]
    fn store<const R: usize>([re, im]: &[[f64; R]; 2], to: &mut [f64], plane: usize) {
        to[..R].copy_from_slice(re);
        to[plane..][..R].copy_from_slice(im);
    }

    #[inline(always)]
    fn lanes<const R: usize>(numbers: [Self; R]) -> [[f64; R]; 2] {
        [numbers.map(|x| x.re), numbers.map(|x| x.im)]
    }

    #[inline(always)]
    fn lane<const R: usize>([re, im]: &[[f64; R]; 2], at: usize) -> Self {
        Self::new(re[at], im[at])
    }

    #[inline(always)]
    fn less_products<const R: usize>(
        [re, im]: &mut [[f64; R]; 2],
        factor: Self,
        row: &[[f64; R]; 2],
    ) {
        // rounds as `less_product` does
        for r in 0..R {
            re[r] = factor.im.mul_add(row[1][r], re[r]);
            re[r] = (-factor.re).mul_add(row[0][r], re[r]);
        }
        for r in 0..R {
            im[r] = (-factor.im).mul_add(row[0][r], im[r]);
            im[r] = (-factor.re).mul_add(row[1][r], im[r]);
        }
    }

    #[inline(always)]
    fn scale<const R: usize>([re, im]: &mut [[f64; R]; 2], factor: Self) {
        for r in 0..R {
            let (x, y) = (re[r], im[r]);
            re[r] = x * factor.re - y * factor.im;
            im[r] = x * factor.im + y * factor.re;
        }
    }

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

/// Square root in the right half plane, without trigonometric functions. For real numbers it equals
/// the real square root exactly.
#[cfg(feature = "complex")]
fn square_root(number: faer::c64) -> faer::c64 {
    let square = number.norm_sqr();
    // `norm` is slow, but handles squares that overflow or underflow
    let size = if square.is_normal() { square.sqrt() } else { number.norm() };
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
        // squares that overflow or underflow
        for size in [1e-200, 1e200] {
            let root = square_root(c64::new(3.0 * size, 4.0 * size)) / size.sqrt();
            assert!((root - c64::new(2.0, 1.0)).norm() < 8.0 * f64::EPSILON, "{root}");
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
