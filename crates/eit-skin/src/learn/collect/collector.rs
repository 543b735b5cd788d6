//! From frames to presses at the places that are asked for.
//!
//! Over 300 lines because one state machine has its settings and its answers here.

use super::places::press_places;
use super::watch::{Values, Watch, good_values};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::frames::of_frames;
use crate::learn::{Frame as PlaceFrame, LearnedSkin, Learning, Press, PressFrames};
use crate::linearised::LinearisedSkin;
use crate::progress::Progress;
use crate::skin::Skin;
use eit_hw::{Frame, Unit};
use ndarray::Array2;
use std::sync::Arc;

/// Smallest number of frames of the untouched skin, and the time that they span if the frames tell, seconds.
const UNTOUCHED_FRAMES: usize = 8;
const UNTOUCHED_S: f64 = 2.0;
/// Assumed frame rate if neither the instrument nor a clock tells, hertz.
const DEFAULT_RATE_HZ: f64 = 20.0;
/// How presses are collected.
#[derive(Debug, Clone, PartialEq)]
pub struct CollectSettings {
    /// Largest number of presses.
    pub presses: usize,
    /// Known forces, used in turn: press k has force k modulo their number, newtons. Empty if unknown.
    pub forces_n: Vec<f64>,
    /// Time for which a press must be held, seconds.
    pub hold_s: f64,
    /// Whether the places are the scene's.
    pub frame: PlaceFrame,
}

impl Default for CollectSettings {
    fn default() -> Self {
        Self { presses: 100, forces_n: Vec::new(), hold_s: 0.5, frame: PlaceFrame::Scene }
    }
}

impl CollectSettings {
    /// Checks every number.
    ///
    /// # Errors
    /// No press, a force that is not above zero, or a time outside 0.05 to 60 s.
    pub fn validate(&self) -> Result<(), SkinError> {
        if self.presses == 0 {
            return Err(SkinError::input("presses is 0: it must be above 0"));
        }
        if let Some(force) = self.forces_n.iter().find(|f| !(**f > 0.0 && f.is_finite())) {
            return Err(SkinError::input(format!("force_n is {force}: it must be above 0")));
        }
        if !(0.05..=60.0).contains(&self.hold_s) {
            return Err(SkinError::input(format!(
                "hold_s is {}: it must be 0.05 to 60",
                self.hold_s
            )));
        }
        Ok(())
    }
}

/// A press that the program asks the user for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AskedPress {
    /// Number of the press, from 0.
    pub number: usize,
    /// Place, metres.
    pub place_m: [f64; 3],
    /// Force, newtons, if it is known beforehand.
    pub force_n: Option<f64>,
}

/// A press that was made.
#[derive(Debug, Clone, PartialEq)]
pub struct CollectedPress {
    /// Its line of the table. Frames are counted over all frames of the recording.
    pub press: Press,
    /// Mean of its frames, `[measurement]`, in the instrument's unit; NaN if no frame has a good value.
    pub values: Vec<f64>,
    /// Mean of the frames of the untouched skin before it, likewise.
    pub reference: Vec<f64>,
}

/// State after a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Collecting {
    /// Frames of the untouched skin are still needed: it must not be touched.
    Measuring,
    /// A moment without a touch is still needed before the next press.
    Settling,
    /// Nothing touches the skin; the press that is asked for may begin.
    Waiting,
    /// The skin is touched, and the touch moves or its force changes.
    Unsteady,
    /// The press was held and is collected. Reported once per press.
    Collected,
    /// A press was held but cannot be used: it began too soon after the last one, or values are missing. Reported once.
    Refused,
    /// The press is still held.
    Held,
}

/// Collects presses frame by frame.
///
/// It first takes frames of the untouched skin (two seconds). A press is collected once it has been held for
/// [`hold_s`](CollectSettings::hold_s); before the next one nothing may touch the skin for as long.
#[derive(Debug)]
pub struct PressCollector {
    skin: Arc<LinearisedSkin>,
    settings: CollectSettings,
    unit: Unit,
    rate_hz: Option<f64>,
    places_m: Vec<[f64; 3]>,
    presses: Vec<CollectedPress>,
    /// Number of frames so far.
    frames: usize,
    untouched: Vec<Frame>,
    watch: Option<Watch>,
    fitted: Option<FittedFrames>,
}

