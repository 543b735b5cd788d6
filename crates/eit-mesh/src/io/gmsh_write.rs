//! Writes a mesh to an ASCII Gmsh file, version 2.2 or 4.1.

use super::{ElementField, check_fields, io_error, patch_numbers, rim_edges, rim_triangles};
use crate::{Electrode, Mesh, MeshError};
use std::io::{self, Write};

/// Version of the Gmsh file format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum GmshVersion {
    /// Version 2.2, which nearly every program reads.
    V2_2,
    /// Version 4.1, Gmsh's own default since 2019.
    #[default]
    V4_1,
}

/// Writes a mesh that [`parse_gmsh`](crate::parse_gmsh) reads back unchanged.
///
/// Physical groups: `skin` (triangles without an electrode) and `electrode_N`, a physical curve for
/// a rim electrode and a physical surface for a patch. Nodes, triangles and rim edges keep their
/// order; the triangles of a patch are read back in ascending order. Numbers are written with the
/// fewest digits that restore the same bits. Each field becomes an `$ElementData` section, where an
/// edge takes the value of its triangle.
///
/// `out` receives many small writes: pass a [`BufWriter`](std::io::BufWriter) and flush it.
///
/// # Errors
/// [`MeshError::WrongLength`] for a field that does not match the mesh, [`MeshError::BadFieldName`]
/// for a name that is not valid in the format, [`MeshError::Io`].
pub fn write_gmsh(
    mesh: &Mesh,
    out: &mut impl Write,
    version: GmshVersion,
    fields: &[ElementField<'_>],
) -> Result<(), MeshError> {
    check_fields(mesh, fields)?;
    if let Some(field) = fields.iter().find(|f| f.name.contains(['"', '\n', '\r'])) {
        return Err(MeshError::BadFieldName { name: field.name.into() });
    }
    let file = GmshFile { mesh, owners: patch_numbers(mesh) };
    let written = file.write(out, version).and_then(|()| {
        let on_edges = if fields.is_empty() { vec![] } else { rim_triangles(mesh) };
        fields.iter().try_for_each(|field| element_data(out, &on_edges, field))
    });
    written.map_err(|error| io_error(&error))
}

struct GmshFile<'a> {
    mesh: &'a Mesh,
    owners: Vec<usize>,
}

