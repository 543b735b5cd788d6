//! Real numbers in two precisions: `f64` and double-double.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, Neg, Sub, SubAssign};

/// Double-double number: the unevaluated sum of two `f64`.
pub(crate) type DoubleDouble = faer::fx128;

/// Real number of some precision.
pub(crate) trait Real:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + DivAssign
{
    /// Unit roundoff, with a margin for fast addition.
    const ROUNDING: f64;
    /// Smallest trusted ratio of a pivot to its diagonal entry: 30 of 104 bits must remain, or half
    /// of 52. The error bound of the voltages relies on this: a pivot that consists of rounding
    /// errors would keep its unknown near zero in every field, where its residual has no weight.
    const LOST: f64;

    /// Converts an `f64` exactly.
    fn of(x: f64) -> Self;
    /// The nearest `f64`.
    fn high(self) -> f64;
    /// The remainder, `self - high`, as `f64`.
    fn low(self) -> f64;
    fn sqrt(self) -> Self;
}

impl Real for f64 {
    const ROUNDING: f64 = f64::EPSILON;
    const LOST: f64 = f64::EPSILON * (1u64 << 26) as f64;

    fn of(x: f64) -> Self {
        x
    }

    fn high(self) -> f64 {
        self
    }

    fn low(self) -> f64 {
        0.0
    }

    fn sqrt(self) -> Self {
        self.sqrt()
    }
}

impl Real for DoubleDouble {
    const ROUNDING: f64 = f64::EPSILON * f64::EPSILON;
    const LOST: f64 = f64::EPSILON * f64::EPSILON * (1u64 << 30) as f64;

    fn of(x: f64) -> Self {
        Self::from_f64(x)
    }

    fn high(self) -> f64 {
        self.0
    }

    fn low(self) -> f64 {
        self.1
    }

    fn sqrt(self) -> Self {
        self.sqrt()
    }
}
