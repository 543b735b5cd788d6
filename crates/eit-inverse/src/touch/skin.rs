//! Points on a surface, the nearest one in a triangle, and tangent planes.

use eit_core::vector::{Vector as Point, along, cross, dot, normal as area_normal, sub, unit};
use std::array::from_fn;

/// A point on a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    pub(crate) position_m: Point,
    /// Orthonormal tangents of the surface; x and y on a flat skin.
    pub(super) tangents: [Point; 2],
}

impl Place {
    /// The point a step along the tangents away.
    pub(super) fn after(&self, step_m: [f64; 2]) -> Point {
        let [first, second] = self.tangents;
        along(along(self.position_m, step_m[0], first), step_m[1], second)
    }

    /// Step along the tangents to a point, whatever is across them.
    pub(super) fn step_to(&self, to_m: Point) -> [f64; 2] {
        self.tangents.map(|tangent| dot(tangent, sub(to_m, self.position_m)))
    }
}

/// Returns two orthonormal directions in the plane of a triangle; x and y on a flat skin.
pub(super) fn tangents(corners: [Point; 3]) -> [Point; 2] {
    across(normal(corners))
}

/// Returns two orthonormal directions across a unit vector; x and y across z.
pub(super) fn across(normal: Point) -> [Point; 2] {
    // x projected onto the plane, or y if the plane is nearly perpendicular to x
    let axis = if normal[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let first = unit(along(axis, -dot(axis, normal), normal));
    [first, cross(normal, first)]
}

/// Returns the unit normal of a triangle, on the side from which its corners run counter-clockwise.
pub(super) fn normal(corners: [Point; 3]) -> Point {
    unit(area_normal(corners))
}

/// Returns the candidate nearest to a point; the point itself if there are none.
pub(super) fn nearest_of(candidates: impl Iterator<Item = Point>, p: Point) -> Point {
    let (mut best, mut least) = (p, f64::INFINITY);
    for candidate in candidates {
        let squared = dot(sub(candidate, p), sub(candidate, p));
        if squared < least {
            (best, least) = (candidate, squared);
        }
    }
    best
}

/// Returns the nearest point of a triangle (Ericson, *Real-Time Collision Detection* (2005), 5.1.5).
pub(super) fn nearest_in([a, b, c]: [Point; 3], p: Point) -> Point {
    let (ab, ac, ap) = (sub(b, a), sub(c, a), sub(p, a));
    let (d1, d2) = (dot(ab, ap), dot(ac, ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = sub(p, b);
    let (d3, d4) = (dot(ab, bp), dot(ac, bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return along(a, d1 / (d1 - d3), ab);
    }
    let cp = sub(p, c);
    let (d5, d6) = (dot(ab, cp), dot(ac, cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return along(a, d2 / (d2 - d6), ac);
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return along(b, (d4 - d3) / ((d4 - d3) + (d5 - d6)), sub(c, b));
    }
    let total = va + vb + vc;
    from_fn(|i| a[i] + ab[i] * (vb / total) + ac[i] * (vc / total))
}

/// Converts a covariance along two tangents into one in space.
pub(super) fn in_space(plane: [[f64; 2]; 2], tangents: [[f64; 3]; 2]) -> [[f64; 3]; 3] {
    let mut space = [[0.0; 3]; 3];
    for (i, row) in space.iter_mut().enumerate() {
        for (j, value) in row.iter_mut().enumerate() {
            for a in 0..2 {
                for b in 0..2 {
                    let weight = tangents[a][i] * tangents[b][j];
                    // an infinite variance has no component across its direction
                    if weight != 0.0 && plane[a][b] != 0.0 {
                        *value += weight * plane[a][b];
                    }
                }
            }
        }
    }
    space
}

#[cfg(test)]
mod tests {
    use super::*;
    use fixtures::Random;

    #[test]
    fn no_point_of_a_triangle_is_nearer() {
        let mut random = Random::new(3);
        for _ in 0..200 {
            let mut point = || -> Point { from_fn(|_| random.normal()) };
            let (corners, p) = ([point(), point(), point()], point());
            let found = nearest_in(corners, p);
            let distance = |q: Point| dot(sub(q, p), sub(q, p)).sqrt();
            let mut least = f64::INFINITY;
            for i in 0..=100 {
                for j in 0..=100 - i {
                    let (u, v) = (i as f64 / 100.0, j as f64 / 100.0);
                    let q = from_fn(|k| {
                        corners[0][k] * (1.0 - u - v) + corners[1][k] * u + corners[2][k] * v
                    });
                    least = least.min(distance(q));
                }
            }
            // the grid step is below 0.01 of edges shorter than 8
            assert!(distance(found) <= least + 1e-12, "{corners:?} {p:?}");
            assert!(distance(found) >= least - 0.08, "{corners:?} {p:?}");
        }
    }
}
