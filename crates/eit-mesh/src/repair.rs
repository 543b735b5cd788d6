//! Repairs harmless faults in triangles from a file and reports the repairs.
//!
//! A fault is harmless if repairing it leaves the skin unchanged: duplicate nodes, nodes that no
//! triangle uses, and triangles that are inverted, repeated or collapsed because two of their
//! corners are one node. Everything else is rejected by [`Surface::new`] with the index in the file
//! and the position. For example, dropping a triangle that is flat but not collapsed would leave a
//! crack.

mod notes;

use crate::{MeshError, Surface};
use eit_core::vector::{norm, sub};
pub use notes::Repairs;
use std::collections::{HashMap, HashSet};

impl Surface {
    /// Creates a surface from nodes and triangles of any origin, repairing harmless faults.
    ///
    /// Nodes within `merge_m` (metres; 0 merges none) of an earlier one are merged with it; then
    /// collapsed and repeated triangles and unused nodes are dropped. The rest keeps its order.
    ///
    /// # Errors
    /// Those of [`Surface::new`]; indices refer to the arguments.
    ///
    /// # Example
    /// ```
    /// use eit_mesh::Surface;
    ///
    /// // two triangles with corners of their own, as in an STL file, and a node of no use
    /// let nodes = vec![
    ///     [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0],
    ///     [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0],
    ///     [5.0, 0.0, 0.0],
    /// ];
    /// let (surface, repairs) = Surface::repaired(nodes, vec![[0, 1, 2], [3, 4, 5]], 1e-9)?;
    /// assert_eq!((surface.nodes().len(), surface.triangles().len()), (4, 2));
    /// assert_eq!((repairs.merged_nodes, repairs.dropped_nodes), (2, 1));
    /// # Ok::<(), eit_mesh::MeshError>(())
    /// ```
    pub fn repaired(
        nodes: Vec<[f64; 3]>,
        triangles: Vec<[u32; 3]>,
        merge_m: f64,
    ) -> Result<(Self, Repairs), MeshError> {
        let mended = mend(&nodes, &triangles, merge_m)?;
        let numbers = mended.numbers();
        let mut repairs = mended.repairs;
        let before = mended.triangles.clone();
        let surface =
            Self::new(mended.nodes, mended.triangles).map_err(|e| numbers.in_arguments(e))?;
        repairs.inspect(&surface, &before);
        Ok((surface, repairs))
    }
}

/// Nodes and triangles after repair.
pub(crate) struct Mended {
    pub nodes: Vec<[f64; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// New index of each node and triangle; `None` if dropped. A merged node has the index of the
    /// node it was merged with.
    pub node_of: Vec<Option<u32>>,
    pub triangle_of: Vec<Option<u32>>,
    pub repairs: Repairs,
}

/// Old index of each repaired node and triangle, for errors in terms of the arguments.
pub(crate) struct Numbers {
    nodes: Vec<u32>,
    triangles: Vec<u32>,
}

impl Mended {
    pub(crate) fn numbers(&self) -> Numbers {
        let inverse = |of: &[Option<u32>], count: usize| {
            let mut old = vec![0; count];
            // in reverse, so that the first of several merged nodes is kept
            for (index, new) in of.iter().enumerate().rev() {
                if let Some(slot) = new.and_then(|n| old.get_mut(n as usize)) {
                    *slot = index as u32;
                }
            }
            old
        };
        Numbers {
            nodes: inverse(&self.node_of, self.nodes.len()),
            triangles: inverse(&self.triangle_of, self.triangles.len()),
        }
    }
}

impl Numbers {
    fn in_arguments(&self, mut error: MeshError) -> MeshError {
        let old = |of: &[u32], index: usize| of.get(index).map_or(index, |&i| i as usize);
        match &mut error {
            MeshError::ZeroArea { triangle, nodes, .. } => {
                *triangle = old(&self.triangles, *triangle);
                *nodes = nodes.map(|n| old(&self.nodes, n as usize) as u32);
            }
            MeshError::NotOrientable { triangle, .. } | MeshError::Unconnected { triangle, .. } => {
                *triangle = old(&self.triangles, *triangle);
            }
            MeshError::NonManifoldEdge { edge, .. } => {
                *edge = edge.map(|n| old(&self.nodes, n as usize) as u32);
            }
            MeshError::NonFiniteNode { node, .. } => *node = old(&self.nodes, *node),
            _ => {}
        }
        error
    }
}

/// Merges nodes and drops unused nodes and collapsed or repeated triangles.
pub(crate) fn mend(
    nodes: &[[f64; 3]],
    triangles: &[[u32; 3]],
    merge_m: f64,
) -> Result<Mended, MeshError> {
    for (what, count) in [("nodes", nodes.len()), ("triangles", triangles.len())] {
        if u32::try_from(count).is_err() {
            return Err(MeshError::TooLarge { what, count });
        }
    }
    let twin_of = twins(nodes, merge_m);
    let mut repairs = Repairs { merge_distance_m: merge_m, ..Repairs::default() };
    let mut seen = HashSet::with_capacity(triangles.len());
    let mut kept = Vec::with_capacity(triangles.len());
    let mut triangle_of = Vec::with_capacity(triangles.len());
    let mut named = vec![false; nodes.len()];
    for (triangle, corners) in triangles.iter().enumerate() {
        let mut merged = *corners;
        for node in &mut merged {
            let unknown = MeshError::UnknownNode { triangle, node: *node, nodes: nodes.len() };
            *named.get_mut(*node as usize).ok_or(unknown)? = true;
            *node = twin_of[*node as usize];
        }
        let mut key = merged;
        key.sort_unstable();
        let collapsed = key[0] == key[1] || key[1] == key[2];
        if collapsed || !seen.insert(key) {
            repairs.dropped_triangles += 1;
            triangle_of.push(None);
        } else {
            triangle_of.push(Some(kept.len() as u32));
            kept.push(merged);
        }
    }
    let mut used = vec![false; nodes.len()];
    kept.iter().flatten().for_each(|&n| used[n as usize] = true);
    let (mut left, mut new) = (Vec::new(), vec![None; nodes.len()]);
    for node in 0..nodes.len() {
        if used[node] {
            new[node] = Some(left.len() as u32);
            left.push(nodes[node]);
        }
        let is_merged = twin_of[node] as usize != node;
        repairs.merged_nodes += usize::from(is_merged && named[node]);
        // twins have smaller indices, so theirs is already known
        new[node] = new[twin_of[node] as usize];
        repairs.dropped_nodes += usize::from(!named[node]);
    }
    for corners in &mut kept {
        *corners = corners.map(|n| new[n as usize].unwrap_or(0));
    }
    Ok(Mended { nodes: left, triangles: kept, node_of: new, triangle_of, repairs })
}

/// Number of nodes that are within a distance of an earlier one.
pub(crate) fn coincident(nodes: &[[f64; 3]], distance_m: f64) -> usize {
    twins(nodes, distance_m)
        .iter()
        .enumerate()
        .filter(|&(node, &twin)| node != twin as usize)
        .count()
}

/// Longest side of the bounding box of the finite nodes, metres; 0 if there are none.
pub(crate) fn size_m(nodes: &[[f64; 3]]) -> f64 {
    let side = |k: usize| {
        let along = nodes.iter().map(|p| p[k]).filter(|x| x.is_finite());
        let low_high = |(low, high): (f64, f64), x: f64| (low.min(x), high.max(x));
        let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), low_high);
        (high - low).max(0.0)
    };
    side(0).max(side(1)).max(side(2))
}

