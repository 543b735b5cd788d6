//! Forward solves: from a model and a conductivity to voltages, fields and their derivatives.
//!
//! | file | content |
//! |---|---|
//! | `forward` | solves of a [`ForwardModel`](crate::ForwardModel) |
//! | `workspace` | working memory of a solve |
//! | `nodal_assembly` | the fast path: the matrix of node and electrode potentials in `f64` |
//! | `electrode_elimination` | the accurate path for extreme contact impedances and contrast |
//! | `solution` | voltages, potentials and the report of one solve |
//! | `jacobians` | derivatives of the voltages |

mod electrode_elimination;
mod forward;
mod jacobians;
pub(crate) mod nodal;
mod nodal_assembly;
mod report;
mod solution;
mod workspace;

pub use report::{SolvePath, SolveReport};
pub use solution::Solution;
pub use workspace::Workspace;