impl GmshFile<'_> {
    fn write(&self, out: &mut impl Write, version: GmshVersion) -> io::Result<()> {
        let number = match version {
            GmshVersion::V2_2 => "2.2",
            GmshVersion::V4_1 => "4.1",
        };
        writeln!(out, "$MeshFormat\n{number} 0 8\n$EndMeshFormat")?;
        self.physical_names(out)?;
        match version {
            GmshVersion::V2_2 => {
                self.nodes_2(out)?;
                self.elements_2(out)
            }
            GmshVersion::V4_1 => {
                self.entities(out)?;
                self.nodes_4(out)?;
                self.elements_4(out)
            }
        }
    }

    /// Physical and entity tag of the bare skin: one above the electrodes' tags 1 to n.
    fn skin_tag(&self) -> usize {
        self.mesh.electrodes().len() + 1
    }

    /// Tag of the group of a triangle with the given owner.
    fn surface_tag(&self, owner: usize) -> usize {
        if owner == 0 { self.skin_tag() } else { owner }
    }

    fn physical_names(&self, out: &mut impl Write) -> io::Result<()> {
        writeln!(out, "$PhysicalNames\n{}", self.skin_tag())?;
        for (number, electrode) in (1..).zip(self.mesh.electrodes()) {
            let dimension = match electrode {
                Electrode::Rim(_) => 1,
                Electrode::Patch(_) => 2,
            };
            writeln!(out, "{dimension} {number} \"electrode_{number}\"")?;
        }
        writeln!(out, "2 {} \"skin\"\n$EndPhysicalNames", self.skin_tag())
    }

    fn nodes_2(&self, out: &mut impl Write) -> io::Result<()> {
        let nodes = self.mesh.surface().nodes();
        writeln!(out, "$Nodes\n{}", nodes.len())?;
        for (tag, [x, y, z]) in (1..).zip(nodes) {
            let tag: usize = tag;
            writeln!(out, "{tag} {x:?} {y:?} {z:?}")?;
        }
        writeln!(out, "$EndNodes")
    }

    fn elements_2(&self, out: &mut impl Write) -> io::Result<()> {
        let triangles = self.mesh.surface().triangles();
        writeln!(out, "$Elements\n{}", rim_edges(self.mesh).count() + triangles.len())?;
        let mut tag = 0_usize;
        for (number, edge) in rim_edges(self.mesh) {
            let [a, b] = edge.map(node_tag);
            tag += 1;
            writeln!(out, "{tag} 1 2 {number} {number} {a} {b}")?;
        }
        for (&owner, triangle) in self.owners.iter().zip(triangles) {
            let [a, b, c] = triangle.map(node_tag);
            tag += 1;
            let group = self.surface_tag(owner);
            writeln!(out, "{tag} 2 2 {group} {group} {a} {b} {c}")?;
        }
        writeln!(out, "$EndElements")
    }

    /// Writes one curve per rim electrode, one surface per patch and one for the bare skin.
    fn entities(&self, out: &mut impl Write) -> io::Result<()> {
        let surface = self.mesh.surface();
        let of_node = |n: &u32| surface.nodes()[*n as usize];
        let (mut curves, mut patches) = (Vec::new(), Vec::new());
        for (number, electrode) in (1..).zip(self.mesh.electrodes()) {
            let number: usize = number;
            match electrode {
                Electrode::Rim(edges) => {
                    curves.push((number, bounds(edges.iter().flatten().map(of_node))));
                }
                Electrode::Patch(triangles) => {
                    let corners = triangles.iter().flat_map(|&t| surface.corners(t as usize));
                    patches.push((number, bounds(corners)));
                }
            }
        }
        patches.push((self.skin_tag(), surface.bounds_m()));
        writeln!(out, "$Entities\n0 {} {} 0", curves.len(), patches.len())?;
        for (tag, [low, high]) in curves.iter().chain(&patches) {
            write!(out, "{tag} ")?;
            for x in low.iter().chain(high) {
                write!(out, "{x:?} ")?;
            }
            writeln!(out, "1 {tag} 0")?;
        }
        writeln!(out, "$EndEntities")
    }

    /// Writes all nodes in one block, on the skin's entity.
    fn nodes_4(&self, out: &mut impl Write) -> io::Result<()> {
        let nodes = self.mesh.surface().nodes();
        let count = nodes.len();
        writeln!(out, "$Nodes\n1 {count} 1 {count}\n2 {} 0 {count}", self.skin_tag())?;
        for tag in 1..=count {
            writeln!(out, "{tag}")?;
        }
        for [x, y, z] in nodes {
            writeln!(out, "{x:?} {y:?} {z:?}")?;
        }
        writeln!(out, "$EndNodes")
    }

    /// Writes a block for the edges of each electrode and for each run of triangles with the same
    /// owner, which preserves the order.
    fn elements_4(&self, out: &mut impl Write) -> io::Result<()> {
        let edges: Vec<(usize, [u32; 2])> = rim_edges(self.mesh).collect();
        let edge_blocks = || edges.chunk_by(|a, b| a.0 == b.0);
        let blocks = edge_blocks().count() + self.owners.chunk_by(usize::eq).count();
        let count = edges.len() + self.owners.len();
        writeln!(out, "$Elements\n{blocks} {count} 1 {count}")?;
        let mut tag = 0;
        for block in edge_blocks() {
            writeln!(out, "1 {} 1 {}", block[0].0, block.len())?;
            for (_, edge) in block {
                let [a, b] = edge.map(node_tag);
                tag += 1;
                writeln!(out, "{tag} {a} {b}")?;
            }
        }
        let mut triangles = self.mesh.surface().triangles().iter();
        for block in self.owners.chunk_by(usize::eq) {
            writeln!(out, "2 {} 2 {}", self.surface_tag(block[0]), block.len())?;
            for triangle in triangles.by_ref().take(block.len()) {
                let [a, b, c] = triangle.map(node_tag);
                tag += 1;
                writeln!(out, "{tag} {a} {b} {c}")?;
            }
        }
        writeln!(out, "$EndElements")
    }
}

/// Gmsh counts nodes from 1.
fn node_tag(node: u32) -> u64 {
    u64::from(node) + 1
}

/// Bounding box of some points: `[min, max]`.
fn bounds(points: impl Iterator<Item = [f64; 3]>) -> [[f64; 3]; 2] {
    points.fold([[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]], |[low, high], p| {
        [std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k]))]
    })
}

/// Writes one scalar per element: the rim edges (with the values of their triangles), then the
/// triangles.
fn element_data(
    out: &mut impl Write,
    on_edges: &[usize],
    field: &ElementField<'_>,
) -> io::Result<()> {
    let count = on_edges.len() + field.values.len();
    // one string (the name), one number (time), three integers: step, components, values
    writeln!(out, "$ElementData\n1\n\"{}\"\n1\n0.0\n3\n0\n1\n{count}", field.name)?;
    let values = on_edges.iter().map(|&t| field.values[t]).chain(field.values.iter().copied());
    for (tag, value) in (1_usize..).zip(values) {
        writeln!(out, "{tag} {value:?}")?;
    }
    writeln!(out, "$EndElementData")
}
