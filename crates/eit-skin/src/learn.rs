//! Learns position and force of touches from presses at known places on the real skin.
//!
//! ```text
//! table of presses + frames -> LearnedSkin::learn -> file -> [touch] learned -> TouchFinder: place, force_n
//! ```
//!
//! Three ways to locate a touch are compared by cross-validation on the presses, and the best is used: the
//! model alone (as for a skin without presses), a [`ResponseMap`] (the model's response with a learnt
//! correction), and a [`PlaceRegression`](eit_inverse::learn::PlaceRegression) from frames to places. The
//! file stores the presses with the chosen parameters, not the maps made from them.
//!
//! | file | holds |
//! |---|---|
//! | `table.rs`, `presses.rs` | the table of presses, and the frames that it names |
//! | `touched.rs` | rejection of presses that their frames do not show |
//! | `earlier.rs` | merging presses of an earlier file with new ones |
//! | `learning.rs`, `model.rs` | [`LearnedSkin::learn`], and the model's response at each place |
//! | `collect.rs` | collecting presses while they are made |
//! | `curve.rs` | errors against the number of presses |
//! | `file.rs` | file format |
//! | `local_sheet.rs` | conductivity of an uneven sheet under a touch |
//! | `refine.rs` | applying what was learnt to the touches of a frame |

pub mod collect;
mod curve;
mod earlier;
mod file;
mod learning;
mod local_sheet;
mod model;
mod presses;
mod refine;
mod table;
mod touched;

pub use curve::{CurvePoint, learning_curve};
pub use learning::{Learning, UnlikePress};
pub(crate) use local_sheet::LocalSheet;
pub use presses::PressFrames;
pub(crate) use refine::LearnedTouches;
pub use table::{Press, PressTable};

use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use eit_inverse::learn::{
    FoldErrors, ForceCurve, ModelResponses, PlaceRegressionSettings, Pose, Presses, ResponseMap,
    ResponseMapSettings, candidates,
};
use serde::{Deserialize, Serialize};

/// Approximate number of places for which a map is computed.
const CANDIDATES: usize = 700;

/// How a touch is located.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlacesBy {
    /// By the model alone, without learning.
    Model,
    /// By the model's responses with a learnt correction.
    Map,
    /// By regression from frames; by the map if there are several touches or a channel is missing.
    Regression,
}

impl PlacesBy {
    /// Describes the method in words.
    pub fn description(self) -> &'static str {
        match self {
            Self::Model => "the model alone",
            Self::Map => "the model with a learnt correction",
            Self::Regression => "regression from frames to places",
        }
    }
}

/// How the coordinates of the table relate to the scene's skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub enum Frame {
    /// They are the scene's.
    #[default]
    Scene,
    /// Unknown: rotation, reflection, scale, shift and the sign of the change are fitted. The table of an
    /// earlier file is assumed to use the same coordinates.
    Fitted,
}

/// Position errors over the presses, in metres of the table: median and mean.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PlaceErrors {
    /// Median error, metres.
    pub median_m: f64,
    /// Mean position error.
    pub mean_m: f64,
}

impl PlaceErrors {
    fn of(errors: &FoldErrors, scale: f64) -> Self {
        Self { median_m: errors.median_m() / scale, mean_m: errors.mean_m() / scale }
    }
}

/// Position errors of each method, each over the same presses: all that were learnt.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorsByWay {
    /// The model alone; `None` if the noise of the frames is unknown, so that no touches can be found.
    pub model: Option<PlaceErrors>,
    /// The map, by cross-validation.
    pub map: PlaceErrors,
    /// Regression, by leave-one-out cross-validation.
    pub regression: PlaceErrors,
}

/// Which strength of a touch determines its force.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum StrengthBy {
    /// That of the model alone.
    Model,
    /// That of the model with a learnt correction.
    Map,
    /// The geometric mean of both. On simulated fabric they err independently: with the mean, the median error of
    /// a force is 3 % instead of 5 %.
    Both,
}

impl StrengthBy {
    /// Describes the strength in words.
    pub fn description(self) -> &'static str {
        match self {
            Self::Model => "the model alone",
            Self::Map => "the model with a learnt correction",
            Self::Both => "the model, without and with a learnt correction",
        }
    }

    /// The strength from that of the model and that of the map; zero if one that is needed is unknown.
    pub(crate) fn strength(self, by_model: Option<f64>, by_map: Option<f64>) -> f64 {
        let [by_model, by_map] = [by_model, by_map].map(|s| s.unwrap_or(0.0).max(0.0));
        match self {
            Self::Model => by_model,
            Self::Map => by_map,
            Self::Both => (by_model * by_map).sqrt(),
        }
    }
}

