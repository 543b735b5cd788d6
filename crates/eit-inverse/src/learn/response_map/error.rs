//! How wrong a map is: the covariance of what is left of presses that were left out.

use super::left_out::{LeftOut, unit_rows};
use crate::InverseError;
use crate::learn::covariance::{Covariance, shrunk};
use crate::learn::linear::inverse_of_factor;
use ndarray::{Array1, Array2, Axis};

/// Range of the strength of a press that was left out.
const STRENGTH_RANGE: [f64; 2] = [0.3, 3.0];

/// Weight of the prior of `S`, in presses, and its squared error relative to a response: the model with a gain per
/// channel explains 0.55 of a press on `hydrogel_superpose500`. Half of the prior is like other responses (a wrong
/// place, width, depth), half changes of single channels.
const PRIOR_PRESSES: f64 = 10.0;
const PRIOR_ERROR: f64 = 0.8;
/// Spread of the logarithm of a press's squared error in the prior, squared.
const PRIOR_SPREAD: f64 = 0.25;
const FREEDOM: [f64; 2] = [4.0, 100.0];

/// Prior covariance of the errors of responses.
fn prior(responses: &Array2<f64>, variance: &Array1<f64>) -> Covariance {
    let squares = responses.mapv(|v| v * v).mean_axis(Axis(0)).unwrap_or_default();
    let whole = PRIOR_ERROR * squares.sum();
    let single = &squares + 0.3 * squares.mean().unwrap_or(0.0);
    let part = 0.5 * whole / variance.mean().unwrap_or(1.0);
    let own = &single * (part / single.sum());
    let alike = responses.t().dot(responses);
    let trace = alike.diag().sum().max(f64::MIN_POSITIVE);
    let all = alike * (part / trace) + Array2::from_diag(&own);
    Covariance { all, own }
}

/// Covariance of what is left of presses that were left out, and its degrees of freedom.
pub(super) fn error(
    shapes: &Array2<f64>,
    left: &LeftOut,
    responses: &Array2<f64>,
    variance: &Array1<f64>,
) -> Result<(Covariance, f64), InverseError> {
    let (presses, channels) = shapes.dim();
    let mut rest = shapes.clone();
    let predicted = left.predicted.rows().into_iter().zip(&left.variance);
    for (mut row, (predicted, variance)) in rest.rows_mut().into_iter().zip(predicted) {
        let square = predicted.dot(&predicted).max(1e-12);
        let strength = (row.dot(&predicted) / square).clamp(STRENGTH_RANGE[0], STRENGTH_RANGE[1]);
        let one_less = presses as f64 / (presses.max(2) - 1) as f64;
        row.zip_mut_with(&predicted, |u, p| {
            *u = (*u / strength - p) * (one_less / variance).sqrt()
        });
    }
    // the same weight for each: outlying presses
    let (unit, sizes) = unit_rows(&rest);
    let size = (sizes.iter().map(|s| s * s).sum::<f64>() / presses as f64).sqrt();
    let alike = unit * size;
    let prior = prior(responses, variance);
    let prior = Some((&prior, PRIOR_PRESSES));
    let covariance = shrunk(&alike, prior)?;
    // sizes of the presses by a covariance of the others
    let mut ratios = vec![0.0; presses];
    for fold in 0..presses.min(5) {
        let (held, others): (Vec<usize>, Vec<usize>) = (0..presses).partition(|k| k % 5 == fold);
        let others = shrunk(&alike.select(Axis(0), &others), prior)?;
        let whitening = inverse_of_factor(&others.all, "covariance of presses")?;
        let white = rest.select(Axis(0), &held).dot(&whitening.t());
        for (row, &press) in white.rows().into_iter().zip(&held) {
            ratios[press] = row.dot(&row) / channels as f64;
        }
    }
    let (k, w) = (presses as f64, PRIOR_PRESSES);
    let median = eit_core::median(ratios.iter().copied()).unwrap_or(1.0);
    let logarithms: Vec<f64> = ratios.iter().map(|q| q.max(1e-12).ln()).collect();
    let mean = logarithms.iter().sum::<f64>() / k;
    let spread = logarithms.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / k;
    let spread = (k * spread + w * PRIOR_SPREAD) / (k + w);
    // the logarithm of such a ratio has the variance 2 / freedom + 2 / channels
    let of_freedom = (spread - 2.0 / channels as f64).max(1e-3);
    let freedom = (2.0 / of_freedom).clamp(FREEDOM[0], FREEDOM[1]);
    Ok((covariance.scaled((k * median + w) / (k + w)), freedom))
}
