//! Place and force of touches, learnt from presses at known places on the real skin.
//!
//! ```text
//! table of presses + frames -> LearnedSkin::learn -> file -> [touch] learned -> TouchFinder: place, force_n
//! ```
//!
//! Three ways to a place are held against each other by cross-validation on the presses, and the best is
//! taken: the model alone (what a skin without presses has), a [`ResponseMap`] (the model's response with a
//! learnt correction), and a [`PlaceRegression`] from frames to places. The file keeps the presses with the
//! parameters that were chosen, not the maps made of them.

mod curve;
mod file;
mod presses;
mod refine;
mod table;

pub use curve::{CurvePoint, learning_curve};
pub use presses::PressFrames;
pub(crate) use refine::LearnedTouches;
pub use table::{Press, PressTable};

use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::linearised::LinearisedSkin;
use crate::progress::Progress;
use crate::scene::TouchSign;
use eit_inverse::learn::{
    FoldErrors, ForceCurve, ForceSample, Locator, ModelResponses, PlaceRegression,
    PlaceRegressionSettings, Pose, Presses, ResponseMap, ResponseMapSettings, bell_responses,
    candidates,
};
use ndarray::Array2;
use serde::{Deserialize, Serialize};

/// Places at which a map is made, about.
const CANDIDATES: usize = 700;

/// Radius of a touch where the scene states none, as a part of the skin's: wider than a fingertip, since
/// robots press with larger tips and sheets spread what presses them.
const BELL_PART: f64 = 0.15;

/// Beyond this factor of the median a ratio of measured over modelled voltage is taken for the channel's
/// noise.
const RATIO_RANGE: f64 = 3.0;

/// What places are taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlacesBy {
    /// The model without anything learnt.
    Model,
    /// The model's responses with a learnt correction.
    Map,
    /// Regression from frames; the map where there are several touches.
    Regression,
}

impl PlacesBy {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Model => "the model alone",
            Self::Map => "the model with a learnt correction",
            Self::Regression => "regression from frames to places",
        }
    }
}

/// How the coordinates of the table lie on the scene's skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Frame {
    /// They are the scene's.
    #[default]
    Scene,
    /// Nobody knows: turn, mirror, scale, shift and the sign of the change are fitted.
    Fitted,
}

/// Errors of places on the presses, metres of the table: median and mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PlaceErrors {
    /// Median.
    pub median_m: f64,
    /// Mean.
    pub mean_m: f64,
}

impl PlaceErrors {
    fn of(errors: &FoldErrors, scale: f64) -> Self {
        Self { median_m: errors.median_m() / scale, mean_m: errors.mean_m() / scale }
    }
}

/// What each way to a place errs by on the presses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorsByWay {
    /// The model alone; `None` where the noise of frames is unknown and it finds no touches.
    pub model: Option<PlaceErrors>,
    /// The map, by cross-validation.
    pub map: PlaceErrors,
    /// Regression, by leave-one-out.
    pub regression: PlaceErrors,
}

/// Force and what its strength is taken from.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnedForce {
    /// [`PlacesBy::Model`] or [`PlacesBy::Map`].
    pub strength_by: PlacesBy,
    /// The curve.
    pub curve: ForceCurve,
}

/// What presses have taught of one skin.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnedSkin {
    /// Checksum of shape, electrodes and protocol.
    pub fingerprint: String,
    /// Measurements of the protocol.
    pub measurements: usize,
    /// Measurements that were learnt.
    pub channels: Vec<usize>,
    /// What the model's derivatives of each channel are multiplied by: measured over modelled voltage.
    pub ratios: Vec<f64>,
    /// Radius of a touch on the model, metres.
    pub bell_m: f64,
    /// Sign of the change of conductivity.
    pub sign: f64,
    /// From the table to the scene.
    pub pose: Pose,
    /// Frames of presses and their places on the scene's skin.
    pub presses: Presses,
    /// Forces of the presses, newtons, where known.
    pub forces_n: Vec<Option<f64>>,
    /// Parameters of the map.
    pub map: ResponseMapSettings,
    /// From cross-validation of the map.
    pub covariance_factor: f64,
    /// See there.
    pub rest_limit: f64,
    /// Parameters of the regression.
    pub regression: PlaceRegressionSettings,
    /// The way that errs least on the presses.
    pub places_by: PlacesBy,
    /// What each errs by.
    pub errors: ErrorsByWay,
    /// Force, where at least three presses state it.
    pub force: Option<LearnedForce>,
}

