//! Discrete complete electrode model: the system matrix of a mesh with electrodes.
//!
//! | file | content |
//! |---|---|
//! | `anisotropy` | direction and ratio of the conductivity of each element |
//! | `contact` | terms of one electrode |
//! | `dof_map` | unknowns of nodes and electrodes, in elimination order |
//! | `assembly` | matrix pattern (once) and values (for each conductivity) |
//! | `geometry` | numbers derived from node positions and contact impedances |
//! | `deformation` | new positions and impedances on the same triangles |
//! | `forward_model` | [`ForwardModel`]: all of the above with a protocol |
//! | `checks` | validation of impedances, conductivities and accuracies |

mod anisotropy;
mod assembly;
pub(crate) mod checks;
pub(crate) mod contact;
mod deformation;
mod dof_map;
mod forward_model;
mod geometry;

pub use anisotropy::Anisotropy;
pub(crate) use anisotropy::Grain;
pub use forward_model::{ForwardModel, ModelCost, SystemMatrix};
pub use geometry::Geometry;
