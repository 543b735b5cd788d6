//! Touch detection and tracking: contacts with a position, a strength and a stable id.
//!
//! ```text
//! frame -> detect (Gaussian-like bells on the linearised model, fitted with all nuisances) -> track
//! ```
//!
//! | file | holds |
//! |---|---|
//! | `detector/` | [`TouchDetector`]: the touches of a frame, and a reference that follows everything else |
//! | `learnt/` | `LearntDetector` (feature `learn`): the same on a skin that was learnt from presses |
//! | `points.rs` | [`TouchTracker`]: ids and velocities of detected touches |
//! | `contact.rs` | [`Touch`]: what is reported for each touch |
//! | `score/` | [`ScoreDetector`]: the same by one model and one score |
//! | `filter.rs`, `motion.rs` | Kalman filter, rest or motion |
//! | `skin.rs` | points on a surface and tangent planes |
//! | `twins.rs` | [`Twins`]: places that a protocol cannot tell apart |

mod contact;
mod detector;
mod filter;
#[cfg(feature = "learn")]
mod learnt;
mod motion;
mod points;
mod score;
mod skin;
mod twins;

pub use contact::{Touch, TouchState};
pub use detector::{
    DentPlace, DetectedTouch, DetectorModel, DetectorSettings, DetectorStep, LearntTouch,
    TouchDetector, UnknownKind,
};
#[cfg(feature = "learn")]
pub(crate) use detector::{Places, bell_at};
#[cfg(feature = "learn")]
pub use learnt::{HeldPress, LearntDetector, LearntSettings, Stated, Untouched};
pub use points::{TouchTracker, TrackerSettings};
pub use score::{ElectrodeState, ScoreDetector, ScoreModel, ScoreSettings};
pub use twins::Twins;
