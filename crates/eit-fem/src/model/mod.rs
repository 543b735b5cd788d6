//! The discrete complete electrode model: from a mesh with electrodes to the system matrix.
//!
//! | file | content |
//! |---|---|
//! | `contact` | what one electrode adds |
//! | `dof_map` | unknowns of nodes and electrodes, in elimination order |
//! | `assembly` | pattern of the matrix once, values per conductivity |
//! | `geometry` | what node positions and contact impedances decide |
//! | `deformation` | other positions and impedances on the same triangles |
//! | `forward_model` | all of it with a protocol: [`ForwardModel`] |
//! | `checks` | impedances, conductivities and accuracies that make sense |

mod assembly;
pub(crate) mod checks;
pub(crate) mod contact;
mod deformation;
mod dof_map;
mod forward_model;
mod geometry;

pub use forward_model::{ForwardModel, ModelCost, SystemMatrix};
pub use geometry::Geometry;
