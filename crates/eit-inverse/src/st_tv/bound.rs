//! A lower bound of a problem, and the part of it that the data duals give.

use super::problem::Problem;

/// A lower bound and the scale of its duals.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bound {
    pub(crate) value: f64,
    pub(crate) scale: f64,
    /// Rounding error relative to the smallest radius of the anchor.
    pub(crate) rounding: f64,
}

impl Bound {
    /// Returns a bound that says nothing.
    pub(crate) fn nothing() -> Self {
        Self { value: f64::NEG_INFINITY, scale: 0.0, rounding: 0.0 }
    }

    /// Returns the bound at the best scale up to `largest` of duals whose value is `s linear - s^2 square / 2`.
    pub(crate) fn scaled(constant: f64, linear: f64, square: f64, largest: f64) -> Self {
        let scale = match (linear > 0.0, square > 0.0) {
            (false, _) => 0.0,
            (true, false) => largest,
            (true, true) => largest.min(linear / square),
        };
        let value = constant + scale * linear - 0.5 * scale * scale * square;
        Self { value, scale, rounding: 0.0 }
    }
}

/// Returns the part of the objective that does not depend on the image, and what the data duals `[frame][padded rank]`
/// contribute to `linear` and `square` of [`Bound::scaled`].
pub(crate) fn of_data(problem: &Problem<'_>, dual: &[f64]) -> [f64; 3] {
    let padded = problem.skin.operators.padded;
    let [mut constant, mut linear, mut square] = [0.0; 3];
    for (frame, own) in dual.chunks_exact(padded).enumerate() {
        let norm = own.iter().map(|y| y * y).sum::<f64>();
        let data =
            if problem.is_held() { problem.beta(frame) } else { &problem.targets[frame].values };
        linear -= own.iter().zip(data).map(|(y, b)| y * b).sum::<f64>();
        match problem.ball(frame) {
            Some(ball) => linear -= (ball * norm).sqrt(),
            None => {
                square += norm;
                constant += 0.5 * problem.targets[frame].rest_squared;
            }
        }
    }
    [constant, linear, square]
}
