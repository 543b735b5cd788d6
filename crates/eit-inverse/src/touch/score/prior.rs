//! Prior of a touch: strength, birth, motion, distance from others; all as -2 ln density.
//!
//! ```text
//! strength   p(a) = 2 x / (1 + x^2)^2 / typical, x = a / typical, and 2 (least / a)^2
//! birth      rate per second and square metre times the time of a frame;  a touch that stays: 1 - rate of its end
//! place      (1 - m) N(p0, S0 + rest^2) + m N(p0 + v dt, S0 + (speed dt)^2) + 1e-3 N(p0, 15 mm)
//! two        1 - exp(-(d / 18 mm)^6)
//! ```

use super::estimate::Scene;
use super::places::Grid;
use super::settings::ScoreSettings;
use super::state::{Before, TouchState};
use crate::geometry::distance_m;
use std::f64::consts::TAU;

/// Standard deviation of a first step from the place at which a touch begins, metres: the distance over which responses are
/// nearly linear.
const FIRST_STEP_M: f64 = 0.02;

type Plane = [[f64; 2]; 2];

/// A term of a score with what Gauss-Newton needs: half of its downward slope, and half of its curvature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OfStrength {
    pub(super) cost: f64,
    pub(super) pull: f64,
    pub(super) precision: f64,
}

/// Prior of a strength.
pub(super) fn of_strength(a: f64, s: &ScoreSettings) -> OfStrength {
    let x = a / s.typical_m2;
    let z = (s.least_m2 / a).powi(2);
    OfStrength {
        cost: 2.0 * (s.typical_m2 / (2.0 * x)).ln() + 4.0 * (x * x).ln_1p() + 2.0 * z,
        pull: a.recip() - 4.0 * x / (1.0 + x * x) / s.typical_m2 + 2.0 * z / a,
        precision: (1.0 + 6.0 * z) / (a * a),
    }
}

/// The same of a position, along the tangents of its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OfPlace {
    pub(super) cost: f64,
    pub(super) pull: [f64; 2],
    pub(super) precision: Plane,
}

/// Prior of the position of a touch; `moves`: it does not rest.
pub(super) fn of_place(
    touch: &TouchState,
    grid: &Grid,
    s: &ScoreSettings,
    dt_s: f64,
    moves: bool,
) -> OfPlace {
    let Some(before) = &touch.before else {
        let precision = FIRST_STEP_M.powi(-2);
        let cost = -2.0 * (s.born_hz_m2 * dt_s).ln();
        return OfPlace { cost, pull: [0.0; 2], precision: [[precision, 0.0], [0.0, precision]] };
    };
    let parts = parts(before, touch, grid, s, dt_s);
    let parts = if moves { &parts[1..] } else { &parts[..] };
    let top = parts.iter().map(|p| p.log).fold(f64::NEG_INFINITY, f64::max);
    let whole: f64 = parts.iter().map(|p| (p.log - top).exp()).sum();
    let (mut pull, mut precision) = ([0.0; 2], [[0.0; 2]; 2]);
    for part in parts {
        let weight = (part.log - top).exp() / whole;
        for i in 0..2 {
            pull[i] +=
                weight * (part.precision[i][0] * part.way[0] + part.precision[i][1] * part.way[1]);
            (0..2).for_each(|j| precision[i][j] += weight * part.precision[i][j]);
        }
    }
    OfPlace { cost: -2.0 * (top + whole.ln()), pull, precision }
}

/// One normal density of a mixture.
struct Part {
    /// Logarithm of its weight times its density.
    log: f64,
    precision: Plane,
    /// From the touch to its mean, metres.
    way: [f64; 2],
}

fn parts(
    before: &Before,
    touch: &TouchState,
    grid: &Grid,
    s: &ScoreSettings,
    dt_s: f64,
) -> [Part; 3] {
    let place = touch.spot.place;
    let own = turned(before.covariance_m2, grid.turn(before.spot.place, place));
    let from = before.spot.position_m;
    let ahead: [f64; 3] = std::array::from_fn(|i| from[i] + dt_s * before.velocity_m_s[i]);
    let wider = |by_m: f64| {
        let square = by_m * by_m;
        [[own[0][0] + square, own[0][1]], [own[1][0], own[1][1] + square]]
    };
    let anywhere = s.misplaced_m * s.misplaced_m;
    let of = |weight: f64, mean: [f64; 3], covariance: Plane| {
        let [[a, b], [_, d]] = covariance;
        let determinant = a * d - b * b;
        let precision = [[d / determinant, -b / determinant], [-b / determinant, a / determinant]];
        let way = grid.along(place, std::array::from_fn(|i| mean[i] - touch.spot.position_m[i]));
        let square: f64 =
            (0..2).map(|i| way[i] * (precision[i][0] * way[0] + precision[i][1] * way[1])).sum();
        Part { log: weight.ln() - 0.5 * (square + determinant.ln()) - TAU.ln(), precision, way }
    };
    [
        of(1.0 - s.moving, from, wider(s.rest_m)),
        of(s.moving, ahead, wider(s.speed_m_s * dt_s)),
        of(s.misplaced, from, [[anywhere, 0.0], [0.0, anywhere]]),
    ]
}

/// `Q S Q'`.
fn turned(covariance: Plane, q: Plane) -> Plane {
    let at = |i: usize, j: usize| {
        (0..2)
            .flat_map(|k| (0..2).map(move |l| (k, l)))
            .map(|(k, l)| q[i][k] * covariance[k][l] * q[j][l])
            .sum()
    };
    [[at(0, 0), at(0, 1)], [at(1, 0), at(1, 1)]]
}

/// Estimate of how much the score would be larger without a touch: what it explains, less what its strength, place and birth
/// cost.
pub(super) fn worth(touch: &TouchState, scene: &Scene<'_>) -> f64 {
    let (s, [[a, b], [c, d]]) = (scene.settings, touch.covariance_m2);
    let volume = touch.strength_variance * (a * d - b * c);
    let place = of_place(touch, &scene.model.grid, s, scene.dt_s, false);
    let cost = of_strength(touch.strength_m2, s).cost + place.cost;
    touch.wald() - cost + volume.max(f64::MIN_POSITIVE).ln() + 3.0 * TAU.ln()
}

/// Cost of two touches this close.
pub(super) fn of_pair(a: &TouchState, b: &TouchState, s: &ScoreSettings) -> f64 {
    let apart = (distance_m(a.spot.position_m, b.spot.position_m) / s.apart_m).min(3.0);
    -2.0 * (-(-apart.powi(6)).exp_m1() + 1e-30).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pull and precision of a strength against differences; the precision leaves out the curvature of `ln(1 + x^2)`, which may
    /// be negative.
    #[test]
    fn strengths_have_the_slope_of_their_cost() {
        let s = ScoreSettings::default();
        for a in [2e-6, 2e-5, 1e-4] {
            let h = 1e-4 * a;
            let [ahead, behind] = [h, -h].map(|by| of_strength(a + by, &s));
            let slope = (ahead.cost - behind.cost) / (2.0 * h);
            let own = of_strength(a, &s);
            assert!((slope + 2.0 * own.pull).abs() < 1e-4 * (slope.abs() + 1.0 / a), "{a}");
            assert!(own.precision > 0.0);
        }
        // the mode of p(a) is at typical / sqrt 3
        let mode = s.typical_m2 / 3.0_f64.sqrt();
        let free = ScoreSettings { least_m2: 1e-12, ..s };
        assert!(of_strength(mode, &free).pull.abs() < 1e-6 / mode);
    }
}
