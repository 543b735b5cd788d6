//! L-curve.

use super::chosen::ChosenHyperparameter;
use super::curve::curve;
use super::search::minimise;
use crate::one_step::spectrum::{Decomposition, Spectrum};

pub(super) fn choose(spectrum: &Spectrum, data: &Decomposition) -> ChosenHyperparameter {
    let curve = curve(spectrum, data, |h| -curvature(spectrum, data, h));
    let mut chosen = minimise(curve, |h| -curvature(spectrum, data, h));
    chosen.criterion = -chosen.criterion;
    chosen.curve.iter_mut().for_each(|point| point.criterion = -point.criterion);
    chosen
}

/// Curvature of `(log |dv - J dsigma|_W, log |dsigma|_R)`, positive at the corner.
///
/// With `eta = |dsigma|_R^2`, `rho = |dv - J dsigma|_W^2`, `mu = lambda^2 s` and primes for d/d mu:
/// `rho' = -mu eta'`, so `eta`, `eta'` and `rho` determine the curvature: `x = log(rho) / 2`,
/// `y = log(eta) / 2`, curvature `(x' y'' - x'' y') / (x'^2 + y'^2)^(3/2)`, which is Hansen's
/// closed form with `mu` in place of lambda,
/// `2 (eta rho / -eta') (rho eta + mu rho eta' + mu^2 eta eta') / (mu^2 eta^2 + rho^2)^(3/2)`.
fn curvature(spectrum: &Spectrum, data: &Decomposition, hyperparameter: f64) -> f64 {
    let damping = spectrum.damping(hyperparameter);
    let eta = data.squared_seminorm(spectrum, hyperparameter);
    let rho = data.squared_residual(spectrum, hyperparameter);
    let slope: f64 = -2.0
        * data
            .squared
            .iter()
            .zip(&spectrum.values)
            .map(|(c, d)| c * d / (d + damping).powi(3))
            .sum::<f64>();
    let numerator = eta * rho + damping * slope * (rho + damping * eta);
    let denominator = (damping * eta).hypot(rho).powi(3);
    2.0 * eta * rho / -slope * numerator / denominator
}
