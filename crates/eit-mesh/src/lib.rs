//! Triangulated skins with electrodes for electrical impedance tomography.
#![doc = ""]

mod csr;
mod electrode;
mod error;
mod generate;
mod geometry;
mod io;
mod overlap;
mod quality;
mod raster;
mod rim_electrodes;
mod size_field;
mod smooth;
mod surface;

pub use csr::CsrMatrix;
pub use electrode::{Electrode, Mesh};
pub use error::MeshError;
pub use generate::{MeshSettings, generate};
pub use geometry::{Loop, Outline, SkinShape};
pub use io::{ElementField, GmshVersion, parse_gmsh, read_gmsh, write_gmsh, write_vtu};
pub use quality::Quality;
pub use raster::Raster;
pub use rim_electrodes::{Direction, Placement, RimElectrodes};
pub use surface::Surface;