impl PressCollector {
    /// Creates a collector for frames in a unit, with the frame rate if it is known. `presses` are earlier ones of
    /// the same recording, which has `frames` frames so far; empty and 0 for a new one.
    ///
    /// # Errors
    /// Invalid settings, or earlier presses of another number of measurements.
    pub fn new(
        skin: &Arc<LinearisedSkin>,
        unit: Unit,
        rate_hz: Option<f64>,
        settings: CollectSettings,
        presses: Vec<CollectedPress>,
        frames: usize,
    ) -> Result<Self, SkinError> {
        settings.validate()?;
        let measurements = skin.skin.protocol.measurements();
        for press in &presses {
            SkinError::check_measurements("an earlier press", press.values.len(), measurements)?;
            SkinError::check_measurements("an earlier press", press.reference.len(), measurements)?;
        }
        let mut skin = (**skin).clone();
        // quiet frames of the scene's recording are not among these
        skin.skin.settings.noise.quiet_frames = None;
        Ok(Self {
            places_m: press_places(&skin.skin.mesh),
            skin: Arc::new(skin),
            settings,
            unit,
            rate_hz,
            presses,
            frames,
            untouched: Vec::new(),
            watch: None,
            fitted: None,
        })
    }

    /// Returns the press that is asked for; `None` once all have been made.
    pub fn asked(&self) -> Option<AskedPress> {
        let number = self.presses.len();
        if number >= self.settings.presses {
            return None;
        }
        let forces = &self.settings.forces_n;
        Some(AskedPress {
            number,
            // a second round over a small skin repeats places
            place_m: *self.places_m.get(number % self.places_m.len().max(1))?,
            force_n: (!forces.is_empty()).then(|| forces[number % forces.len()]),
        })
    }

    /// Returns the presses so far.
    pub fn presses(&self) -> &[CollectedPress] {
        &self.presses
    }

    /// States the force of the last press, newtons, as read from a scale after it.
    ///
    /// # Errors
    /// A force that is not above zero.
    pub fn set_last_force(&mut self, force_n: f64) -> Result<(), SkinError> {
        if !(force_n > 0.0 && force_n.is_finite()) {
            return Err(SkinError::input(format!("a force of {force_n} N: it must be above 0")));
        }
        if let Some(last) = self.presses.last_mut() {
            last.press.force_n = Some(force_n);
        }
        Ok(())
    }

    /// Forgets the untouched skin, for example after the instrument was lost: it is measured again.
    pub fn restart(&mut self) {
        self.untouched.clear();
        self.watch = None;
    }

    /// Takes the next frame of the recording.
    ///
    /// # Errors
    /// A frame with the wrong length; an untouched skin to which the model cannot be fitted.
    pub fn push(&mut self, frame: &Frame) -> Result<Collecting, SkinError> {
        SkinError::check_frame(frame, self.skin.skin.protocol.measurements())?;
        self.frames += 1;
        if self.watch.is_none() {
            self.untouched.push(frame.clone());
            if self.has_untouched() {
                self.begin()?;
            }
            return Ok(Collecting::Measuring);
        }
        let (number, asked) = (self.frames - 1, self.asked());
        let Some(watch) = &mut self.watch else { return Ok(Collecting::Measuring) };
        let state = watch.push(good_values(frame), number);
        if state != Collecting::Collected {
            return Ok(state);
        }
        let used = self.fitted.as_ref().map(|fitted| fitted.frames.used.clone());
        let Some((asked, made)) = asked.zip(watch.press(number)) else {
            return Ok(Collecting::Refused);
        };
        let is_whole = |values: &Values| {
            let used = used.iter().flatten();
            values.iter().zip(used).all(|(value, used)| !*used || value.is_finite())
        };
        let CollectedPress { values, reference, .. } = &made;
        if !(is_whole(values) && is_whole(reference)) {
            return Ok(Collecting::Refused);
        }
        let [x_m, y_m, z_m] = asked.place_m;
        let (z_m, force_n) = ((z_m != 0.0).then_some(z_m), asked.force_n);
        let press = Press { x_m, y_m, z_m, force_n, ..made.press };
        self.presses.push(CollectedPress { press, ..made });
        Ok(Collecting::Collected)
    }

