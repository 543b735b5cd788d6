#![doc = include_str!("../README.md")]

mod data;
mod error;
mod gauss_newton;
mod hyperparameter;
mod left_out;
pub mod metrics;
pub mod prior;
mod reconstructor;
mod spectrum;

pub use data::{DifferenceData, DifferenceSettings};
pub use error::InverseError;
pub use gauss_newton::{Difference, Report};
pub use hyperparameter::{
    Chosen, CurvePoint, HyperparameterChoice, HyperparameterStatus, NoiseTarget,
};
pub use prior::{Gaussian, GaussianSettings, Laplace, LaplaceSettings, Noser, Prior, Tikhonov};
pub use reconstructor::{Reconstructor, Workspace};
