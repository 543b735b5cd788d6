//! The rims of a surface as closed polygons, measured by arc length.

use super::{Covered, Skin, between};
use eit_core::vector::{dot, norm, sub};
use std::collections::{HashMap, HashSet};

/// A rim node within this fraction of an edge of an electrode's end is used as the end: a triangle
/// with a side ten thousand times shorter than the others loses four digits and gains nothing.
const SNAP: f64 = 1e-4;

/// The loops of a rim, with the skin on their left. Each loop starts at its smallest node; the loop
/// with the smallest node comes first.
pub(super) struct Rims {
    loops: Vec<RimLoop>,
}

struct RimLoop {
    nodes: Vec<u32>,
    /// Arc length of each node, followed by the length of the loop.
    at_m: Vec<f64>,
}

impl Rims {
    pub(super) fn new(skin: &Skin) -> Self {
        // the third node of the triangle on the left of each directed edge
        let mut apex: HashMap<[u32; 2], u32> = HashMap::with_capacity(3 * skin.triangles.len());
        for t in &skin.triangles {
            for k in 0..3 {
                apex.insert([t[k], t[(k + 1) % 3]], t[(k + 2) % 3]);
            }
        }
        let mut starts: Vec<[u32; 2]> =
            apex.keys().filter(|[a, b]| !apex.contains_key(&[*b, *a])).copied().collect();
        starts.sort_unstable();
        let mut seen = HashSet::with_capacity(starts.len());
        let mut loops = Vec::new();
        for &start in &starts {
            let (mut edge, mut nodes) = (start, Vec::new());
            while seen.insert(edge) {
                nodes.push(edge[0]);
                edge = next_edge(&apex, edge);
            }
            if !nodes.is_empty() {
                loops.push(RimLoop::new(skin, nodes));
            }
        }
        Self { loops }
    }

    pub(super) fn length_m(&self, loop_index: usize) -> f64 {
        self.loops[loop_index].length_m()
    }

    /// Returns a node through which the rim passes more than once.
    pub(super) fn pinched(&self) -> Option<u32> {
        let mut nodes: Vec<u32> = self.loops.iter().flat_map(|l| &l.nodes).copied().collect();
        nodes.sort_unstable();
        nodes.windows(2).find(|pair| pair[0] == pair[1]).map(|pair| pair[0])
    }

    /// Returns loop, arc length and distance of the rim point nearest to a position.
    pub(super) fn nearest(&self, skin: &Skin, position: [f64; 3]) -> Option<(usize, f64, f64)> {
        let mut nearest: Option<(usize, f64, f64)> = None;
        for (index, l) in self.loops.iter().enumerate() {
            for (k, [a, b]) in l.edges().enumerate() {
                let (a, b) = (skin.at(a), skin.at(b));
                let along = sub(b, a);
                let t = (dot(sub(position, a), along) / dot(along, along)).clamp(0.0, 1.0);
                let distance = norm(sub(position, between(a, b, t)));
                if nearest.is_none_or(|n| distance < n.2) {
                    nearest = Some((index, l.at_m[k] + t * norm(along), distance));
                }
            }
        }
        nearest
    }

    /// Returns the rim edges of each electrode, in rim order; the electrode ends must already be
    /// nodes.
    pub(super) fn edges_of(&self, skin: &Skin, covered: &[Covered]) -> Vec<Vec<[u32; 2]>> {
        let edges = |c: &Covered| {
            let l = &self.loops[c.interval.loop_index];
            let mut inside: Vec<(f64, [u32; 2])> = Vec::new();
            for (k, edge) in l.edges().enumerate() {
                let middle = l.at_m[k] + 0.5 * skin.length(edge);
                let from_start = (middle - c.interval.start_m).rem_euclid(l.length_m());
                if from_start < c.interval.width_m {
                    inside.push((from_start, edge));
                }
            }
            inside.sort_by(|a, b| a.0.total_cmp(&b.0));
            inside.into_iter().map(|(_, edge)| edge).collect()
        };
        covered.iter().map(edges).collect()
    }
}

