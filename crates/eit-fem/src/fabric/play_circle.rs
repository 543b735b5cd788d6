//! Region of a skin that built-in scripts and random paths stay within.

use super::motion::segment_distance_m;
use super::seat::sides;
use crate::error::FemError;
use eit_mesh::{Mesh, Outline};

/// Radius of a fingertip.
const TIP_M: f64 = 0.01;
/// A circle around the centroid is used unless it is smaller than this share of the largest one.
const LEAST_SHARE: f64 = 0.5;

/// A circle on a skin that does not cross the rim: around the centroid where that is well inside.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PlayCircle {
    /// Its centre, metres.
    pub centre_m: [f64; 2],
    /// Distance from the centre to the rim, metres.
    pub radius_m: f64,
}

impl PlayCircle {
    /// Computes the circle of a mesh, seen from +z: around the centroid of its area, or, if that is off the skin or much
    /// closer to the rim than other places, around the element's centre farthest from the rim.
    pub fn of(mesh: &Mesh) -> Self {
        let surface = mesh.surface();
        let (areas, centroids) = (surface.areas_m2(), surface.centroids());
        let total: f64 = areas.iter().sum();
        let moment =
            |i: usize| centroids.iter().zip(areas).map(|(c, a)| c[i] * a).sum::<f64>() / total;
        let circle = |centre_m: [f64; 2]| {
            let distance = |edge: &[u32; 2]| {
                let [a, b] = edge.map(|n| surface.nodes()[n as usize]);
                segment_distance_m([centre_m[0], centre_m[1], 0.0], a, b)
            };
            let distances = surface.rim_edges().iter().map(distance);
            Self { centre_m, radius_m: distances.fold(f64::INFINITY, f64::min) }
        };
        let middle = circle([moment(0), moment(1)]);
        let circles = centroids.iter().map(|c| circle([c[0], c[1]]));
        let widest = circles.max_by(|a, b| a.radius_m.total_cmp(&b.radius_m)).unwrap_or(middle);
        let is_inside =
            (0..centroids.len()).any(|t| is_in_triangle(middle.centre_m, surface.corners(t)));
        match is_inside && middle.radius_m >= LEAST_SHARE * widest.radius_m {
            true => middle,
            false => widest,
        }
    }

    /// Computes the circle of an outline, around its centroid (ignoring holes). It does not depend
    /// on the mesh.
    ///
    /// # Errors
    /// [`FemError::CentroidOffSkin`].
    pub fn of_outline(outline: &Outline) -> Result<Self, FemError> {
        let centre_m = outline.centre_m();
        if !outline.contains(centre_m) {
            let [x_m, y_m] = centre_m;
            return Err(FemError::CentroidOffSkin { x_m, y_m });
        }
        let distances = outline.loops().iter().map(|rim| rim.project(centre_m).1);
        Ok(Self { centre_m, radius_m: distances.fold(f64::INFINITY, f64::min) })
    }

    /// Point at a fraction of the radius and an angle, radians counter-clockwise from +x.
    pub(super) fn at(&self, part: f64, angle: f64) -> [f64; 2] {
        let r = part * self.radius_m;
        [self.centre_m[0] + r * angle.cos(), self.centre_m[1] + r * angle.sin()]
    }

    /// Radius of a fingertip: 10 mm, or less on small skins.
    pub(super) fn tip_m(&self) -> f64 {
        TIP_M.min(0.15 * self.radius_m)
    }

    /// Share of a finger's force for that tip: the same mean pressure on small skins, whose fabric would else be dented
    /// beyond what the contact model covers.
    pub(super) fn force_share(&self) -> f64 {
        (self.tip_m() / TIP_M).powi(2)
    }
}

/// Whether a triangle, of either orientation, contains a point.
fn is_in_triangle(place_m: [f64; 2], corners: [[f64; 3]; 3]) -> bool {
    let sides = sides(corners, place_m);
    sides.iter().all(|side| *side >= 0.0) || sides.iter().all(|side| *side <= 0.0)
}
