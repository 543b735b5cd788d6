//! Touches of a skin that was learnt from presses.
//!
//! ```text
//! d = (frame - reference) / c      no touch: d ~ t(0, B);    touches: d ~ t(sum s_k d(x_k), B + sum s_k^2 v(x_k) S)
//! T = min -2 ln L(no touch, but any change of single channels) - min over x, s > 0 of -2 ln L(one touch)
//! ```
//!
//! `t` is Student's with the degrees of freedom of the [`ResponseMap`], `d(x)`, `v(x) S` its responses and their
//! covariance; `B` is the noise of quiet frames and the drift of the untouched skin between presses. Every decision is a
//! comparison of `-2 ln L`, and every threshold follows from stated error rates ([`LearntSettings`]).
//!
//! One eigenproblem, `S` against `B`, makes every covariance diagonal (`W B W' = 1`, `W S W' = diag(lambda)`): after
//! `z = W d`, for `2 n^2` flops a frame, a touch of any strength at any place costs `16 n`. With `n` = 190 channels and 400
//! coarse places, of which two strengths are tried, a frame without touches takes some 3 Mflop. A touch adds two searches for
//! another one, near and far, with three rounds in 70 places for each of both: some 9 more. The responses of 2 000 places,
//! 3 MB, are read near touches only. Nothing is allocated after set-up, except when the set of channels that count changes.
//!
//! | file | holds |
//! |---|---|
//! | `basis.rs` | the two bases in which covariances are diagonal |
//! | `places.rs` | places on the skin, coarse and fine |
//! | `evaluate.rs` | strength and score of a touch at many places |
//! | `candidate.rs` | a touch of a hypothesis, and where it is |
//! | `search.rs` | the touches of a frame |
//! | `reference.rs` | the reference |
//! | `thresholds.rs` | thresholds, and how far stated places of left-out presses are off |
//!
//! Source of the test: a likelihood ratio against a null with the same freedom, as in Robey et al., *IEEE Trans. Aerosp.
//! Electron. Syst.* 28 (1992), 208-216 (adaptive matched filter), with Student's distribution.

mod basis;
mod candidate;
mod evaluate;
mod places;
mod reference;
mod search;
mod settings;
mod thresholds;

pub use {
    settings::LearntSettings, settings::Untouched, thresholds::HeldPress, thresholds::Stated,
};

use super::{DetectedTouch, DetectorStep, LearntTouch};
use crate::InverseError;
use crate::check::{check_length, check_positive};
use crate::learn::{ResponseMap, shrunk};
use basis::Basis;
use eit_mesh::Surface;
use ndarray::{Array1, Array2, Axis};
use places::SkinPlaces;
use reference::Reference;
use search::{Looked, Search, Skin};
use thresholds::Thresholds;

/// Clipping of channels while touches are sought, in units of the largest change in learning: several touches add up, and
/// presses may be stronger than the learnt ones.
const CLIP: f64 = 4.0;
/// Evidence ratio that a tracker calls sure by default ([`TrackerSettings`](super::TrackerSettings)).
const SURE: f64 = 8.0;
/// Least variance of a channel's noise relative to the median one: a quiet channel is so by chance.
const LEAST_NOISE: f64 = 0.1;

/// Finds the touches of each frame of a learnt skin, against a reference that follows what is no touch.
#[derive(Debug, Clone)]
pub struct LearntDetector {
    map: ResponseMap,
    places: SkinPlaces,
    /// Noise and drift, `[channel, channel]`.
    background: Array2<f64>,
    basis: Basis,
    thresholds: Thresholds,
    search: Search,
    /// Conductivity change of a touch of strength 1 at each place, S m^2, with its sign.
    strength_s_m2: Vec<f64>,
    /// Sum of the bell of 1 S m^2 over its peak, square metres.
    bell_m2: f64,
    held: Vec<HeldPress>,
    false_steps: [usize; 2],
    reference: Reference,
    difference: Vec<f64>,
    is_missing: Vec<bool>,
    touches: Vec<DetectedTouch>,
}

