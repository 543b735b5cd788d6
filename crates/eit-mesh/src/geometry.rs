//! Shapes of flat skins and their outlines: closed loops of straight lines and circular arcs,
//! measured by arc length.

mod check;
mod loops;
mod piece;

use crate::MeshError;
use check::{check_polygon, in_range};
pub use loops::Loop;
use piece::Piece;
use std::f64::consts::TAU;

/// Points closer than this fraction of the outline's length, or of a surface's longest side, are treated
/// as the same point.
///
/// Coordinates carry a rounding error of 1e-16 of their magnitude. This value is seven digits
/// larger, so the smallest gap between electrodes (a few times this) keeps seven correct digits.
pub(crate) const RESOLUTION: f64 = 1e-9;

/// The shape of a flat skin.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum SkinShape {
    /// A disc centred at the origin.
    Disc {
        /// Radius, metres.
        radius_m: f64,
    },
    /// A rectangle centred at the origin, with sides along x and y.
    Rectangle {
        /// Side along x, metres.
        width_m: f64,
        /// Side along y, metres.
        height_m: f64,
    },
    /// The upper half of a sphere centred at the origin, with its rim at z = 0. It is meshed as a
    /// disc and mapped by the inverse stereographic projection, which preserves angles.
    Hemisphere {
        /// Radius, metres.
        radius_m: f64,
    },
    /// A polygon with holes. Loops close automatically and may run in either direction.
    Polygon {
        /// Corners of the outer loop, metres.
        outline_m: Vec<[f64; 2]>,
        /// Corners of each hole, metres.
        holes_m: Vec<Vec<[f64; 2]>>,
    },
}

impl SkinShape {
    /// Returns the validated outline of the shape; for a hemisphere, that of its rim.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`] for a size that is not finite or not between 1e-9 m and 1e9 m;
    /// [`MeshError::BadOutline`] for a polygon that touches or crosses itself, has a spike sharper
    /// than one degree, or has a hole that is not inside it or not clear of the other loops.
    pub fn outline(&self) -> Result<Outline, MeshError> {
        match self {
            Self::Disc { radius_m } | Self::Hemisphere { radius_m } => Outline::disc(*radius_m),
            Self::Rectangle { width_m, height_m } => Outline::rectangle(*width_m, *height_m),
            Self::Polygon { outline_m, holes_m } => Outline::polygon(outline_m, holes_m),
        }
    }
}

/// A disc in the plane of a skin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Disc {
    pub centre_m: [f64; 2],
    pub radius_m: f64,
}

/// The outline of a flat skin: one outer loop and the holes.
///
/// ```
/// use eit_mesh::Outline;
///
/// // a square with a square hole
/// let corners_m = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
/// let hole_m = vec![[0.4, 0.4], [0.6, 0.4], [0.6, 0.6], [0.4, 0.6]];
/// let outline = Outline::polygon(&corners_m, &[hole_m])?;
/// assert!(outline.contains([0.2, 0.2]) && !outline.contains([0.5, 0.5]));
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Outline {
    /// Outer loop first.
    loops: Vec<Loop>,
    centre: [f64; 2],
}

impl Outline {
    /// Creates a disc centred at the origin; arc length starts on the +x axis.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`].
    pub fn disc(radius_m: f64) -> Result<Self, MeshError> {
        let radius = in_range("radius_m", radius_m)?;
        let rim = Piece::Arc { centre: [0.0; 2], radius, from_rad: 0.0, sweep_rad: TAU };
        Ok(Self { loops: vec![Loop::new(vec![rim])], centre: [0.0; 2] })
    }

    /// Creates a rectangle centred at the origin; arc length starts at its lower left corner.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`].
    pub fn rectangle(width_m: f64, height_m: f64) -> Result<Self, MeshError> {
        let x = 0.5 * in_range("width_m", width_m)?;
        let y = 0.5 * in_range("height_m", height_m)?;
        Self::polygon(&[[-x, -y], [x, -y], [x, y], [-x, y]], &[])
    }

    /// Creates a polygon with holes, whose loops may run in either direction.
    ///
    /// All pairs of sides are compared, so the time is quadratic in the number of corners (10 000
    /// corners: 1 s).
    ///
    /// # Errors
    /// [`MeshError::BadOutline`] with the position, or [`MeshError::OutOfRange`].
    pub fn polygon(outline_m: &[[f64; 2]], holes_m: &[Vec<[f64; 2]>]) -> Result<Self, MeshError> {
        check_polygon(outline_m, holes_m)?;
        let mut loops = vec![Loop::polygon(outline_m, true)];
        loops.extend(holes_m.iter().map(|hole| Loop::polygon(hole, false)));
        Ok(Self { loops, centre: centroid(outline_m) })
    }

    /// Returns the loops: the outer loop, then the holes in their order.
    pub fn loops(&self) -> &[Loop] {
        &self.loops
    }

    /// Whether a point lies on the skin: inside the outer loop and in no hole. The point must not
    /// lie on a loop.
    pub fn contains(&self, point_m: [f64; 2]) -> bool {
        self.loops_around(point_m) == 1
    }

    /// Number of loops around a point that is not on a loop: 0 outside, 1 on the skin, 2 in a hole.
    pub(crate) fn loops_around(&self, point_m: [f64; 2]) -> usize {
        self.loops.iter().filter(|l| l.is_around(point_m)).count()
    }

