//! Learns a skin from presses.

use super::earlier::Joined;
use super::model::{middle_m, radius_m, ratios, responses};
use super::presses::{errors_of_detected, strongest};
use super::{
    CANDIDATES, ErrorsByWay, Frame, LearnedForce, LearnedSkin, PlaceErrors, PlacesBy, PressFrames,
    StrengthBy,
};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::progress::Progress;
use crate::touches::PressTouch;
use eit_inverse::InverseError;
use eit_inverse::learn::{
    Choice, ForceCurve, ForceSample, Locator, ModelResponses, PlaceRegression, Pose, Presses,
    ResponseMap, candidates,
};

/// Radius of a touch if the scene states none, as a fraction of the skin's: wider than a fingertip, because
/// robots press with larger tips and the fabric spreads a press.
const BELL_PART: f64 = 0.15;

/// Smallest number of presses with a force and a touch.
const LEAST_FORCES: usize = 3;

/// Another strength must lower the error of the presses to less than this fraction: the errors of twelve presses
/// tell no smaller difference.
const FAR_SMALLER: f64 = 0.6;

/// A press is unlike the others if a touch at any place leaves more than this fraction of it unexplained, ...
const UNLIKE_REST: f64 = 0.5;
/// ... and more than this multiple of what the median press leaves.
const UNLIKE_FACTOR: f64 = 3.0;

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
    /// Fraction of its change, 0 to 1, that a touch at no place explains, judged by the other presses.
    pub rest: f64,
}

impl LearnedSkin {
    /// Learns from presses, together with those of an earlier file of the same skin.
    ///
    /// # Errors
    ///
    /// Fewer than four presses; places off the skin; frames without a change; duplicate frames (a press that
    /// is both learnt and tested has an error of zero); an earlier file of another skin, with other
    /// measurements, or whose places were obtained differently.
    pub fn learn(
        fitted: &FittedFrames,
        pressed: &PressFrames,
        frame: Frame,
        earlier: Option<&Self>,
        progress: &mut Progress,
    ) -> Result<Learning, SkinError> {
        let skin = &*fitted.skin;
        let mut sign = skin.skin.settings.touch.sign.factor();
        let joined = Joined::new(fitted, pressed, frame, sign, earlier)?;
        let channels = &joined.channels;
        let ratios = ratios(fitted, channels);
        let bell_m = skin.skin.settings.touch.radius_m.unwrap_or(BELL_PART * radius_m(skin));
        let candidates_m = candidates(skin.skin.mesh.surface(), CANDIDATES);
        let at_candidates = responses(skin, channels, &ratios, &candidates_m, bell_m)?;
        let (mut pose, mut model) = (Pose::SAME, None);
        if frame == Frame::Fitted {
            let found = progress.stage("turn, mirror and scale", || {
                Pose::fit(&joined.table, &candidates_m, &at_candidates)
            });
            let found = found.map_err(|e| joined.named(e))?;
            (pose, sign) = (found.pose, found.sign);
            model = Some(PlaceErrors { median_m: found.median_m, mean_m: found.mean_m });
        }
        let presses = Presses {
            places_m: joined.table.places_m.iter().map(|p| pose.to_model(*p)).collect(),
            frames: joined.table.frames.clone(),
            sessions: joined.table.sessions.clone(),
        };
        let at_presses = responses(skin, channels, &ratios, &presses.places_m, bell_m)
            .map_err(|e| joined.located(e))?;
        let model_responses = ModelResponses {
            candidates_m,
            at_candidates: at_candidates * sign,
            at_presses: at_presses * sign,
        };
        let choice = progress
            .stage("map of responses", || ResponseMap::learn(&presses, &model_responses))
            .map_err(|e| joined.named(e))?;
        let (regression, by_regression) = progress
            .stage("regression", || PlaceRegression::learn(&presses))
            .map_err(|e| joined.named(e))?;
        let mut detect = |places_by: PlacesBy| {
            let pairs = joined.pairs(fitted, pressed);
            progress.stage("model alone", || strongest(fitted, pairs, places_by))
        };
        let mut detected = match frame {
            Frame::Scene => detect(PlacesBy::Model)?,
            Frame::Fitted => None,
        };
        if let Some(detected) = &detected {
            model =
                Some(PlaceErrors::of_detected(detected, &joined.table.places_m, radius_m(skin)));
        }
        let errors = ErrorsByWay {
            model,
            map: PlaceErrors::of(&choice.errors, pose.scale),
            regression: PlaceErrors::of(&by_regression, pose.scale),
        };
        let by_detected = detected
            .as_deref()
            .map(|detected| errors_of_detected(detected, &joined.table.places_m, radius_m(skin)));
        let latest = |errors_m: &[f64]| of_latest(&presses, errors_m);
        let by_latest = ErrorsByWay {
            model: by_detected.as_deref().map(latest),
            map: latest(&choice.errors.errors_m),
            regression: latest(&by_regression.errors_m),
        };
        let places_by = by_latest.best(frame);
        if detected.is_some() && places_by != PlacesBy::Model {
            detected = detect(places_by)?;
        }
        let unlike = unlike(&choice, joined.earlier);
        let forces = Forces::new(&joined, &presses, &choice.map, detected.as_deref())?;
        let force = forces.learn(&presses, middle_m(skin), radius_m(skin))?;
        let without_touch = forces.without_touch().filter_map(|k| k.checked_sub(joined.earlier));
        Ok(Learning {
            unlike,
            without_touch: without_touch.collect(),
            skin: Self {
                fingerprint: skin.skin.fingerprint.clone(),
                measurements: fitted.frames.used.len(),
                ratios,
                bell_m,
                sign,
                pose,
                map: choice.map.settings,
                covariance_factor: choice.map.covariance_factor,
                rest_limit: choice.map.rest_limit,
                regression: regression.settings,
                places_by,
                errors,
                force,
                forces_n: joined.forces_n.clone(),
                channels: joined.channels,
                presses,
            },
        })
    }
}

