//! The exact data step, in the coordinates of each frame's mode.

use super::certificate::{Fidelity, gather};
use super::data::{Mode, Target};
use super::scalar::Scalar;

/// Data of all frames as the data step reads it.
pub(crate) struct Fit<'a> {
    pub(crate) modes: &'a [Mode],
    /// `[frame]`.
    pub(crate) mode_of: &'a [usize],
    /// `[frame]`.
    pub(crate) targets: &'a [Target],
    pub(crate) fidelity: Fidelity<'a>,
    /// Share of each radius to stay inside of, see [`margin`].
    pub(crate) margin: f64,
    pub(crate) tau: f64,
}

/// Share of its radius that a data constraint is drawn in by, so that the rounding of the iteration
/// leaves the image feasible.
pub(crate) fn margin(rounding: f64) -> f64 {
    1e3 * rounding
}

/// Newton steps for the multiplier of a data constraint: it converges from below in fewer.
const MULTIPLIER_STEPS: usize = 60;

impl Fit<'_> {
    /// Replaces the coefficients `[rank][stride]` of `w` by `c' - V' w`, and sets the data's dual
    /// variable, `[frame][rank]`.
    ///
    /// ```text
    /// penalised:    y = (s u - b) / (1 + tau s^2)
    /// constrained:  y = mu (s u - b) / (1 + mu tau s^2),   mu >= 0 with |s u' - b| = delta
    /// u' = u - tau s y
    /// ```
    pub(crate) fn apply<T: Scalar>(
        &self,
        coefficients: &mut [T],
        stride: usize,
        [column, rotated]: [&mut [f64]; 2],
        data_dual: &mut [f64],
    ) {
        let rank = column.len();
        for (frame, dual) in data_dual.chunks_exact_mut(rank).enumerate() {
            let (mode, target) = (&self.modes[self.mode_of[frame]], &self.targets[frame]);
            gather(coefficients, stride, frame, column);
            mode.rotate(column, rotated);
            let terms = || mode.singular.iter().zip(&target.values);
            for ((y, u), (s, b)) in dual.iter_mut().zip(rotated.iter()).zip(terms()) {
                *y = s * u - b;
            }
            let tau = self.tau;
            let mu = match self.fidelity {
                Fidelity::Penalised => 1.0,
                Fidelity::Constrained(delta) => {
                    let inside = delta[frame].powi(2) - target.rest_squared;
                    let inside = inside.max(0.0) * (1.0 - self.margin).powi(2);
                    multiplier(dual, &mode.singular, tau, inside)
                }
            };
            for ((u, y), s) in rotated.iter_mut().zip(dual.iter_mut()).zip(&mode.singular) {
                *y *= match mu {
                    mu if mu.is_finite() => mu / (1.0 + mu * tau * s * s),
                    _ if *s > 0.0 => 1.0 / (tau * s * s),
                    _ => 0.0,
                };
                *u = -tau * s * *y;
            }
            mode.rotate_back(rotated, column);
            for (k, c) in column.iter().enumerate() {
                coefficients[k * stride + frame] = T::from_f64(*c);
            }
        }
    }
}

/// The least `mu >= 0` with `sum (r / (1 + mu tau s^2))^2 <= square`; infinite for `square = 0`.
///
/// `1 / norm` is concave and nearly linear in `mu`, so Newton on it converges from below, as for
/// trust regions (Moré, Sorensen, *SIAM J. Sci. Stat. Comput.* 4 (1983) 553).
fn multiplier(residual: &[f64], singular: &[f64], tau: f64, square: f64) -> f64 {
    let norm = |mu: f64| {
        let (mut sum, mut slope) = (0.0, 0.0);
        for (r, s) in residual.iter().zip(singular) {
            let t = tau * s * s;
            let inverse = 1.0 / (1.0 + mu * t);
            let value = (r * inverse).powi(2);
            sum += value;
            slope += value * t * inverse;
        }
        (sum, slope)
    };
    let mut mu = 0.0;
    if square == 0.0 {
        return if norm(0.0).0 == 0.0 { 0.0 } else { f64::INFINITY };
    }
    for _ in 0..MULTIPLIER_STEPS {
        let (sum, slope) = norm(mu);
        // a hair inside, so that rounding does not leave the ball
        let excess = (sum / square).sqrt() - 1.0;
        if excess <= 1e-13 || slope == 0.0 {
            break;
        }
        mu += excess * sum / slope;
    }
    mu
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_multiplier_puts_the_residual_on_the_sphere() {
        let residual = [3.0, -4.0, 0.5, 1e-3];
        for (tau, square) in [(1.0, 1.0), (1e-8, 24.0), (1e8, 1e-6), (1.0, 1e-12)] {
            let singular = [1.0, 0.1, 1e-3, 1.0];
            let mu = multiplier(&residual, &singular, tau, square);
            let found: f64 = residual
                .iter()
                .zip(singular)
                .map(|(r, s)| (r / (1.0 + mu * tau * s * s)).powi(2))
                .sum();
            // Newton stops at 1e-13 of the norm
            assert!((found / square - 1.0).abs() < 1e-11, "{found:e} for {square:e}");
        }
    }

    #[test]
    fn no_force_inside_the_ball() {
        assert_eq!(multiplier(&[0.1], &[1.0], 1.0, 1.0), 0.0);
        assert_eq!(multiplier(&[0.0], &[1.0], 1.0, 0.0), 0.0);
        assert_eq!(multiplier(&[0.1], &[1.0], 1.0, 0.0), f64::INFINITY);
    }
}
