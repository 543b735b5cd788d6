//! Learning from presses at known positions: where a touch is and how hard it presses.
//!
//! ```text
//! presses (frames, positions) + model --pose--> positions on the model's skin
//!        --choose--> ResponseMap     response to a press at each position, searched for the position
//!                    PlaceRegression frame -> position directly
//!        --force---> ForceCurve      strength and position of a touch -> newtons
//! ```
//!
//! | file | holds |
//! |---|---|
//! | `presses.rs` | [`Presses`], [`ModelResponses`]: data to learn from, and the model's responses |
//! | `response_map.rs` | [`ResponseMap`]: a Gaussian process over positions with the model as its mean |
//! | `locate.rs` | [`Locator`], [`Located`]: position, covariance and strength of a touch in a frame |
//! | `choose.rs` | its parameters by cross-validation, and the remaining errors |
//! | `regression.rs` | [`PlaceRegression`]: kernel ridge regression from frame to position |
//! | `pose.rs` | [`Pose`]: rotation, mirror, scale and shift from press table to model, and sign |
//! | `force.rs` | [`ForceCurve`]: strength and position to newtons, monotone |
//!
//! Frames here are differences `[channel]`, pressed minus untouched, in any unit. A channel is a
//! measurement that is used.

mod choose;
mod force;
mod locate;
mod pose;
mod presses;
mod regression;
mod response_map;

pub use choose::{Choice, FoldErrors};
pub use force::{ForceCurve, ForceEstimate, ForceSample};
pub use locate::{Located, Locator};
pub use pose::{Pose, PoseFit};
pub use presses::{ModelResponses, Presses, bell_responses, candidates};
pub use regression::{PlaceEstimate, PlaceRegression, PlaceRegressionSettings};
pub use response_map::{ResponseMap, ResponseMapSettings};
