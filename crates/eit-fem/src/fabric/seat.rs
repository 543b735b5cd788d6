//! Places on a skin that may be curved, seen from +z.
//!
//! Scripts state places as x and y. On a curved skin, a dent is that of a flat fabric in the tangent plane of its place:
//! distances are straight lines through space, and the fabric moves along the tangent plane and against its normal. That
//! holds for touches much smaller than the radius of curvature. On a flat skin it is exact.

use crate::error::FemError;
use eit_core::vector::{along, distance, dot, normal, sub, unit};
use eit_mesh::Surface;

/// Least z of a unit normal. Steeper places are not seen from +z.
const LEAST_NORMAL_Z: f64 = 0.1;

/// A place on the skin, with the skin's unit normal there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seat {
    pub place_m: [f64; 3],
    pub normal: [f64; 3],
}

impl Seat {
    /// The highest place of the surface with this x and y; `None` if there is none that is seen from +z.
    pub(crate) fn on(surface: &Surface, place: [f64; 2]) -> Option<Self> {
        Self::among(surface, 0..surface.triangles().len(), place)
    }

    /// [`Seat::on`] where only these triangles can be at the place.
    pub(super) fn among(
        surface: &Surface,
        triangles: impl Iterator<Item = usize>,
        [x, y]: [f64; 2],
    ) -> Option<Self> {
        let seats = triangles.filter_map(|t| {
            let corners = surface.corners(t);
            if !sides(corners, [x, y]).iter().all(|side| *side >= 0.0) {
                return None;
            }
            let normal = unit(normal(corners));
            let [a, ..] = corners;
            let slope = normal[0] * (x - a[0]) + normal[1] * (y - a[1]);
            (normal[2] >= LEAST_NORMAL_Z)
                .then(|| Self { place_m: [x, y, a[2] - slope / normal[2]], normal })
        });
        seats.max_by(|one, other| one.place_m[2].total_cmp(&other.place_m[2]))
    }

    /// The place of a finger, which must be on the surface.
    pub(crate) fn require(
        seat: Option<Self>,
        finger: u32,
        place: impl FnOnce() -> String,
        time_s: f64,
        [x_m, y_m]: [f64; 2],
    ) -> Result<Self, FemError> {
        seat.ok_or_else(|| FemError::OutsideSkin { finger, place: place(), time_s, x_m, y_m })
    }

    /// The place beside this one in its tangent plane.
    pub(crate) fn beside(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        let ([x0, y0, z0], [nx, ny, nz]) = (self.place_m, self.normal);
        [x, y, z0 - (nx * (x - x0) + ny * (y - y0)) / nz]
    }

    /// A unit vector in the tangent plane that is this direction as seen from +z.
    pub(crate) fn tangent(&self, [x, y]: [f64; 2]) -> [f64; 3] {
        let [nx, ny, nz] = self.normal;
        let z = (nx * x + ny * y) / nz;
        let long = if z == 0.0 { 1.0 } else { x.hypot(y).hypot(z) / x.hypot(y) };
        [x / long, y / long, -z / long]
    }

    /// Offset of a place along the tangent plane, metres.
    pub(crate) fn offset(&self, place_m: [f64; 3]) -> [f64; 3] {
        let to = sub(place_m, self.place_m);
        along(to, -dot(to, self.normal), self.normal)
    }

    /// Distance of a place, metres.
    pub(crate) fn distance_m(&self, place_m: [f64; 3]) -> f64 {
        distance(place_m, self.place_m)
    }
}

/// Seen from +z, on which side of each edge a point is: positive where the edge has it on the left.
pub(super) fn sides(corners: [[f64; 3]; 3], [x, y]: [f64; 2]) -> [f64; 3] {
    std::array::from_fn(|k| {
        let ([ax, ay, _], [bx, by, _]) = (corners[k], corners[(k + 1) % 3]);
        (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two roofs, one above the other: the upper one is seen; a vertical wall is not.
    #[test]
    fn the_highest_place_is_seen() {
        let nodes = vec![
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 1.0],
            [1.0, 1.0, 1.0],
            [1.0, 0.0, -1.0],
        ];
        let surface = Surface::new(nodes, vec![[0, 1, 2], [1, 3, 2], [0, 4, 1]]).unwrap();
        let seat = Seat::on(&surface, [0.25, 0.5]).unwrap();
        let root = 0.5_f64.sqrt();
        assert!((seat.place_m[2] - 0.5).abs() < 1e-15, "{seat:?}");
        assert!((0..3).all(|k| (seat.normal[k] - [0.0, -root, root][k]).abs() < 1e-15));
        assert!(Seat::on(&surface, [-0.1, 0.5]).is_none());
        // up the slope: half of the way is height
        let [x, y, z] = seat.tangent([0.0, 1.0]);
        assert!(x == 0.0 && (y - root).abs() < 1e-15 && (z - root).abs() < 1e-15);
        let along = seat.offset(seat.beside([0.25, 0.7]));
        assert!((seat.distance_m(seat.beside([0.25, 0.7])) - 0.2 / root).abs() < 1e-15);
        assert!((along[2] - 0.2).abs() < 1e-15 && along[0].abs() < 1e-15);
    }
}