impl LearntDetector {
    /// Prepares a map for frames of this untouched skin. `strength_s_m2` is the conductivity change that the model gives
    /// a touch of strength 1 at each place of the map, for forces and images; `bell_m` the radius of a touch. Without
    /// `stated`, the presses are held out to find it, which takes most of the time.
    ///
    /// # Errors
    /// Lengths that do not match, settings that are not above zero, values that are not finite.
    pub fn new(
        map: ResponseMap,
        surface: &Surface,
        untouched: &Untouched<'_>,
        strength_s_m2: Vec<f64>,
        bell_m: f64,
        settings: LearntSettings,
        stated: Option<Stated>,
    ) -> Result<Self, InverseError> {
        settings.validate()?;
        untouched.check(&map, strength_s_m2.len())?;
        check_positive("bell_m", bell_m)?;
        let channels = map.scale.len();
        let places = SkinPlaces::new(surface, &map.places_m);
        let noise = noise(untouched.noise_std, &map.scale);
        let steps = untouched.steps / &Array1::from_iter(map.scale.iter().copied());
        let drift = shrunk(&steps, None)?.all;
        let background = &noise + &drift;
        let mut search = Search::new(&map, &places, settings.max_touches);
        let unit = |background: &Array2<f64>| {
            let all: Vec<usize> = (0..channels).collect();
            Basis::new(&map.responses, &map.error, map.unit, background, &all, &places.coarse)
        };
        let mut thresholds = Thresholds::of_chance(&settings, untouched.rate_hz, &places, &map);
        let shown = thresholds.raise(&steps, untouched, &map, &places, &mut search, |others| {
            unit(&(&noise + &shrunk(others, None)?.all))
        })?;
        let basis = unit(&background)?;
        let mut held = match stated {
            Some(stated) => {
                thresholds.state(stated);
                Vec::new()
            }
            None => thresholds.hold_out(&map, &places, &basis, &mut search)?,
        };
        for press in &mut held {
            press.strength_s_m2 *= strength_s_m2[press.place];
        }
        let drift = drift.diag().sum() / noise.diag().sum();
        Ok(Self {
            reference: Reference::new(untouched, &settings, drift),
            bell_m2: std::f64::consts::PI * bell_m * bell_m,
            map,
            places,
            background,
            basis,
            thresholds,
            search,
            strength_s_m2,
            held,
            false_steps: [shown, steps.nrows()],
            difference: vec![0.0; channels],
            is_missing: vec![false; channels],
            touches: Vec::with_capacity(settings.max_touches),
        })
    }

    /// Returns where presses that were left out are found, for some of the presses, in order of time.
    pub fn held_presses(&self) -> &[HeldPress] {
        &self.held
    }

    /// Returns how places are stated.
    pub fn stated(&self) -> Stated {
        self.thresholds.stated
    }

    /// Returns in how many changes of the untouched skin a touch would be shown against a background of the others, and their
    /// number; the threshold is that of all.
    pub fn false_steps(&self) -> [usize; 2] {
        self.false_steps
    }

    /// Returns the touches of the last frame.
    pub fn touches(&self) -> &[DetectedTouch] {
        &self.touches
    }

    /// Returns the reference, `[channel]`.
    pub fn reference(&self) -> &[f64] {
        &self.reference.values
    }

    /// Sets the reference of a channel.
    pub fn set_reference(&mut self, channel: usize, value: f64) {
        if let Some(reference) = self.reference.values.get_mut(channel) {
            *reference = value;
        }
    }

    /// Forgets the frames that wait to enter the reference, as when an electrode turns out to be faulty.
    pub fn forget_waiting(&mut self) {
        self.reference.forget_waiting();
    }

    /// Returns the number of channels that count, of coarse places, and of all places.
    pub fn sizes(&self) -> [usize; 3] {
        [self.basis.channels.len(), self.places.coarse.len(), self.places.at.len()]
    }

    /// Leaves out channels of faulty electrodes from the next frame on; the bases are computed again if the set changes,
    /// which takes as long as 30 n^3 flops and allocates.
    ///
    /// # Errors
    /// [`InverseError::Factorisation`].
    pub fn leave_out(&mut self, is_faulty: impl Fn(usize) -> bool) -> Result<(), InverseError> {
        let channels = || (0..self.is_missing.len()).filter(|&i| !is_faulty(i));
        if channels().eq(self.basis.channels.iter().copied()) || channels().next().is_none() {
            return Ok(());
        }
        let channels: Vec<usize> = channels().collect();
        let Self { map, background, places, .. } = self;
        let error = crate::learn::Covariance {
            all: map.error.all.select(Axis(0), &channels).select(Axis(1), &channels),
            own: map.error.own.select(Axis(0), &channels),
        };
        let background = background.select(Axis(0), &channels).select(Axis(1), &channels);
        let responses = map.responses.select(Axis(1), &channels);
        self.basis =
            Basis::new(&responses, &error, map.unit, &background, &channels, &places.coarse)?;
        Ok(())
    }

