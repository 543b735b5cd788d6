#![doc = include_str!("../README.md")]

pub mod baseline;
mod calibration;
mod data;
mod error;
mod gauss_newton;
#[cfg(feature = "st-tv")]
mod gradient;
mod hyperparameter;
mod left_out;
pub mod metrics;
mod movie;
pub mod prior;
mod reconstructor;
mod reference;
mod side;
mod spectrum;
#[cfg(feature = "st-tv")]
mod st_tv;
pub mod touch;
mod whitened;

pub use calibration::{Calibration, CalibrationSettings, CalibrationStatus, Contacts};
pub use data::{DifferenceData, DifferenceSettings, FrameStatus};
pub use error::InverseError;
pub use gauss_newton::{Difference, Report};
#[cfg(feature = "st-tv")]
pub use gradient::Gradient;
pub use hyperparameter::{
    Chosen, CurvePoint, HyperparameterChoice, HyperparameterStatus, NoiseTarget,
};
pub use movie::{
    Certificate, Differences, Movie, MovieMethod, MovieReport, MovieStatus, TracePoint,
};
pub use prior::{Gaussian, GaussianSettings, Laplace, LaplaceSettings, Noser, Prior, Tikhonov};
pub use reconstructor::{Reconstructor, Workspace};
pub use reference::{AdaptiveReference, ReferenceSettings, ReferenceState, ReferenceStep};
pub use side::SideUnknowns;
#[cfg(feature = "st-tv")]
pub use st_tv::{
    ChosenWeights, Fidelity, StTv, StTvSettings, StTvStream, Stop, StreamSettings, StreamStep,
    WeightPoint, WeightStatus, noise_std_of_quiet_frames,
};
