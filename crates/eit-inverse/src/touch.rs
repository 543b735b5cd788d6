//! Touch detection and tracking: contacts with a position, a strength and a stable id.
//!
//! ```text
//! frame -> detect (Gaussian-like bells on the linearised model, fitted with all nuisances) -> track
//! image -> segment (above the noise floor, split where two peaks stand out) -> track
//! frame -> fit (a few bells on the non-linear model): accuracy near the Cramer-Rao bound
//! ```
//!
//! | file | holds |
//! |---|---|
//! | `detector/` | [`TouchDetector`]: the touches of a frame, and a reference that follows everything else |
//! | `points.rs` | [`TouchTracker`]: ids and velocities of detected touches |
//! | `reference.rs` | [`AdaptiveReference`]: a reference frame that follows drift but not contact |
//! | `contact.rs` | [`Touch`]: what is reported for each touch |
//! | `noise.rs`, `normal.rs` | [`NoiseFloor`]: threshold for a given rate of false touches |
//! | `segment.rs` | blobs of an image and their positions |
//! | `assign.rs`, `filter.rs`, `track.rs` | optimal assignment, Kalman filter, ids |
//! | `stream.rs`, `settings.rs` | [`TouchStream`]: image in, touches out |
//! | `skin.rs`, `bell.rs`, `fit.rs` | [`TouchFit`]: bells fitted to a frame, and their number chosen |
//! | `bound.rs` | [`cramer_rao`]: lower bound on the error of any unbiased method |
//!
//! `eit-skin` uses [`TouchDetector`]. [`TouchStream`] needs a linear image or quiet images, and takes
//! microseconds. [`TouchFit`] needs the forward model and about ten forward solves per frame, and has no
//! bias toward the rim.

mod assign;
mod bell;
mod bound;
mod contact;
mod detector;
mod filter;
mod fit;
mod motion;
mod noise;
mod normal;
mod points;
mod reference;
mod segment;
mod settings;
mod skin;
mod stream;
mod track;

pub use bell::Bell;
pub use bound::{BellBound, Nuisance, cramer_rao};
pub use contact::{Touch, TouchState};
pub use detector::{
    DentPlace, DetectedTouch, DetectorModel, DetectorSettings, DetectorStep, LearntTouch,
    TouchDetector, UnknownKind,
};
#[cfg(feature = "learn")]
pub(crate) use detector::{Places, bell_at};
pub use fit::{FitResult, FitSettings, FitStatus, FittedTouch, TouchFit};
pub use noise::{FalseAlarms, NoiseFloor};
pub use points::{TouchTracker, TrackerSettings};
pub use reference::{AdaptiveReference, ReferenceSettings, ReferenceState, ReferenceStep};
pub use settings::TouchStreamSettings;
pub use stream::TouchStream;
