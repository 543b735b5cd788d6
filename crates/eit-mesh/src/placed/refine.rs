//! Bisects edges until none is too long: longest-edge bisection (Rivara 1984, "Algorithms for
//! refining triangular grids suitable for adaptive and multigrid techniques"). The smallest angles
//! remain above half of the original ones.

use super::{Skin, between};
use crate::MeshError;
use crate::surface::{sides, sorted};
use std::collections::{HashMap, HashSet};

/// An edge is bisected if it is longer than this multiple of the requested length, so final edges
/// are between two thirds and four thirds of it.
const SLACK: f64 = 4.0 / 3.0;

/// Refines until every edge is short enough at its midpoint; existing nodes keep their numbers.
pub(super) fn refine(
    skin: &mut Skin,
    wanted_m: impl Fn([f64; 3]) -> f64,
    node_limit: usize,
) -> Result<(), MeshError> {
    loop {
        let marked = marked(skin, &wanted_m);
        if marked.is_empty() {
            return Ok(());
        }
        let nodes = skin.nodes.len();
        if nodes + marked.len() > node_limit {
            return Err(MeshError::RefinementIncomplete { nodes, limit: node_limit });
        }
        split(skin, &marked);
    }
}

/// Rotates the triangle's nodes so that its longest side comes first. Of equal sides, the one with
/// the smaller nodes counts as longest, so that both triangles of an edge agree.
fn longest_first(skin: &Skin, t: [u32; 3]) -> [u32; 3] {
    let rank = |k: usize| {
        let side = sorted([t[k], t[(k + 1) % 3]]);
        // measured from the smaller node, so that both triangles get the same bits
        (skin.length(side), std::cmp::Reverse(side))
    };
    let larger = |a: usize, b: usize| {
        let ((x, i), (y, j)) = (rank(a), rank(b));
        if x.total_cmp(&y).then(i.cmp(&j)).is_ge() { a } else { b }
    };
    let k = larger(larger(0, 1), 2);
    [t[k], t[(k + 1) % 3], t[(k + 2) % 3]]
}

/// Returns the edges to bisect, in the order found: the longest edge of each triangle that has an
/// edge that is too long, and of each triangle that contains an edge to bisect.
fn marked(skin: &Skin, wanted_m: &impl Fn([f64; 3]) -> f64) -> Vec<[u32; 2]> {
    let mut too_long: HashMap<[u32; 2], bool> = HashMap::new();
    let mut triangles_of: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
    let mut queue: Vec<u32> = Vec::new();
    for (t, corners) in skin.triangles.iter().enumerate() {
        let mut any = false;
        for edge in sides(*corners) {
            triangles_of.entry(edge).or_default().push(t as u32);
            any |= *too_long.entry(edge).or_insert_with(|| {
                let middle = between(skin.at(edge[0]), skin.at(edge[1]), 0.5);
                skin.length(edge) > SLACK * wanted_m(middle)
            });
        }
        if any {
            queue.push(t as u32);
        }
    }
    let mut found = HashSet::new();
    let mut order = Vec::new();
    while let Some(t) = queue.pop() {
        let [a, b, _] = longest_first(skin, skin.triangles[t as usize]);
        let edge = sorted([a, b]);
        if found.insert(edge) {
            order.push(edge);
            queue.extend(triangles_of.get(&edge).into_iter().flatten());
        }
    }
    order
}

/// Inserts a node in the middle of each marked edge and splits its triangles: first along their
/// longest side, then the halves along the other sides.
fn split(skin: &mut Skin, marked: &[[u32; 2]]) {
    let mut middle_of: HashMap<[u32; 2], u32> = HashMap::with_capacity(marked.len());
    for &edge in marked {
        let node = skin.push(between(skin.at(edge[0]), skin.at(edge[1]), 0.5));
        middle_of.insert(edge, node);
    }
    let mut added = Vec::new();
    for t in 0..skin.triangles.len() {
        let [a, b, c] = longest_first(skin, skin.triangles[t]);
        // a triangle with a marked side has its longest one marked
        let Some(&m) = middle_of.get(&sorted([a, b])) else { continue };
        let halves = |from: u32, to: u32, apex: u32| match middle_of.get(&sorted([from, to])) {
            Some(&n) => vec![[from, n, apex], [n, to, apex]],
            None => vec![[from, to, apex]],
        };
        // (b, c) and (c, a) with the middle of (a, b) as apex
        let mut parts = halves(b, c, m);
        parts.extend(halves(c, a, m));
        skin.triangles[t] = parts[0];
        added.extend_from_slice(&parts[1..]);
    }
    skin.triangles.extend(added);
}
