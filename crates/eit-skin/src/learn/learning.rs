//! Learns a skin from presses.

use super::earlier::Joined;
use super::model::{middle_m, places, radius_m, ratios, responses};
use super::presses::errors_of_detected;
use super::{Frame, HeldOut, LearnedSkin, PlaceErrors, PlacesBy, PressFrames, Quiet};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::linearised::LinearisedSkin;
use crate::progress::Progress;
use crate::touches::{DEFAULT_RATE_HZ, PressTouch, TouchFinder};
use eit_core::vector::{along, distance, sub};
use eit_inverse::learn::{ForceCurve, ForceSample, MapSettings, Orientation, Presses, ResponseMap};
use eit_inverse::noise_std_of_quiet_frames;
use eit_inverse::touch::{HeldPress, LearntDetector, LearntSettings, Stated};
use ndarray::{Array1, ArrayView1};

/// Radius of a touch if the scene states none, as a fraction of the skin's: 10 mm on one of 85.
const BELL_PART: f64 = 0.12;

/// Time from one press to the next where the frames do not tell it, seconds: that of a robot.
const INTERVAL_S: f64 = 10.0;

/// Smallest number of presses with a force and a touch.
const LEAST_FORCES: usize = 3;

/// A press is unlike the others if a touch at its best place leaves more than this fraction of it unexplained, ...
const UNLIKE_REST: f64 = 0.5;
/// ... and more than this multiple of what the median press leaves.
const UNLIKE_FACTOR: f64 = 3.0;

/// Fewest presses that must be placed better than their middle; fewer may be worse by chance.
const TELLING: usize = 10;

/// Presses in a robot's coordinates may reach beyond the skin by this factor: neither radius is known better.
const REACH: f64 = 1.1;

/// A learnt skin, and presses of the table that should be checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Learning {
    /// What was learnt from all presses.
    pub skin: LearnedSkin,
    /// Presses that contradict all others, perhaps because the skin was touched elsewhere.
    pub unlike: Vec<UnlikePress>,
    /// Presses with a force in whose frames no touch was found; their force is not learnt.
    pub without_touch: Vec<usize>,
}

/// A press that the others do not explain.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct UnlikePress {
    /// Index of the press in the table, from 0.
    pub press: usize,
    /// Fraction of its change, 0 to 1, that the touch found does not explain, judged by the other presses.
    pub rest: f64,
}

impl LearnedSkin {
    /// Learns from presses, together with those of an earlier file of the same skin.
    ///
    /// # Errors
    ///
    /// Fewer than four presses; places off the skin; frames without a change; duplicate frames (a press that
    /// is both learnt and tested has an error of zero); an earlier file of another skin, with other
    /// measurements, or whose places were obtained differently; ten presses or more of which nothing places those that are
    /// held out better than the middle of the others.
    pub fn learn(
        fitted: &FittedFrames,
        pressed: &PressFrames,
        frame: Frame,
        earlier: Option<&Self>,
        progress: &mut Progress,
    ) -> Result<Learning, SkinError> {
        let skin = &*fitted.skin;
        let joined = Joined::new(fitted, pressed, frame, earlier)?;
        let mut made = Self::start(fitted, pressed, frame, earlier, &joined)?;
        let model = made.model_responses(skin).map_err(|e| joined.located(e))?;
        let radius_m = radius_m(skin);
        let map = progress
            .stage("responses to presses", || {
                ResponseMap::choose(&made.presses, &made.levels, &model, radius_m)
            })
            .map_err(|e| joined.named(e))?;
        made.map = map.settings;
        let noise_std = made.noise_std(fitted);
        let rate_hz = fitted.frames.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
        let settings = LearntSettings::default();
        let detector = progress.stage("presses held out", || {
            let quiet = Quiet { reference: &made.levels, std_v: &noise_std, rate_hz };
            made.detector(skin, map, quiet, settings, None)
        })?;
        made.stated = detector.stated();
        let by_model = match frame {
            Frame::Scene => progress.stage("model alone", || by_model(fitted, pressed, &joined))?,
            Frame::Fitted => None,
        };
        made.judge(&detector, by_model.as_deref(), radius_m)?;
        let strengths = made.strengths(&detector, by_model.as_deref());
        made.force = made.learn_force(&strengths, middle_m(skin), radius_m)?;
        let without = (0..strengths.len())
            .filter(|&k| made.forces_n[k].is_some() && strengths[k].is_none())
            .filter_map(|k| k.checked_sub(joined.earlier));
        let without_touch = without.collect();
        let unlike = unlike(detector.held_presses(), joined.earlier);
        Ok(Learning { skin: made, unlike, without_touch })
    }

