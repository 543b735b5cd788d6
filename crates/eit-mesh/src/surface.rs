//! A triangulated surface: nodes, triangles and rim. Always valid.
//!
//! Flat skins (z = 0) and robot links use the same code. Indices are `u32`, which halves the memory
//! traffic of `usize`, the bottleneck of assembly.

use crate::MeshError;
use eit_core::vector::{self, norm, sub};
use std::collections::HashMap;

/// Triangles with an area below this fraction of their longest edge squared count as degenerate.
///
/// The cross product of two edges of length h carries a rounding error of about
/// `4 * f64::EPSILON * h^2` (two products and one difference per component), so a smaller area has
/// no correct digit. Slivers above it are kept: they are valid, only badly conditioned.
const ZERO_AREA: f64 = 4.0 * f64::EPSILON;

/// A connected, oriented, manifold triangulated surface.
///
/// Invariants, checked by [`Surface::new`]: nodes are finite and each is used by a triangle;
/// triangles have a positive area and a consistent orientation (counter-clockwise seen from +z if
/// the surface is flat); at most two triangles share an edge; the surface is connected.
///
/// ```
/// use eit_mesh::Surface;
///
/// let corners_m = vec![[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]];
/// let surface = Surface::new(corners_m, vec![[0, 1, 2]])?;
/// assert!((surface.areas_m2()[0] - 0.005).abs() < 1e-15);
/// assert_eq!(surface.rim_edges().len(), 3);
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "crate::serialised::SurfaceParts", into = "crate::serialised::SurfaceParts")
)]
pub struct Surface {
    nodes: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    areas_m2: Vec<f64>,
    rim_edges: Vec<[u32; 2]>,
}

impl Surface {
    /// Creates a surface from nodes (metres) and triangles (node indices) and checks it.
    ///
    /// Triangles oriented against their neighbours are reversed (second and third node swapped);
    /// all orders are otherwise kept, so values per element stay with their element.
    ///
    /// # Errors
    /// Any violation of an invariant of [`Surface`], with the index of the item at fault.
    pub fn new(nodes: Vec<[f64; 3]>, mut triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        check_nodes_and_indices(&nodes, &triangles)?;
        let areas_m2 = check_areas(&nodes, &triangles)?;
        let neighbours = neighbours(&nodes, &triangles)?;
        orient(&nodes, &mut triangles, &areas_m2, &neighbours)?;
        let mut rim_edges = Vec::new();
        for (triangle, sides) in triangles.iter().zip(&oriented_sides(&triangles, &neighbours)) {
            for (k, across) in sides.iter().enumerate() {
                if across.is_none() {
                    rim_edges.push([triangle[k], triangle[(k + 1) % 3]]);
                }
            }
        }
        Ok(Self { nodes, triangles, areas_m2, rim_edges })
    }

    /// Nodes, metres.
    pub fn nodes(&self) -> &[[f64; 3]] {
        &self.nodes
    }

    /// Triangles as node indices, consistently oriented.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Area of each triangle, square metres.
    pub fn areas_m2(&self) -> &[f64] {
        &self.areas_m2
    }

    /// Rim edges as node pairs, with the skin on their left, in triangle order.
    pub fn rim_edges(&self) -> &[[u32; 2]] {
        &self.rim_edges
    }

    /// Corner positions of one triangle, metres.
    pub fn corners(&self, triangle: usize) -> [[f64; 3]; 3] {
        self.triangles[triangle].map(|n| self.nodes[n as usize])
    }

    /// Centroid of each triangle, metres.
    pub fn centroids(&self) -> Vec<[f64; 3]> {
        (0..self.triangles.len()).map(|t| middle(&self.corners(t))).collect()
    }

    /// Returns the three triangles across the sides (0-1, 1-2, 2-0) of each triangle; `None` on the
    /// rim.
    pub fn neighbours(&self) -> Vec<[Option<u32>; 3]> {
        // built from valid triangles, so the only error of `neighbours` cannot occur
        neighbours(&self.nodes, &self.triangles).unwrap_or_default()
    }

    /// Bounding box of the surface: `[min, max]`, metres.
    pub fn bounds_m(&self) -> [[f64; 3]; 2] {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for node in &self.nodes {
            for k in 0..3 {
                bounds[0][k] = bounds[0][k].min(node[k]);
                bounds[1][k] = bounds[1][k].max(node[k]);
            }
        }
        bounds
    }
}

/// An edge with its smaller node first.
pub(crate) fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// The sides of a triangle, smaller node first.
pub(crate) fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(sorted)
}

/// Mean of some points.
pub(crate) fn middle<const N: usize>(points: &[[f64; 3]; N]) -> [f64; 3] {
    std::array::from_fn(|k| points.iter().map(|p| p[k]).sum::<f64>() / N as f64)
}

fn centroid(nodes: &[[f64; 3]], triangle: [u32; 3]) -> [f64; 3] {
    middle(&triangle.map(|n| nodes[n as usize]))
}

fn normal(nodes: &[[f64; 3]], triangle: [u32; 3]) -> [f64; 3] {
    vector::normal(triangle.map(|n| nodes[n as usize]))
}

