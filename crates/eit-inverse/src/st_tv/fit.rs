//! One iteration of a run, with its exact data step in the coordinates of each frame's mode.

use super::certificate::gather;
use super::float::Float;
use super::kernel::RANKS;
use super::operators::Operators;
use super::problem::{DataTerm, Problem};
use super::state::{REFRESH, State, Steps};
use super::step;
use pulp::Arch;

/// Weights above this, in the solver's units, change no result but would overflow `f32`.
const LARGEST_WEIGHT: f64 = 1e8;

/// What the data step writes.
pub(crate) struct Memory<'a> {
    /// Two of `[rank]`.
    pub(crate) columns: &'a mut [Vec<f64>; 2],
    /// Dual variable of the data, `[frame][rank]`.
    pub(crate) data_dual: &'a mut [f64],
}

/// One iteration with a primal step `tau`, before one with `next_tau`.
pub(crate) fn iterate<T: Float>(
    arch: Arch,
    ops: &Operators<T>,
    problem: &Problem<'_>,
    state: &mut State<T>,
    memory: Memory<'_>,
    [tau, next_tau]: [f64; 2],
    keep: bool,
) {
    let Memory { columns: [column, rotated], data_dual } = memory;
    if state.age >= REFRESH {
        let head = head(problem, tau);
        state.refresh_tail(arch, ops, head, |coefficients, stride| {
            pull(problem, head.next_multiple_of(RANKS), coefficients, stride, data_dual);
        });
    }
    let steps = Steps {
        tau,
        sigma: 1.0 / (tau * step::norm_squared(ops, state)),
        lambda_space: problem.lambda_space.min(LARGEST_WEIGHT),
        lambda_time: problem.lambda_time.min(LARGEST_WEIGHT),
        bounds: problem.bounds,
    };
    let fit = Fit { problem, margin: margin(T::EPSILON), tau, head: state.head };
    state.iterate(arch, ops, &steps, next_tau, keep, |coefficients, stride| {
        fit.apply(coefficients, stride, [column, rotated], data_dual);
    });
}

/// Ranks that need the exact step: an explicit one must not overshoot before the tail is brought up
/// to date. All of them where the data does not separate by ranks.
fn head(problem: &Problem<'_>, tau: f64) -> usize {
    let all = problem.singular.len();
    let separate = |&mode: &usize| problem.modes[mode].rotation.is_empty();
    if problem.data_term != DataTerm::Penalised || !problem.mode_of.iter().all(separate) {
        return all;
    }
    let least = 1.0 / (2.0 * REFRESH as f64 * tau);
    problem.singular.iter().take_while(|&s| s * s > least).count()
}

/// Replaces the tail's coefficients `c` of the image by their force `s y`, `y = s c - b`.
fn pull<T: Float>(
    problem: &Problem<'_>,
    head: usize,
    coefficients: &mut [T],
    stride: usize,
    data_dual: &mut [f64],
) {
    let rank = problem.singular.len();
    for (frame, dual) in data_dual.chunks_exact_mut(rank).enumerate() {
        let (mode, target) = (&problem.modes[problem.mode_of[frame]], &problem.targets[frame]);
        for k in head..rank {
            let c = &mut coefficients[k * stride + frame];
            dual[k] = mode.singular[k] * c.to_f64() - target.values[k];
            *c = T::from_f64(mode.singular[k] * dual[k]);
        }
    }
}

/// The data step of one iteration.
struct Fit<'a> {
    problem: &'a Problem<'a>,
    /// Share of each radius to stay inside of, see [`margin`].
    margin: f64,
    tau: f64,
    /// Ranks that take part.
    head: usize,
}

/// Share of its radius that a data constraint is drawn in by, so that the rounding of the iteration
/// leaves the image feasible.
fn margin(rounding: f64) -> f64 {
    1e3 * rounding
}

/// Newton steps for the multiplier of a data constraint: it converges from below in fewer.
const MULTIPLIER_STEPS: usize = 60;

impl Fit<'_> {
    /// Replaces the head's coefficients `[rank][stride]` of `w` by `c' - V' w`, and sets the data's
    /// dual variable, `[frame][rank]`.
    ///
    /// ```text
    /// penalised:    y = (s u - b) / (1 + tau s^2)
    /// constrained:  y = mu (s u - b) / (1 + mu tau s^2),   mu >= 0 with |s u' - b| = delta
    /// u' = u - tau s y
    /// ```
    fn apply<T: Float>(
        &self,
        coefficients: &mut [T],
        stride: usize,
        [column, rotated]: [&mut Vec<f64>; 2],
        data_dual: &mut [f64],
    ) {
        let problem = self.problem;
        let rank = column.len();
        let head = self.head.min(rank);
        let (column, rotated) = (&mut column[..head], &mut rotated[..head]);
        for (frame, dual) in data_dual.chunks_exact_mut(rank).enumerate() {
            let dual = &mut dual[..head];
            let (mode, target) = (&problem.modes[problem.mode_of[frame]], &problem.targets[frame]);
            gather(coefficients, stride, frame, column);
            mode.rotate(column, rotated);
            let terms = || mode.singular.iter().zip(&target.values);
            for ((y, u), (s, b)) in dual.iter_mut().zip(rotated.iter()).zip(terms()) {
                *y = s * u - b;
            }
            let tau = self.tau;
            let mu = match problem.data_term {
                DataTerm::Penalised => 1.0,
                DataTerm::Constrained(delta) => {
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
