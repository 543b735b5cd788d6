//! Round patches: triangles are cut along a sphere; those inside it that are connected to its
//! centre form the patch.

use super::{Skin, between};
use crate::surface::{middle, sides, sorted};
use crate::{MeshError, Surface};
use eit_core::vector::{cross, dot, norm, normal, sub};
use std::collections::HashMap;

/// A node within this fraction of an edge of the sphere counts as lying on it: a cut there would
/// leave a triangle with an angle of about a degree, to gain a hundredth of an edge of outline.
const SNAP: f64 = 0.02;

/// The sphere that bounds a patch.
pub(super) struct Ball {
    /// Index of the electrode.
    pub electrode: usize,
    /// Centre on the surface, metres.
    pub centre: [f64; 3],
    /// Radius, metres.
    pub radius: f64,
}

impl Ball {
    /// Signed distance of a position from the sphere, negative inside.
    fn outside(&self, position: [f64; 3]) -> f64 {
        norm(sub(position, self.centre)) - self.radius
    }

    /// Returns where an edge with one end inside and one outside crosses the sphere, as a fraction.
    fn crossing(&self, from: [f64; 3], to: [f64; 3]) -> f64 {
        // |f + t d|^2 = r^2 with f from the centre to the start: a t^2 + 2 b t + c = 0
        let (d, f) = (sub(to, from), sub(from, self.centre));
        let (a, b, c) = (dot(d, d), dot(f, d), dot(f, f) - self.radius * self.radius);
        let root = (b * b - a * c).max(0.0).sqrt();
        // the start is inside if c < 0: then the larger root is the crossing, otherwise the smaller
        let (q, out) = (-(b + root.copysign(b)), c < 0.0);
        let (one, other) = (q / a, c / q);
        let t = if out { one.max(other) } else { one.min(other) };
        t.clamp(0.0, 1.0)
    }

    /// Cuts the triangles that the sphere crosses.
    pub(super) fn cut(&self, skin: &mut Skin) {
        let mut side: Vec<f64> = skin.nodes.iter().map(|&p| self.outside(p)).collect();
        let crossed = |side: &[f64], [a, b]: [u32; 2]| side[a as usize] * side[b as usize] < 0.0;
        let mut edges: Vec<[u32; 2]> = skin
            .triangles
            .iter()
            .flat_map(|t| sides(*t))
            .filter(|&edge| crossed(&side, edge))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        for &[a, b] in &edges {
            let t = self.crossing(skin.at(a), skin.at(b));
            for (node, share) in [(a, t), (b, 1.0 - t)] {
                if share < SNAP {
                    side[node as usize] = 0.0;
                }
            }
        }
        let mut node_on: HashMap<[u32; 2], u32> = HashMap::with_capacity(edges.len());
        for edge in edges.into_iter().filter(|&edge| crossed(&side, edge)) {
            let [a, b] = edge.map(|n| skin.at(n));
            let node = skin.push(between(a, b, self.crossing(a, b)));
            node_on.insert(edge, node);
        }
        let mut added = Vec::new();
        for t in 0..skin.triangles.len() {
            let parts = parts(skin, skin.triangles[t], &node_on);
            skin.triangles[t] = parts[0];
            added.extend_from_slice(&parts[1..]);
        }
        skin.triangles.extend(added);
    }
}

/// Splits a triangle at the nodes on its sides, of which a sphere crosses at most two.
fn parts(skin: &Skin, corners: [u32; 3], node_on: &HashMap<[u32; 2], u32>) -> Vec<[u32; 3]> {
    let on = |t: [u32; 3], k: usize| node_on.get(&sorted([t[k], t[(k + 1) % 3]])).copied();
    let cut = |t: [u32; 3]| [on(t, 0), on(t, 1), on(t, 2)];
    for turn in 0..3 {
        let t: [u32; 3] = std::array::from_fn(|k| corners[(k + turn) % 3]);
        let [a, b, c] = t;
        match cut(t) {
            [Some(p), None, None] => return vec![[a, p, c], [p, b, c]],
            // `a` is cut off; the remaining quadrilateral is split along its shorter diagonal
            [Some(p), None, Some(q)] => {
                let rest = if skin.length([p, c]) < skin.length([b, q]) {
                    [[p, b, c], [p, c, q]]
                } else {
                    [[p, b, q], [b, c, q]]
                };
                return vec![[a, p, q], rest[0], rest[1]];
            }
            _ => {}
        }
    }
    vec![corners]
}

