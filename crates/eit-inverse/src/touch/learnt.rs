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
//! | `thresholds.rs` | thresholds, and how far stated places of left-out presses are off |
//!
//! Source of the test: a likelihood ratio against a null with the same freedom, as in Robey et al., *IEEE Trans. Aerosp.
//! Electron. Syst.* 28 (1992), 208-216 (adaptive matched filter), with Student's distribution.

mod basis;
mod candidate;
mod evaluate;
mod places;
mod search;
mod thresholds;

pub use thresholds::{HeldPress, Stated};

use super::{DetectedTouch, DetectorStep, LearntTouch};
use crate::InverseError;
use crate::check::{check_length, check_positive};
use crate::learn::{ResponseMap, shrunk};
use basis::Basis;
use eit_mesh::Surface;
use ndarray::{Array1, Array2, Axis};
use places::SkinPlaces;
use search::Search;
use thresholds::Thresholds;

/// Clipping of channels while touches are sought, in units of the largest change in learning: several touches add up, and
/// presses may be stronger than the learnt ones.
const CLIP: f64 = 4.0;
/// Evidence ratio that a tracker calls sure by default ([`TrackerSettings`](super::TrackerSettings)).
const SURE: f64 = 8.0;
/// Least variance of a channel's noise relative to the median one: a quiet channel is so by chance.
const LEAST_NOISE: f64 = 0.1;
/// Least weight of a new frame in the reference: that of one in a mean of 60.
const LEAST_FOLLOWING: f64 = 1.0 / 60.0;

/// Stated error rates, from which all thresholds follow.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LearntSettings {
    /// False touches a second on an untouched skin. Default: one an hour.
    pub alarms_hz: f64,
    /// Part of the untouched frames in which the reference may stand still by chance. Default 0.01.
    pub frozen: f64,
    /// Part of single touches that may show another one beside them. Default 0.01.
    pub extra: f64,
    /// Part of true touches that may count as not explained. Default 0.001.
    pub unexplained: f64,
    /// Time for which a frame must be followed by others without a touch before the reference takes it, seconds.
    /// Default 0.5.
    pub delay_s: f64,
    /// Most touches. Default 4.
    pub max_touches: usize,
    /// Weight of a new frame in the reference; `None` from noise and drift.
    pub following: Option<f64>,
}

impl Default for LearntSettings {
    fn default() -> Self {
        Self {
            alarms_hz: 1.0 / 3600.0,
            frozen: 0.01,
            extra: 0.01,
            unexplained: 1e-3,
            delay_s: 0.5,
            max_touches: 4,
            following: None,
        }
    }
}

impl LearntSettings {
    fn validate(&self) -> Result<(), InverseError> {
        check_positive("alarms_hz", self.alarms_hz)?;
        check_positive("frozen", self.frozen)?;
        check_positive("extra", self.extra)?;
        check_positive("unexplained", self.unexplained)?;
        check_positive("delay_s", self.delay_s)?;
        check_positive("max_touches", self.max_touches as f64)
    }
}

/// What is known of the untouched skin, in the unit of the presses.
#[derive(Debug, Clone, Copy)]
pub struct Untouched<'a> {
    /// Voltages, `[channel]`.
    pub reference: &'a [f64],
    /// Standard deviation of the noise of a frame minus the reference, `[channel]`.
    pub noise_std: &'a [f64],
    /// Changes of the untouched skin from one press to the next, `[interval, channel]`.
    pub steps: &'a Array2<f64>,
    /// Time from one press to the next, seconds.
    pub interval_s: f64,
    /// Frames a second.
    pub rate_hz: f64,
}

/// Quiet frames that have not entered the reference yet: the oldest is the next one once all slots are in use.
#[derive(Debug, Clone)]
struct Waiting {
    frames: Vec<Vec<f64>>,
    next: usize,
    count: usize,
}

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
    reference: Vec<f64>,
    following: f64,
    waiting: Waiting,
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
        let channels = map.scale.len();
        check_length("reference", untouched.reference.len(), channels)?;
        check_length("noise of the channels", untouched.noise_std.len(), channels)?;
        check_length("channels of the untouched skin", untouched.steps.ncols(), channels)?;
        check_length("strengths of the places", strength_s_m2.len(), map.places_m.len())?;
        check_positive("interval_s", untouched.interval_s)?;
        check_positive("rate_hz", untouched.rate_hz)?;
        check_positive("bell_m", bell_m)?;
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
        let frames = untouched.interval_s * untouched.rate_hz;
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
        let drift_part = drift.diag().sum() / noise.diag().sum() / frames;
        let following = 0.5 * ((drift_part * (drift_part + 4.0)).sqrt() - drift_part);
        let delay_frames = (settings.delay_s * untouched.rate_hz).ceil().min(1e4) as usize;
        let frames = (0..=delay_frames).map(|_| vec![0.0; channels]).collect();
        Ok(Self {
            following: settings.following.unwrap_or(following.max(LEAST_FOLLOWING)),
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
            reference: untouched.reference.to_vec(),
            waiting: Waiting { frames, next: 0, count: 0 },
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
        &self.reference
    }

    /// Sets the reference of a channel.
    pub fn set_reference(&mut self, channel: usize, value: f64) {
        if let Some(reference) = self.reference.get_mut(channel) {
            *reference = value;
        }
    }

    /// Forgets the frames that wait to enter the reference, as when an electrode turns out to be faulty.
    pub fn forget_waiting(&mut self) {
        self.waiting.count = 0;
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
        let channels = || (0..self.reference.len()).filter(|&i| !is_faulty(i));
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
        check_length("the frame", frame.len(), self.reference.len())?;
        let mut missing = 0;
        for (i, value) in self.difference.iter_mut().enumerate() {
            let change = (frame[i] - self.reference[i]) / self.map.scale[i];
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
            self.waiting.count = 0;
            return Ok(step(0, [0.0; 2], false));
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
        self.follow(frame, is_quiet);
        Ok(step(rows, [found.whole, found.rest], is_explained))
    }

    fn look(&mut self) -> search::Looked {
        let Self { search, basis, thresholds, map, places, difference, .. } = self;
        search.look(basis, map, places, thresholds, difference)
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

    /// Lets the reference follow a frame that has been quiet, and was followed by quiet ones for a while.
    fn follow(&mut self, frame: &[f64], is_quiet: bool) {
        let Waiting { frames, next, count } = &mut self.waiting;
        if !is_quiet {
            *count = 0;
            return;
        }
        let (slots, slot) = (frames.len(), &mut frames[*next]);
        if *count == slots {
            let waited = self.reference.iter_mut().zip(&*slot);
            for (reference, value) in waited.filter(|(_, value)| value.is_finite()) {
                *reference += self.following * (value - *reference);
            }
        }
        for ((to, value), missing) in slot.iter_mut().zip(frame).zip(&self.is_missing) {
            *to = if *missing { f64::NAN } else { *value };
        }
        (*next, *count) = ((*next + 1) % slots, (*count + 1).min(slots));
    }
}

fn step(rows: usize, [whole, rest]: [f64; 2], is_explained: bool) -> DetectorStep {
    DetectorStep {
        rows,
        chi_square: whole,
        chi_square_without: whole,
        chi_square_rest: rest,
        blamed: None,
        is_explained,
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
