#![doc = include_str!("../README.md")]
#![cfg_attr(docsrs, feature(doc_cfg))]
#![deny(clippy::missing_errors_doc)]

#[cfg(feature = "complex")]
mod admittivity;
pub mod analytic;
mod derivatives;
mod element;
mod error;
#[cfg(feature = "fabric")]
pub mod fabric;
mod mesh_choice;
mod model;
mod protocol;
mod solve;
pub mod sparse;

/// ndarray, in the version of this crate's interface.
pub use ndarray;

#[cfg(feature = "complex")]
pub use admittivity::{
    AdmittivityModel, AdmittivityReport, AdmittivitySolution, AdmittivityWorkspace, admittivity,
};
pub use derivatives::{Displacement, ElectrodeMotion, JacobianValue};
pub use element::ElementOrder;
pub use error::FemError;
pub use mesh_choice::{ChosenMesh, Estimate, MeshSearch, MeshTrial, RequiredAccuracy};
pub use model::{Anisotropy, ForwardModel, Geometry, ModelCost, SystemMatrix};
#[cfg(feature = "complex")]
pub use num_complex::Complex64;
pub use protocol::{DrivenElectrodes, Order, PairPattern, PairProtocol, Protocol};
pub use solve::{Solution, SolvePath, SolveReport, Workspace};