impl RimLoop {
    fn new(skin: &Skin, nodes: Vec<u32>) -> Self {
        let mut at_m = Vec::with_capacity(nodes.len() + 1);
        let mut s = 0.0;
        at_m.push(s);
        for k in 0..nodes.len() {
            s += skin.length([nodes[k], nodes[(k + 1) % nodes.len()]]);
            at_m.push(s);
        }
        Self { nodes, at_m }
    }

    fn edges(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        let count = self.nodes.len();
        (0..count).map(move |k| [self.nodes[k], self.nodes[(k + 1) % count]])
    }

    fn length_m(&self) -> f64 {
        self.at_m[self.nodes.len()]
    }

    /// Index of the edge at an arc length.
    fn edge_at(&self, s_m: f64) -> usize {
        let after = self.at_m.partition_point(|&at| at <= s_m);
        after.saturating_sub(1).min(self.nodes.len() - 1)
    }
}

/// Returns the rim edge that follows another one, turning around its end node from triangle to
/// triangle.
fn next_edge(apex: &HashMap<[u32; 2], u32>, [a, b]: [u32; 2]) -> [u32; 2] {
    let mut from = a;
    // the triangle left of from -> b has the side b -> third; across it lies third -> b
    while let Some(&third) = apex.get(&[from, b]) {
        if !apex.contains_key(&[third, b]) {
            return [b, third];
        }
        from = third;
    }
    [a, b]
}

/// Inserts the ends of every electrode as rim nodes; returns their positions.
pub(super) fn insert_ends(skin: &mut Skin, rims: &Rims, covered: &[Covered]) -> Vec<[[f64; 3]; 2]> {
    // ends on each edge, as (loop, edge) and fractions
    let mut on_edge: HashMap<(usize, usize), Vec<f64>> = HashMap::new();
    let mut ends_m = Vec::with_capacity(covered.len());
    for c in covered {
        let l = &rims.loops[c.interval.loop_index];
        let end = |s_m: f64| {
            let s_m = s_m.rem_euclid(l.length_m());
            let k = l.edge_at(s_m);
            let edge = [l.nodes[k], l.nodes[(k + 1) % l.nodes.len()]];
            let t = (s_m - l.at_m[k]) / (l.at_m[k + 1] - l.at_m[k]);
            (k, t, between(skin.at(edge[0]), skin.at(edge[1]), t))
        };
        let (start, stop) = (end(c.interval.start_m), end(c.interval.start_m + c.interval.width_m));
        for (k, t, _) in [start, stop] {
            if (SNAP..=1.0 - SNAP).contains(&t) {
                on_edge.entry((c.interval.loop_index, k)).or_default().push(t);
            }
        }
        ends_m.push([start.2, stop.2]);
    }
    let mut places: Vec<_> = on_edge.into_iter().collect();
    places.sort_by_key(|(place, _)| *place);
    let mut triangle_of: HashMap<[u32; 2], usize> = HashMap::new();
    for (t, corners) in skin.triangles.iter().enumerate() {
        for k in 0..3 {
            triangle_of.insert([corners[k], corners[(k + 1) % 3]], t);
        }
    }
    for ((index, k), mut fractions) in places {
        let l = &rims.loops[index];
        let (mut a, b) = (l.nodes[k], l.nodes[(k + 1) % l.nodes.len()]);
        let (from, to) = (skin.at(a), skin.at(b));
        fractions.sort_by(f64::total_cmp);
        fractions.dedup();
        for t in fractions {
            // (a, b, c) becomes (a, p, c), which keeps its index, and (p, b, c)
            let Some(&triangle) = triangle_of.get(&[a, b]) else { continue };
            let corners = skin.triangles[triangle];
            let Some(c) = corners.into_iter().find(|n| *n != a && *n != b) else { continue };
            let p = skin.push(between(from, to, t));
            let second = skin.triangles.len();
            skin.triangles[triangle] = [a, p, c];
            skin.triangles.push([p, b, c]);
            triangle_of.remove(&[a, b]);
            for (edge, t) in
                [([a, p], triangle), ([c, a], triangle), ([p, b], second), ([b, c], second)]
            {
                triangle_of.insert(edge, t);
            }
            a = p;
        }
    }
    ends_m
}
