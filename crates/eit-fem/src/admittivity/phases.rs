//! Range of the phases of admittances: whether it spans less than 180 degrees, and its middle.

use crate::error::FemError;
use num_complex::Complex64;

/// Smallest and largest phase of a list, from -90 to 90 degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Phases {
    least: f64,
    most: f64,
}

impl Phases {
    /// Phase range of non-zero numbers in the right half plane.
    pub(crate) fn of(numbers: &[Complex64]) -> Self {
        // monotonic in the phase and needs no arc tangent; -1 and 1 on the imaginary axis
        let rank = |y: &Complex64| y.im / (y.re + y.im.abs());
        let ranks = numbers.iter().map(rank);
        let (least, most) =
            ranks.fold((1.0_f64, -1.0_f64), |(least, most), r| (least.min(r), most.max(r)));
        let phase = |rank: f64| rank.atan2(1.0 - rank.abs());
        Self { least: phase(least), most: phase(most) }
    }

    /// Union of two ranges.
    pub(crate) fn with(self, other: Self) -> Self {
        Self { least: self.least.min(other.least), most: self.most.max(other.most) }
    }

    /// Difference between the largest and the smallest phase, radians.
    pub(crate) fn span(self) -> f64 {
        self.most - self.least
    }

    /// Middle of the range, as a complex number of modulus one.
    ///
    /// # Errors
    /// A span of 180 degrees: inductors and capacitors may cancel.
    pub(crate) fn direction(self) -> Result<Complex64, FemError> {
        // entries may grow with the inverse square of this cosine: below 1e-8, a factorisation
        // without pivoting has no correct digit
        if (0.5 * self.span()).cos() < 1e-8 {
            let degrees = [self.least.to_degrees(), self.most.to_degrees()];
            return Err(FemError::OppositePhases { degrees });
        }
        Ok(Complex64::cis(0.5 * (self.least + self.most)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

    #[test]
    fn spans_and_middles() {
        let phases = |list: &[(f64, f64)]| {
            Phases::of(&list.iter().map(|p| Complex64::new(p.0, p.1)).collect::<Vec<_>>())
        };
        let real = phases(&[(1e-9, 0.0), (3.0, 0.0)]);
        assert_eq!((real.span(), real.direction()), (0.0, Ok(Complex64::new(1.0, 0.0))));
        // conductors and pure capacitors: 90 degrees, centred at 45 degrees
        let passive = phases(&[(2.0, 0.0), (0.0, 1e-5), (1.0, 1.0)]);
        assert!((passive.span() - FRAC_PI_2).abs() < 1e-15);
        let middle = passive.direction().unwrap_or_default();
        assert!((middle.arg() - FRAC_PI_4).abs() < 1e-15);
        assert_eq!(phases(&[(0.0, 2.0)]).span(), 0.0);
        let joined = real.with(phases(&[(1.0, -1.0)]));
        assert!((joined.span() - FRAC_PI_4).abs() < 1e-15);
        // a lossless capacitor and a lossless inductor
        let resonant = phases(&[(0.0, 1.0), (0.0, -1.0)]);
        assert!(matches!(resonant.direction(), Err(FemError::OppositePhases { .. })));
    }
}
