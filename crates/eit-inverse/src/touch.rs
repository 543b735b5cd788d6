//! Touches instead of pictures: contacts with a place, a strength and a name that stays.
//!
//! ```text
//! frame -> detect (bells on the linearised model, beside all that is no touch) -> track (who is who)
//! image -> segment (above the noise floor, parted where two hills meet) -> track
//! frame -> fit (a few bells on the non-linear model): position to the statistical limit
//! ```
//!
//! | file | holds |
//! |---|---|
//! | `detector/` | [`TouchDetector`]: the touches of a frame, and a reference that follows the rest |
//! | `points.rs` | [`TouchTracker`]: names and velocities of detected touches |
//! | `reference.rs` | [`AdaptiveReference`]: a reference frame that follows drift, not contact |
//! | `contact.rs` | [`Touch`]: what is reported |
//! | `noise.rs`, `normal.rs` | [`NoiseFloor`]: threshold at a stated rate of false touches |
//! | `segment.rs` | blobs of an image and where they are |
//! | `assign.rs`, `filter.rs`, `track.rs` | optimal assignment, Kalman filter, names |
//! | `stream.rs`, `settings.rs` | [`TouchStream`]: image in, touches out |
//! | `skin.rs`, `bell.rs`, `fit.rs` | [`TouchFit`]: bells fitted to a frame, their number chosen |
//! | `bound.rs` | [`cramer_rao`]: what no unbiased method can beat |
//!
//! [`TouchDetector`] is what `eit-skin` takes. [`TouchStream`] needs a linear image or quiet images and
//! microseconds; [`TouchFit`] needs the forward model and some ten forward solves, and has no bias toward
//! the rim.

mod assign;
mod bell;
mod bound;
mod contact;
mod detector;
mod filter;
mod fit;
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
    DetectedTouch, DetectorModel, DetectorSettings, DetectorStep, LearntTouch, TouchDetector,
};
#[cfg(feature = "learn")]
pub(crate) use detector::{Places, bell_at};
pub use fit::{FitResult, FitSettings, FitStatus, FittedTouch, TouchFit};
pub use noise::{FalseAlarms, NoiseFloor};
pub use points::{TouchTracker, TrackerSettings};
pub use reference::{AdaptiveReference, ReferenceSettings, ReferenceState, ReferenceStep};
pub use settings::TouchStreamSettings;
pub use stream::TouchStream;
