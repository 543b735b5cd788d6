//! Generalised cross-validation.

use super::chosen::ChosenHyperparameter;
use super::curve::curve;
use super::search::minimise;
use crate::one_step::spectrum::{Decomposition, Spectrum};

pub(super) fn choose(spectrum: &Spectrum, data: &Decomposition) -> ChosenHyperparameter {
    let criterion = |hyperparameter: f64| function(spectrum, data, hyperparameter);
    minimise(curve(spectrum, data, criterion), criterion)
}

/// `|dv - J dsigma|_W^2 / trace(I - J RM)^2`.
///
/// Uses `trace(I - J RM) = (m - r) + sum mu / (d + mu)`, a sum of positive terms; the difference of
/// `m` and the degrees of freedom would suffer cancellation for small lambda.
fn function(spectrum: &Spectrum, data: &Decomposition, hyperparameter: f64) -> f64 {
    let damping = spectrum.damping(hyperparameter);
    let unexplained = (spectrum.vectors.nrows() - spectrum.values.len()) as f64;
    let trace = unexplained + spectrum.values.iter().map(|d| damping / (d + damping)).sum::<f64>();
    data.squared_residual(spectrum, hyperparameter) / trace / trace
}