/// Returns the triangles of each patch.
pub(super) fn triangles_of(skin: &Skin, balls: &[Ball]) -> Result<Vec<Vec<u32>>, MeshError> {
    if balls.is_empty() {
        return Ok(Vec::new());
    }
    let mut across: HashMap<[u32; 2], u32> = HashMap::with_capacity(3 * skin.triangles.len());
    for (t, corners) in skin.triangles.iter().enumerate() {
        for k in 0..3 {
            across.insert([corners[k], corners[(k + 1) % 3]], t as u32);
        }
    }
    let mut owner: Vec<Option<usize>> = vec![None; skin.triangles.len()];
    let mut patches = Vec::with_capacity(balls.len());
    for (index, ball) in balls.iter().enumerate() {
        let patch = connected(skin, ball, &across)?;
        for &t in &patch {
            if let Some(other) = owner[t as usize].replace(index) {
                let other = &balls[other];
                let distance = norm(sub(ball.centre, other.centre));
                let (first, second) = (other.electrode + 1, ball.electrode + 1);
                let gap_m = distance - ball.radius - other.radius;
                return Err(MeshError::OverlappingPatches { first, second, gap_m, least_m: 0.0 });
            }
        }
        patches.push(patch);
    }
    Ok(patches)
}

/// Returns the triangles inside a sphere that are connected to its centre; an error if any is on
/// the rim.
fn connected(
    skin: &Skin,
    ball: &Ball,
    across: &HashMap<[u32; 2], u32>,
) -> Result<Vec<u32>, MeshError> {
    let corners = |t: usize| skin.triangles[t].map(|n| skin.at(n));
    let inside: Vec<bool> =
        (0..skin.triangles.len()).map(|t| ball.outside(middle(&corners(t))) < 0.0).collect();
    let distance = |&t: &usize| norm(sub(nearest_on(corners(t), ball.centre), ball.centre));
    let start = (0..skin.triangles.len())
        .filter(|&t| inside[t])
        .min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let electrode = ball.electrode + 1;
    let mut found: Vec<u32> = start.into_iter().map(|t| t as u32).collect();
    let mut seen = vec![false; skin.triangles.len()];
    found.iter().for_each(|&t| seen[t as usize] = true);
    let mut next = 0;
    while next < found.len() {
        let t = skin.triangles[found[next] as usize];
        next += 1;
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            let Some(&other) = across.get(&[b, a]) else {
                let position_m = middle(&[skin.at(a), skin.at(b)]);
                let problem = "extends beyond the rim: move it inwards or make it smaller";
                return Err(MeshError::BadPatch { electrode, position_m, problem });
            };
            if inside[other as usize] && !std::mem::replace(&mut seen[other as usize], true) {
                found.push(other);
            }
        }
    }
    found.sort_unstable();
    Ok(found)
}

/// Returns the point of a surface nearest to a position, and the distance to it.
pub(super) fn nearest(surface: &Surface, position: [f64; 3]) -> ([f64; 3], f64) {
    let mut best = ([f64::NAN; 3], f64::INFINITY);
    for t in 0..surface.triangles().len() {
        let point = nearest_on(surface.corners(t), position);
        let distance = norm(sub(point, position));
        if distance < best.1 {
            best = (point, distance);
        }
    }
    best
}

/// Returns the point of a triangle nearest to a position: the foot of the perpendicular if it is
/// inside, otherwise the nearest point of a side.
fn nearest_on([a, b, c]: [[f64; 3]; 3], position: [f64; 3]) -> [f64; 3] {
    let normal = normal([a, b, c]);
    let turned = |from, to| dot(cross(sub(to, from), sub(position, from)), normal);
    if turned(a, b) >= 0.0 && turned(b, c) >= 0.0 && turned(c, a) >= 0.0 {
        let height = dot(sub(position, a), normal) / dot(normal, normal);
        return std::array::from_fn(|k| position[k] - height * normal[k]);
    }
    let on_side = |(from, to)| {
        let along = sub(to, from);
        let t = dot(sub(position, from), along) / dot(along, along);
        between(from, to, t.clamp(0.0, 1.0))
    };
    let distance = |p: &[f64; 3]| norm(sub(*p, position));
    let sides = [(a, b), (b, c), (c, a)].map(on_side);
    sides.into_iter().min_by(|p, q| distance(p).total_cmp(&distance(q))).unwrap_or(a)
}