    /// The presses with their orientation, before anything is learnt from them.
    fn start(
        fitted: &FittedFrames,
        pressed: &PressFrames,
        frame: Frame,
        earlier: Option<&Self>,
        joined: &Joined,
    ) -> Result<Self, SkinError> {
        let skin = &*fitted.skin;
        let (presses, shift_m) =
            placed(skin, &joined.table, frame).map_err(|e| e.within(&pressed.place))?;
        let bell_m = skin.skin.settings.touch.radius_m.unwrap_or(BELL_PART * radius_m(skin));
        let level = |column: ArrayView1<'_, f64>| eit_core::median(column.iter().copied());
        let levels = joined.untouched.columns().into_iter().map(|of| level(of).unwrap_or(0.0));
        let of_table = pressed.interval_s.or(earlier.map(|earlier| earlier.interval_s));
        let mut made = Self {
            fingerprint: skin.skin.fingerprint.clone(),
            measurements: fitted.frames.used.len(),
            untouched: joined.untouched.clone(),
            interval_s: of_table.unwrap_or(INTERVAL_S),
            forces_n: joined.forces_n.clone(),
            map: MapSettings { length_m: bell_m, noise: 1.0, weak: 0.0, gain_pull: None },
            orientation: Orientation::of_model(1.0),
            stated: Stated::NONE,
            places_by: PlacesBy::Presses,
            force: None,
            levels: levels.collect(),
            channels: joined.channels.clone(),
            bell_m,
            frame,
            shift_m,
            presses,
            held_out: HeldOut::default(),
        };
        let found = made.oriented(skin, middle_m(skin), frame == Frame::Fitted)?;
        made.orientation = match frame {
            Frame::Fitted => found,
            Frame::Scene => Orientation::of_model(found.sign),
        };
        Ok(made)
    }

    /// The orientation of the model under places in a robot's coordinates; its sign alone if it is not turned.
    fn oriented(
        &self,
        skin: &LinearisedSkin,
        middle_m: [f64; 3],
        is_turned: bool,
    ) -> Result<Orientation, SkinError> {
        let (places_m, factors) = (places(skin), ratios(skin, &self.channels, &self.levels));
        let model = responses(skin, &self.channels, &factors, &places_m, self.bell_m)?;
        let scale = ResponseMap::scales(&self.presses.frames, &self.levels);
        let scale = Array1::from_vec(scale);
        let changes = &self.presses.frames / &scale;
        let model = model / &scale;
        let presses_m = &self.presses.places_m;
        Ok(Orientation::find(&changes, presses_m, &places_m, &model, middle_m, is_turned))
    }

    /// Noise of a frame minus the reference, `[channel]`: that of quiet frames, else that of the untouched skin between
    /// presses, else a hundredth of the changes.
    pub(super) fn noise_std(&self, fitted: &FittedFrames) -> Vec<f64> {
        let quiet = fitted.frames.quiet.as_ref();
        let quiet = quiet.and_then(|quiet| noise_std_of_quiet_frames(quiet.values.view()).ok());
        if let Some(std) = quiet {
            return self.channels.iter().map(|&i| std[i]).collect();
        }
        let steps = self.steps();
        let rows = if steps.nrows() > 0 { &steps } else { &(&self.presses.frames * 0.01) };
        let mean2 = |column: ArrayView1<'_, f64>| column.dot(&column) / rows.nrows() as f64;
        rows.columns().into_iter().map(|column| (0.5 * mean2(column)).sqrt()).collect()
    }

    /// States what held-out presses show, and chooses the better way.
    fn judge(
        &mut self,
        detector: &LearntDetector,
        by_model: Option<&[Option<PressTouch>]>,
        radius_m: f64,
    ) -> Result<(), SkinError> {
        let places_m = &self.presses.places_m;
        let held = detector.held_presses();
        let error_m = |held: &HeldPress| match held.is_shown {
            true => distance(held.position_m, places_m[held.press]),
            false => radius_m,
        };
        // only the latest session is what frames to come are like
        let latest = self.presses.sessions.iter().max();
        let is_latest = |press: usize| self.presses.sessions.get(press) == latest;
        let judged: Vec<&HeldPress> = held.iter().filter(|held| is_latest(held.press)).collect();
        let shown = judged.iter().filter(|held| held.is_shown).count();
        let presses = PlaceErrors::of_errors(judged.iter().map(|held| error_m(held)).collect());
        let middle = PlaceErrors::of_errors(errors_of_middle(places_m));
        let model = by_model.map(|found| {
            let errors = errors_of_detected(found, places_m, radius_m);
            let errors = errors.into_iter().enumerate().filter(|(press, _)| is_latest(*press));
            PlaceErrors::of_errors(errors.map(|(_, error)| error).collect())
        });
        self.held_out = HeldOut {
            model,
            presses,
            shown: shown as f64 / judged.len().max(1) as f64,
            middle,
            false_touches: detector.false_steps(),
        };
        let is_right = model.is_some_and(|model| model.mean_m <= presses.mean_m);
        self.places_by = if is_right { PlacesBy::Model } else { PlacesBy::Presses };
        let best = self.errors();
        if places_m.len() >= TELLING && best.mean_m >= middle.mean_m {
            let (error_m, middle_m) = (best.mean_m, middle.mean_m);
            return Err(SkinError::NothingLearnt { presses: places_m.len(), error_m, middle_m });
        }
        Ok(())
    }