/// Errors of the presses of the latest session, which frames to come are like.
fn of_latest(presses: &Presses, errors_m: &[f64]) -> PlaceErrors {
    let latest = presses.sessions.iter().max();
    let all = errors_m.iter().enumerate();
    let of = all.filter(|(press, _)| presses.sessions.get(*press) == latest);
    PlaceErrors::of_errors(of.map(|(_, error_m)| *error_m).collect())
}

/// New presses that the others do not explain.
fn unlike(choice: &Choice, earlier: usize) -> Vec<UnlikePress> {
    let median = eit_core::median(choice.rests.iter().copied()).unwrap_or(0.0);
    let new = choice.rests.iter().skip(earlier).enumerate();
    new.filter(|(_, rest)| **rest > UNLIKE_REST.max(UNLIKE_FACTOR * median))
        .map(|(press, &rest)| UnlikePress { press, rest })
        .collect()
}

/// Forces of presses, and strengths of the touches in their frames.
struct Forces<'a> {
    forces_n: &'a [Option<f64>],
    /// `None` if the model alone was not evaluated.
    by_model: Option<Vec<Option<f64>>>,
    by_map: Vec<Option<f64>>,
}

impl<'a> Forces<'a> {
    fn new(
        joined: &'a Joined,
        presses: &Presses,
        map: &ResponseMap,
        detected: Option<&[Option<PressTouch>]>,
    ) -> Result<Self, InverseError> {
        // a touch of strength 0 is no touch
        let strength = |s: f64| (s > 0.0 && s.is_finite()).then_some(s);
        let mut locator = Locator::new(map.clone(), &vec![0.0; joined.channels.len()])?;
        let rows = presses.frames.rows().into_iter();
        let by_map = rows
            .map(|row| locator.locate(&row.to_vec(), None, 0.0))
            .map(|located| strength(located?.strength_s_m2))
            .collect();
        let of_touch = |touch: &Option<PressTouch>| strength(touch.as_ref()?.even_strength_s_m2);
        let by_model = detected.map(|all| all.iter().map(of_touch).collect());
        Ok(Self { forces_n: &joined.forces_n, by_model, by_map })
    }

    /// Whether every source of strength found a touch in this press.
    fn has_touch(&self, press: usize) -> bool {
        let by_model = self.by_model.as_ref().is_none_or(|all| all[press].is_some());
        by_model && self.by_map[press].is_some()
    }

    /// Presses with a force but without a touch.
    fn without_touch(&self) -> impl Iterator<Item = usize> {
        let stated = (0..self.forces_n.len()).filter(|&k| self.forces_n[k].is_some());
        stated.filter(|&k| !self.has_touch(k))
    }

    /// Learns curves from both strengths together, that of the map and that of the model, and keeps the first
    /// unless a later one has a far smaller error on the same presses.
    fn learn(
        &self,
        presses: &Presses,
        middle_m: [f64; 3],
        radius_m: f64,
    ) -> Result<Option<LearnedForce>, SkinError> {
        let mut best: Option<LearnedForce> = None;
        for strength_by in [StrengthBy::Both, StrengthBy::Map, StrengthBy::Model] {
            if self.by_model.is_none() && strength_by != StrengthBy::Map {
                continue;
            }
            let sample = |k: usize| {
                let by_model = self.by_model.as_ref().and_then(|all| all[k]);
                let strength = strength_by.strength(by_model, self.by_map[k]);
                let force_n = self.forces_n[k]?;
                Some(ForceSample { strength, place_m: presses.places_m[k], force_n })
            };
            let touched = (0..self.by_map.len()).filter(|&k| self.has_touch(k));
            let samples: Vec<ForceSample> = touched.filter_map(sample).collect();
            if samples.len() < LEAST_FORCES {
                return Ok(None);
            }
            let curve = ForceCurve::learn(&samples, middle_m, radius_m)?;
            if best.as_ref().is_none_or(|old| curve.error_ln < FAR_SMALLER * old.curve.error_ln) {
                best = Some(LearnedForce { strength_by, curve });
            }
        }
        Ok(best)
    }
}
