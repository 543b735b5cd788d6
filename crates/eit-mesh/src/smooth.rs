//! Smoothing: moves interior nodes to optimal positions for the size field and restores the
//! Delaunay property after each round, keeping the best round. Rim nodes do not move.

mod flip;

use crate::generate::interior::Triangulation;
use crate::geometry::{cross, dot};
use crate::quality::shape_quality;
use crate::size_field::SizeField;
use flip::{Neighbours, restore_delaunay};

/// A node may move if all triangles around it stay above this quality (angles of about 35 to 98
/// degrees), even if the worst of them gets worse: the gain in the mean is larger.
const GOOD_ENOUGH: f64 = 0.8;
/// Sweeps over the nodes between two triangulations: four take about as long as one triangulation,
/// and more give no measurable improvement.
const SWEEPS: usize = 4;

/// Smooths for a number of rounds and returns the best triangulation, which may be the initial one.
/// The first `rim_nodes` nodes do not move.
///
/// Every triangle keeps a positive area throughout, so the outline and its edges are preserved.
pub(crate) fn smooth(
    start: Triangulation,
    rim_nodes: usize,
    field: &SizeField,
    rounds: usize,
) -> Triangulation {
    let mut best_score = score(&start);
    let mut best = start.clone();
    let mut current = start;
    let mut sizes: Vec<f64> = current.points.iter().map(|&p| field.at(p)).collect();
    let mut neighbours = Neighbours::new(&current.triangles);
    for _ in 0..rounds {
        let stars = Stars::new(&current);
        for _ in 0..SWEEPS {
            for node in rim_nodes..current.points.len() {
                if relax(&mut current, stars.of(node), node, &sizes) {
                    sizes[node] = field.at(current.points[node]);
                }
            }
        }
        restore_delaunay(&current.points, &mut current.triangles, &mut neighbours);
        let found = score(&current);
        if found > best_score {
            best_score = found;
            best.clone_from(&current);
        }
    }
    best
}

/// The triangles around each node.
struct Stars {
    starts: Vec<u32>,
    triangles: Vec<u32>,
}

impl Stars {
    fn new(triangulation: &Triangulation) -> Self {
        let mut starts = vec![0u32; triangulation.points.len() + 1];
        for &node in triangulation.triangles.iter().flatten() {
            starts[node as usize + 1] += 1;
        }
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        let mut next = starts.clone();
        let mut triangles = vec![0; 3 * triangulation.triangles.len()];
        for (t, corners) in triangulation.triangles.iter().enumerate() {
            for &node in corners {
                triangles[next[node as usize] as usize] = t as u32;
                next[node as usize] += 1;
            }
        }
        Self { starts, triangles }
    }

    fn of(&self, node: usize) -> &[u32] {
        &self.triangles[self.starts[node] as usize..self.starts[node + 1] as usize]
    }
}

/// Moves one node to its position in the optimal Delaunay triangulation of its neighbours, or half
/// or a quarter of the way, if the triangles around it allow it. Returns whether it moved.
///
/// The position is `sum w_t c_t / sum w_t` with the circumcentres `c_t` and `w_t = A_t / h^4` (Chen
/// and Holst 2011, "Efficient mesh optimization schemes based on optimal Delaunay triangulations",
/// with the density `h^-4`, which distributes nodes by the size field in the plane).
fn relax(current: &mut Triangulation, star: &[u32], node: usize, sizes: &[f64]) -> bool {
    let old = current.points[node];
    let (mut weight, mut sum) = (0.0, [0.0; 2]);
    let mut worst = f64::INFINITY;
    for &t in star {
        let nodes = current.triangles[t as usize];
        let corners = nodes.map(|n| current.points[n as usize]);
        worst = worst.min(quality(corners));
        // h is nearly linear over a triangle, so its mean is that of the corners. A ratio is used
        // so that the fourth power stays in range at any scale.
        let size = nodes.iter().map(|&n| sizes[n as usize]).sum::<f64>() / sizes[node];
        let w = area(corners) / (size * size * size * size);
        let c = circumcentre(corners);
        weight += w;
        sum = [sum[0] + w * (c[0] - old[0]), sum[1] + w * (c[1] - old[1])];
    }
    for fraction in [1.0, 0.5, 0.25] {
        let step = fraction / weight;
        current.points[node] = [old[0] + step * sum[0], old[1] + step * sum[1]];
        let corners = |&t: &u32| current.triangles[t as usize].map(|n| current.points[n as usize]);
        let moved = star.iter().map(corners).map(quality).fold(f64::INFINITY, f64::min);
        if moved >= worst.min(GOOD_ENOUGH) {
            return true;
        }
    }
    current.points[node] = old;
    false
}

fn area([a, b, c]: [[f64; 2]; 3]) -> f64 {
    0.5 * cross([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]])
}

/// [`shape_quality`], negative for an inverted triangle.
fn quality(corners: [[f64; 2]; 3]) -> f64 {
    let [a, b, c] = corners;
    let squares = [(a, b), (b, c), (c, a)].map(|(p, q)| {
        let side = [q[0] - p[0], q[1] - p[1]];
        dot(side, side)
    });
    shape_quality(area(corners), squares)
}

/// Sine of the amount by which the angles at `c` and `d`, opposite the edge `a b`, exceed 180
/// degrees in sum: positive if `d` lies inside the circle through `a`, `b`, `c`.
fn incircle_sine([a, b, c]: [[f64; 2]; 3], d: [f64; 2]) -> f64 {
    let from = |p: [f64; 2], q: [f64; 2]| [q[0] - p[0], q[1] - p[1]];
    let (ca, cb, da, db) = (from(c, a), from(c, b), from(d, a), from(d, b));
    let lengths = (dot(ca, ca) * dot(cb, cb)).sqrt() * (dot(da, da) * dot(db, db)).sqrt();
    -(cross(ca, cb) * dot(da, db) + dot(ca, cb) * cross(db, da)) / lengths
}

fn circumcentre([a, b, c]: [[f64; 2]; 3]) -> [f64; 2] {
    let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
    let (uu, vv, twice) = (dot(u, u), dot(v, v), 2.0 * cross(u, v));
    [a[0] + (v[1] * uu - u[1] * vv) / twice, a[1] + (u[0] * vv - v[0] * uu) / twice]
}

/// Mean quality plus smallest quality, so that neither is sacrificed for the other.
fn score(triangulation: &Triangulation) -> f64 {
    let (mut sum, mut worst) = (0.0, f64::INFINITY);
    for corners in &triangulation.triangles {
        let q = quality(corners.map(|n| triangulation.points[n as usize]));
        sum += q;
        worst = worst.min(q);
    }
    sum / triangulation.triangles.len() as f64 + worst
}
