//! Place and force of touches, learnt from presses at known places on the real skin.
//!
//! ```text
//! table of presses + frames -> LearnedSkin::learn -> file -> [touch] learned -> TouchFinder: place, force_n
//! ```
//!
//! Three ways to a place are held against each other by cross-validation on the presses, and the best is
//! taken: the model alone (what a skin without presses has), a [`ResponseMap`] (the model's response with a
//! learnt correction), and a [`PlaceRegression`](eit_inverse::learn::PlaceRegression) from frames to places. The
//! file keeps the presses with the parameters that were chosen, not the maps made of them.
//!
//! | file | holds |
//! |---|---|
//! | `table.rs`, `presses.rs` | the table of presses, and the frames that it names |
//! | `touched.rs` | presses whose frames do not show them |
//! | `earlier.rs` | presses of an earlier file beside new ones |
//! | `learning.rs`, `model.rs` | [`LearnedSkin::learn`], and what the model says of each place |
//! | `curve.rs` | errors by the number of presses |
//! | `file.rs` | the file |
//! | `refine.rs` | touches of a frame by what was learnt |

mod curve;
mod earlier;
mod file;
mod learning;
mod model;
mod presses;
mod refine;
mod table;
mod touched;

pub use curve::{CurvePoint, learning_curve};
pub use learning::{Learning, UnlikePress};
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

/// Places at which a map is made, about.
const CANDIDATES: usize = 700;

/// What places are taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlacesBy {
    /// The model without anything learnt.
    Model,
    /// The model's responses with a learnt correction.
    Map,
    /// Regression from frames; the map where there are several touches, or a channel is missing.
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
    /// Nobody knows: turn, mirror, scale, shift and the sign of the change are fitted. The coordinates of an
    /// earlier file's table are taken to be the same.
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

/// What each way to a place errs by, each on the same presses: all that were learnt.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorsByWay {
    /// The model alone; `None` where the noise of frames is unknown and it finds no touches.
    pub model: Option<PlaceErrors>,
    /// The map, by cross-validation.
    pub map: PlaceErrors,
    /// Regression, by leave-one-out.
    pub regression: PlaceErrors,
}

/// Force and what its strength is taken from: whichever of the two errs less on the same presses.
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
    /// What the covariance of a place by the map is multiplied by, from cross-validation.
    pub covariance_factor: f64,
    /// Part of a frame that a press may leave unexplained, from cross-validation.
    pub rest_limit: f64,
    /// Parameters of the regression.
    pub regression: PlaceRegressionSettings,
    /// The way that errs least on the presses.
    pub places_by: PlacesBy,
    /// What each errs by.
    pub errors: ErrorsByWay,
    /// Force, where at least three presses state it and show a touch.
    pub force: Option<LearnedForce>,
}

impl LearnedSkin {
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

    /// The map, made anew from presses and parameters.
    ///
    /// # Errors
    ///
    /// A skin that this was not learnt on.
    pub fn response_map(&self, skin: &LinearisedSkin) -> Result<ResponseMap, SkinError> {
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
