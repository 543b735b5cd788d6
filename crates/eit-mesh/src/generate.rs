//! From a shape, electrodes and a size field to a mesh.
//!
//! Order of work: the outline is cut at corners and electrode ends ([`rim`]), the inside is
//! filled by a frontal Delaunay insertion that follows the size field and then refined to an
//! angle limit ([`interior`]), and the inner nodes are smoothed ([`crate::smooth`]). Rim nodes
//! never move and rim edges are never split.

pub(crate) mod interior;
mod rim;

use crate::geometry::Outline;
use crate::rim_electrodes::RimElectrodes;
use crate::{Electrode, Mesh, MeshError, SkinShape, Surface, smooth};

/// How fine a mesh is wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshSettings {
    /// Edge length away from the electrodes, metres. `None`: a 38th of the side of the square
    /// that has the skin's area, about 2000 nodes.
    pub edge_m: Option<f64>,
    /// Edge length at the ends of the electrodes, where the current density is singular, metres.
    /// `None`: a sixth of the electrode's width, or `edge_m` where that is smaller. Gaps and
    /// corners may need shorter edges and get them.
    pub electrode_edge_m: Option<f64>,
    /// Growth of the edge length with distance from an electrode end, 0.05 to 0.5. Small values
    /// give better triangles and more of them; above 0.4 the smallest angles can fall to 19 degrees.
    pub grading: f64,
    /// More nodes than this are an error.
    pub node_limit: usize,
    /// Rounds of smoothing; 0 leaves the refined mesh as it is.
    pub smoothing_rounds: usize,
}

impl Default for MeshSettings {
    fn default() -> Self {
        Self {
            edge_m: None,
            electrode_edge_m: None,
            grading: 0.25,
            node_limit: 1_000_000,
            smoothing_rounds: 3,
        }
    }
}

