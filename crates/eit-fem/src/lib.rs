//! placeholder

pub mod analytic;
mod assembly;
mod electrode_model;
mod element;
mod error;
mod fields;
mod forward;
mod jacobian;
mod protocol;
mod solver;

pub use error::FemError;
pub use forward::{ForwardModel, ModelCost, Solution, SolveReport, Workspace};
pub use protocol::{DrivenElectrodes, Order, PairPattern, PairProtocol, Protocol};
