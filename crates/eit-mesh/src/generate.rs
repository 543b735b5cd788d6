//! From a shape, electrodes and a size field to a mesh.
//!
//! Order of work: the outline is cut at corners and electrode ends ([`rim`]), the inside is
//! filled by a frontal Delaunay insertion that follows the size field and then refined to an
//! angle limit ([`interior`]), and the inner nodes are smoothed ([`crate::smooth`]). Rim nodes
//! never move and rim edges are never split. A patch is meshed as a skin of its own, with the nodes of
//! the hole that it leaves ([`patch`]).

pub(crate) mod interior;
mod patch;
mod rim;

use crate::geometry::Outline;
use crate::rim_electrodes::{FlatElectrodes, RimElectrodes, RimInterval};
use crate::surface::norm;
use crate::{Electrode, Mesh, MeshError, PlacedElectrode, SkinShape, Surface, smooth};

/// How fine a mesh is wanted.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshSettings {
    /// Edge length away from the electrodes, metres; of a hemisphere at the pole, half of it at the
    /// rim. `None`: a 38th of the side of the square
    /// that has the skin's area, about 2000 nodes.
    pub edge_m: Option<f64>,
    /// Edge length at the ends of the electrodes and at corners that reach into the skin (those of a
    /// hole), where the current density is singular, metres.
    /// Also that on the outline of a patch, at most a twelfth of it.
    /// `None`: a sixth of the electrode's width (a third of a patch's radius), or `edge_m` where that is
    /// smaller; at corners that of the finest electrode. Gaps and other corners may need shorter edges
    /// and get them.
    pub electrode_edge_m: Option<f64>,
    /// Growth of the edge length with distance from such a place, 0.05 to 0.5. Small values
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
        self.for_about(shape, nodes, |trial| generate(shape, electrodes, trial))
    }

    /// [`for_nodes`](Self::for_nodes) for electrodes by position.
    ///
    /// # Errors
    /// As [`generate_placed`], and [`MeshError::OutOfRange`] as there.
    pub fn for_nodes_placed(
        &self,
        shape: &SkinShape,
        electrodes: &[PlacedElectrode],
        nodes: usize,
    ) -> Result<Self, MeshError> {
        self.for_about(shape, nodes, |trial| generate_placed(shape, electrodes, trial))
    }

    fn for_about(
        &self,
        shape: &SkinShape,
        nodes: usize,
        mesh: impl Fn(&Self) -> Result<Mesh, MeshError>,
    ) -> Result<Self, MeshError> {
        let area_m2 = shape.outline()?.area_m2();
        let out_of_range = |must| {
            let (quantity, value) = ("number of nodes", nodes as f64);
            Err(MeshError::OutOfRange { quantity, value, must })
        };
        if nodes < 3 {
            return out_of_range("at least 3");
        }
        let mut edge_m = stretch(shape) * (NODES_PER_SQUARE_EDGE * area_m2 / nodes as f64).sqrt();
        let mut best = (f64::INFINITY, edge_m);
        for _ in 0..8 {
            let trial = Self { edge_m: Some(edge_m), smoothing_rounds: 0, ..self.clone() };
            let found = mesh(&trial)?.surface().nodes().len();
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

    /// Interior edge length on the outline of a shape, metres, checked against its size and the node
    /// limit.
    fn edge_on(&self, outline: &Outline, shape: &SkinShape) -> Result<f64, MeshError> {
        for (quantity, edge) in
            [("edge_m", self.edge_m), ("electrode_edge_m", self.electrode_edge_m)]
        {
            if let Some(value) = edge.filter(|&e| e < outline.resolution_m()) {
                let must =
                    "at least 1e-9 of the outline's length (shorter edges drown in rounding)";
                return Err(MeshError::OutOfRange { quantity, value, must });
            }
        }
        let wanted = self.edge_m.map(|edge_m| edge_m / stretch(shape));
        let edge_m = wanted.unwrap_or_else(|| outline.area_m2().sqrt() / 38.0);
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

/// Largest length of a skin over that in its outline: 2 at the pole of a hemisphere.
fn stretch(shape: &SkinShape) -> f64 {
    if matches!(shape, SkinShape::Hemisphere { .. }) { 2.0 } else { 1.0 }
}

/// Meshes a flat skin (z = 0), or a hemisphere, with electrodes on its rim.
///
/// Every electrode end is a node on the true outline, and so is every corner. On a disc of
/// radius R, rim edges of length h are chords, so an electrode's mesh length falls short of its
/// width by the fraction h^2 / (24 R^2), and the area by about four times that. The mesh knows the
/// middle of each arc, and on a hemisphere of each edge ([`Mesh::midpoint_m`]), for curved elements.
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
    mesh(shape, &outline, &FlatElectrodes::rim(electrodes, &outline)?, settings)
}

/// Meshes a skin as [`generate`] does, with electrodes of any width and spacing on its rim, and round
/// patches inside it.
///
/// Rim electrodes may be off the rim by 1e-3 of the outer rim's length and are moved to the nearest
/// rim point. The nodes on the outline of a patch form a polygon of the disc's area, so that
/// [`Mesh::electrode_measure`] is `pi r^2`; they lie off the circle by up to 2.3 % of the radius,
/// 0.9 % by default. A patch keeps a twentieth of its radius from the rim and from other patches.
///
/// # Errors
/// As [`generate`], and [`MeshError::ElectrodeSize`], [`MeshError::OffSurface`],
/// [`MeshError::BadPatch`] for a patch that is not on the skin whole (outside, in a hole, over the
/// rim; or on a hemisphere, where patches go with [`place_electrodes`](crate::place_electrodes)),
/// [`MeshError::OverlappingPatches`].
///
/// # Example
/// ```
/// use eit_mesh::{MeshSettings, PlacedElectrode, SkinShape, generate_placed};
///
/// let skin = SkinShape::Rectangle { width_m: 0.2, height_m: 0.1 };
/// let electrodes =
///     [PlacedElectrode::rim([-0.1, 0.0, 0.0], 0.03), PlacedElectrode::patch([0.05, 0.0, 0.0], 0.01)];
/// let mesh = generate_placed(&skin, &electrodes, &MeshSettings::default())?;
/// let area_m2 = mesh.electrode_measure(1).unwrap_or(0.0);
/// assert!((area_m2 / (std::f64::consts::PI * 1e-4) - 1.0).abs() < 1e-12);
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
pub fn generate_placed(
    shape: &SkinShape,
    electrodes: &[PlacedElectrode],
    settings: &MeshSettings,
) -> Result<Mesh, MeshError> {
    let outline = shape.outline()?;
    settings.validate()?;
    let flat = FlatElectrodes::placed(electrodes, &outline)?;
    if let (SkinShape::Hemisphere { .. }, Some(disc)) = (shape, flat.patches.first()) {
        let position_m = electrodes[disc.electrode].position_m;
        let problem = "is on a generated hemisphere, which has rim electrodes only: write the mesh to \
                       a file and place the patch on that";
        return Err(MeshError::BadPatch { electrode: disc.electrode + 1, position_m, problem });
    }
    mesh(shape, &outline, &flat, settings)
}

fn mesh(
    shape: &SkinShape,
    outline: &Outline,
    electrodes: &FlatElectrodes,
    settings: &MeshSettings,
) -> Result<Mesh, MeshError> {
    let edge_m = settings.edge_on(outline, shape)?;
    let discs = &electrodes.patches;
    let intervals: Vec<RimInterval> =
        electrodes.rim.iter().map(|(_, interval)| *interval).collect();
    // a third of the radius is a sixth of the width, as on the rim
    let patch_edge =
        |radius_m: f64| settings.electrode_edge_m.unwrap_or(radius_m / 3.0).min(edge_m);
    let patch_edges_m: Vec<f64> = discs.iter().map(|disc| patch_edge(disc.radius_m)).collect();
    let pierced = outline.pierced(discs);
    let (mut rim, field) = rim::cut(&pierced, &intervals, settings, (edge_m, &patch_edges_m))?;
    patch::widen(&mut rim, discs);
    let filled = interior::fill(&rim, &field, settings.node_limit)?;
    let mut skin = smooth::smooth(filled, rim.points.len(), &field, settings.smoothing_rounds);
    let patches = patch::join(&mut skin, &rim, discs, (&field, settings))?;
    let nodes = skin.points.iter().map(|&p| on_shape(shape, p)).collect();
    let surface = Surface::new(nodes, skin.triangles)?;
    let mut placed: Vec<(usize, Electrode)> = Vec::new();
    placed.extend(
        electrodes.rim.iter().map(|e| e.0).zip(rim.electrodes.into_iter().map(Electrode::Rim)),
    );
    placed.extend(discs.iter().map(|d| d.electrode).zip(patches.into_iter().map(Electrode::Patch)));
    placed.sort_by_key(|(index, _)| *index);
    let mesh = Mesh::new(surface, placed.into_iter().map(|(_, electrode)| electrode).collect())?;
    match *shape {
        SkinShape::Hemisphere { radius_m } => mesh.with_midpoints(|_, p| onto_sphere(p, radius_m)),
        _ => Ok(mesh.with_arcs(&rim.arc_middles)),
    }
}

/// The point of a sphere around the origin that is nearest to another; on the equator it stays there.
fn onto_sphere(point: [f64; 3], radius_m: f64) -> [f64; 3] {
    let scale = radius_m / norm(point);
    point.map(|x| scale * x)
}

/// The point of a skin that stands for a point inside its outline.
fn on_shape(shape: &SkinShape, [x, y]: [f64; 2]) -> [f64; 3] {
    match *shape {
        SkinShape::Hemisphere { radius_m } => {
            let square = (x * x + y * y) / (radius_m * radius_m);
            let factor = 2.0 / (1.0 + square);
            // the rim to the last bit: 0 there, not the rounding of its coordinates
            let height = (1.0 - square) * (0.5 * factor);
            let height = if height.abs() < 1e-14 { 0.0 } else { height };
            [factor * x, factor * y, radius_m * height]
        }
        _ => [x, y, 0.0],
    }
}
