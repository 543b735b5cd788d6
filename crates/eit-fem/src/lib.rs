#![doc = include_str!("../README.md")]

mod accurate;
#[cfg(feature = "complex")]
mod admittivity;
pub mod analytic;
mod assembly;
mod cholesky;
mod derivatives;
mod electrode_model;
mod element;
mod error;
#[cfg(feature = "fabric")]
pub mod fabric;
mod fields;
mod forward;
mod geometry;
mod jacobian;
mod mesh_choice;
mod middles;
mod protocol;
mod quadratic;
mod scalar;
mod solution;
mod solver;
mod workspace;

#[cfg(feature = "complex")]
pub use admittivity::{
    AdmittivityModel, AdmittivityReport, AdmittivitySolution, AdmittivityWorkspace, admittivity,
};
pub use derivatives::{Displacement, ElectrodeMotion};
pub use element::Elements;
pub use error::FemError;
pub use forward::{ForwardModel, ModelCost};
pub use geometry::Geometry;
pub use jacobian::JacobianValue;
pub use mesh_choice::{ChosenMesh, Estimate, MeshSearch, MeshTrial, RequiredAccuracy};
#[cfg(feature = "complex")]
pub use num_complex::Complex64;
pub use protocol::{DrivenElectrodes, Order, PairPattern, PairProtocol, Protocol};
pub use solution::{Solution, SolvePath, SolveReport};
pub use workspace::Workspace;