/// Force curve and the strength that it needs.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LearnedForce {
    /// Both, unless the error of another on the same presses is far smaller.
    pub strength_by: StrengthBy,
    /// Curve of force against strength.
    #[serde(flatten)]
    pub curve: ForceCurve,
}

/// What was learnt from presses on one skin.
#[derive(Debug, Clone, PartialEq)]
pub struct LearnedSkin {
    /// Checksum of shape, electrodes and protocol.
    pub fingerprint: String,
    /// Number of measurements of the protocol.
    pub measurements: usize,
    /// Measurements that were learnt.
    pub channels: Vec<usize>,
    /// Factor for the model's derivatives of each channel: measured over modelled voltage.
    pub ratios: Vec<f64>,
    /// Radius of a touch in the model, metres.
    pub bell_m: f64,
    /// Sign of the conductivity change.
    pub sign: f64,
    /// Transform from the table to the scene.
    pub pose: Pose,
    /// Frames of presses and their places on the scene's skin.
    pub presses: Presses,
    /// Forces of the presses, newtons, if known.
    pub forces_n: Vec<Option<f64>>,
    /// Parameters of the map.
    pub map: ResponseMapSettings,
    /// Factor for the covariance of a place found by the map, from cross-validation.
    pub covariance_factor: f64,
    /// Fraction of a frame that a press may leave unexplained, from cross-validation.
    pub rest_limit: f64,
    /// Parameters of the regression.
    pub regression: PlaceRegressionSettings,
    /// Method with the smallest error on the presses.
    pub places_by: PlacesBy,
    /// Errors of each method.
    pub errors: ErrorsByWay,
    /// Force, if at least three presses state it and show a touch.
    pub force: Option<LearnedForce>,
}

impl LearnedSkin {
    /// Rejects a skin other than the one that this was learnt on.
    ///
    /// # Errors
    ///
    /// Different shape, electrodes or protocol.
    pub fn check(&self, skin: &LinearisedSkin) -> Result<(), SkinError> {
        let measurements = skin.skin.protocol.measurements();
        if self.fingerprint == skin.skin.fingerprint && self.measurements == measurements {
            return Ok(());
        }
        Err(SkinError::input(format!(
            "learnt on another skin: its shape, electrodes and protocol have the checksum {} and {} \
             measurements, those of {} have {} and {measurements}; learn again, or use the scene that \
             it was learnt with",
            self.fingerprint, self.measurements, skin.skin.place, skin.skin.fingerprint,
        )))
    }

    /// Rebuilds the map from presses and parameters.
    ///
    /// # Errors
    ///
    /// A skin other than the one that this was learnt on.
    pub(crate) fn response_map(&self, skin: &LinearisedSkin) -> Result<ResponseMap, SkinError> {
        self.check(skin)?;
        let Self { channels, ratios, bell_m, sign, presses, .. } = self;
        let candidates_m = candidates(skin.skin.mesh.surface(), CANDIDATES);
        let responses = ModelResponses {
            at_candidates: model::responses(skin, channels, ratios, &candidates_m, *bell_m)?
                * *sign,
            at_presses: model::responses(skin, channels, ratios, &presses.places_m, *bell_m)?
                * *sign,
            candidates_m,
        };
        let mut map = ResponseMap::with_settings(presses, &responses, self.map)?;
        map.covariance_factor = self.covariance_factor;
        map.rest_limit = self.rest_limit;
        Ok(map)
    }
}

impl ErrorsByWay {
    /// Returns the method with the smallest mean error. Never the model if the frame was fitted:
    /// its errors are then not those of held-out presses, and a skin with unknown electrodes is not
    /// the model's. With presses of several sessions the errors are those of the latest session,
    /// which later frames resemble most.
    fn best(&self, frame: Frame) -> PlacesBy {
        let (by, least) = match self.regression.mean_m < self.map.mean_m {
            true => (PlacesBy::Regression, self.regression.mean_m),
            false => (PlacesBy::Map, self.map.mean_m),
        };
        let model = self.model.filter(|_| frame == Frame::Scene);
        if model.is_some_and(|model| model.mean_m <= least) { PlacesBy::Model } else { by }
    }
}
