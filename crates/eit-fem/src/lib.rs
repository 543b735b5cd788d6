#![doc = include_str!("../README.md")]

mod accurate;
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
mod middles;
mod protocol;
mod quadratic;
mod solution;
mod solver;
mod workspace;

pub use derivatives::{Displacement, ElectrodeMotion};
pub use element::Elements;
pub use error::FemError;
pub use forward::{ForwardModel, ModelCost};
pub use geometry::Geometry;
pub use jacobian::JacobianValue;
pub use protocol::{DrivenElectrodes, Order, PairPattern, PairProtocol, Protocol};
pub use solution::{Solution, SolvePath, SolveReport};
pub use workspace::Workspace;
