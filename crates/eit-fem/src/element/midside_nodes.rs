//! Midside nodes: the additional nodes of quadratic elements, one per edge.
//!
//! They are numbered after the mesh nodes, in ascending order of their edges (smaller node first).
//! Where the mesh describes a curved edge, a midside node has an *offset* from the midpoint of the
//! straight edge. The offset is stored in the frame of a triangle at the edge: two of its sides and
//! its normal, scaled to the square root of twice the area. The offset therefore rotates, scales
//! and stretches with the skin when nodes move.

use super::order::ElementOrder;
use eit_core::vector::{cross, dot, norm, sub};
use eit_mesh::Mesh;

/// Midside nodes of a mesh; empty for linear elements.
#[derive(Debug, Clone)]
pub(crate) struct MidsideNodes {
    mesh_nodes: usize,
    /// Edge of each midside node.
    edges: Vec<[u32; 2]>,
    offsets: Vec<Offset>,
}

/// Offset of a midside node from the midpoint of its straight edge.
#[derive(Debug, Clone)]
struct Offset {
    node: u32,
    /// Corners of a triangle at the edge; the edge's nodes come first.
    corners: [u32; 3],
    /// Components along sides 0-1 and 0-2 and along the normal.
    coefficients: [f64; 3],
}

impl MidsideNodes {
    /// Creates the midside nodes that elements of the given order need.
    pub(crate) fn new(mesh: &Mesh, order: ElementOrder) -> Self {
        let surface = mesh.surface();
        let mut midside_nodes =
            Self { mesh_nodes: surface.nodes().len(), edges: Vec::new(), offsets: Vec::new() };
        if order == ElementOrder::Linear {
            return midside_nodes;
        }
        let side = |t: &[u32; 3], k: usize| [t[k], t[(k + 1) % 3], t[(k + 2) % 3]];
        let mut sides: Vec<([u32; 2], [u32; 3])> = surface
            .triangles()
            .iter()
            .flat_map(|t| [0, 1, 2].map(|k| side(t, k)))
            .map(|corners| (sorted([corners[0], corners[1]]), corners))
            .collect();
        sides.sort_unstable();
        sides.dedup_by_key(|(edge, _)| *edge);
        for (index, (edge, corners)) in sides.iter().enumerate() {
            if let Some(position) = mesh.midpoint_m(*edge) {
                let places = corners.map(|n| surface.nodes()[n as usize]);
                let offset = sub(position, mean(places[0], places[1]));
                let coefficients = in_frame(places, offset);
                midside_nodes.offsets.push(Offset {
                    node: index as u32,
                    corners: *corners,
                    coefficients,
                });
            }
        }
        midside_nodes.edges = sides.into_iter().map(|(edge, _)| edge).collect();
        midside_nodes
    }

    /// Number of mesh nodes.
    pub(crate) fn mesh_nodes(&self) -> usize {
        self.mesh_nodes
    }

    /// Number of mesh nodes and midside nodes together.
    pub(crate) fn all_nodes(&self) -> usize {
        self.mesh_nodes + self.edges.len()
    }

    /// Appends the nodes of an element (three corners) or of an electrode's edge (two ends): the
    /// given nodes, then the midside nodes of the sides in order, if there are any.
    pub(crate) fn extend(&self, corners: &[u32], nodes: &mut Vec<u32>) {
        nodes.extend_from_slice(corners);
        let sides = if corners.len() == 2 { 1 } else { corners.len() };
        let middle = |k: usize| {
            let edge = sorted([corners[k], corners[(k + 1) % corners.len()]]);
            let index = self.edges.binary_search(&edge).ok()?;
            Some((self.mesh_nodes + index) as u32)
        };
        nodes.extend((0..sides).filter_map(middle));
    }

    /// Calls `visit` with every midside node (numbered from 0) and its position, for mesh nodes at
    /// `nodes_m`.
    pub(crate) fn places(&self, nodes_m: &[[f64; 3]], mut visit: impl FnMut(usize, [f64; 3])) {
        let mut offsets = self.offsets.iter().peekable();
        for (index, edge) in self.edges.iter().enumerate() {
            let [a, b] = edge.map(|n| nodes_m[n as usize]);
            let mut place = mean(a, b);
            if let Some(offset) = offsets.next_if(|offset| offset.node as usize == index) {
                let frame = frame(offset.corners.map(|n| nodes_m[n as usize]));
                for (axis, coefficient) in frame.iter().zip(offset.coefficients) {
                    place.iter_mut().zip(axis).for_each(|(p, x)| *p += coefficient * x);
                }
            }
            visit(index, place);
        }
    }
}

fn sorted(edge: [u32; 2]) -> [u32; 2] {
    [edge[0].min(edge[1]), edge[0].max(edge[1])]
}

fn mean(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| 0.5 * (a[k] + b[k]))
}

/// Two sides of a triangle, and its normal scaled to the square root of twice the area.
fn frame(corners: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let (e1, e2) = (sub(corners[1], corners[0]), sub(corners[2], corners[0]));
    let normal = cross(e1, e2);
    let root = norm(normal).sqrt();
    [e1, e2, normal.map(|x| x / root)]
}

/// Coefficients of a vector in the frame of a triangle.
fn in_frame(corners: [[f64; 3]; 3], vector: [f64; 3]) -> [f64; 3] {
    let [e1, e2, normal] = frame(corners);
    let (v1, v2) = (dot(vector, e1), dot(vector, e2));
    let [g11, g12, g22] = [dot(e1, e1), dot(e1, e2), dot(e2, e2)];
    let size = dot(normal, normal);
    // the determinant of the sides' Gram matrix is the fourth power of the normal's length
    let determinant = size * size;
    [
        (v1 * g22 - v2 * g12) / determinant,
        (v2 * g11 - v1 * g12) / determinant,
        dot(vector, normal) / size,
    ]
}
