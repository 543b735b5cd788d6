//! Mesh files: Gmsh in and out, VTU out.

mod gmsh_read;
mod gmsh_sections;
mod gmsh_write;
mod vtu;

pub use gmsh_read::{parse_gmsh, read_gmsh};
pub use gmsh_write::{GmshVersion, write_gmsh};
pub use vtu::write_vtu;

use crate::{Mesh, MeshError};

/// One named value per triangle that goes into a mesh file, for example the conductivity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementField<'a> {
    /// Name in the file; with the unit, as in "conductivity_s".
    pub name: &'a str,
    /// One value per triangle, in the mesh's order. NaN is kept.
    pub values: &'a [f64],
}

/// Every field must have one value per triangle.
fn check_fields(mesh: &Mesh, fields: &[ElementField<'_>]) -> Result<(), MeshError> {
    let wanted = mesh.surface().triangles().len();
    match fields.iter().map(|f| f.values.len()).find(|&found| found != wanted) {
        Some(found) => Err(MeshError::WrongLength { what: "values per triangle", found, wanted }),
        None => Ok(()),
    }
}

/// A writer's trouble; the writer itself knows its path, so the caller adds it.
fn io_error(error: &std::io::Error) -> MeshError {
    MeshError::Io { path: "writing the mesh".into(), reason: error.to_string() }
}
