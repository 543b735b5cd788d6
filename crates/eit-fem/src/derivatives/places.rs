//! Places in space: boxes, segments and directions.

use eit_core::vector::{Vector, along, dot, norm, scaled, sub};

/// An axis-aligned bounding box.
pub(super) struct Bounds([Vector; 2]);

impl Bounds {
    pub(super) fn around(places: impl Iterator<Item = Vector>, margin: f64) -> Self {
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for place in places {
            for k in 0..3 {
                bounds[0][k] = bounds[0][k].min(place[k] - margin);
                bounds[1][k] = bounds[1][k].max(place[k] + margin);
            }
        }
        Self(bounds)
    }

    pub(super) fn holds(&self, place: Vector) -> bool {
        (0..3).all(|k| (self.0[0][k]..=self.0[1][k]).contains(&place[k]))
    }
}

/// Distance from a point to a segment.
pub(super) fn to_segment(point: Vector, a: Vector, b: Vector) -> f64 {
    let side = sub(b, a);
    let t = (dot(sub(point, a), side) / dot(side, side)).clamp(0.0, 1.0);
    norm(sub(point, along(a, t, side)))
}

/// Unit vector in the direction of `a`; `None` if `a` is zero.
pub(super) fn unit(a: Vector) -> Option<Vector> {
    let length = norm(a);
    (length > 0.0).then(|| scaled(1.0 / length, a))
}
