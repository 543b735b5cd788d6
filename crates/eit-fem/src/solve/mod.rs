//! Forward solves: from a model and a conductivity to voltages, fields and their derivatives.
//!
//! | file | content |
//! |---|---|
//! | `forward` | what a [`ForwardModel`](crate::ForwardModel) is asked for |
//! | `workspace` | memory of one solve |
//! | `textbook` | the fast path: the assembled matrix in `f64` |
//! | `accurate` | the path that contact impedances and contrast cannot spoil |
//! | `solution` | voltages, potentials and the report of one solve |
//! | `jacobians` | derivatives of its voltages |

mod accurate;
mod forward;
mod jacobians;
mod report;
mod solution;
mod textbook;
mod workspace;

pub use report::{SolvePath, SolveReport};
pub use solution::Solution;
pub use workspace::Workspace;
