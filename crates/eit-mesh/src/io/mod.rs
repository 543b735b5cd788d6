//! Mesh files: reads Gmsh, STL and OBJ; writes Gmsh and VTU.

mod gmsh_electrodes;
mod gmsh_read;
mod gmsh_sections;
mod gmsh_write;
mod lines;
mod obj;
mod stl;
mod surface_file;
mod vtu;

pub use gmsh_read::{parse_gmsh, read_gmsh};
pub use gmsh_write::{GmshVersion, write_gmsh};
pub use surface_file::{parse_obj, parse_stl, read_mesh};
pub use vtu::write_vtu;

use crate::surface::{sides, sorted};
use crate::{Electrode, Mesh, MeshError};
use std::collections::HashMap;

/// Nodes and triangles of a file, before they form a surface.
#[derive(Debug, Default)]
struct Soup {
    nodes: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Soup {
    /// Adds a triangle with its own three nodes. Beyond 32 bits the indices wrap, but such counts
    /// are rejected before the indices are used.
    fn push(&mut self, corners: [[f64; 3]; 3]) {
        let first = self.nodes.len();
        self.nodes.extend(corners);
        self.triangles.push([first, first + 1, first + 2].map(|n| n as u32));
    }
}

/// A named value per triangle to write to a mesh file, for example the conductivity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementField<'a> {
    /// Name in the file, including the unit, as in "conductivity_s".
    pub name: &'a str,
    /// One value per triangle, in the mesh's order. NaN is kept.
    pub values: &'a [f64],
}

/// Checks that every field has one value per triangle.
fn check_fields(mesh: &Mesh, fields: &[ElementField<'_>]) -> Result<(), MeshError> {
    let wanted = mesh.surface().triangles().len();
    fields.iter().try_for_each(|field| {
        MeshError::check_length("values per triangle", field.values.len(), wanted)
    })
}

/// Returns the 1-based electrode number and the edge for every rim electrode edge, electrode by
/// electrode.
fn rim_edges(mesh: &Mesh) -> impl Iterator<Item = (usize, [u32; 2])> + '_ {
    (1..).zip(mesh.electrodes()).flat_map(|(number, electrode)| {
        let edges = match electrode {
            Electrode::Rim(edges) => edges.as_slice(),
            Electrode::Patch(_) => &[],
        };
        edges.iter().map(move |&edge| (number, edge))
    })
}

/// Returns the 1-based electrode number of each triangle, 0 on bare skin.
fn patch_numbers(mesh: &Mesh) -> Vec<usize> {
    let mut numbers = vec![0; mesh.surface().triangles().len()];
    for (number, electrode) in (1..).zip(mesh.electrodes()) {
        if let Electrode::Patch(triangles) = electrode {
            triangles.iter().for_each(|&t| numbers[t as usize] = number);
        }
    }
    numbers
}

/// Returns the triangle of each of [`rim_edges`]. In a file an edge takes the value of its
/// triangle: meshio reads data only if every element has a value, and NaN spoils colour scales.
fn rim_triangles(mesh: &Mesh) -> Vec<usize> {
    let mut triangle_of: HashMap<[u32; 2], usize> =
        rim_edges(mesh).map(|(_, edge)| (sorted(edge), 0)).collect();
    for (t, triangle) in mesh.surface().triangles().iter().enumerate() {
        for side in sides(*triangle) {
            triangle_of.entry(side).and_modify(|triangle| *triangle = t);
        }
    }
    rim_edges(mesh).map(|(_, edge)| triangle_of[&sorted(edge)]).collect()
}

/// Wraps an error of the writer, whose path only the caller knows.
fn io_error(error: &std::io::Error) -> MeshError {
    MeshError::Io { path: "writing the mesh".into(), reason: error.to_string() }
}
