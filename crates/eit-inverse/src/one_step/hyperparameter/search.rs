//! Searches over log lambda.

use super::chosen::{ChosenHyperparameter, CurvePoint, HyperparameterStatus};

/// Points per decade of lambda. The filters change over a decade, so every feature of a curve spans
/// several points.
const POINTS_PER_DECADE: f64 = 8.0;

/// Relative width of the lambda bracket at which a search stops; no rule is meaningful to better
/// than a percent.
const RELATIVE_WIDTH: f64 = 1e-3;

/// Returns logarithmically spaced points from the lower to the upper end of a range.
pub(super) fn logarithmic_grid(range: [f64; 2]) -> Vec<f64> {
    let [low, high] = range.map(f64::ln);
    let steps = ((high - low) / std::f64::consts::LN_10 * POINTS_PER_DECADE).ceil().max(2.0);
    (0..=steps as usize).map(|k| (low + (high - low) * k as f64 / steps).exp()).collect()
}

/// Minimises `criterion` by golden section between the neighbours of the smallest point of its
/// curve.
pub(super) fn minimise(
    curve: Vec<CurvePoint>,
    criterion: impl Fn(f64) -> f64,
) -> ChosenHyperparameter {
    let best = (0..curve.len())
        .min_by(|&a, &b| curve[a].criterion.total_cmp(&curve[b].criterion))
        .unwrap_or(0);
    let point = curve[best];
    let (hyperparameter, status) = if best == 0 {
        (point.hyperparameter, HyperparameterStatus::AtLowerEdge)
    } else if best + 1 == curve.len() {
        (point.hyperparameter, HyperparameterStatus::AtUpperEdge)
    } else {
        let bracket = [curve[best - 1].hyperparameter, curve[best + 1].hyperparameter];
        (golden_section(bracket, &criterion), HyperparameterStatus::Interior)
    };
    ChosenHyperparameter { hyperparameter, status, criterion: criterion(hyperparameter), curve }
}

/// Golden-section search for a minimum in log lambda.
///
/// Source: Kiefer, *Proc. Amer. Math. Soc.* 4 (1953), 502-506.
fn golden_section(bracket: [f64; 2], criterion: impl Fn(f64) -> f64) -> f64 {
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let [mut a, mut b] = bracket.map(f64::ln);
    let (mut c, mut d) = (b - ratio * (b - a), a + ratio * (b - a));
    let (mut at_c, mut at_d) = (criterion(c.exp()), criterion(d.exp()));
    while b - a > RELATIVE_WIDTH {
        if at_c < at_d {
            (b, d, at_d) = (d, c, at_c);
            c = b - ratio * (b - a);
            at_c = criterion(c.exp());
        } else {
            (a, c, at_c) = (c, d, at_d);
            d = a + ratio * (b - a);
            at_d = criterion(d.exp());
        }
    }
    (0.5 * (a + b)).exp()
}
