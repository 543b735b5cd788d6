//! Triangulated skins with electrodes for electrical impedance tomography.
//!
//! A [`Mesh`] is a [`Surface`] (nodes in metres, triangles) with [`Electrode`]s on its rim or
//! inside it. [`generate`] meshes a [`SkinShape`] with [`RimElectrodes`] at the resolution set by
//! [`MeshSettings`]; [`generate_placed`] takes electrodes by position, including patches inside the
//! skin. [`read_mesh`] reads a surface from a Gmsh, STL or OBJ file and reports what it repaired
//! ([`Repairs`]); [`place_electrodes`] adds electrodes to it. [`Quality`] measures the shape of the
//! triangles.
//!
//! # Example
//! ```
//! use eit_mesh::{MeshSettings, Quality, RimElectrodes, SkinShape, generate};
#![deny(clippy::missing_errors_doc)]
//!
//! let skin = SkinShape::Disc { radius_m: 0.1 };
//! let mesh = generate(&skin, &RimElectrodes::equally_spaced(16, 0.0196), &MeshSettings::default())?;
//! assert!(Quality::of(&mesh).smallest_angle_deg > 30.0);
//! # Ok::<(), eit_mesh::MeshError>(())
//! ```
#![cfg_attr(docsrs, feature(doc_cfg))]

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod csr;
mod electrode;
mod error;
mod flat_electrodes;
mod generate;
mod geometry;
mod io;
mod placed;
mod quality;
mod raster;
mod repair;
mod rim_electrodes;
#[cfg(feature = "serde")]
mod serialised;
mod settings;
mod size_field;
mod smooth;
mod surface;

/// ndarray, in the version of this crate's interface.
pub use ndarray;

pub use csr::CsrMatrix;
pub use electrode::{Electrode, Mesh};
pub use error::MeshError;
pub use generate::{generate, generate_placed};
pub use geometry::{Loop, Outline, SkinShape};
pub use io::{
    ElementField, GmshVersion, parse_gmsh, parse_obj, parse_stl, read_gmsh, read_mesh, write_gmsh,
    write_vtu,
};
pub use placed::{Contact, PlacedElectrode, place_electrodes};
pub use quality::Quality;
pub use raster::Raster;
pub use repair::Repairs;
pub use rim_electrodes::{Direction, Placement, RimElectrodes};
pub use settings::MeshSettings;
pub use surface::Surface;
