//! Region of a skin that built-in scripts and random paths stay within.

use super::motion::segment_distance_m;
use crate::error::FemError;
use eit_mesh::{Mesh, Outline};

/// Largest circle around the centroid of a skin that does not cross the rim.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlayCircle {
    /// Centroid of the skin's area, metres.
    pub centre_m: [f64; 2],
    /// Distance from the centroid to the rim, metres.
    pub radius_m: f64,
}

impl PlayCircle {
    /// Computes the circle of a mesh, seen from +z. If the centroid of the skin is in a hole, write
    /// scripts by hand.
    pub fn of(mesh: &Mesh) -> Self {
        let surface = mesh.surface();
        let areas = surface.areas_m2();
        let total: f64 = areas.iter().sum();
        let moment = |i: usize| {
            surface.centroids().iter().zip(areas).map(|(c, a)| c[i] * a).sum::<f64>() / total
        };
        let centre_m = [moment(0), moment(1)];
        let distance = |edge: &[u32; 2]| {
            let [a, b] = edge.map(|n| surface.nodes()[n as usize]);
            segment_distance_m([centre_m[0], centre_m[1], 0.0], a, b)
        };
        let radius_m = surface.rim_edges().iter().map(distance).fold(f64::INFINITY, f64::min);
        Self { centre_m, radius_m }
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
        0.01_f64.min(0.15 * self.radius_m)
    }
}
