//! Touches frame by frame, recorded or live.

use super::background::Sheet;
#[cfg(feature = "learn")]
use super::by_presses;
use super::choices::Choices;
use super::model::VoltageNoise;
use super::{by_score, by_search};
use crate::error::SkinError;
use crate::faults::{ElectrodeFault, FaultMonitor};
use crate::fitted::FittedFrames;
use crate::learn::LearnedSkin;
use crate::progress::Progress;
use crate::scene::{Must, TouchModel, TouchSettings, check_numbers};
use eit_inverse::InverseError;
use eit_inverse::touch::{DetectorSettings, DetectorStep, Touch, TrackerSettings, Twins};
use std::fmt::Debug;

/// Minimum strength of a touch as an area of doubled conductivity, square metres: a finger of 0.2 N on the
/// paper's fabric has 2.5e-6, ghosts of its hysteresis less than 1e-6.
const LEAST_M2: f64 = 2e-6;
/// Strength of a touch that is accepted at once.
const STRONG_M2: f64 = 6e-6;

/// Time constant for a reference that does not follow: thirty years.
const STANDS_STILL_S: f64 = 1e9;

/// The strongest touch of a press.
#[cfg(feature = "learn")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PressTouch {
    /// Position on the skin, metres.
    pub position_m: [f64; 3],
    /// Strength that it would have on an even sheet, S m^2, without sign: divided by the relative conductivity of
    /// the sheet there, as far as the reference frame shows it.
    pub even_strength_s_m2: f64,
}

/// What finds the touches of frames: the model, or what presses have taught.
pub(super) trait Source: Debug + Send + Sync {
    /// Takes a frame `[measurement]`, volts, at a time, and the time since the last one, seconds.
    fn push(
        &mut self,
        values: &[f64],
        is_good: &dyn Fn(usize) -> bool,
        times_s: [f64; 2],
    ) -> Result<(), SkinError>;

    /// Touches of the last frame.
    fn touches(&self) -> &[Touch];

    /// Marks touches of the last frame as not valid.
    fn invalidate(&mut self, is_doubted: &dyn Fn(&Touch) -> bool);

    /// The strongest touch of a frame relative to a reference, without those of other frames; `None` if there is none, or none
    /// would be valid.
    #[cfg(feature = "learn")]
    fn strongest(
        &self,
        values: &[f64],
        reference_v: &[f64],
        period_s: f64,
    ) -> Result<Option<PressTouch>, SkinError>;

    /// Electrodes that are excluded from the last frame.
    fn faults(&self) -> &[ElectrodeFault];

    /// Whether a measurement of the last frame is excluded.
    fn is_missing(&self, measurement: usize) -> bool;

    /// Whether the instrument repeats an old frame.
    fn is_frozen(&self) -> bool;

    /// Whether touches, or the absence of any, explain the last frame.
    fn is_explained(&self) -> bool;

    /// How the last frame was explained.
    fn step(&self) -> Option<DetectorStep>;

    /// The reference that the last frame was compared with, `[measurement]`.
    fn reference(&self) -> &[f64];

    /// Sets the reference of the next frame, `[measurement]`.
    #[cfg(feature = "learn")]
    fn set_reference(&mut self, reference_v: &[f64]) -> Result<(), SkinError>;

    /// The id that the next new touch will get.
    fn next_id(&self) -> u64;

    /// Continues the ids of another source.
    fn set_next_id(&mut self, id: u64);

    fn boxed(&self) -> Box<dyn Source>;
}

impl Clone for Box<dyn Source> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}

/// Finds touches frame by frame.
#[derive(Debug, Clone)]
pub struct TouchFinder {
    /// What the finder chose, and why.
    pub choices: Choices,
    used: Vec<bool>,
    source: Box<dyn Source>,
    /// Places that the measurements cannot tell apart, if there are any.
    twins: Option<Twins>,
    period_s: f64,
    before_s: Option<f64>,
    level_s: f64,
}

impl TouchFinder {
    /// Creates a finder for frames like `fitted` at this rate; `None` if their noise is unknown.
    ///
    /// # Errors
    ///
    /// Invalid settings.
    pub fn new(
        fitted: &FittedFrames,
        rate_hz: f64,
        progress: &mut Progress,
    ) -> Result<Option<Self>, SkinError> {
        let skin = &*fitted.skin;
        let file = skin.skin.settings.touch.learned.as_ref();
        let learned = file.map(|file| LearnedSkin::read_for(file, skin)).transpose()?;
        Self::with_learned(fitted, rate_hz, learned.as_ref(), progress)
    }