/// Returns for each node the first unmerged node within `distance_m` of it, or itself.
fn twins(nodes: &[[f64; 3]], distance_m: f64) -> Vec<u32> {
    // large enough that most nodes are far from cell borders, and small enough that a cell holds
    // few nodes, since unmerged nodes are at least a distance apart
    let cell_m = 8.0 * distance_m;
    let mut cells: HashMap<[i64; 3], Vec<u32>> = HashMap::new();
    let mut twin_of = Vec::with_capacity(nodes.len());
    for (index, node) in nodes.iter().enumerate() {
        let merges = distance_m > 0.0 && node.iter().all(|x| x.is_finite());
        let twin = merges.then(|| near(nodes, &cells, node, distance_m, cell_m)).flatten();
        twin_of.push(twin.unwrap_or(index as u32));
        if merges && twin.is_none() {
            cells.entry(node.map(|x| (x / cell_m).floor() as i64)).or_default().push(index as u32);
        }
    }
    twin_of
}

/// Returns the first node within a distance of a position.
fn near(
    nodes: &[[f64; 3]],
    cells: &HashMap<[i64; 3], Vec<u32>>,
    at: &[f64; 3],
    distance_m: f64,
    cell_m: f64,
) -> Option<u32> {
    // casts saturate: beyond 1e18 cells, all share one cell, which is slow but correct
    let low = at.map(|x| ((x - distance_m) / cell_m).floor() as i64);
    let high = at.map(|x| ((x + distance_m) / cell_m).floor() as i64);
    let mut first: Option<u32> = None;
    for corner in 0..8 {
        let bit = |k: usize| corner >> k & 1 == 1;
        // if both ends lie in one cell, search it only once
        if (0..3).any(|k| bit(k) && low[k] == high[k]) {
            continue;
        }
        let cell: [i64; 3] = std::array::from_fn(|k| if bit(k) { high[k] } else { low[k] });
        for &node in cells.get(&cell).into_iter().flatten() {
            let close = norm(sub(nodes[node as usize], *at)) <= distance_m;
            if close && first.is_none_or(|f| node < f) {
                first = Some(node);
            }
        }
    }
    first
}

/// Whether two orderings of the same three nodes have the same orientation.
fn same_sense(a: [u32; 3], b: [u32; 3]) -> bool {
    (0..3).any(|k| [a[k], a[(k + 1) % 3], a[(k + 2) % 3]] == b)
}