    /// Strength of the touch of each press, by the way in which touches are found; `None` where none is.
    fn strengths(
        &self,
        detector: &LearntDetector,
        by_model: Option<&[Option<PressTouch>]>,
    ) -> Vec<Option<f64>> {
        // a touch of strength 0 is no touch
        let strength = |s: f64| (s > 0.0 && s.is_finite()).then_some(s);
        if let (PlacesBy::Model, Some(found)) = (self.places_by, by_model) {
            let of = |touch: &Option<PressTouch>| strength(touch.as_ref()?.even_strength_s_m2);
            return found.iter().map(of).collect();
        }
        let mut all = vec![None; self.presses.places_m.len()];
        for held in detector.held_presses() {
            all[held.press] = strength(held.strength_s_m2.abs());
        }
        all
    }

    /// Learns force against strength, if three presses state one.
    fn learn_force(
        &self,
        strengths: &[Option<f64>],
        middle_m: [f64; 3],
        radius_m: f64,
    ) -> Result<Option<ForceCurve>, SkinError> {
        let sample = |k: usize| {
            let (strength, force_n) = (strengths[k]?, self.forces_n[k]?);
            Some(ForceSample { strength, place_m: self.presses.places_m[k], force_n })
        };
        let samples: Vec<ForceSample> = (0..strengths.len()).filter_map(sample).collect();
        match samples.len() >= LEAST_FORCES {
            true => Ok(Some(ForceCurve::learn(&samples, middle_m, radius_m)?)),
            false => Ok(None),
        }
    }
}

/// The strongest valid touch of each press by the model alone; `None` if the noise is unknown.
fn by_model(
    fitted: &FittedFrames,
    pressed: &PressFrames,
    joined: &Joined,
) -> Result<Option<Vec<Option<PressTouch>>>, SkinError> {
    let rate_hz = fitted.frames.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
    let finder = TouchFinder::with_learned(fitted, rate_hz, None, &mut Progress::silent())?;
    let Some(finder) = finder else { return Ok(None) };
    let pairs = joined.pairs(fitted, pressed);
    let found = pairs.map(|[values, reference]| finder.strongest(&values, &reference));
    Ok(Some(found.collect::<Result<_, _>>()?))
}

/// Distance of each place from the mean of the others.
fn errors_of_middle(places_m: &[[f64; 3]]) -> Vec<f64> {
    let count = places_m.len() as f64;
    let sum: [f64; 3] = std::array::from_fn(|k| places_m.iter().map(|p| p[k]).sum());
    let others = |place: &[f64; 3]| std::array::from_fn(|k| (sum[k] - place[k]) / (count - 1.0));
    places_m.iter().map(|place| distance(*place, others(place))).collect()
}

/// Presses in the coordinates of the scene, and what was added to their places.
fn placed(
    skin: &LinearisedSkin,
    table: &Presses,
    frame: Frame,
) -> Result<(Presses, [f64; 3]), SkinError> {
    let middle_m = middle_m(skin);
    let shift_m = match frame {
        Frame::Scene => [0.0; 3],
        Frame::Fitted => sub(middle_m, middle_of(&table.places_m)),
    };
    let places_m = table.places_m.iter().map(|place| along(*place, 1.0, shift_m)).collect();
    let presses = Presses { places_m, ..table.clone() };
    if frame == Frame::Fitted {
        check_reach(&presses.places_m, middle_m, radius_m(skin))?;
    }
    Ok((presses, shift_m))
}

/// Middle of the bounding box.
fn middle_of(places_m: &[[f64; 3]]) -> [f64; 3] {
    let of = |fold: fn(f64, f64) -> f64, k: usize| {
        places_m.iter().map(|place| place[k]).reduce(fold).unwrap_or(0.0)
    };
    std::array::from_fn(|k| 0.5 * (of(f64::min, k) + of(f64::max, k)))
}

/// Rejects presses that reach farther than the skin: a wrong unit or radius.
fn check_reach(places_m: &[[f64; 3]], middle_m: [f64; 3], radius_m: f64) -> Result<(), SkinError> {
    let reach_m = places_m.iter().map(|place| distance(*place, middle_m)).fold(0.0, f64::max);
    if reach_m <= REACH * radius_m {
        return Ok(());
    }
    Err(SkinError::input(format!(
        "the presses reach {:.1} mm from their middle, the scene's skin {:.1} mm: places are in metres, and the skin must \
         be as large as the real one",
        1e3 * reach_m,
        1e3 * radius_m
    )))
}

/// New presses that the others do not explain.
fn unlike(held: &[HeldPress], earlier: usize) -> Vec<UnlikePress> {
    let median = eit_core::median(held.iter().map(|held| held.rest)).unwrap_or(0.0);
    let is_unlike = |held: &&HeldPress| held.rest > UNLIKE_REST.max(UNLIKE_FACTOR * median);
    let unlike = held.iter().filter(is_unlike);
    let new = unlike.filter_map(|held| Some((held.press.checked_sub(earlier)?, held.rest)));
    new.map(|(press, rest)| UnlikePress { press, rest }).collect()
}
