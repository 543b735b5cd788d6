//! Parameters of a [`ResponseMap`] by cross-validation, and the remaining errors.
//!
//! Up to forty presses are dealt one by one, in order of time, to ten folds (leave-one-out for ten presses or
//! fewer). Each fold is located with a map learnt from the others. Everything is fitted again without the fold,
//! including gains and variances.
//!
//! More presses are left out one by one in closed form: one kernel serves all, and gains and variances, on which a
//! single press then has little influence, remain those of all presses.

use super::locate::posterior_of_misfits;
use super::presses::{ModelResponses, Presses};
use super::response_map::{Explained, Geometry, ResponseMap, ResponseMapSettings, UnitData, fit};
use crate::InverseError;
use crate::geometry::distance_m;
use ndarray::{Array2, Axis};

/// Most folds.
const FOLDS: usize = 10;
/// Most presses for which everything is fitted again without each fold.
const FEW_PRESSES: usize = 40;

/// Fewest presses to learn from.
pub(super) const LEAST_PRESSES: usize = 4;

/// Kernel lengths to try, as fractions of the presses' spread (root mean square distance from their mean).
const LENGTHS: [f64; 5] = [0.28, 0.4, 0.5, 0.7, 1.0];
const NOISES: [f64; 2] = [0.1, 0.3];
const PULLS: [Option<f64>; 3] = [None, Some(0.05), Some(0.5)];
const INDEPENDENT_CHANNELS: [f64; 4] = [8.0, 15.0, 30.0, 60.0];

/// Spread below which all presses are at one position, metres: a nanometre is far below any robot's step
/// and far above the rounding of coordinates.
const LEAST_SPREAD_M: f64 = 1e-9;

/// A press is unlike the learnt ones if its residual exceeds this many times the quantile below of the
/// residuals of held-out presses.
const UNLIKE: f64 = 1.5;
const UNLIKE_LEVEL: f64 = 0.95;

/// Distance between the position of each press and where it is located without it.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct FoldErrors {
    /// Error of each press, metres.
    pub errors_m: Vec<f64>,
}

impl FoldErrors {
    /// Returns the mean error, metres.
    pub fn mean_m(&self) -> f64 {
        self.errors_m.iter().sum::<f64>() / self.errors_m.len().max(1) as f64
    }

    /// Returns the median error, metres.
    pub fn median_m(&self) -> f64 {
        quantile(&self.errors_m, 0.5)
    }
}

/// Returns a quantile of finite values; 0 if there are none.
pub(super) fn quantile(values: &[f64], part: f64) -> f64 {
    eit_core::quantile(values, part).unwrap_or(0.0)
}

/// A learnt map and how it was chosen.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Choice {
    /// The map learnt from all presses.
    pub map: ResponseMap,
    /// Cross-validated errors of the presses.
    pub errors: FoldErrors,
    /// Fraction of each press's frame, 0 to 1, that no touch explains by the map of the other folds.
    pub rests: Vec<f64>,
    /// Number of parameter combinations tried.
    pub tried: usize,
}

/// Held-out presses located with one choice of parameters.
struct Held {
    errors_m: Vec<f64>,
    /// Mean squared error divided by the mean trace of the covariance.
    factor: f64,
}

impl ResponseMap {
    /// Learns a map from presses, with parameters that minimise the cross-validated mean distance.
    ///
    /// # Errors
    /// Fewer than four presses, all presses at one position, or non-finite frames or responses.
    pub fn learn(presses: &Presses, model: &ModelResponses) -> Result<Choice, InverseError> {
        presses.validate(LEAST_PRESSES)?;
        model.validate(presses)?;
        let spread_m = spread_m(&presses.places_m);
        if spread_m <= LEAST_SPREAD_M {
            return Err(InverseError::PressesAtOnePlace { presses: presses.places_m.len() });
        }
        let data = UnitData::new(presses, model);
        let folds = folds(presses);
        let (mut best, mut tried): (Option<(f64, ResponseMapSettings, Held)>, usize) = (None, 0);
        for length_m in LENGTHS.map(|part| part * spread_m) {
            for noise in NOISES {
                let kernels = kernels(presses, model, &folds, length_m, noise)?;
                for gain_pull in PULLS {
                    let misfits = held_misfits(&kernels, &data, gain_pull);
                    for independent_channels in INDEPENDENT_CHANNELS {
                        let held = locate(presses, model, &misfits, independent_channels);
                        let score = held.errors_m.iter().sum::<f64>();
                        tried += 1;
                        if best.as_ref().is_none_or(|(least, ..)| score < *least) {
                            let settings = ResponseMapSettings {
                                length_m,
                                noise,
                                gain_pull,
                                independent_channels,
                            };
                            best = Some((score, settings, held));
                        }
                    }
                }
            }
        }
        let Some((_, settings, held)) = best else {
            return Err(InverseError::PressesAtOnePlace { presses: presses.places_m.len() });
        };
        let mut map = Self::with_settings(presses, model, settings)?;
        map.covariance_factor = held.factor;
        let rests = held_rests(presses, model, &folds, &data, &settings)?;
        map.rest_limit = (UNLIKE * quantile(&rests, UNLIKE_LEVEL)).min(1.0);
        Ok(Choice { map, errors: FoldErrors { errors_m: held.errors_m }, rests, tried })
    }
}

