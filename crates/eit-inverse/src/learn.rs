//! Learning from presses at known positions: what a press does to each channel, how sure that is, and how hard it is.
//!
//! ```text
//! presses (changes, positions) + model --Orientation--> ResponseMap   response at each place, and its covariance
//!                                                 |--> touch::LearntDetector   touches of a frame
//! strength and position of a touch --ForceCurve--> newtons
//! ```
//!
//! | file | holds |
//! |---|---|
//! | `presses.rs` | [`Presses`], [`ModelResponses`]: data to learn from, and the model's responses |
//! | `orientation.rs` | [`Orientation`]: turn, mirror and sign of the model under which it predicts presses best |
//! | `process.rs` | Gaussian process over places, with presses left out in closed form |
//! | `response_map.rs` | [`ResponseMap`]: gains and process, their settings by cross-validation, and their error |
//! | `covariance.rs` | covariances of few rows, and quantiles |
//! | `force.rs` | [`ForceCurve`]: strength and position to newtons, monotone |
//!
//! Frames here are differences `[channel]`, pressed minus untouched, in any unit. A channel is a
//! measurement that is used.

mod covariance;
mod force;
mod linear;
mod orientation;
mod presses;
mod process;
mod response_map;

pub(crate) use covariance::{Covariance, chi_square_level, f_level, shrunk, tail_level};
pub use force::{ForceCurve, ForceEstimate, ForceSample};
pub(crate) use linear::{eigen, inverse_of_factor};
pub use orientation::Orientation;
pub use presses::{ModelResponses, Presses, bell_responses, candidates};
pub(crate) use response_map::folds;
pub use response_map::{MapSettings, ResponseMap};
