//! Curve of a rule over the whole range of lambda.

use super::chosen::CurvePoint;
use super::search::logarithmic_grid;
use crate::one_step::spectrum::{Decomposition, Spectrum};

/// Evaluates a rule over the whole range of lambda.
pub(super) fn curve(
    spectrum: &Spectrum,
    data: &Decomposition,
    mut criterion: impl FnMut(f64) -> f64,
) -> Vec<CurvePoint> {
    logarithmic_grid(spectrum.hyperparameter_range())
        .into_iter()
        .map(|hyperparameter| CurvePoint {
            hyperparameter,
            residual_norm: data.squared_residual(spectrum, hyperparameter).sqrt(),
            solution_norm: data.squared_seminorm(spectrum, hyperparameter).sqrt(),
            criterion: criterion(hyperparameter),
        })
        .collect()
}