    /// Returns this outline with round holes, added as loops after its own.
    pub(crate) fn pierced(&self, discs: &[Disc]) -> Self {
        let mut pierced = self.clone();
        pierced.loops.extend(discs.iter().map(|disc| {
            let (centre, radius) = (disc.centre_m, disc.radius_m);
            Loop::new(vec![Piece::Arc { centre, radius, from_rad: 0.0, sweep_rad: -TAU }])
        }));
        pierced
    }

    /// Centroid of the area inside the outer loop (holes not subtracted), metres.
    pub fn centre_m(&self) -> [f64; 2] {
        self.centre
    }

    /// Area, square metres.
    pub fn area_m2(&self) -> f64 {
        let under = |piece: &Piece| match *piece {
            Piece::Line { from, to } => 0.5 * cross(from, to),
            Piece::Arc { centre, radius, sweep_rad, .. } => {
                let from = piece.point_at(0.0);
                let to = piece.point_at(piece.length());
                0.5 * (radius * radius * sweep_rad
                    + cross(centre, [to[0] - from[0], to[1] - from[1]]))
            }
        };
        self.loops.iter().flat_map(|l| &l.pieces).map(under).sum()
    }

    /// Arc length of the outermost point of the outer loop at an angle counter-clockwise from +x,
    /// seen from the centroid.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`] if no rim point lies in that direction: the angle is not finite,
    /// or the outline is so concave that its centroid lies outside.
    pub(crate) fn arc_length_at_angle(&self, angle_deg: f64) -> Result<f64, MeshError> {
        let must = "a finite angle at which a ray from the centroid of the outline meets the rim \
                    (otherwise give positions_m)";
        let (quantity, value) = ("first_angle_deg", angle_deg);
        let found = self.loops[0].outermost_at(self.centre, angle_deg.to_radians());
        found.ok_or(MeshError::OutOfRange { quantity, value, must })
    }

    /// Bounding box of the outer loop: `[low, high]`, metres.
    pub(crate) fn bounds_m(&self) -> [[f64; 2]; 2] {
        let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for piece in &self.loops[0].pieces {
            for k in 0..2 {
                let (low, high) = match *piece {
                    Piece::Line { from, to } => (from[k].min(to[k]), from[k].max(to[k])),
                    Piece::Arc { centre, radius, .. } => (centre[k] - radius, centre[k] + radius),
                };
                bounds[0][k] = bounds[0][k].min(low);
                bounds[1][k] = bounds[1][k].max(high);
            }
        }
        bounds
    }

    /// Distance from the rim point at `arc_length_m` on a loop to the nearest piece of the outline,
    /// excluding the point's own piece and its neighbours on the same loop, metres; infinite if
    /// there is none.
    pub(crate) fn clearance_m(&self, loop_index: usize, arc_length_m: f64) -> f64 {
        let own = &self.loops[loop_index];
        let (piece, count) = (own.piece_at(arc_length_m), own.pieces.len());
        let point = own.point_at(arc_length_m);
        let mut nearest = f64::INFINITY;
        for (index, l) in self.loops.iter().enumerate() {
            for (k, other) in l.pieces.iter().enumerate() {
                let steps = (k + count - piece) % count;
                let adjacent = index == loop_index && (steps <= 1 || steps + 1 == count);
                // a corner also belongs to the preceding piece
                let at_corner = arc_length_m <= own.starts_m[piece];
                let before = index == loop_index && at_corner && steps + 2 == count;
                if !adjacent && !before {
                    nearest = nearest.min(other.project(point).1);
                }
            }
        }
        nearest
    }

    /// Distance below which two points of the outline are treated as one, metres.
    pub(crate) fn resolution_m(&self) -> f64 {
        RESOLUTION * self.loops[0].length_m()
    }
}

pub(crate) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    dot([b[0] - a[0], b[1] - a[1]], [b[0] - a[0], b[1] - a[1]]).sqrt()
}

pub(crate) fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(crate) fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// Shoelace formula about the first corner: positive if counter-clockwise.
fn signed_area(corners: &[[f64; 2]]) -> f64 {
    0.5 * triangles_from_first(corners).map(|(twice_area, _)| twice_area).sum::<f64>()
}

fn centroid(corners: &[[f64; 2]]) -> [f64; 2] {
    let twice_area: f64 = triangles_from_first(corners).map(|t| t.0).sum();
    std::array::from_fn(|k| {
        triangles_from_first(corners).map(|(a, c)| a * c[k]).sum::<f64>() / twice_area
    })
}

/// Twice the signed area and the centroid of each triangle in the fan about the first corner.
/// Taking differences from the first corner preserves the digits of an outline far from the origin.
fn triangles_from_first(corners: &[[f64; 2]]) -> impl Iterator<Item = (f64, [f64; 2])> + '_ {
    let origin = corners.first().copied().unwrap_or_default();
    corners.windows(2).map(move |side| {
        let [a, b] = [0, 1].map(|k| [side[k][0] - origin[0], side[k][1] - origin[1]]);
        let centre = std::array::from_fn(|k| origin[k] + (a[k] + b[k]) / 3.0);
        (cross(a, b), centre)
    })
}