impl LearnedSkin {
    /// Learns from presses and everything that an earlier file holds of the same skin.
    ///
    /// # Errors
    ///
    /// Fewer than four presses, places beside the skin, forces that are not above zero, an earlier file of
    /// another skin.
    pub fn learn(
        fitted: &FittedFrames,
        pressed: &PressFrames,
        frame: Frame,
        earlier: Option<&Self>,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let skin = &*fitted.skin;
        let channels: Vec<usize> =
            (0..fitted.frames.used.len()).filter(|&i| fitted.frames.used[i]).collect();
        let ratios = ratios(fitted, &channels);
        let bell_m = skin.skin.settings.touch.radius_m.unwrap_or(BELL_PART * radius_m(skin));
        let mut sign = match skin.skin.settings.touch.sign {
            TouchSign::Increase => 1.0,
            TouchSign::Decrease => -1.0,
        };
        let candidates_m = candidates(skin.skin.mesh.surface(), CANDIDATES);
        let at_candidates = responses(skin, &channels, &ratios, &candidates_m, bell_m)?;
        let table =
            Presses { frames: pressed.differences(&channels), places_m: pressed.places_m.clone() };
        let (mut pose, mut model) = (Pose::SAME, None);
        if frame == Frame::Fitted {
            let found = progress.stage("turn, mirror and scale", || {
                Pose::fit(&table, &candidates_m, &at_candidates)
            })?;
            (pose, sign) = (found.pose, found.sign);
            model = Some(PlaceErrors { median_m: found.median_m, mean_m: found.mean_m });
        }
        let mut presses = Presses {
            places_m: table.places_m.iter().map(|p| pose.to_model(*p)).collect(),
            ..table
        };
        let mut forces_n = pressed.forces_n.clone();
        let own = presses.places_m.len();
        if let Some(earlier) = earlier {
            earlier.check(skin)?;
            if earlier.channels != channels {
                let message = "the earlier file left out other measurements; learn anew";
                return Err(SkinError::input(message));
            }
            presses = earlier.presses_and(&presses)?;
            forces_n = [earlier.forces_n.clone(), forces_n].concat();
        }
        let at_presses = responses(skin, &channels, &ratios, &presses.places_m, bell_m)?;
        let responses = ModelResponses {
            candidates_m,
            at_candidates: at_candidates * sign,
            at_presses: at_presses * sign,
        };
        let choice =
            progress.stage("map of responses", || ResponseMap::learn(&presses, &responses))?;
        let (regression, by_regression) =
            progress.stage("regression", || PlaceRegression::learn(&presses))?;
        let detected = match frame {
            Frame::Scene => progress.stage("model alone", || pressed.detect(fitted))?,
            Frame::Fitted => None,
        };
        if let Some(detected) = &detected {
            model = Some(pressed.errors_of(detected, radius_m(skin)));
        }
        let scale = pose.scale;
        let errors = ErrorsByWay {
            model,
            map: PlaceErrors::of(&choice.errors, scale),
            regression: PlaceErrors::of(&by_regression, scale),
        };
        let mut learned = Self {
            fingerprint: skin.skin.fingerprint.clone(),
            measurements: fitted.frames.used.len(),
            channels,
            ratios,
            bell_m,
            sign,
            pose,
            map: choice.map.settings,
            covariance_factor: choice.map.covariance_factor,
            rest_limit: choice.map.rest_limit,
            regression: regression.settings,
            places_by: errors.best(frame),
            errors,
            force: None,
            forces_n,
            presses,
        };
        let strengths: Option<Vec<f64>> =
            detected.filter(|_| learned.presses.places_m.len() == own).and_then(|all| {
                all.iter().map(|touch| Some(touch.as_ref()?.strength_s_m2.abs())).collect()
            });
        learned.force = learned.learn_force(skin, choice.map, strengths)?;
        Ok(learned)
    }

    /// The force curve by the strengths of the model and of the map, whichever errs less.
    fn learn_force(
        &self,
        skin: &LinearisedSkin,
        map: ResponseMap,
        by_model: Option<Vec<f64>>,
    ) -> Result<Option<LearnedForce>, SkinError> {
        if self.forces_n.iter().flatten().count() < 3 {
            return Ok(None);
        }
        let mut locator = Locator::new(map, &vec![0.0; self.channels.len()])?;
        let located = self.presses.frames.rows().into_iter();
        let by_map: Option<Vec<f64>> = located
            .map(|row| Some(locator.locate(&row.to_vec(), None, 0.0)?.strength_s_m2))
            .collect();
        let (middle_m, radius_m) = (middle_m(skin), radius_m(skin));
        let mut best: Option<LearnedForce> = None;
        for (strength_by, strengths) in [(PlacesBy::Model, by_model), (PlacesBy::Map, by_map)] {
            let Some(strengths) = strengths else { continue };
            let samples: Vec<ForceSample> = strengths
                .iter()
                .zip(&self.presses.places_m)
                .zip(&self.forces_n)
                .filter_map(|((&strength, &place_m), force_n)| {
                    Some(ForceSample { strength, place_m, force_n: (*force_n)? })
                })
                .collect();
            let curve = ForceCurve::learn(&samples, middle_m, radius_m)?;
            if best.as_ref().is_none_or(|old| curve.error_ln < old.curve.error_ln) {
                best = Some(LearnedForce { strength_by, curve });
            }
        }
        Ok(best)
    }