    /// Takes a frame `[channel]` and returns how it is explained. A channel that is missing in this frame alone counts
    /// as what the touches of the others give it.
    ///
    /// # Errors
    /// A frame with the wrong length.
    pub fn push(
        &mut self,
        frame: &[f64],
        is_missing: impl Fn(usize) -> bool,
    ) -> Result<DetectorStep, InverseError> {
        check_length("the frame", frame.len(), self.is_missing.len())?;
        let mut missing = 0;
        for (i, value) in self.difference.iter_mut().enumerate() {
            let change = (frame[i] - self.reference.values[i]) / self.map.scale[i];
            let most = CLIP * self.map.most[i];
            self.is_missing[i] = is_missing(i) || !change.is_finite();
            *value = if self.is_missing[i] { 0.0 } else { change.clamp(-most, most) };
        }
        for &channel in &self.basis.channels {
            missing += usize::from(self.is_missing[channel]);
        }
        let rows = self.basis.channels.len() - missing;
        self.touches.clear();
        if 2 * rows < self.basis.channels.len() {
            self.reference.forget_waiting();
            return Ok(DetectorStep::new(0, [0.0; 2], false));
        }
        let mut found = self.look();
        if missing > 0 && found.touches > 0 {
            self.fill_in();
            found = self.look();
        }
        let is_explained = found.rest <= rows as f64 * self.thresholds.explained;
        self.report(found.touches, is_explained);
        let is_quiet = found.touches == 0
            && found.evidence < self.thresholds.freeze
            && found.whole <= self.basis.channels.len() as f64 * self.thresholds.changed;
        match is_quiet {
            true => self.reference.follow(frame, &self.is_missing),
            false => self.reference.forget_waiting(),
        }
        Ok(DetectorStep::new(rows, [found.whole, found.rest], is_explained))
    }

    /// Finds the touches of the difference.
    fn look(&mut self) -> Looked {
        let Self { search, basis, thresholds, map, places, difference, .. } = self;
        let of_places = map.variance.as_slice().unwrap_or_default();
        search.look(Skin { basis, of_places, places }, thresholds, difference)
    }

    /// Sets the missing channels to what the touches found give them.
    fn fill_in(&mut self) {
        for (i, value) in self.difference.iter_mut().enumerate() {
            if self.is_missing[i] {
                let responses = &self.map.responses;
                let found = self.search.found();
                let of = found.map(|(place, strength, _)| strength * responses[[place, i]]);
                *value = of.sum::<f64>() * self.map.unit;
            }
        }
    }

    /// Sets the touches of the frame.
    fn report(&mut self, touches: usize, is_explained: bool) {
        let Self { search, places, thresholds, .. } = self;
        for (k, (place, strength, evidence)) in search.found().take(touches).enumerate() {
            let (position_m, covariance_m2) =
                search.candidates()[k].place(places, &thresholds.stated);
            let strength_s_m2 = strength * self.strength_s_m2[place];
            let need = if k == 0 { thresholds.first } else { thresholds.more[0] };
            self.touches.push(DetectedTouch {
                position_m,
                normal: places.normal(places.nearest(position_m)),
                position_covariance_m2: covariance_m2,
                strength_s_m2,
                strength_std_s_m2: (strength_s_m2 * search.relative_std(k, &self.basis, &self.map))
                    .abs(),
                peak_s: strength_s_m2 / self.bell_m2,
                // the tracker reports at once what is worth as much as it calls sure, which all of these are
                worth: SURE * evidence / need,
                learnt: Some(LearntTouch { force_n: None, is_unlike: !is_explained }),
            });
        }
    }
}

/// Variance of the noise in units of the scales, on the diagonal.
fn noise(std: &[f64], scale: &[f64]) -> Array2<f64> {
    let variances: Vec<f64> = std.iter().zip(scale).map(|(s, c)| (s / c).powi(2)).collect();
    let finite = variances.iter().copied().filter(|v| v.is_finite());
    let median = eit_core::median(finite).unwrap_or(0.0).max(f64::MIN_POSITIVE);
    let noise: Array1<f64> = variances
        .iter()
        .map(|v| if v.is_finite() { v.max(LEAST_NOISE * median) } else { median })
        .collect();
    Array2::from_diag(&noise)
}
