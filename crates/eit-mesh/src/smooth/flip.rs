//! Restores the Delaunay property after nodes have moved slightly, by flipping edges (Lawson 1977).
//! This is far cheaper than a new triangulation and never changes the rim.

use super::{area, incircle_sine};

/// Marks a side without a neighbouring triangle: the rim.
const RIM: u32 = u32::MAX;

/// An edge counts as Delaunay if the sine of the excess of its two opposite angles over 180 degrees
/// is at most this. It is well above rounding (1e-15 for angles above a degree), so that four
/// points on one circle do not flip back and forth, and far below any relevant excess.
const TOLERANCE: f64 = 1e-9;

/// Triangles across the sides (0-1, 1-2, 2-0) of each triangle.
pub(super) struct Neighbours(Vec<[u32; 3]>);

impl Neighbours {
    pub(crate) fn new(triangles: &[[u32; 3]]) -> Self {
        let mut sides: Vec<(u32, u32, u32, u8)> = Vec::with_capacity(3 * triangles.len());
        for (t, corners) in triangles.iter().enumerate() {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                sides.push((a.min(b), a.max(b), t as u32, k as u8));
            }
        }
        sides.sort_unstable();
        let mut across = vec![[RIM; 3]; triangles.len()];
        for pair in sides.windows(2) {
            let ((a, b, t, i), (c, d, u, j)) = (pair[0], pair[1]);
            if (a, b) == (c, d) {
                across[t as usize][i as usize] = u;
                across[u as usize][j as usize] = t;
            }
        }
        Self(across)
    }

    fn replace(&mut self, triangle: u32, old: u32, new: u32) {
        if triangle != RIM {
            let sides = &mut self.0[triangle as usize];
            sides.iter_mut().filter(|side| **side == old).for_each(|side| *side = new);
        }
    }
}

/// Flips edges until all are Delaunay, up to a fixed number of flips per triangle.
pub(super) fn restore_delaunay(
    points: &[[f64; 2]],
    triangles: &mut [[u32; 3]],
    neighbours: &mut Neighbours,
) {
    // a smoothing sweep needs about one flip per ten triangles
    let mut flips_left = 10 * triangles.len();
    let mut stack: Vec<u32> = (0..triangles.len() as u32).collect();
    while let Some(t) = stack.pop() {
        for k in 0..3 {
            let u = neighbours.0[t as usize][k];
            if u != RIM && flips_left > 0 && flip(points, triangles, neighbours, t, k, u) {
                flips_left -= 1;
                stack.extend([t, u]);
                break;
            }
        }
    }
}

/// Flips side `k` of triangle `t`, shared with triangle `u`, if it is not Delaunay.
fn flip(
    points: &[[f64; 2]],
    triangles: &mut [[u32; 3]],
    neighbours: &mut Neighbours,
    t: u32,
    k: usize,
    u: u32,
) -> bool {
    let across_u = neighbours.0[u as usize];
    let Some(j) = across_u.iter().position(|&n| n == t) else { return false };
    let (own, other) = (triangles[t as usize], triangles[u as usize]);
    let (a, b, c, d) = (own[k], own[(k + 1) % 3], own[(k + 2) % 3], other[(j + 2) % 3]);
    let at = |n: u32| points[n as usize];
    if incircle_sine([at(a), at(b), at(c)], at(d)) <= TOLERANCE {
        return false;
    }
    let (new_t, new_u) = ([c, a, d], [d, b, c]);
    if area(new_t.map(at)) <= 0.0 || area(new_u.map(at)) <= 0.0 {
        return false;
    }
    let across_t = neighbours.0[t as usize];
    let (beyond_bc, beyond_ca) = (across_t[(k + 1) % 3], across_t[(k + 2) % 3]);
    let (beyond_ad, beyond_db) = (across_u[(j + 1) % 3], across_u[(j + 2) % 3]);
    triangles[t as usize] = new_t;
    triangles[u as usize] = new_u;
    neighbours.0[t as usize] = [beyond_ca, beyond_ad, u];
    neighbours.0[u as usize] = [beyond_db, beyond_bc, t];
    neighbours.replace(beyond_ad, u, t);
    neighbours.replace(beyond_bc, t, u);
    true
}