    /// Whether the frames of the untouched skin are enough.
    fn has_untouched(&self) -> bool {
        let frames = &self.untouched;
        if frames.len() < UNTOUCHED_FRAMES {
            return false;
        }
        match (self.rate_hz, span_s(frames)) {
            (Some(rate_hz), _) => frames.len() as f64 >= UNTOUCHED_S * rate_hz,
            (None, Some(span_s)) => span_s >= UNTOUCHED_S,
            (None, None) => frames.len() as f64 >= UNTOUCHED_S * DEFAULT_RATE_HZ,
        }
    }

    /// Begins to watch for presses.
    fn begin(&mut self) -> Result<(), SkinError> {
        let frames = std::mem::take(&mut self.untouched);
        let steps = (frames.len() - 1) as f64;
        let rate_hz = self.rate_hz.or_else(|| Some(steps / span_s(&frames)?));
        let rate_hz = rate_hz.unwrap_or(DEFAULT_RATE_HZ);
        let values = frames.iter().map(good_values).collect();
        let watch = Watch::new(values, self.settings.hold_s, rate_hz, self.frames)?;
        let measured = of_frames(&frames, self.unit);
        let mut fitted = self.skin.fit(self.skin.skin.frames_of_quiet(measured)?)?;
        fitted.frames.rate_hz.get_or_insert(rate_hz);
        self.fitted = Some(fitted);
        self.watch = Some(watch);
        Ok(())
    }

    /// Returns the presses in the form in which they are learnt, and the untouched skin; `None` before it is measured.
    pub fn pressed(&self) -> Option<(&FittedFrames, PressFrames)> {
        let fitted = self.fitted.as_ref()?;
        let measurements = fitted.frames.used.len();
        let factor = self.factor();
        let rows = |of: fn(&CollectedPress) -> &Values| {
            Array2::from_shape_fn((self.presses.len(), measurements), |(press, i)| {
                let value = factor * of(&self.presses[press])[i];
                // arbitrary, since it is not used
                if value.is_finite() { value } else { fitted.frames.reference[i] }
            })
        };
        let table = || self.presses.iter().map(|collected| &collected.press);
        let pressed = PressFrames {
            values: rows(|press| &press.values),
            references: rows(|press| &press.reference),
            places_m: table().map(|p| [p.x_m, p.y_m, p.z_m.unwrap_or(0.0)]).collect(),
            forces_n: table().map(|p| p.force_n).collect(),
            interval_s: crate::learn::interval_s(
                &table().cloned().collect::<Vec<_>>(),
                fitted.frames.rate_hz,
            ),
            // after the header
            lines: (2..self.presses.len() + 2).collect(),
            place: "table of presses".to_owned(),
        };
        Some((fitted, pressed))
    }

    /// Learns from the presses so far, together with those of an earlier file.
    ///
    /// # Errors
    /// Those of [`LearnedSkin::learn`]; fewer than four presses.
    pub fn learn(
        &self,
        earlier: Option<&LearnedSkin>,
        progress: &mut Progress,
    ) -> Result<Learning, SkinError> {
        let Some((fitted, pressed)) = self.pressed() else {
            return Err(SkinError::input("the untouched skin has not been measured yet"));
        };
        LearnedSkin::learn(fitted, &pressed, self.settings.frame, earlier, progress)
    }

    /// Factor from the instrument's unit to volts of the scene.
    fn factor(&self) -> f64 {
        Skin::live_factor(&self.skin.skin, self.unit)
    }
}

/// Time from the first to the last frame, seconds, if their clocks tell.
fn span_s(frames: &[Frame]) -> Option<f64> {
    let (first, last) = (frames.first()?, frames.last()?);
    let by = |time: fn(&Frame) -> Option<f64>| Some(time(last)? - time(first)?);
    by(|frame| frame.device_time_s)
        .or_else(|| by(|frame| frame.host_time_s))
        .filter(|span| *span > 0.0)
}
