//! Real numbers of two precisions: `f64`, and twice as many digits.

use std::fmt::Debug;
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, Neg, Sub, SubAssign};

/// The unevaluated sum of two `f64`.
pub(crate) type DoubleDouble = faer::fx128;

/// A real number of some precision.
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
    /// Unit roundoff, with room for fast addition.
    const ROUNDING: f64;
    /// A pivot below this part of its diagonal has lost too much to be trusted: of the 104 bits 30
    /// must be left, of 52 half. The bound of the voltages relies on it: a pivot of rounding alone
    /// would hold its unknown near zero in every field, where no residual weighs anything.
    const LOST: f64;

    /// An exact number.
    fn of(x: f64) -> Self;
    /// The nearest `f64`.
    fn high(self) -> f64;
    /// What `high` lacks.
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
