//! Thresholds that follow from stated error rates, and how far stated places are off.

use super::basis::Basis;
use super::candidate::Candidate;
use super::places::SkinPlaces;
use super::search::{Search, Skin};
use super::{LearntSettings, ResponseMap, Untouched};
use crate::InverseError;
use crate::learn::{chi_square_level, f_level, folds, tail_level};
use ndarray::{Array2, Axis};

/// Fewest changes of the untouched skin from which thresholds are learnt, and their folds.
const LEAST_STEPS: usize = 6;
const STEP_FOLDS: usize = 5;
/// Most presses that are held out one after the other.
const HELD: usize = 300;
/// Divisors of -2 ln L, and standard deviations in parts of the skin's radius, that are tried for stated places.
const MILD: [f64; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];
const FLOORS: usize = 12;
const LEAST_FLOOR: f64 = 0.01;
/// Squared distance within which 90 % of a normal variable in the plane lie.
const WITHIN_90: f64 = 4.605;

/// A press that was found by a map that did not know it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct HeldPress {
    /// Index of the press.
    pub press: usize,
    /// Whether a valid touch shows it.
    pub is_shown: bool,
    /// Where it is found, metres.
    pub position_m: [f64; 3],
    /// Conductivity change that the model gives it, S m^2, with its sign.
    pub strength_s_m2: f64,
    /// Index of the nearest place of the map.
    pub(super) place: usize,
    /// Part of the frame, 0 to 1, that no touch anywhere explains.
    pub rest: f64,
}

/// How places are stated, and when a further touch is: what presses that were held out have shown.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Stated {
    /// Divisor of -2 ln L.
    pub mild: f64,
    /// Variance of a place that -2 ln L does not know of, square metres.
    pub floor_m2: f64,
    /// Factor of the covariance.
    pub wide: f64,
    /// -2 ln L that a touch near another one must gain, and one far from all others: an error of a response looks like
    /// another touch near it.
    pub beside: [f64; 2],
}

impl Stated {
    /// Before any press was held out.
    pub const NONE: Self = Self { mild: 1.0, floor_m2: 0.0, wide: 1.0, beside: [0.0; 2] };
}

#[derive(Debug, Clone)]
pub(super) struct Thresholds {
    /// -2 ln L that a first touch must gain, and a further one near others and far from them.
    pub(super) first: f64,
    pub(super) more: [f64; 2],
    /// Gain above which the reference stands still.
    pub(super) freeze: f64,
    /// Squared length per channel of an explained frame, and of one in which nothing has changed.
    pub(super) explained: f64,
    pub(super) changed: f64,
    pub(super) stated: Stated,
    more_by_chance: [f64; 2],
    settings: LearntSettings,
}

impl Thresholds {
    /// Those that a normal variable exceeds by chance at one of the coarse places.
    pub(super) fn of_chance(
        settings: &LearntSettings,
        rate_hz: f64,
        places: &SkinPlaces,
        map: &ResponseMap,
    ) -> Self {
        let coarse = places.coarse.len().max(1) as f64;
        let level = |probability: f64| chi_square_level(2.0 * probability / coarse);
        let first = level(settings.alarms_hz / rate_hz);
        // near another one as much as a first touch
        let more = [first, level(0.5 * settings.extra)];
        let [explained, changed] = Self::limits(settings, map.scale.len(), map.freedom);
        Self {
            first,
            more,
            freeze: level(settings.frozen),
            explained,
            changed,
            stated: Stated::NONE,
            more_by_chance: more,
            settings: *settings,
        }
    }

    /// Raises them by changes of the untouched skin in units of the scales, each judged by a background that did not see
    /// it. Returns in how many a touch would be shown.
    pub(super) fn raise(
        &mut self,
        steps: &Array2<f64>,
        untouched: &Untouched<'_>,
        map: &ResponseMap,
        places: &SkinPlaces,
        search: &mut Search,
        basis_of: impl Fn(&Array2<f64>) -> Result<Basis, InverseError>,
    ) -> Result<usize, InverseError> {
        let count = steps.nrows();
        if count < LEAST_STEPS {
            return Ok(0);
        }
        let variance = map.variance.to_vec();
        let mut gains = Vec::with_capacity(count);
        for fold in 0..STEP_FOLDS {
            let (held, others): (Vec<usize>, Vec<usize>) =
                (0..count).partition(|k| k % STEP_FOLDS == fold);
            let basis = basis_of(&steps.select(Axis(0), &others))?;
            let skin = Skin { basis: &basis, of_places: &variance, places };
            for k in held {
                let step = steps.row(k).to_vec();
                gains.push(search.first(skin, &step).0);
            }
        }
        let probability = (self.settings.alarms_hz * untouched.interval_s).min(0.5);
        self.first = self.first.max(tail_level(&gains, probability));
        self.freeze = self.freeze.max(tail_level(&gains, self.settings.frozen));
        Ok(gains.iter().filter(|gain| **gain >= self.first).count())
    }