    /// Creates a finder that uses what was learnt.
    pub(crate) fn with_learned(
        fitted: &FittedFrames,
        rate_hz: f64,
        learned: Option<&LearnedSkin>,
        progress: &mut Progress,
    ) -> Result<Option<Self>, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let Some(noise) = VoltageNoise::of(fitted)? else { return Ok(None) };
        let protocol = &skin.skin.protocol;
        let monitor = FaultMonitor::new(protocol, &frames.used, &noise.std_v, noise.step_v)?
            .with_lasting(&frames.faults)?;
        let monitor = match frames.quiet.as_ref().filter(|_| noise.is_measured) {
            Some(quiet) => monitor.with_quiet_frames(quiet.values.view())?,
            None => monitor,
        };
        #[cfg(feature = "learn")]
        if let Some(learned) = learned.filter(|learned| !learned.model_is_right()) {
            let made = by_presses::source(fitted, rate_hz, learned, &noise, monitor, progress)?;
            return Ok(Some(Self::with_source(fitted, rate_hz, made, None)));
        }
        let surface = skin.skin.mesh.surface();
        let radius_m = skin.skin.touch_radius_m();
        let find_twins = || Twins::find(surface, &skin.jacobian, &frames.used, radius_m);
        let twins = progress.stage("places that are alike", find_twins)?;
        let sheet = progress.stage("background", || Sheet::new(fitted, &noise))?;
        let made = match skin.skin.settings.touch.model {
            TouchModel::OneScore => {
                by_score::source(fitted, learned, &noise, &sheet, monitor, progress)?
            }
            TouchModel::Search => {
                by_search::source(fitted, learned, &noise, &sheet, monitor, progress)?
            }
        };
        Ok(Some(Self::with_source(fitted, rate_hz, made, Some(twins))))
    }

    fn with_source(
        fitted: &FittedFrames,
        rate_hz: f64,
        (source, mut choices): (Box<dyn Source>, Choices),
        twins: Option<Twins>,
    ) -> Self {
        choices.twins = twins.as_ref().map_or(0.0, Twins::share);
        // images are relative to the scene's conductivity
        let print_m2 = std::f64::consts::PI * choices.radius_m.powi(2);
        Self {
            level_s: fitted.level() * choices.least_s_m2 / print_m2,
            choices,
            used: fitted.frames.used.clone(),
            source,
            twins: twins.filter(|twins| twins.share() > 0.0),
            period_s: rate_hz.recip(),
            before_s: None,
        }
    }

    /// Continues the ids of another finder ([`TouchFinder::next_id`]), so that none is used twice.
    pub(crate) fn set_first_id(&mut self, first: u64) {
        self.source.set_next_id(first);
    }

    /// Returns the id that the next new touch will get.
    pub(crate) fn next_id(&self) -> u64 {
        self.source.next_id()
    }

    /// Takes a frame `[measurement]`, volts, and returns its touches. Faulty electrodes are excluded; the
    /// rest is compared with the reference, which follows what touches do not explain.
    ///
    /// # Errors
    ///
    /// A frame with the wrong length; a time that is not after the previous one. The finder is then
    /// unchanged.
    pub fn push(
        &mut self,
        values: &[f64],
        is_good: impl Fn(usize) -> bool,
        time_s: f64,
    ) -> Result<&[Touch], SkinError> {
        SkinError::check_measurements("the frame", values.len(), self.used.len())?;
        let dt_s = self.before_s.map_or(self.period_s, |before_s| time_s - before_s);
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            let (quantity, must) = ("time since the last frame", "finite and above zero");
            return Err(InverseError::OutOfRange { quantity, value: dt_s, must }.into());
        }
        self.source.push(values, &is_good, [time_s, dt_s])?;
        if let Some(twins) = &self.twins {
            self.source.invalidate(&|touch| twins.of(touch.position_m).is_some());
        }
        self.before_s = Some(time_s);
        Ok(self.source.touches())
    }

    /// Returns the strongest touch of a frame relative to a given reference, without tracking. `None` if there is no
    /// touch, or touches do not explain the frame, so that none would be valid.
    ///
    /// # Errors
    ///
    /// A frame or reference with the wrong length.
    #[cfg(feature = "learn")]
    pub(crate) fn strongest(
        &self,
        values: &[f64],
        reference: &[f64],
    ) -> Result<Option<PressTouch>, SkinError> {
        SkinError::check_measurements("the frame", values.len(), self.used.len())?;
        SkinError::check_measurements("the reference", reference.len(), self.used.len())?;
        self.source.strongest(values, reference, self.period_s)
    }

    /// Sets the reference of the next frame, `[measurement]`.
    ///
    /// # Errors
    ///
    /// A reference with the wrong length.
    #[cfg(feature = "learn")]
    pub(crate) fn set_reference(&mut self, reference: &[f64]) -> Result<(), SkinError> {
        SkinError::check_measurements("the reference", reference.len(), self.used.len())?;
        self.source.set_reference(reference)
    }

    /// Returns the electrodes that are excluded from the current frame.
    pub fn faults(&self) -> &[ElectrodeFault] {
        self.source.faults()
    }

    /// Returns whether a measurement of the current frame is excluded, because it is bad, its electrode is faulty, or
    /// its electrode has recovered under a touch that has not ended yet.
    pub fn is_missing(&self, measurement: usize) -> bool {
        self.source.is_missing(measurement)
    }

    /// Returns whether the instrument repeats an old frame, so that nothing is known of the skin.
    pub fn is_frozen(&self) -> bool {
        self.source.is_frozen()
    }

    /// Returns whether touches, or the absence of any, explain the last frame, and no electrode's gain does so better: a
    /// contact that gets worse looks like touches around its electrode until it is named. Nothing explains a frame of
    /// which no value counts.
    pub fn is_explained(&self) -> bool {
        self.source.is_explained()
    }

    /// Returns how the last frame was explained.
    pub fn step(&self) -> Option<DetectorStep> {
        self.source.step()
    }

    /// Returns the conductivity change of the faintest touch, siemens.
    pub(crate) fn level_s(&self) -> f64 {
        self.level_s
    }

    /// Returns the reference of the current frame, `[measurement]`.
    pub fn reference(&self) -> &[f64] {
        self.source.reference()
    }

    /// Returns which measurements are used.
    pub(crate) fn used(&self) -> &[bool] {
        &self.used
    }
}

