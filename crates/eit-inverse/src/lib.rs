#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(clippy::missing_errors_doc)]

// Dependency order of the modules: error, check, geometry, assign; then data, noise, prior; then one_step,
// sequence and st_tv. touch uses metrics; calibration uses data; learn uses touch.
// No two files import each other.
#[cfg(feature = "serde")]
mod absent;
mod assign;
mod calibration;
mod check;
mod data;
mod error;
mod geometry;
#[cfg(feature = "learn")]
pub mod learn;
pub mod metrics;
mod noise;
mod one_step;
pub mod prior;
pub mod sequence;
#[cfg(feature = "st-tv")]
mod st_tv;
pub mod touch;
mod unevenness;

/// mint, whose points and vectors most mathematics crates convert.
#[cfg(feature = "mint")]
#[cfg_attr(docsrs, doc(cfg(feature = "mint")))]
pub use mint;
/// ndarray, in the version of this crate's interface.
pub use ndarray;

pub use calibration::{Calibration, CalibrationSettings, CalibrationStatus, Contacts};
pub use data::{DifferenceData, DifferenceKind, FrameStatus};
pub use error::InverseError;
pub use noise::{NuisanceParameters, noise_std_of_quiet_frames, smallest_step};
pub use one_step::{
    ChosenHyperparameter, CurvePoint, HyperparameterChoice, HyperparameterStatus, NoiseTarget,
    OneStepGaussNewton, OneStepReport, OneStepSettings, Reconstructor, Workspace,
};
pub use prior::{Gaussian, GaussianSettings, Laplace, LaplaceSettings, Noser, Prior, Tikhonov};
pub use sequence::{
    Certificate, DifferenceFrames, ImageSequence, SequenceReport, SequenceSolver, SequenceStatus,
    TracePoint,
};
#[cfg(feature = "st-tv")]
pub use st_tv::{
    CausalDual, CausalSettings, CausalStep, CausalStream, ChosenWeights, Fidelity, Gradient, StTv,
    StTvSettings, Stop, WeightPoint, WeightStatus,
};
pub use unevenness::{Effects, ReferenceModel, UnevenSheet, Unevenness};
