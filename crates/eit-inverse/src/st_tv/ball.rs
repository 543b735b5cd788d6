//! Proximal map of a ball, `|F' c - b| <= radius`, in the eigenvectors of `F' G F`.

/// Maximum number of Newton steps for the multiplier of a data constraint; it converges in fewer.
const MULTIPLIER_STEPS: usize = 60;

/// Returns the smallest `mu >= 0` with `sum (r / (1 + mu e))^2 <= square`; infinite if the radius is 0
/// and the residual is not.
///
/// `1 / norm` is concave and nearly linear in `mu`, so Newton on it converges from below, as for
/// trust regions (Moré, Sorensen, *SIAM J. Sci. Stat. Comput.* 4 (1983) 553).
#[inline(always)]
pub(crate) fn multiplier<I: Iterator<Item = (f64, f64)>>(
    terms: impl Fn() -> I,
    square: f64,
) -> f64 {
    let norm = |mu: f64| {
        let (mut sum, mut slope) = (0.0, 0.0);
        for (r, e) in terms() {
            let inverse = 1.0 / (1.0 + mu * e);
            let value = (r * inverse).powi(2);
            sum += value;
            slope += value * e * inverse;
        }
        (sum, slope)
    };
    let mut mu = 0.0;
    if square <= 0.0 {
        return if norm(0.0).0 == 0.0 { 0.0 } else { f64::INFINITY };
    }
    for _ in 0..MULTIPLIER_STEPS {
        let (sum, slope) = norm(mu);
        // tolerance at the level of rounding errors
        let excess = (sum / square).sqrt() - 1.0;
        if excess <= 1e-13 || slope == 0.0 {
            break;
        }
        mu += excess * sum / slope;
    }
    mu
}

/// Returns `mu r / (1 + mu e)`.
#[inline(always)]
pub(crate) fn dual(residual: f64, value: f64, mu: f64) -> f64 {
    match mu {
        mu if mu.is_finite() => mu * residual / (1.0 + mu * value),
        _ if value > 0.0 => residual / value,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_multiplier_puts_the_residual_on_the_sphere() {
        let residual = [3.0, -4.0, 0.5, 1e-3];
        for (tau, square) in [(1.0, 1.0), (1e-8, 24.0), (1e8, 1e-6), (1.0, 1e-12)] {
            let values = [1.0, 0.1_f64, 1e-3, 1.0].map(|s| tau * s * s);
            let mu = multiplier(|| residual.into_iter().zip(values), square);
            let found: f64 =
                residual.iter().zip(values).map(|(r, e)| (r / (1.0 + mu * e)).powi(2)).sum();
            // Newton stops at 1e-13 of the norm
            assert!((found / square - 1.0).abs() < 1e-11, "{found:e} for {square:e}");
        }
    }

    #[test]
    fn no_force_inside_the_ball() {
        let of = |r: f64, square: f64| multiplier(|| [(r, 1.0)].into_iter(), square);
        assert_eq!(of(0.1, 1.0), 0.0);
        assert_eq!(of(0.0, 0.0), 0.0);
        assert_eq!(of(0.1, 0.0), f64::INFINITY);
    }
}
