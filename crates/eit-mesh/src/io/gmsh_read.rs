//! Reads a mesh from a Gmsh file: numbers its nodes and resolves groups to electrodes.

use super::gmsh_electrodes::{ElectrodeName, electrode_groups, electrode_names};
use super::gmsh_sections::{Element, Problem, Sections, read_sections};
use crate::geometry::RESOLUTION;
use crate::repair::{coincident, mend, size_m};
use crate::{Electrode, Mesh, MeshError, Repairs, Surface};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// Reads an ASCII Gmsh file, version 2.2 or 4.1. See [`parse_gmsh`].
///
/// # Errors
/// [`MeshError::Io`] if the file cannot be read, otherwise those of [`parse_gmsh`].
pub fn read_gmsh(path: impl AsRef<Path>) -> Result<Mesh, MeshError> {
    let name = path.as_ref().display().to_string();
    parse_gmsh(&super::surface_file::read_file(path.as_ref())?, &name)
}

/// Parses a mesh from the bytes of an ASCII Gmsh file, version 2.2 or 4.1. Coordinates are metres.
///
/// All triangles belong to the skin. Lines of a physical curve named `electrode_N` (N from 1) form
/// rim electrode N; triangles of a physical surface of that name form patch electrode N. A file may
/// have no electrodes. Points, other lines, other groups and non-mesh sections are ignored. Nodes
/// that no triangle uses are dropped; otherwise nodes, triangles and the lines of an electrode keep
/// the file's order, and the triangles of a patch are sorted (2.2 files repeat an element for each
/// of its groups; it counts as one triangle). If the skin consists of disconnected parts with nodes
/// at the same positions, as in meshes of several surfaces, those nodes are merged; if the skin is
/// connected without merging, such nodes form a cut and are kept. [`read_mesh`](crate::read_mesh)
/// reports what was repaired.
///
/// `file` is the file name used in error messages.
///
/// # Errors
/// [`MeshError::Parse`] with the 1-based line (0: the whole file) for every error in the file or in
/// its mesh, including those of [`Surface::new`] and [`Mesh::new`]. Node and triangle indices in
/// their messages are 0-based in file order.
pub fn parse_gmsh(bytes: &[u8], file: &str) -> Result<Mesh, MeshError> {
    mended_gmsh(bytes, file, 1.0).map(|(mesh, _)| mesh)
}

/// Does the same as [`parse_gmsh`] with lengths multiplied by `scale_m`, and returns what was
/// repaired.
pub(super) fn mended_gmsh(
    bytes: &[u8],
    file: &str,
    scale_m: f64,
) -> Result<(Mesh, Repairs), MeshError> {
    let sections = read_sections(bytes, file)?;
    let at = |(line, problem)| MeshError::Parse { file: file.into(), line, problem };
    let names = electrode_names(&sections).map_err(at)?;
    let mut found = resolve(&sections, &names).map_err(at)?;
    found.nodes.iter_mut().flatten().for_each(|x| *x *= scale_m);
    let merge_distance_m = RESOLUTION * size_m(&found.nodes);
    let dropped_nodes = sections.nodes.len() - found.nodes.len();
    let mut repairs = Repairs { dropped_nodes, merge_distance_m, ..Repairs::default() };
    let mut surface = Surface::new(found.nodes.clone(), found.triangles.clone());
    let twins = coincident(&found.nodes, merge_distance_m);
    if twins > 0 && matches!(surface, Err(MeshError::Unconnected { .. })) {
        found.merge(&mut repairs).map_err(|e| at((0, e.to_string())))?;
        surface = Surface::new(found.nodes.clone(), found.triangles.clone());
    } else {
        repairs.coincident_nodes = twins;
    }
    if let Ok(surface) = &surface {
        repairs.inspect(surface, &found.triangles);
    }
    let mesh =
        surface.and_then(|surface| Mesh::new(surface, std::mem::take(&mut found.electrodes)));
    let Resolved { triangle_lines, node_of_tag, .. } = found;
    let lines = ErrorLines { sections: &sections, names: &names, triangle_lines, node_of_tag };
    mesh.map(|mesh| (mesh, repairs)).map_err(|error| at((lines.line_of(&error), error.to_string())))
}

