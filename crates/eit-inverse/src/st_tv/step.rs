//! Step sizes, from norms alone.

use super::float::Float;
use super::operators::Operators;
use super::problem::Problem;
use super::state::State;

/// Share of the balanced step that is best to begin with, on the reference problems; a factor of
/// two either way costs a tenth of the iterations.
const SHARE: f64 = 0.6;

/// `|D|^2` with the links in time and the bounds, for `sigma tau |D|^2 = 1`.
pub(crate) fn norm_squared<T: Float>(ops: &Operators<T>, state: &State<T>) -> f64 {
    let time = if state.time_dual.is_empty() { 0.0 } else { 4.0 };
    let bounds = if state.bound_dual.is_empty() { 0.0 } else { 1.0 };
    // a basis without any difference (one pixel) and without bounds has no dual step
    (ops.norm_squared + time + bounds).max(1.0)
}

/// The step for which image and dual variables have equally far to go, from their squared norms;
/// `None` where there is nothing to measure yet.
fn balanced(image: f64, dual: f64, norm_squared: f64) -> Option<f64> {
    let step = SHARE * (image / dual / norm_squared).sqrt();
    (step > 0.0 && step.is_finite()).then_some(step)
}

/// A first guess, from the least squares image and the largest dual variables.
pub(crate) fn guess<T: Float>(
    problem: &Problem<'_>,
    ops: &Operators<T>,
    state: &State<T>,
) -> Option<f64> {
    let (mut image, mut force) = (0.0, 0.0);
    for (target, &mode) in problem.targets.iter().zip(problem.mode_of) {
        for (b, s) in target.values.iter().zip(&problem.modes[mode].singular) {
            image += (s * b / (s * s + 1e-3)).powi(2);
            force += (s * b).powi(2);
        }
    }
    let square = |radii: &[T]| radii.iter().map(|r| r.to_f64().powi(2)).sum::<f64>();
    let frames = state.frames as f64;
    let mut dual = frames * square(&ops.radius) * problem.lambda_space.powi(2);
    if !state.time_dual.is_empty() {
        dual += frames * square(&ops.time_radius) * problem.lambda_time.powi(2);
    }
    // weights beyond all need: the force of the data times the width of the skin is enough
    let dual = dual.min(force * ops.unknowns as f64);
    balanced(image, dual, norm_squared(ops, state))
}

/// From an iterate.
pub(crate) fn measure<T: Float>(ops: &Operators<T>, state: &State<T>) -> Option<f64> {
    let square = |values: &[T]| values.iter().map(|v| v.to_f64().powi(2)).sum::<f64>();
    let image = square(&state.image);
    let dual = square(&state.dual) + square(&state.time_dual);
    balanced(image, dual, norm_squared(ops, state))
}