/// Root mean square distance from the mean.
pub(super) fn spread_m(places_m: &[[f64; 3]]) -> f64 {
    let count = places_m.len().max(1) as f64;
    let middle: [f64; 3] =
        std::array::from_fn(|k| places_m.iter().map(|p| p[k]).sum::<f64>() / count);
    (places_m.iter().map(|p| distance_m(*p, middle).powi(2)).sum::<f64>() / count).sqrt()
}

/// Presses that are learnt, and presses of one session that are held out.
struct Fold {
    learnt: Vec<usize>,
    held: Vec<usize>,
    session: u32,
    /// Whether the held ones are among the learnt ones, from which each is left out in closed form.
    is_closed: bool,
}

/// Returns the folds; with presses of several sessions, those of each are held out on their own, because candidates
/// are of one session.
fn folds(presses: &Presses) -> Vec<Fold> {
    let total = presses.places_m.len();
    let mut sessions: Vec<u32> = (0..total).map(|press| presses.session(press)).collect();
    sessions.sort_unstable();
    sessions.dedup();
    let is_closed = total > FEW_PRESSES;
    let count = if is_closed { 1 } else { total.min(FOLDS) };
    let mut folds = Vec::new();
    for fold in 0..count {
        for &session in &sessions {
            let is_held = |press: &usize| press % count == fold;
            let held: Vec<usize> =
                (0..total).filter(|k| is_held(k) && presses.session(*k) == session).collect();
            let learnt = (0..total).filter(|press| is_closed || !is_held(press)).collect();
            if !held.is_empty() {
                folds.push(Fold { learnt, held, session, is_closed });
            }
        }
    }
    folds
}

/// A fold of the cross-validation, and the geometry of its presses.
struct Kernel<'a> {
    of: &'a Fold,
    geometry: Geometry,
}

fn kernels<'a>(
    presses: &Presses,
    model: &ModelResponses,
    folds: &'a [Fold],
    length_m: f64,
    noise: f64,
) -> Result<Vec<Kernel<'a>>, InverseError> {
    let kernel = |of: &'a Fold| {
        let learnt = presses.select(&of.learnt);
        let geometry = Geometry::new(&learnt, &model.candidates_m, of.session, length_m, noise)?;
        Ok(Kernel { of, geometry })
    };
    folds.iter().map(kernel).collect()
}

/// How well the presses of a fold are explained when they are held out.
fn explained(kernel: &Kernel<'_>, data: &UnitData, gain_pull: Option<f64>) -> Explained {
    let Kernel { of, geometry } = kernel;
    let [frames, model] = data.select(&of.learnt);
    let responses = fit(geometry, &frames, &model, &data.model_at_candidates, gain_pull);
    match of.is_closed {
        true => Explained::left_out(geometry, &responses, &frames, &of.held),
        false => {
            let held = data.frames.select(Axis(0), &of.held);
            Explained::new(geometry, &responses, &held)
        }
    }
}

/// Returns the misfits of every press when it is held out, `[press, candidate]`.
fn held_misfits(kernels: &[Kernel<'_>], data: &UnitData, gain_pull: Option<f64>) -> Array2<f64> {
    let shape = (data.frames.nrows(), data.model_at_candidates.nrows());
    let mut all = Array2::zeros(shape);
    for kernel in kernels {
        let of_fold = explained(kernel, data, gain_pull).misfits();
        for (row, &press) in of_fold.rows().into_iter().zip(&kernel.of.held) {
            all.row_mut(press).assign(&row);
        }
    }
    all
}

fn locate(
    presses: &Presses,
    model: &ModelResponses,
    misfits: &Array2<f64>,
    independent_channels: f64,
) -> Held {
    let scale = independent_channels / presses.frames.ncols() as f64;
    let (mut errors_m, mut squares, mut traces) = (Vec::new(), 0.0, 0.0);
    let mut weights = vec![0.0; model.candidates_m.len()];
    for (misfits, place) in misfits.rows().into_iter().zip(&presses.places_m) {
        weights.iter_mut().zip(misfits).for_each(|(w, m)| *w = scale * m);
        let found = posterior_of_misfits(&mut weights, &model.candidates_m);
        let error_m = distance_m(found.mean_m, *place);
        squares += error_m * error_m;
        traces += (0..3).map(|k| found.covariance_m2[k][k]).sum::<f64>();
        errors_m.push(error_m);
    }
    Held { errors_m, factor: if traces > 0.0 { squares / traces } else { 1.0 } }
}

/// Returns the fraction of each press that remains unexplained when it is held out.
fn held_rests(
    presses: &Presses,
    model: &ModelResponses,
    folds: &[Fold],
    data: &UnitData,
    settings: &ResponseMapSettings,
) -> Result<Vec<f64>, InverseError> {
    let ResponseMapSettings { length_m, noise, gain_pull, .. } = *settings;
    let mut all = vec![0.0; presses.places_m.len()];
    for kernel in &kernels(presses, model, folds, length_m, noise)? {
        let rests = explained(kernel, data, gain_pull).rests();
        for (rest, &press) in rests.into_iter().zip(&kernel.of.held) {
            all[press] = rest;
        }
    }
    Ok(all)
}