fn check_nodes_and_indices(nodes: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<(), MeshError> {
    if triangles.is_empty() {
        return Err(MeshError::NoTriangles { nodes: nodes.len() });
    }
    for (what, count) in [("nodes", nodes.len()), ("triangles", triangles.len())] {
        if u32::try_from(count).is_err() {
            return Err(MeshError::TooLarge { what, count });
        }
    }
    if let Some(node) = nodes.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
        return Err(MeshError::NonFiniteNode { node, position_m: nodes[node] });
    }
    let mut used = vec![false; nodes.len()];
    for (triangle, corners) in triangles.iter().enumerate() {
        for &node in corners {
            *used.get_mut(node as usize).ok_or(MeshError::UnknownNode {
                triangle,
                node,
                nodes: nodes.len(),
            })? = true;
        }
    }
    match used.iter().position(|&u| !u) {
        Some(node) => Err(MeshError::UnusedNode { node, position_m: nodes[node] }),
        None => Ok(()),
    }
}

fn check_areas(nodes: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Vec<f64>, MeshError> {
    let mut areas_m2 = Vec::with_capacity(triangles.len());
    for (triangle, &corners) in triangles.iter().enumerate() {
        let [a, b, c] = corners.map(|n| nodes[n as usize]);
        let area_m2 = 0.5 * norm(normal(nodes, corners));
        let longest = norm(sub(b, a)).max(norm(sub(c, b))).max(norm(sub(a, c)));
        // intermediate values may overflow
        if !area_m2.is_finite() || area_m2 <= ZERO_AREA * longest * longest {
            let position_m = middle(&[a, b, c]);
            return Err(MeshError::ZeroArea { triangle, nodes: corners, area_m2, position_m });
        }
        areas_m2.push(area_m2);
    }
    Ok(areas_m2)
}

/// Returns the triangles across each side; rejects edges shared by three or more triangles.
fn neighbours(
    nodes: &[[f64; 3]],
    triangles: &[[u32; 3]],
) -> Result<Vec<[Option<u32>; 3]>, MeshError> {
    let mut first: HashMap<[u32; 2], (u32, u8)> = HashMap::with_capacity(2 * triangles.len());
    let mut across = vec![[None; 3]; triangles.len()];
    for (t, corners) in triangles.iter().enumerate() {
        for k in 0..3 {
            let edge = sorted([corners[k], corners[(k + 1) % 3]]);
            match first.get(&edge) {
                None => {
                    first.insert(edge, (t as u32, k as u8));
                }
                Some(&(other, side)) => {
                    let slot = &mut across[other as usize][side as usize];
                    if slot.is_some() {
                        let triangles = count_on_edge(triangles, edge);
                        let position_m = middle(&edge.map(|n| nodes[n as usize]));
                        return Err(MeshError::NonManifoldEdge { edge, triangles, position_m });
                    }
                    *slot = Some(t as u32);
                    across[t][k] = Some(other);
                }
            }
        }
    }
    Ok(across)
}

fn count_on_edge(triangles: &[[u32; 3]], edge: [u32; 2]) -> usize {
    triangles.iter().filter(|t| t.contains(&edge[0]) && t.contains(&edge[1])).count()
}

/// Returns neighbours by side of the reoriented triangles (reversing swaps sides 0 and 2).
fn oriented_sides(
    triangles: &[[u32; 3]],
    neighbours: &[[Option<u32>; 3]],
) -> Vec<[Option<u32>; 3]> {
    let shares = |t: &[u32; 3], a: u32, b: u32| t.contains(&a) && t.contains(&b);
    triangles
        .iter()
        .zip(neighbours)
        .map(|(t, across)| {
            std::array::from_fn(|k| {
                let (a, b) = (t[k], t[(k + 1) % 3]);
                across.iter().flatten().copied().find(|&o| shares(&triangles[o as usize], a, b))
            })
        })
        .collect()
}

/// Orients triangles so that neighbours traverse their common edge in opposite directions, and the
/// whole surface so that most of its area faces +z. Rejects disconnected surfaces.
fn orient(
    nodes: &[[f64; 3]],
    triangles: &mut [[u32; 3]],
    areas_m2: &[f64],
    neighbours: &[[Option<u32>; 3]],
) -> Result<(), MeshError> {
    let mut part = vec![u32::MAX; triangles.len()];
    let mut sizes: Vec<(usize, usize)> = Vec::new();
    let mut queue = Vec::new();
    for start in 0..triangles.len() {
        if part[start] != u32::MAX {
            continue;
        }
        let id = sizes.len() as u32;
        part[start] = id;
        queue.push(start);
        let mut size = 0;
        while let Some(t) = queue.pop() {
            size += 1;
            for &other in neighbours[t].iter().flatten() {
                let o = other as usize;
                let same_way = same_direction(triangles[t], triangles[o]);
                if part[o] == u32::MAX {
                    if same_way {
                        triangles[o].swap(1, 2);
                    }
                    part[o] = id;
                    queue.push(o);
                } else if same_way {
                    let position_m = centroid(nodes, triangles[o]);
                    return Err(MeshError::NotOrientable { triangle: o, position_m });
                }
            }
        }
        sizes.push((size, start));
    }
    if let (true, Some(&(part_triangles, triangle))) = (sizes.len() > 1, sizes.iter().min()) {
        let position_m = centroid(nodes, triangles[triangle]);
        let (parts, triangles) = (sizes.len(), triangles.len());
        return Err(MeshError::Unconnected {
            parts,
            triangle,
            position_m,
            part_triangles,
            triangles,
        });
    }
    let upward: f64 =
        triangles.iter().zip(areas_m2).map(|(&t, a)| a * normal(nodes, t)[2].signum()).sum();
    if upward < 0.0 {
        triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Ok(())
}

/// Whether two triangles traverse their common edge in the same direction.
fn same_direction(a: [u32; 3], b: [u32; 3]) -> bool {
    (0..3).any(|i| (0..3).any(|j| a[i] == b[j] && a[(i + 1) % 3] == b[(j + 1) % 3]))
}