    /// Refuses a skin that this was not learnt on.
    ///
    /// # Errors
    ///
    /// Another shape, other electrodes, another protocol.
    pub fn check(&self, skin: &LinearisedSkin) -> Result<(), SkinError> {
        let measurements = skin.skin.protocol.measurements();
        if self.fingerprint == skin.skin.fingerprint && self.measurements == measurements {
            return Ok(());
        }
        Err(SkinError::input(format!(
            "learnt on another skin: shape, electrodes and protocol have the checksum {} and {} \
             measurements, those of {} {} and {measurements}; learn anew, or take the scene that it \
             was learnt with",
            self.fingerprint, self.measurements, skin.skin.place, skin.skin.fingerprint,
        )))
    }

    /// Earlier presses and others.
    fn presses_and(&self, others: &Presses) -> Result<Presses, SkinError> {
        let frames = ndarray::concatenate(
            ndarray::Axis(0),
            &[self.presses.frames.view(), others.frames.view()],
        );
        let frames = frames.map_err(|e| SkinError::Failure(format!("joining presses: {e}")))?;
        let places_m = [self.presses.places_m.clone(), others.places_m.clone()].concat();
        Ok(Presses { frames, places_m })
    }

    /// The map, made anew from presses and parameters.
    ///
    /// # Errors
    ///
    /// A skin that this was not learnt on.
    pub fn response_map(&self, skin: &LinearisedSkin) -> Result<ResponseMap, SkinError> {
        self.check(skin)?;
        let Self { channels, ratios, bell_m, sign, presses, .. } = self;
        let candidates_m = candidates(skin.skin.mesh.surface(), CANDIDATES);
        let model = ModelResponses {
            at_candidates: responses(skin, channels, ratios, &candidates_m, *bell_m)? * *sign,
            at_presses: responses(skin, channels, ratios, &presses.places_m, *bell_m)? * *sign,
            candidates_m,
        };
        let mut map = ResponseMap::with_settings(presses, &model, self.map)?;
        map.covariance_factor = self.covariance_factor;
        map.rest_limit = self.rest_limit;
        Ok(map)
    }
}

impl ErrorsByWay {
    /// The way with the least mean error. Where the frame was fitted on the presses, the model's errors are not
    /// those of held-out presses, and a skin whose electrodes nobody knows is not the model's: never the model.
    fn best(&self, frame: Frame) -> PlacesBy {
        let (by, least) = match self.regression.mean_m < self.map.mean_m {
            true => (PlacesBy::Regression, self.regression.mean_m),
            false => (PlacesBy::Map, self.map.mean_m),
        };
        let model = self.model.filter(|_| frame == Frame::Scene);
        if model.is_some_and(|model| model.mean_m <= least) { PlacesBy::Model } else { by }
    }
}

/// Measured over modelled voltages of the channels, signs included: values of an instrument that gives
/// magnitudes change with the sign of the model's voltage.
fn ratios(fitted: &FittedFrames, channels: &[usize]) -> Vec<f64> {
    let ratio = |i: usize| fitted.frames.reference[i] / fitted.skin.voltages[i];
    let mut sizes: Vec<f64> =
        channels.iter().map(|&i| ratio(i).abs()).filter(|r| r.is_finite()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let median = sizes.get(sizes.len() / 2).copied().filter(|m| *m > 0.0).unwrap_or(1.0);
    let within = |r: f64| match r.is_finite() {
        true => r.signum() * r.abs().clamp(median / RATIO_RANGE, median * RATIO_RANGE),
        false => median,
    };
    channels.iter().map(|&i| within(ratio(i))).collect()
}

/// The model's responses to 1 S m^2 at places, `[place, channel]`.
fn responses(
    skin: &LinearisedSkin,
    channels: &[usize],
    ratios: &[f64],
    places_m: &[[f64; 3]],
    bell_m: f64,
) -> Result<Array2<f64>, SkinError> {
    let surface = skin.skin.mesh.surface();
    let jacobian = skin.jacobian.select(ndarray::Axis(0), channels);
    let all = bell_responses(surface, &jacobian, places_m, bell_m)?;
    Ok(all * ndarray::ArrayView1::from(ratios))
}

fn middle_m(skin: &LinearisedSkin) -> [f64; 3] {
    let [low, high] = skin.skin.mesh.surface().bounds_m();
    std::array::from_fn(|k| 0.5 * (low[k] + high[k]))
}

/// Half of the longest side.
fn radius_m(skin: &LinearisedSkin) -> f64 {
    let [low, high] = skin.skin.mesh.surface().bounds_m();
    (0..3).map(|k| 0.5 * (high[k] - low[k])).fold(0.0, f64::max)
}