impl TouchSettings {
    /// Rejects invalid settings before any work.
    ///
    /// # Errors
    ///
    /// An invalid setting; the message names it.
    pub fn validate(&self) -> Result<(), SkinError> {
        // beyond what any skin has: a slip of unit
        let radii = (1e-5..=1.0, "from 0.00001 to 1 (metres)");
        let distances = (1e-5..=10.0, "from 0.00001 to 10 (metres)");
        let times = (0.0..=f64::MAX, "above zero, or 0 for no drift");
        check_numbers([
            ("touch.radius_m", self.radius_m, Must::Within(radii)),
            ("touch.apart_m", self.apart_m, Must::Within(distances)),
            ("touch.drift_time_s", self.drift_time_s, Must::Within(times)),
        ])?;
        let refuse = |e| SkinError::input(format!("touch: {e}"));
        detector_settings(self, 1.0).validate().map_err(refuse)?;
        tracker_settings(self, 1.0).validate().map_err(refuse)
    }
}

pub(super) fn detector_settings(keys: &TouchSettings, conductivity_s: f64) -> DetectorSettings {
    let least_s_m2 = keys.least_strength_m2.unwrap_or(LEAST_M2) * conductivity_s;
    let default = DetectorSettings::with_least(least_s_m2);
    DetectorSettings {
        sign: keys.sign,
        max_touches: keys.max_touches.unwrap_or(default.max_touches),
        radius_m: keys.radius_m.unwrap_or(default.radius_m),
        apart_m: keys.apart_m.unwrap_or(default.apart_m),
        idle_s: following_s(keys).unwrap_or(default.idle_s),
        touched_s: following_s(keys).map_or(default.touched_s, |s| s.max(default.touched_s)),
        ..default
    }
}

/// Time constant with which the reference follows; 0 in a scene means so slow that it does not.
pub(super) fn following_s(keys: &TouchSettings) -> Option<f64> {
    keys.drift_time_s.map(|s| if s == 0.0 { STANDS_STILL_S } else { s })
}

pub(super) fn tracker_settings(keys: &TouchSettings, conductivity_s: f64) -> TrackerSettings {
    let strong_m2 = STRONG_M2.max(2.0 * keys.least_strength_m2.unwrap_or(0.0));
    let default = TrackerSettings::with_strong(strong_m2 * conductivity_s);
    TrackerSettings {
        max_touches: keys.max_touches.unwrap_or(default.max_touches),
        birth_frames: keys.birth_frames.unwrap_or(default.birth_frames),
        forgiven_frames: keys.forgiven_frames.unwrap_or(default.forgiven_frames),
        ..default
    }
}
