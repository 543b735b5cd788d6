#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]

// Dependency order of the modules: error, check, geometry; then data, noise, prior; then one_step,
// sequence and st_tv. touch uses metrics, noise and one_step; calibration uses data; learn uses touch.
// No two files import each other.
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
    StTvSettings, StTvStream, Stop, StreamSettings, StreamStep, WeightPoint, WeightStatus,
};
pub use touch::{AdaptiveReference, ReferenceSettings, ReferenceState, ReferenceStep};
pub use unevenness::{ReferenceModel, UnevenSheet, Unevenness};
