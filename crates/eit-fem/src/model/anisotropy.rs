//! Sheets that conduct better along one direction than across, such as knits.
//!
//! The conductivity tensor of an element with scale `sigma`, ratio `r` and unit direction `d` in its
//! plane, `n` across, is
//!
//! ```text
//! sigma M,   M = sqrt(r) d d' + n n' / sqrt(r),   det M = 1
//! ```
//!
//! so `sigma` is the geometric mean of the conductivities along and across. The map `M^(-1/2)` of the
//! plane preserves areas and turns the element into one of scalar conductivity `sigma`: its edges are
//! multiplied by `r^(-1/4)` along `d` and by `r^(1/4)` across. Assembly, solves and Jacobian use the
//! coefficients of the mapped element ([`crate::element`]) and cost the same as for a scalar. Contacts
//! keep their true lengths and areas.

use crate::error::FemError;
use eit_core::vector::{Vector, along, cross, distance, dot, norm, normal, scaled, sub, unit};
use eit_mesh::Surface;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Ratio and direction of the conductivity of each element; their scale is the conductivity of a solve.
///
/// Directions are fixed in space: where nodes move ([`ForwardModel::deform`](crate::ForwardModel::deform)), they are projected onto the
/// moved elements.
///
/// ```
/// use eit_fem::{Anisotropy, ForwardModel, PairProtocol};
/// use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
///
/// let skin = SkinShape::Disc { radius_m: 0.1 };
/// let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
/// let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.02))?;
/// let knit = Anisotropy::uniform(mesh.surface(), 1.6, 30_f64.to_radians())?;
/// let model = ForwardModel::new(&mesh, &PairProtocol::default().protocol()?, &[1e3; 16])?
///     .with_anisotropy(&knit)?;
/// assert_eq!(model.forward(&vec![1e-5; model.elements()])?.len(), 208);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Anisotropy {
    grains: Vec<Grain>,
}

/// Ratio and direction of one element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grain {
    /// Conductivity along divided by that across.
    pub ratio: f64,
    /// Direction of the conductivity along, of any length.
    pub direction: Vector,
}

impl Anisotropy {
    /// Creates a sheet from the ratio of each element (along divided by across, above zero) and the
    /// direction along (of any length; its part in the element's plane counts).
    ///
    /// # Errors
    /// Different lengths; a ratio that is not finite and above zero; a direction without length.
    pub fn new(ratios: &[f64], directions: &[Vector]) -> Result<Self, FemError> {
        let what = "directions of the conductivity (one per element)";
        FemError::check_length(what, directions.len(), ratios.len())?;
        let grains = ratios.iter().zip(directions).map(|(&ratio, &direction)| {
            check("ratio of the conductivities along and across", ratio)?;
            check("length of a direction of the conductivity", norm(direction))?;
            Ok(Grain { ratio, direction })
        });
        Ok(Self { grains: grains.collect::<Result<_, FemError>>()? })
    }

    /// Creates a sheet of one ratio and angle.
    ///
    /// The angle is measured counter-clockwise, seen against the normals (for a flat skin: from +z),
    /// from the x axis to the direction along. On a curved skin that holds for the element nearest to
    /// the centroid of all (with the y axis if it is normal to x), and its direction is transported to
    /// the others on the shortest way through the elements between, without rotation in their planes.
    ///
    /// # Errors
    /// A ratio that is not finite and above zero, an angle that is not finite.
    pub fn uniform(surface: &Surface, ratio: f64, angle_rad: f64) -> Result<Self, FemError> {
        FemError::require("angle of the conductivity along", angle_rad, true, "finite")?;
        Self::new(&vec![ratio; surface.triangles().len()], &transported(surface, angle_rad))
    }

    /// Number of elements.
    pub fn elements(&self) -> usize {
        self.grains.len()
    }

    /// Returns the ratio of each element.
    pub fn ratios(&self) -> impl Iterator<Item = f64> {
        self.grains.iter().map(|grain| grain.ratio)
    }

    /// Returns the direction of each element, as it was given.
    pub fn directions(&self) -> impl Iterator<Item = Vector> {
        self.grains.iter().map(|grain| grain.direction)
    }

    pub(crate) fn grains(&self) -> &[Grain] {
        &self.grains
    }

    pub(crate) fn map(&self, change: impl Fn(usize, &Grain) -> Grain) -> Self {
        Self { grains: self.grains.iter().enumerate().map(|(e, grain)| change(e, grain)).collect() }
    }
}