    /// Finds presses by maps that do not know them; sets the threshold of further touches, and how places are stated.
    pub(super) fn hold_out(
        &mut self,
        map: &ResponseMap,
        places: &SkinPlaces,
        basis: &Basis,
        search: &mut Search,
    ) -> Result<Vec<HeldPress>, InverseError> {
        let (mut held, mut kept) = (Vec::new(), Vec::new());
        let mut seconds = [Vec::new(), Vec::new()];
        for fold in folds(map.presses_m.len(), HELD) {
            let (responses, variance) = map.without(&fold)?;
            let variance = variance.to_vec();
            let without = basis.with_responses(&responses, map.unit);
            let skin = Skin { basis: &without, of_places: &variance, places };
            for &press in &fold {
                let change = map.changes.row(press).to_vec();
                let (gained, rest) = search.first(skin, &change);
                let Some(found) = search.first_found(skin) else { continue };
                let (place, strength) = (found.place, found.strength);
                kept.push((held.len(), found.clone()));
                let is_explained = rest <= change.len() as f64 * self.explained;
                held.push(HeldPress {
                    press,
                    is_shown: gained >= self.first && is_explained,
                    position_m: places.at[place].position_m,
                    strength_s_m2: strength,
                    place,
                    rest: rest_part(&change, &responses, place),
                });
                for (is_far, seconds) in [false, true].into_iter().zip(&mut seconds) {
                    seconds.push(search.second(skin, is_far));
                }
            }
        }
        let beside = seconds.map(|gains| tail_level(&gains, 0.5 * self.settings.extra));
        self.state(Stated { beside, ..Self::best_stated(map, places, &kept, &held) });
        for (k, found) in &kept {
            held[*k].position_m = found.place(places, &self.stated).0;
        }
        held.sort_unstable_by_key(|held| held.press);
        Ok(held)
    }

    /// Sets how places are stated, and the threshold of further touches.
    pub(super) fn state(&mut self, stated: Stated) {
        self.stated = stated;
        self.more = [0, 1].map(|far| self.more_by_chance[far].max(stated.beside[far]));
    }

    /// Chooses how places are stated by a proper score, that of a t distribution of 4 degrees of freedom.
    fn best_stated(
        map: &ResponseMap,
        places: &SkinPlaces,
        kept: &[(usize, Candidate)],
        held: &[HeldPress],
    ) -> Stated {
        let radius_m =
            (places.cells_m2[0] * 12.0 * places.at.len() as f64 / std::f64::consts::PI).sqrt();
        let count = kept.len() as f64;
        let mut best = (f64::INFINITY, Stated::NONE);
        for mild in MILD {
            for step in 0..FLOORS {
                let floor_m = match step {
                    0 => 0.0,
                    _ => LEAST_FLOOR * radius_m * 2.0_f64.powf(0.5 * (step - 1) as f64),
                };
                let tried = Stated { mild, floor_m2: floor_m * floor_m, ..Stated::NONE };
                let of = |(k, found): &(usize, Candidate)| {
                    let truth_m = map.presses_m[held[*k].press];
                    found.distance2(truth_m, places, &tried)
                };
                let found: Vec<(f64, f64)> = kept.iter().map(of).collect();
                let score = found.iter().map(|(d2, size)| size.ln() + 6.0 * (0.25 * d2).ln_1p());
                let score = score.sum::<f64>() / count;
                if score < best.0 {
                    let distances: Vec<f64> = found.iter().map(|(d2, _)| *d2).collect();
                    let part = (0.9 + 0.15 / count.sqrt()).min(1.0);
                    let reach = eit_core::quantile(&distances, part).unwrap_or(0.0) / WITHIN_90;
                    let wide = reach.clamp(1.0, 9.0).powf(count / (count + 5.0));
                    best = (score, Stated { wide, ..tried });
                }
            }
        }
        best.1
    }

    /// Limits of the squared length per channel: of an explained frame, and of one without a change.
    fn limits(settings: &LearntSettings, channels: usize, freedom: f64) -> [f64; 2] {
        [settings.unexplained, settings.frozen].map(|part| f_level(part, channels as f64, freedom))
    }
}

/// Part of a change that the response at a place does not explain, by squared length.
fn rest_part(change: &[f64], responses: &Array2<f64>, place: usize) -> f64 {
    let response = responses.row(place);
    let (mut product, mut square, mut whole) = (0.0, 0.0, 0.0);
    for (c, r) in change.iter().zip(response) {
        product += c * r;
        square += r * r;
        whole += c * c;
    }
    let explained = product * product / (square * whole).max(f64::MIN_POSITIVE);
    (1.0 - explained).clamp(0.0, 1.0)
}