/// Finds the line that caused an error of [`Surface::new`] or [`Mesh::new`].
struct ErrorLines<'a> {
    sections: &'a Sections,
    names: &'a BTreeMap<usize, ElectrodeName>,
    triangle_lines: Vec<usize>,
    node_of_tag: NodesByTag,
}

impl ErrorLines<'_> {
    /// Returns the 1-based line, or 0 if the error concerns the whole file.
    fn line_of(&self, error: &MeshError) -> usize {
        match *error {
            MeshError::ZeroArea { triangle, .. }
            | MeshError::NotOrientable { triangle, .. }
            | MeshError::Unconnected { triangle, .. } => {
                self.triangle_lines.get(triangle).copied().unwrap_or(0)
            }
            MeshError::NonManifoldEdge { edge, .. } => {
                self.last_on_edge(&self.sections.triangles, edge)
            }
            MeshError::NotOnRim { edge, .. } => self.last_on_edge(&self.sections.edges, edge),
            MeshError::OverlappingElements { second, .. } => {
                self.names.get(&second).map_or(0, |name| name.line)
            }
            _ => 0,
        }
    }

    fn last_on_edge<const N: usize>(&self, elements: &[Element<N>], edge: [u32; 2]) -> usize {
        let index = |tag: &u64| self.node_of_tag.get(tag).and_then(|node| node.index);
        let on_edge = |element: &&Element<N>| {
            edge.iter().all(|&end| element.nodes.iter().any(|tag| index(tag) == Some(end)))
        };
        elements.iter().rfind(on_edge).map_or(0, |element| element.line)
    }
}

/// A node of the file and, once a triangle uses it, its index in the mesh.
struct NodeOfTag {
    position: usize,
    index: Option<u32>,
}

/// Nodes of the file by their tags.
type NodesByTag = HashMap<u64, NodeOfTag>;

/// The contents of the file with tags resolved to indices.
struct Resolved {
    nodes: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    triangle_lines: Vec<usize>,
    electrodes: Vec<Electrode>,
    node_of_tag: NodesByTag,
}

impl Resolved {
    /// Merges nodes at the same position.
    fn merge(&mut self, repairs: &mut Repairs) -> Result<(), MeshError> {
        let mended = mend(&self.nodes, &self.triangles, repairs.merge_distance_m)?;
        repairs.merged_nodes = mended.repairs.merged_nodes;
        repairs.dropped_triangles = mended.repairs.dropped_triangles;
        let mut kept = mended.triangle_of.iter().map(Option::is_some);
        self.triangle_lines.retain(|_| kept.next().unwrap_or(false));
        for electrode in &mut self.electrodes {
            match electrode {
                Electrode::Rim(edges) => edges.iter_mut().flatten().for_each(|node| {
                    *node = mended.node_of.get(*node as usize).copied().flatten().unwrap_or(*node);
                }),
                Electrode::Patch(triangles) => {
                    let new = |t: &u32| mended.triangle_of.get(*t as usize).copied().flatten();
                    *triangles = triangles.iter().filter_map(new).collect();
                }
            }
        }
        for node in self.node_of_tag.values_mut() {
            node.index = node.index.and_then(|i| mended.node_of.get(i as usize).copied().flatten());
        }
        (self.nodes, self.triangles) = (mended.nodes, mended.triangles);
        Ok(())
    }
}