impl MeshSettings {
    /// Settings with a given interior edge length, the rest as default.
    pub fn with_edge(edge_m: f64) -> Self {
        Self { edge_m: Some(edge_m), ..Self::default() }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`].
    pub fn validate(&self) -> Result<(), MeshError> {
        for (quantity, edge) in
            [("edge_m", self.edge_m), ("electrode_edge_m", self.electrode_edge_m)]
        {
            if let Some(value) = edge.filter(|e| !(e.is_finite() && *e > 0.0)) {
                return Err(MeshError::OutOfRange { quantity, value, must: "positive and finite" });
            }
        }
        if !(0.05..=0.5).contains(&self.grading) {
            let (quantity, value) = ("grading", self.grading);
            return Err(MeshError::OutOfRange { quantity, value, must: "between 0.05 and 0.5" });
        }
        if self.node_limit < 3 {
            let (quantity, value) = ("node_limit", self.node_limit as f64);
            return Err(MeshError::OutOfRange { quantity, value, must: "at least 3" });
        }
        Ok(())
    }

    /// These settings with the interior edge length that gives about `nodes` nodes (within 2 %,
    /// within 10 % where the mesh is too coarse to hit the number), found by meshing without
    /// smoothing a few times.
    ///
    /// # Errors
    /// As [`generate`], and [`MeshError::OutOfRange`] for a number that cannot be reached because
    /// electrode ends and corners alone need more.
    pub fn for_nodes(
        &self,
        shape: &SkinShape,
        electrodes: &RimElectrodes,
        nodes: usize,
    ) -> Result<Self, MeshError> {
        let area_m2 = shape.outline()?.area_m2();
        let out_of_range = |must| {
            let (quantity, value) = ("number of nodes", nodes as f64);
            Err(MeshError::OutOfRange { quantity, value, must })
        };
        if nodes < 3 {
            return out_of_range("at least 3");
        }
        let mut edge_m = (NODES_PER_SQUARE_EDGE * area_m2 / nodes as f64).sqrt();
        let mut best = (f64::INFINITY, edge_m);
        for _ in 0..8 {
            let trial = Self { edge_m: Some(edge_m), smoothing_rounds: 0, ..self.clone() };
            let found = generate(shape, electrodes, &trial)?.surface().nodes().len();
            let ratio = found as f64 / nodes as f64;
            let miss = (ratio - 1.0).abs();
            if miss < best.0 {
                best = (miss, edge_m);
            }
            if miss < 0.02 {
                break;
            }
            edge_m *= ratio.sqrt();
        }
        if best.0 > 0.1 {
            return out_of_range(
                "a number that the electrode ends and corners leave room for (raise \
                 electrode_edge_m or grading, or ask for more)",
            );
        }
        Ok(Self { edge_m: Some(best.1), ..self.clone() })
    }

    /// Interior edge length on an outline, metres, checked against its size and the node limit.
    fn edge_on(&self, outline: &Outline) -> Result<f64, MeshError> {
        for (quantity, edge) in
            [("edge_m", self.edge_m), ("electrode_edge_m", self.electrode_edge_m)]
        {
            if let Some(value) = edge.filter(|&e| e < outline.resolution_m()) {
                let must =
                    "at least 1e-9 of the outline's length (shorter edges drown in rounding)";
                return Err(MeshError::OutOfRange { quantity, value, must });
            }
        }
        let edge_m = self.edge_m.unwrap_or_else(|| outline.area_m2().sqrt() / 38.0);
        let expected = NODES_PER_SQUARE_EDGE * outline.area_m2() / (edge_m * edge_m);
        // the estimate is within a factor of 1.5 of what comes out
        if expected > 2.0 * self.node_limit as f64 {
            let limit = self.node_limit;
            return Err(MeshError::TooManyNodes { edge_m, expected, limit });
        }
        Ok(edge_m)
    }
}

/// Nodes in the area of a square with the wanted edge as its side, in equilateral triangles:
/// 2 / sqrt(3).
const NODES_PER_SQUARE_EDGE: f64 = 1.154_700_538_379_251_7;

/// Meshes a flat skin (z = 0) with electrodes on its rim.
///
/// Every electrode end is a node on the true outline, and so is every corner. On a disc of
/// radius R, rim edges of length h are chords, so an electrode's mesh length falls short of its
/// width by the fraction h^2 / (24 R^2), and the area by about four times that. The mesh knows the
/// middle of each arc ([`Mesh::midpoint_m`]), for curved elements.
/// The same input gives the same mesh, bit for bit.
///
/// # Errors
/// [`MeshError::OutOfRange`], [`MeshError::BadOutline`], [`MeshError::OverlappingElectrodes`],
/// [`MeshError::TouchingElectrodes`], [`MeshError::OffRim`] or [`MeshError::TooManyNodes`] before
/// any work;
/// [`MeshError::RefinementIncomplete`] where the wanted edge length needs more nodes than
/// [`MeshSettings::node_limit`].
///
/// # Example
/// ```
/// use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
///
/// let skin = SkinShape::Disc { radius_m: 0.1 };
/// let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
/// let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(0.01))?;
/// assert_eq!(mesh.electrodes().len(), 16);
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
pub fn generate(
    shape: &SkinShape,
    electrodes: &RimElectrodes,
    settings: &MeshSettings,
) -> Result<Mesh, MeshError> {
    let outline = shape.outline()?;
    settings.validate()?;
    let edge_m = settings.edge_on(&outline)?;
    let intervals = electrodes.place(&outline)?;
    let (rim, field) = rim::cut(&outline, &intervals, settings, edge_m)?;
    let filled = interior::fill(&rim, &field, settings.node_limit)?;
    let triangulation = smooth::smooth(filled, rim.points.len(), &field, settings.smoothing_rounds);
    let nodes = triangulation.points.iter().map(|p| [p[0], p[1], 0.0]).collect();
    let surface = Surface::new(nodes, triangulation.triangles)?;
    let mesh = Mesh::new(surface, rim.electrodes.into_iter().map(Electrode::Rim).collect())?;
    Ok(mesh.with_arcs(&rim.arc_middles))
}
