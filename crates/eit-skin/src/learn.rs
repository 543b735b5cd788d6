//! Learns a skin from presses at known places: what a press does to each channel, and how hard it is.
//!
//! ```text
//! table of presses + frames -> LearnedSkin::learn -> file -> [touch] learned -> TouchFinder: touches, force_n
//! ```
//!
//! Touches are found by the model, as on a skin without presses, or by a
//! [`ResponseMap`](eit_inverse::learn::ResponseMap) of the presses, with the model as its mean, whichever places presses
//! that it does not know with the smaller mean error; one that is not shown counts as the radius of the skin. The file
//! stores the presses with the chosen settings, not the map made from them.
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
//! | `touches.rs` | touches of frames by what was learnt |

pub mod collect;
mod curve;
mod earlier;
mod file;
mod learning;
mod local_sheet;
mod model;
mod presses;
mod table;
mod touched;
mod touches;

pub use curve::{CurvePoint, learning_curve};
pub use learning::{Learning, UnlikePress};
pub(crate) use local_sheet::LocalSheet;
pub use presses::{PressFrames, RecordedPresses};
pub use table::{Press, PressTable};
use touched::interval_s;
pub(crate) use touches::{LearnedTouches, ModelForces, Quiet};

use crate::error::SkinError;
use crate::linearised::LinearisedSkin;
use eit_inverse::learn::{ForceCurve, MapSettings, Orientation, Presses};
use eit_inverse::touch::Stated;
use ndarray::Array2;
use serde::{Deserialize, Serialize};

/// Approximate number of places at which a person is asked to press, and around which a sheet is averaged.
const CANDIDATES: usize = 700;

/// How touches are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PlacesBy {
    /// By the model alone.
    Model,
    /// By what the presses have taught, with the model as its mean.
    Presses,
}

impl PlacesBy {
    /// Describes the method in words.
    pub fn description(self) -> &'static str {
        match self {
            Self::Model => "the model alone",
            Self::Presses => "the presses",
        }
    }
}

/// How the coordinates of the table relate to the scene's skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
pub enum Frame {
    /// They are the scene's.
    #[default]
    Scene,
    /// A robot's, in metres: the middle of the presses is that of the skin. Turn, mirror and sign of the model are fitted.
    /// The table of an earlier file is assumed to use the same coordinates.
    Fitted,
}

/// Position errors over the presses, metres: median and mean.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct PlaceErrors {
    /// Median error, metres.
    pub median_m: f64,
    /// Mean position error.
    pub mean_m: f64,
}

/// What presses that are held out show. A press that is not shown counts with the radius of the skin.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Errors of the model alone; `None` if the noise of the frames is unknown, so that it finds no touches, or the frame was
    /// fitted, so that it does not know where they are.
    pub model: Option<PlaceErrors>,
    /// Errors of what the other presses have taught, ...
    pub presses: PlaceErrors,
    /// ... and the part of the presses that a valid touch shows.
    pub shown: f64,
    /// Errors of the middle of the other presses, whatever a frame shows.
    pub middle: PlaceErrors,
    /// In how many changes of the untouched skin a touch would be shown, judged by the others, and their number.
    pub false_touches: [usize; 2],
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
    /// Voltages of the untouched skin, `[channel]`.
    pub levels: Vec<f64>,
    /// The untouched skin before each press, `[press, channel]`, volts.
    pub untouched: Array2<f64>,
    /// Time from one press to the next, seconds.
    pub interval_s: f64,
    /// Radius of a touch in the model, metres.
    pub bell_m: f64,
    /// Coordinates of the table.
    pub frame: Frame,
    /// Shift from the table to the scene, metres.
    pub shift_m: [f64; 3],
    /// How the model lies under the places.
    pub orientation: Orientation,
    /// Changes by presses and their places on the scene's skin.
    pub presses: Presses,
    /// Forces of the presses, newtons, if known.
    pub forces_n: Vec<Option<f64>>,
    /// Settings of the map.
    pub map: MapSettings,
    /// How places are stated, and further touches found.
    pub stated: Stated,
    /// How touches are found.
    pub places_by: PlacesBy,
    /// What held-out presses show.
    pub held_out: HeldOut,
    /// Force, if at least three presses state it and show a touch.
    pub force: Option<ForceCurve>,
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

    /// Returns the errors of the way in which touches are found.
    pub fn errors(&self) -> PlaceErrors {
        let HeldOut { model, presses, .. } = self.held_out;
        match self.places_by {
            PlacesBy::Model => model.unwrap_or(presses),
            PlacesBy::Presses => presses,
        }
    }
}