/// Resolves tags to indices and groups to electrodes.
fn resolve(
    sections: &Sections,
    names: &BTreeMap<usize, ElectrodeName>,
) -> Result<Resolved, Problem> {
    if sections.triangles.is_empty() {
        return Err((0, no_triangle(sections)));
    }
    let (nodes, node_of_tag) = number_nodes(sections)?;
    let index = |tag: u64, line: usize| match node_of_tag.get(&tag) {
        Some(NodeOfTag { index: Some(index), .. }) => Ok(*index),
        Some(_) => Err((line, format!("node {tag} of an electrode belongs to no triangle"))),
        None => Err((line, format!("node {tag} is not in $Nodes"))),
    };
    let groups = electrode_groups(sections, names)?;
    let mut rims = vec![Vec::new(); names.len()];
    for edge in &sections.edges {
        if let Some(&number) = groups.get(&(1, edge.group)) {
            let [a, b] = edge.nodes;
            rims[number - 1].push([index(a, edge.line)?, index(b, edge.line)?]);
        }
    }
    let mut patches: Vec<Vec<u32>> = vec![Vec::new(); names.len()];
    let mut triangles = Vec::with_capacity(sections.triangles.len());
    let mut triangle_lines = Vec::with_capacity(sections.triangles.len());
    let mut known: HashMap<[u64; 3], usize> = HashMap::with_capacity(sections.triangles.len());
    for triangle in &sections.triangles {
        let mut key = triangle.nodes;
        key.sort_unstable();
        let number = *known.entry(key).or_insert(triangles.len());
        if number == triangles.len() {
            let [a, b, c] = triangle.nodes;
            let line = triangle.line;
            triangles.push([index(a, line)?, index(b, line)?, index(c, line)?]);
            triangle_lines.push(line);
        }
        if let Some(&electrode) = groups.get(&(2, triangle.group)) {
            let index =
                u32::try_from(number).map_err(|_| (triangle.line, too_many("triangles")))?;
            patches[electrode - 1].push(index);
        }
    }
    let mut electrodes = Vec::with_capacity(names.len());
    for (name, (rim, mut patch)) in names.iter().zip(rims.into_iter().zip(patches)) {
        let (number, name) = name;
        if rim.is_empty() && patch.is_empty() {
            let what = if name.dimension == 1 { "line" } else { "triangle" };
            return Err((name.line, format!("electrode_{number} is named but has no {what}")));
        }
        patch.sort_unstable();
        patch.dedup();
        electrodes.push(match name.dimension {
            1 => Electrode::Rim(rim),
            _ => Electrode::Patch(patch),
        });
    }
    Ok(Resolved { nodes, triangles, triangle_lines, electrodes, node_of_tag })
}

/// Says why Gmsh saved no triangle: it saves the elements of physical groups alone if there are any.
fn no_triangle(sections: &Sections) -> String {
    let in_2 = sections.edges.iter().any(|edge| sections.entities.is_none() && edge.group != 0);
    let mut entities = sections.entities.iter().flatten();
    if in_2 || entities.any(|(_, entity)| !entity.physical.is_empty()) {
        "the file has physical groups but no triangle, because Gmsh saves only elements of physical groups: \
         add a Physical Surface that contains the skin, or set Mesh.SaveAll = 1"
    } else {
        "the file has no triangle: mesh the surface before saving (gmsh -2)"
    }
    .to_owned()
}

fn too_many(what: &str) -> String {
    format!("more {what} than 32-bit indices can address: use a coarser mesh")
}

/// Returns the positions of the nodes that triangles use, in file order, and all nodes by tag.
fn number_nodes(sections: &Sections) -> Result<(Vec<[f64; 3]>, NodesByTag), Problem> {
    let mut by_tag: NodesByTag = HashMap::with_capacity(sections.nodes.len());
    for (position, node) in sections.nodes.iter().enumerate() {
        if let Some(first) = by_tag.insert(node.tag, NodeOfTag { position, index: None }) {
            let first = sections.nodes[first.position].line;
            let problem = format!("node {} again, first on line {first}: remove one", node.tag);
            return Err((node.line, problem));
        }
    }
    let mut used = vec![false; sections.nodes.len()];
    for triangle in &sections.triangles {
        for tag in triangle.nodes {
            if let Some(node) = by_tag.get(&tag) {
                used[node.position] = true;
            }
        }
    }
    let mut positions_m = Vec::new();
    for (node, used) in sections.nodes.iter().zip(used) {
        if used {
            let index =
                u32::try_from(positions_m.len()).map_err(|_| (node.line, too_many("nodes")))?;
            positions_m.push(node.position_m);
            if let Some(entry) = by_tag.get_mut(&node.tag) {
                entry.index = Some(index);
            }
        }
    }
    Ok((positions_m, by_tag))
}
