//! Touches frame by frame, recorded or live.

use super::background;
use super::choices::{Choices, FoundSheet};
use super::model::{Spread, VoltageNoise, dents, electrode_kinds, unknowns};
use super::score::{Linearised, ScoreFinder};
use super::source::Source;
use crate::error::SkinError;
use crate::faults::{ElectrodeFault, FaultMonitor};
use crate::fitted::FittedFrames;
#[cfg(feature = "learn")]
use crate::learn::Quiet;
use crate::learn::{LearnedSkin, LocalSheet};
use crate::progress::Progress;
use crate::scene::{Must, TouchModel, TouchSettings, check_numbers};
use eit_inverse::InverseError;
#[cfg(feature = "learn")]
use eit_inverse::touch::{DetectedTouch, LearntSettings};
use eit_inverse::touch::{
    DetectorModel, DetectorSettings, DetectorStep, Touch, TouchDetector, TouchTracker,
    TrackerSettings,
};
use ndarray::Array2;

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
    /// Touch in the frame named above.
    pub touch: DetectedTouch,
    /// Strength that it would have on an even sheet, S m^2, without sign: divided by the relative conductivity of
    /// the sheet there, as far as the reference frame shows it.
    pub even_strength_s_m2: f64,
}

/// Finds touches frame by frame.
#[derive(Debug, Clone)]
pub struct TouchFinder {
    /// What the finder chose, and why.
    pub choices: Choices,
    used: Vec<bool>,
    source: Source,
    tracker: TouchTracker,
    monitor: FaultMonitor,
    /// Whether the reference frame resembles the model; else touches explain frames by chance.
    is_alike: bool,
    /// Measurements that have recovered and wait for a frame without touches, to set their reference.
    waiting: Vec<bool>,
    #[cfg(feature = "learn")]
    local: LocalSheet,
    /// Finds the touches instead of the detector, if the scene asks for it.
    score: Option<Box<ScoreFinder>>,
    /// Reference of the current frame.
    reference: Vec<f64>,
    period_s: f64,
    before_s: Option<f64>,
    level_s: f64,
    step: Option<DetectorStep>,
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
            return Self::of_presses(fitted, rate_hz, learned, &noise, monitor, progress).map(Some);
        }
        Self::of_model(fitted, rate_hz, learned, noise, monitor, progress).map(Some)
    }

    /// Finds touches by the map that presses have taught.
    #[cfg(feature = "learn")]
    fn of_presses(
        fitted: &FittedFrames,
        rate_hz: f64,
        learned: &LearnedSkin,
        noise: &VoltageNoise,
        monitor: FaultMonitor,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let keys = &skin.skin.settings.touch;
        let std_v: Vec<f64> = noise.std_v.iter().map(|e| e * noise.with_reference).collect();
        let reference = &frames.reference;
        let default = LearntSettings::default();
        let settings = LearntSettings {
            max_touches: keys.max_touches.unwrap_or(default.max_touches),
            following: following_s(keys).map(|s| (1.0 / (s * rate_hz)).min(1.0)),
            ..default
        };
        let quiet = Quiet { reference, std_v: &std_v, rate_hz };
        let touches =
            progress.stage("detector of touches", || learned.touches(skin, quiet, settings))?;
        let [rows, places, _] = touches.sizes();
        let [low, high] = skin.skin.mesh.surface().bounds_m();
        let largest_m = (0..3).map(|k| high[k] - low[k]).fold(0.0, f64::max);
        let conductivity_s = skin.skin.conductivity_s / fitted.level();
        let least_s_m2 = detector_settings(keys, conductivity_s).least_s_m2;
        let bell_m2 = std::f64::consts::PI * learned.bell_m.powi(2);
        let tracker = TrackerSettings {
            // a place that is not known well is stated, not hidden
            max_position_std_m: largest_m,
            errs_alike: true,
            ..tracker_settings(keys, conductivity_s)
        };
        Ok(Self {
            choices: Choices {
                noise: noise.source.clone(),
                presses: Some(touches.presses),
                sheet: None,
                left_even: background::left_even(fitted),
                rows,
                places,
                blind: 0,
                radius_m: learned.bell_m,
                least_s_m2,
            },
            used: frames.used.clone(),
            tracker: TouchTracker::new(tracker)?,
            source: Source::Presses(Box::new(touches)),
            monitor,
            is_alike: fitted.fit.is_alike(),
            waiting: vec![false; frames.used.len()],
            local: LocalSheet::default(),
            score: None,
            reference: frames.reference.clone(),
            period_s: rate_hz.recip(),
            before_s: None,
            level_s: fitted.level() * least_s_m2 / bell_m2,
            step: None,
        })
    }

    /// Finds touches by the model.
    fn of_model(
        fitted: &FittedFrames,
        rate_hz: f64,
        learned: Option<&LearnedSkin>,
        noise: VoltageNoise,
        monitor: FaultMonitor,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let FittedFrames { skin, frames, .. } = fitted;
        let keys = &skin.skin.settings.touch;
        let leak_v = background::leak_v(fitted, &noise)?;
        let of_sheet = || background::of_reference(fitted, &noise, &leak_v);
        let sheet = progress.stage("background", of_sheet)?;
        let even_s = skin.skin.background_s();
        let (background_s, jacobian, voltages) = match &sheet {
            Some(sheet) => (&sheet.conductivity_s, &sheet.jacobian, &sheet.voltages),
            None => (&even_s, &skin.jacobian, &skin.voltages),
        };
        let score = match keys.model {
            TouchModel::OneScore => {
                let sheet = Linearised {
                    conductivity_s: background_s,
                    voltages,
                    jacobian,
                    leak_v: &leak_v,
                };
                let finder = ScoreFinder::new(fitted, &noise, sheet, &monitor, progress)?;
                Some(Box::new(finder))
            }
            TouchModel::Search => None,
        };
        let unknowns =
            unknowns(&skin.skin, background_s, &Spread::in_use(skin), &mut Progress::silent())?;
        let std_v: Vec<f64> = noise.std_v.iter().map(|e| e * noise.with_reference).collect();
        let quiet = match &frames.quiet {
            Some(quiet) => quiet.values.clone(),
            None => Array2::zeros((0, frames.used.len())),
        };
        let kinds = electrode_kinds(skin, unknowns.ncols())?;
        let model = DetectorModel {
            surface: skin.skin.mesh.surface(),
            jacobian,
            model_v: &voltages.to_vec(),
            unknowns: &unknowns,
            kinds: &kinds,
            reference_v: &frames.reference,
            noise_std_v: &std_v,
            quiet_v: quiet.view(),
            used: &frames.used,
            reciprocal: monitor.reciprocal(),
            of_electrode: monitor.of_electrode(),
        };
        // the detector takes voltages of g times the model's for a sheet of 1 / g of its conductivity
        let gain = fitted.level();
        let conductivity_s = skin.skin.conductivity_s / gain;
        let settings = detector_settings(keys, conductivity_s);
        // images are relative to the scene's conductivity
        let level_s =
            gain * settings.least_s_m2 / (std::f64::consts::PI * settings.radius_m.powi(2));
        let detector =
            progress.stage("detector of touches", || TouchDetector::new(&model, settings))?;
        let detector = match unknowns.ncols() == 1 {
            true => detector,
            false => {
                let movement_m = Spread::in_use(skin).movement_m;
                let places = detector.dent_places();
                let dents_v = progress
                    .stage("dents of touches", || dents(skin, background_s, &places, movement_m))?;
                detector.with_dents(&dents_v)?
            }
        };
        let local = sheet.as_ref().map_or_else(LocalSheet::default, |sheet| {
            LocalSheet::new(skin.skin.mesh.surface(), &sheet.conductivity_s, &even_s)
        });
        let forces = learned.map(|learned| Box::new(learned.model_forces(local.clone())));
        let (places, seen) = detector.places();
        Ok(Self {
            choices: Choices {
                noise: noise.source,
                presses: None,
                sheet: sheet.map(|sheet| FoundSheet {
                    amplitude: sheet.found.amplitude,
                    left_even: sheet.left[0],
                    left: sheet.left[1],
                }),
                left_even: background::left_even(fitted),
                rows: detector.rows(),
                places: seen,
                blind: places - seen,
                radius_m: detector.settings().radius_m,
                least_s_m2: detector.settings().least_s_m2,
            },
            used: frames.used.clone(),
            tracker: TouchTracker::new(tracker_settings(keys, conductivity_s))?,
            source: Source::Model { detector: Box::new(detector), forces },
            monitor,
            is_alike: fitted.fit.is_alike(),
            waiting: vec![false; frames.used.len()],
            #[cfg(feature = "learn")]
            local,
            score,
            reference: frames.reference.clone(),
            period_s: rate_hz.recip(),
            before_s: None,
            level_s,
            step: None,
        })
    }

    /// Continues the ids of another finder ([`TouchFinder::next_id`]), so that none is used twice.
    pub(crate) fn with_first_id(self, first: u64) -> Self {
        let score = self.score.map(|score| Box::new(score.with_first_id(first)));
        Self { tracker: self.tracker.with_first_id(first), score, ..self }
    }

    /// Returns the id that the next new touch will get.
    pub(crate) fn next_id(&self) -> u64 {
        if let Some(score) = &self.score {
            return score.next_id();
        }
        self.tracker.next_id()
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
        let measurements = self.used.len();
        SkinError::check_measurements("the frame", values.len(), measurements)?;
        let dt_s = self.before_s.map_or(self.period_s, |before_s| time_s - before_s);
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            let (quantity, must) = ("time since the last frame", "finite and above zero");
            return Err(InverseError::OutOfRange { quantity, value: dt_s, must }.into());
        }
        if self.score.is_some() {
            return self.push_score(values, is_good, [time_s, dt_s]);
        }
        let Self { used, monitor, waiting, source, reference, .. } = self;
        let faults = monitor.faults().len();
        monitor.push(values, source.reference_v(), is_good, time_s)?;
        if monitor.faults().len() > faults {
            source.take_back_reference();
        }
        // after an outage of the instrument old references hold
        let is_outage = 2 * monitor.healed().len() > measurements;
        monitor.healed().iter().for_each(|&i| waiting[i] = !is_outage);
        // a frame that nothing was seen in, or that nothing explains, is not one without a finger
        let is_seen = self.step.is_none_or(|step| step.rows > 0 && step.is_explained);
        if is_seen && source.is_empty() {
            // the reference of a recovered measurement is unknown; under a finger it would take on the error of the fit
            for i in (0..measurements).filter(|&i| !monitor.is_missing(i)) {
                if std::mem::take(&mut waiting[i]) {
                    source.set_reference(i, values[i]);
                }
            }
        }
        let is_faulty = |i: usize| {
            let of_electrode = monitor.of_electrode();
            let is_of = |fault: &ElectrodeFault| of_electrode[fault.electrode].contains(&i);
            !used[i] || monitor.faults().iter().any(is_of)
        };
        let is_missing = |i: usize| monitor.is_missing(i) || waiting[i];
        reference.copy_from_slice(source.reference_v());
        let is_whole =
            monitor.faults().is_empty() && (0..measurements).all(|i| !used[i] || !is_missing(i));
        let step = source.push(values, is_faulty, is_missing, dt_s)?;
        let faults = monitor.faults().len();
        monitor.blame(step.blamed, time_s)?;
        // a model that does not explain the reference explains no frame
        let is_judged = self.is_alike && !source.is_learnt();
        monitor.doubt(step.is_explained || !is_judged, time_s)?;
        if monitor.faults().len() > faults {
            // the next frame is the first one without it
            source.take_back_reference();
        }
        (self.before_s, self.step) = (Some(time_s), Some(step));
        match step.rows {
            0 => self.tracker.push_unseen(time_s)?,
            _ => self.tracker.push(self.source.found(), time_s, is_whole)?,
        };
        let source = &self.source;
        self.tracker.place(|point_m| source.nearest_on_skin(point_m));
        // what touches do not explain may be anything
        let is_valid = (self.is_alike || self.source.is_learnt()) && self.is_explained();
        Ok(match is_valid {
            true => self.tracker.touches(),
            false => self.tracker.invalidate(),
        })
    }

    /// The same by one score.
    fn push_score(
        &mut self,
        values: &[f64],
        is_good: impl Fn(usize) -> bool,
        [time_s, dt_s]: [f64; 2],
    ) -> Result<&[Touch], SkinError> {
        let Some(score) = &mut self.score else { return Ok(&[]) };
        self.reference.copy_from_slice(score.reference_v());
        self.before_s = Some(time_s);
        score.push(values, is_good, [time_s, dt_s])
    }

    /// Returns the strongest touch of a frame relative to a given reference, without tracking. `None` if there is no
    /// touch, or touches do not explain the frame, so that none would be valid.
    ///
    /// # Errors
    ///
    /// A frame or reference with the wrong length, or values that are not finite.
    #[cfg(feature = "learn")]
    pub(crate) fn strongest(
        &self,
        values: &[f64],
        reference: &[f64],
    ) -> Result<Option<PressTouch>, SkinError> {
        let measurements = self.used.len();
        SkinError::check_measurements("the frame", values.len(), measurements)?;
        let mut source = self.source.clone();
        reference.iter().enumerate().for_each(|(i, v)| source.set_reference(i, *v));
        let step = source.push(values, |i| !self.used[i], |_| false, self.period_s)?;
        if !(step.is_explained && (self.is_alike || source.is_learnt())) {
            return Ok(None);
        }
        let strength = |touch: &&DetectedTouch| touch.strength_s_m2.abs();
        let touches = source.found().iter();
        let strongest = touches.max_by(|a, b| strength(a).total_cmp(&strength(b))).copied();
        Ok(strongest.map(|touch| PressTouch {
            even_strength_s_m2: touch.strength_s_m2.abs() / self.local.ratio_at(touch.position_m),
            touch,
        }))
    }

    /// Sets the reference, `[measurement]`.
    #[cfg(feature = "learn")]
    pub(crate) fn set_reference(&mut self, reference: &[f64]) {
        reference.iter().enumerate().for_each(|(i, v)| self.source.set_reference(i, *v));
    }

    /// Returns how much a touch at each of the given positions lowers the chi^2 of the last frame, see
    /// [`TouchDetector::evidence_at`]; empty on a learnt skin.
    pub fn evidence_at(&mut self, positions_m: &[[f64; 3]]) -> Vec<f64> {
        match &mut self.source {
            Source::Model { detector, .. } => detector.evidence_at(positions_m),
            #[cfg(feature = "learn")]
            Source::Presses(_) => Vec::new(),
        }
    }

    /// Returns the electrodes that are excluded from the current frame.
    pub fn faults(&self) -> &[ElectrodeFault] {
        if let Some(score) = &self.score {
            return score.faults();
        }
        self.monitor.faults()
    }

    /// Returns whether a measurement of the current frame is excluded, because it is bad, its electrode is faulty, or
    /// its electrode has recovered under a touch that has not ended yet.
    pub fn is_missing(&self, measurement: usize) -> bool {
        if let Some(score) = &self.score {
            return score.is_missing(measurement);
        }
        let is_waiting = self.waiting.get(measurement).copied().unwrap_or(false);
        self.monitor.is_missing(measurement) || is_waiting
    }

    /// Returns whether the instrument repeats an old frame, so that nothing is known of the skin.
    pub fn is_frozen(&self) -> bool {
        if let Some(score) = &self.score {
            return score.is_frozen();
        }
        self.monitor.is_frozen()
    }

    /// Returns whether touches, or the absence of any, explain the last frame, and no electrode's gain does so better: a
    /// contact that gets worse looks like touches around its electrode until it is named. Nothing explains a frame of
    /// which no value counts.
    pub fn is_explained(&self) -> bool {
        if let Some(score) = &self.score {
            return score.is_explained();
        }
        let explains = |s: DetectorStep| s.rows > 0 && s.is_explained && s.blamed.is_none();
        self.step.is_none_or(explains)
    }

    /// Returns how the last frame was explained.
    pub fn step(&self) -> Option<DetectorStep> {
        if let Some(score) = &self.score {
            return score.step();
        }
        self.step
    }

    /// Returns the conductivity change of the faintest touch, siemens.
    pub(crate) fn level_s(&self) -> f64 {
        self.level_s
    }

    /// Returns the reference of the current frame, `[measurement]`.
    pub fn reference(&self) -> &[f64] {
        &self.reference
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

fn detector_settings(keys: &TouchSettings, conductivity_s: f64) -> DetectorSettings {
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
fn following_s(keys: &TouchSettings) -> Option<f64> {
    keys.drift_time_s.map(|s| if s == 0.0 { STANDS_STILL_S } else { s })
}

fn tracker_settings(keys: &TouchSettings, conductivity_s: f64) -> TrackerSettings {
    let strong_m2 = STRONG_M2.max(2.0 * keys.least_strength_m2.unwrap_or(0.0));
    let default = TrackerSettings::with_strong(strong_m2 * conductivity_s);
    TrackerSettings {
        max_touches: keys.max_touches.unwrap_or(default.max_touches),
        birth_frames: keys.birth_frames.unwrap_or(default.birth_frames),
        forgiven_frames: keys.forgiven_frames.unwrap_or(default.forgiven_frames),
        ..default
    }
}
