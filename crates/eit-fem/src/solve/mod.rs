//! Forward solves: from a model and a conductivity to voltages, fields and their derivatives.
//!
//! | file | content |
//! |---|---|
//! | `forward` | what a [`ForwardModel`](crate::ForwardModel) is asked for |
//! | `workspace` | memory of one solve |
//! | `nodal_assembly` | the fast path: the matrix of node and electrode potentials in `f64` |
//! | `electrode_elimination` | the path that contact impedances and contrast cannot spoil |
//! | `solution` | voltages, potentials and the report of one solve |
//! | `jacobians` | derivatives of its voltages |

mod electrode_elimination;
mod forward;
mod jacobians;
mod nodal_assembly;
mod report;
mod solution;
mod workspace;

pub use report::{SolvePath, SolveReport};
pub use solution::Solution;
pub use workspace::Workspace;
