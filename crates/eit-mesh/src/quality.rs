//! Measures how well shaped a mesh is.

use crate::{Electrode, Mesh, Surface};
use eit_core::vector::{norm, sub};
use std::fmt;

/// Shape statistics of a mesh.
///
/// ```
/// use eit_mesh::{MeshSettings, Quality, RimElectrodes, SkinShape, generate};
///
/// let skin = SkinShape::Disc { radius_m: 0.1 };
/// let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
/// let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.02))?;
/// let quality = Quality::of(&mesh);
/// assert!(quality.smallest_angle_deg > 25.0);
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Quality {
    /// Number of nodes.
    pub nodes: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Number of edges on the rim.
    pub rim_edges: usize,
    /// Smallest angle of any triangle, degrees.
    pub smallest_angle_deg: f64,
    /// Largest angle of any triangle, degrees.
    pub largest_angle_deg: f64,
    /// Mean [quality](Surface::triangle_quality) of the triangles.
    pub mean_quality: f64,
    /// Smallest quality of any triangle.
    pub smallest_quality: f64,
    /// Shortest edge, metres.
    pub shortest_edge_m: f64,
    /// Longest edge, metres.
    pub longest_edge_m: f64,
    /// Area, square metres.
    pub area_m2: f64,
    /// Number of edges (rim electrode) or triangles (patch electrode) of each electrode.
    pub elements_per_electrode: Vec<usize>,
}

impl Quality {
    /// Measures a mesh.
    pub fn of(mesh: &Mesh) -> Self {
        let surface = mesh.surface();
        let mut report = Self {
            nodes: surface.nodes().len(),
            triangles: surface.triangles().len(),
            rim_edges: surface.rim_edges().len(),
            smallest_angle_deg: f64::INFINITY,
            largest_angle_deg: 0.0,
            mean_quality: 0.0,
            smallest_quality: f64::INFINITY,
            shortest_edge_m: f64::INFINITY,
            longest_edge_m: 0.0,
            area_m2: surface.areas_m2().iter().sum(),
            elements_per_electrode: mesh.electrodes().iter().map(elements).collect(),
        };
        for (t, &area_m2) in surface.areas_m2().iter().enumerate() {
            let [a, b, c] = surface.corners(t);
            let sides = [norm(sub(c, b)), norm(sub(a, c)), norm(sub(b, a))];
            for (k, angle_rad) in angles(sides, area_m2).into_iter().enumerate() {
                report.smallest_angle_deg = report.smallest_angle_deg.min(angle_rad.to_degrees());
                report.largest_angle_deg = report.largest_angle_deg.max(angle_rad.to_degrees());
                report.shortest_edge_m = report.shortest_edge_m.min(sides[k]);
                report.longest_edge_m = report.longest_edge_m.max(sides[k]);
            }
            let quality = surface.triangle_quality(t);
            report.mean_quality += quality / report.triangles as f64;
            report.smallest_quality = report.smallest_quality.min(quality);
        }
        report
    }
}

impl Surface {
    /// Quality of one triangle, `q = 4 sqrt(3) A / (a^2 + b^2 + c^2)` with area `A` and sides `a`,
    /// `b`, `c`: 1 is equilateral, 0 degenerate. NaN if the triangle does not exist.
    ///
    /// Source: Bhatia, Lawrence, *Two-dimensional finite element mesh generation based on
    /// stripwise automatic triangulation*, *Comput. Struct.* 36 (1990), 309-319.
    pub fn triangle_quality(&self, triangle: usize) -> f64 {
        let Some(&area_m2) = self.areas_m2().get(triangle) else { return f64::NAN };
        let [a, b, c] = self.corners(triangle);
        let squares = [sub(c, b), sub(a, c), sub(b, a)].map(|s| s.iter().map(|x| x * x).sum());
        shape_quality(area_m2, squares)
    }
}

/// `4 sqrt(3) A / (a^2 + b^2 + c^2)` from an area and the squares of the sides.
pub(crate) fn shape_quality(area: f64, squared_sides: [f64; 3]) -> f64 {
    4.0 * 3f64.sqrt() * area / squared_sides.iter().sum::<f64>()
}

fn elements(electrode: &Electrode) -> usize {
    match electrode {
        Electrode::Rim(edges) => edges.len(),
        Electrode::Patch(triangles) => triangles.len(),
    }
}

/// Angle opposite each side, radians:
/// `tan = 4 A / (sum of the squares of the other sides - own square)`, which is accurate at all
/// angles.
fn angles(sides: [f64; 3], area_m2: f64) -> [f64; 3] {
    let [a, b, c] = sides.map(|s| s * s);
    [b + c - a, c + a - b, a + b - c].map(|cos_part| (4.0 * area_m2).atan2(cos_part))
}

impl fmt::Display for Quality {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { nodes, triangles, rim_edges, area_m2, mean_quality, smallest_quality, .. } =
            self;
        let Self { smallest_angle_deg, largest_angle_deg, shortest_edge_m, longest_edge_m, .. } =
            self;
        write!(
            f,
            "nodes       {nodes} ({triangles} triangles, {rim_edges} rim edges)\n\
             area        {area_m2:.6e} m2\n\
             angles      {smallest_angle_deg:.1} to {largest_angle_deg:.1} degrees\n\
             quality     {mean_quality:.4} mean, {smallest_quality:.4} worst\n\
             edges       {shortest_edge_m:.3e} m to {longest_edge_m:.3e} m (ratio {:.1})",
            longest_edge_m / shortest_edge_m
        )?;
        let counts = &self.elements_per_electrode;
        if let (Some(least), Some(most)) = (counts.iter().min(), counts.iter().max()) {
            let range =
                if least == most { least.to_string() } else { format!("{least} to {most}") };
            write!(f, "\nelectrodes  {} with {range} elements each", counts.len())?;
        }
        Ok(())
    }
}
