//! Learning from presses at known places: where a touch is, and how hard it presses.
//!
//! ```text
//! presses (frames, places) + model --pose--> places on the model's skin
//!        --choose--> ResponseMap     what a press at each place does to the frame, and from it the place
//!                    PlaceRegression frame -> place directly
//!        --force---> ForceCurve      strength of a touch at its place -> newtons
//! ```
//!
//! | file | holds |
//! |---|---|
//! | `presses.rs` | [`Presses`], [`ModelResponses`]: what is learnt from, and the physical model's part |
//! | `response_map.rs` | [`ResponseMap`]: a Gaussian process over places with the model as its mean |
//! | `locate.rs` | [`Locator`], [`Located`]: place, covariance and strength of a touch in a frame |
//! | `choose.rs` | its parameters by cross-validation, and the errors that they leave |
//! | `regression.rs` | [`PlaceRegression`]: kernel ridge from frame to place, leave-one-out in closed form |
//! | `pose.rs` | [`Pose`]: turn, mirror, scale and shift of the places against the model, sign of the change |
//! | `force.rs` | [`ForceCurve`]: strength and place to newtons, monotone |
//!
//! Frames here are differences `[channel]`, pressed less untouched, in any unit; a channel is a measurement
//! that counts.

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
