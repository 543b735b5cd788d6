//! Map from an unbounded unknown to a conductivity between bounds.
//!
//! ```text
//! sigma(x) = lower (upper / lower)^p,   p = 1 / (1 + exp(-phi)),   phi = phi_0 + x / kappa
//! d sigma / d x = sigma ln(upper / lower) p (1 - p) / kappa
//! ```
//!
//! `phi_0` and `kappa` are chosen so that `sigma(0) = sigma_ref` and `d sigma / d x = 1` there. So `x`
//! is in siemens and approximates small changes of the conductivity. Between wide bounds `ln sigma` is
//! nearly linear in `x`, which treats conductivity and resistivity alike; between narrow bounds the
//! map is a logistic function.
//!
//! Source: Barber, Brown, *Clin. Phys. Physiol. Meas.* 9 (1988), suppl. A, 101-104 (logarithm);
//! Grychtol, Adler, *Physiol. Meas.* 34 (2013), 579-597 (on the choice of the unknown).

use crate::InverseError;

/// Map of one element.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounded {
    lower_s: f64,
    upper_s: f64,
    /// `ln(upper / lower)`.
    log_range: f64,
    phi_0: f64,
    kappa_s: f64,
    reference_s: f64,
}

impl Bounded {
    /// Creates the map of an element whose reference conductivity lies inside the bounds.
    pub(super) fn new(
        element: usize,
        reference_s: f64,
        [lower_s, upper_s]: [f64; 2],
    ) -> Result<Self, InverseError> {
        let log_range = upper_s.ln() - lower_s.ln();
        let share = (reference_s.ln() - lower_s.ln()) / log_range;
        let phi_0 = (share / (1.0 - share)).ln();
        let kappa_s = reference_s * log_range * share * (1.0 - share);
        if !(phi_0.is_finite() && kappa_s > 0.0 && kappa_s.is_finite()) {
            return Err(InverseError::ElementOutOfRange {
                quantity: "reference conductivity",
                element,
                value: reference_s,
                must: "strictly between the conductivity bounds",
            });
        }
        Ok(Self { lower_s, upper_s, log_range, phi_0, kappa_s, reference_s })
    }

    /// Returns `sigma` and `d sigma / d x`; `sigma` is exactly within the bounds for any `x` but NaN.
    pub(super) fn at(&self, x: f64) -> [f64; 2] {
        // exact, without rounding, so that an unchanged frame has the image zero
        if x == 0.0 {
            return [self.reference_s, 1.0];
        }
        let phi = self.phi_0 + x / self.kappa_s;
        let share = 1.0 / (1.0 + (-phi).exp());
        // 1 - share, without cancellation for share near 1
        let rest = 1.0 / (1.0 + phi.exp());
        let sigma_s = self.lower_s * (self.log_range * share).exp();
        let sigma_s = sigma_s.clamp(self.lower_s, self.upper_s);
        [sigma_s, sigma_s * self.log_range * share * rest / self.kappa_s]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reference_slope_and_derivative() {
        for (reference_s, bounds) in [(1e-5, [1e-8, 1e-2]), (3.0, [2.9, 40.0]), (1.0, [0.5, 1.1])] {
            let map = Bounded::new(0, reference_s, bounds).unwrap();
            assert_eq!(map.at(0.0), [reference_s, 1.0]);
            // continuous at 0: a change of 1e-12 of the reference is below the rounding of phi
            let [near, slope] = map.at(1e-12 * reference_s);
            assert!((near / reference_s - 1.0).abs() < 1e-11 && (slope - 1.0).abs() < 1e-9);
            for x in [-3.0, -0.4, 0.2, 5.0] {
                let (x, h) = (x * reference_s, 1e-5 * reference_s);
                let [value, slope] = map.at(x);
                assert!((bounds[0]..=bounds[1]).contains(&value));
                let difference = (map.at(x + h)[0] - map.at(x - h)[0]) / (2.0 * h);
                // error h^2 of the difference quotient; kappa is as low as 0.09 of the reference in case 2
                assert!((difference - slope).abs() < 1e-6, "{difference} {slope} at {x}");
            }
        }
    }

    #[test]
    fn bounds_hold_exactly_at_any_distance() {
        let bounds = [0.1, 7.3];
        let map = Bounded::new(0, 0.3, bounds).unwrap();
        for x in [-1e300, -1e3, -50.0, 50.0, 1e3, 1e300, f64::INFINITY, f64::NEG_INFINITY] {
            let [value, slope] = map.at(x);
            assert!((bounds[0]..=bounds[1]).contains(&value), "{value} at {x}");
            assert!(slope >= 0.0 && slope.is_finite(), "{slope} at {x}");
        }
        // without the clamp, about half of these would exceed their upper bound by one rounding error
        for k in 1..100 {
            let bounds = [0.1 + 0.013 * f64::from(k), 7.3 + f64::from(k)];
            let [value, _] = Bounded::new(0, 2.0, bounds).unwrap().at(1e3);
            assert!(value <= bounds[1] && value > 0.999 * bounds[1], "{value} of {bounds:?}");
        }
        for outside in [0.1, 7.3, 0.05, 8.0, f64::NAN, -1.0, 0.0] {
            assert!(matches!(
                Bounded::new(4, outside, bounds),
                Err(InverseError::ElementOutOfRange { element: 4, .. })
            ));
        }
    }
}