impl Grain {
    /// Unit vector along, in the plane of two tangents.
    fn along(&self, [t1, t2]: [Vector; 2]) -> Vector {
        unit(self.within(cross(t1, t2)))
    }

    /// Part of the direction at right angles to a normal.
    pub(crate) fn within(&self, normal: Vector) -> Vector {
        let out = dot(self.direction, normal) / dot(normal, normal);
        along(self.direction, -out, normal)
    }

    /// Maps two tangents of the element to the plane in which its conductivity is a scalar.
    pub(crate) fn mapped(&self, tangents: [Vector; 2]) -> [Vector; 2] {
        let direction = self.along(tangents);
        let across = self.ratio.sqrt().sqrt();
        tangents.map(|t| {
            along(scaled(across, t), (1.0 / across - across) * dot(direction, t), direction)
        })
    }

    /// Derivatives of the mapped tangents, up to a common rotation, where the tangents move.
    ///
    /// The direction stays in space, but its part in the plane turns with the plane if it is not in the
    /// plane. The direction of its unit vector `d` changes by `-(direction . n) (n' . b) / |part|` along
    /// `b`, at right angles to it in the plane, where `n'` is the change of the unit normal.
    pub(crate) fn mapped_moves(&self, tangents: [Vector; 2], moves: [Vector; 2]) -> [Vector; 2] {
        let d = self.along(tangents);
        let area_normal = cross(tangents[0], tangents[1]);
        let n = unit(area_normal);
        let b = cross(n, d);
        let (out, part) = (dot(self.direction, n), dot(self.direction, d));
        let change = along(cross(moves[0], tangents[1]), 1.0, cross(tangents[0], moves[1]));
        let turn = -out * dot(change, b) / (norm(area_normal) * part);
        let across = self.ratio.sqrt().sqrt();
        let factor = 1.0 / across - across;
        std::array::from_fn(|k| {
            let (t, w) = (tangents[k], moves[k]);
            let along_d = dot(d, w) + turn * dot(b, t);
            let moved = along(scaled(across, w), factor * along_d, d);
            along(moved, factor * dot(d, t) * turn, b)
        })
    }
}

fn check(quantity: &'static str, value: f64) -> Result<(), FemError> {
    FemError::require(quantity, value, value > 0.0, "finite and above zero")
}

/// Direction of each triangle: at one angle in the triangle nearest to the centroid, and parallel from
/// triangle to triangle.
fn transported(surface: &Surface, angle_rad: f64) -> Vec<Vector> {
    let centroids = surface.centroids();
    let normals: Vec<Vector> =
        (0..centroids.len()).map(|t| unit(normal(surface.corners(t)))).collect();
    let count = centroids.len() as f64;
    let middle = centroids.iter().fold([0.0; 3], |sum, c| along(sum, 1.0 / count, *c));
    let from_middle = |t: &usize| distance(centroids[*t], middle);
    let first = (0..centroids.len()).min_by(|a, b| from_middle(a).total_cmp(&from_middle(b)));
    let mut directions = vec![[0.0; 3]; centroids.len()];
    let Some(first) = first else { return directions };
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let tangential = axes.map(|axis| along(axis, -dot(axis, normals[first]), normals[first]));
    let axis = unit(if norm(tangential[0]) > 1e-6 { tangential[0] } else { tangential[1] });
    let (sin, cos) = angle_rad.sin_cos();
    directions[first] = along(scaled(cos, axis), sin, cross(normals[first], axis));
    // shortest ways through centroids; bits of distances, which are not negative, sort like them
    let neighbours = surface.neighbours();
    let mut is_done = vec![false; centroids.len()];
    let mut open = BinaryHeap::from([Reverse((0u64, first, first))]);
    while let Some(Reverse((way, at, from))) = open.pop() {
        if std::mem::replace(&mut is_done[at], true) {
            continue;
        }
        let corners = surface.corners(at);
        for (side, across) in neighbours[at].iter().enumerate() {
            let Some(across) = across.map(|across| across as usize) else { continue };
            let edge = unit(sub(corners[(side + 1) % 3], corners[side]));
            if across == from && at != first {
                let inward = |t: usize| cross(normals[t], edge);
                let parts = [edge, inward(from)].map(|axis| dot(directions[from], axis));
                directions[at] = along(scaled(parts[0], edge), parts[1], inward(at));
            }
            let way = f64::from_bits(way) + distance(centroids[at], centroids[across]);
            open.push(Reverse((way.to_bits(), across, at)));
        }
    }
    directions
}
