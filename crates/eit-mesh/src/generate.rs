//! Generates a mesh from a shape, electrodes and a size field.
//!
//! Steps: the outline is cut at corners and electrode ends ([`rim`]); the interior is filled by
//! frontal Delaunay insertion that follows the size field and then refined to an angle limit
//! ([`interior`]); the interior nodes are smoothed ([`crate::smooth`]). Rim nodes never move and
//! rim edges are never split. A patch is meshed separately, using the nodes around the hole left
//! for it ([`patch`]).

pub(crate) mod interior;
mod node_count;
mod patch;
mod rim;

use crate::flat_electrodes::FlatElectrodes;
use crate::geometry::{Disc, Outline};
use crate::rim_electrodes::{RimElectrodes, RimInterval};
use crate::settings::MeshSettings;
use crate::{Electrode, Mesh, MeshError, PlacedElectrode, SkinShape, Surface, smooth};
use eit_core::event;
use eit_core::vector::norm;

/// Meshes a flat skin (z = 0), or a hemisphere, with electrodes on its rim.
///
/// Every electrode end and every corner is a node on the true outline. On a disc of radius R, rim
/// edges of length h are chords, so an electrode's length in the mesh falls short of its width by
/// the fraction h^2 / (24 R^2), and the area by about four times that. The mesh stores the midpoint
/// of each arc, and on a hemisphere of every edge ([`Mesh::midpoint_m`]), for curved elements. The
/// same input gives the same mesh, bit for bit.
///
/// # Errors
/// [`MeshError::OutOfRange`], [`MeshError::BadOutline`], [`MeshError::OverlappingElectrodes`],
/// [`MeshError::TouchingElectrodes`], [`MeshError::OffRim`] or [`MeshError::TooManyNodes`] before
/// any meshing; [`MeshError::RefinementIncomplete`] if the requested edge length needs more nodes
/// than [`MeshSettings::node_limit`].
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

/// Meshes a skin as [`generate`] does, with rim electrodes of any width and spacing, and round
/// patches inside it.
///
/// Rim electrodes may be off the rim by 1e-3 of the outer rim's length and are moved to the nearest
/// rim point. The nodes on a patch outline form a polygon of the disc's area, so that
/// [`Mesh::electrode_measure`] is `pi r^2`; they lie up to 2.3 % of the radius off the circle, 0.9
/// % by default. A patch must be at least a twentieth of its radius from the rim and from other
/// patches.
///
/// # Errors
/// As [`generate`], and [`MeshError::ElectrodeSize`], [`MeshError::OffSurface`],
/// [`MeshError::OverlappingPatches`] and [`MeshError::BadPatch`] for a patch that does not lie
/// entirely on the skin (outside it, in a hole or across the rim) or lies on a hemisphere, where
/// patches need [`place_electrodes`](crate::place_electrodes).
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
    if let (SkinShape::Hemisphere { .. }, Some((index, _))) = (shape, flat.patches.first()) {
        let position_m = electrodes[*index].position_m;
        let problem = "is on a generated hemisphere, which supports only rim electrodes: write the \
                       mesh to a file and place the patch on that mesh";
        return Err(MeshError::BadPatch { electrode: index + 1, position_m, problem });
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
    let discs: Vec<Disc> = electrodes.patches.iter().map(|(_, disc)| *disc).collect();
    let intervals: Vec<RimInterval> =
        electrodes.rim.iter().map(|(_, interval)| *interval).collect();
    // a third of the radius is a sixth of the diameter, the same fraction of the width as on the
    // rim
    let patch_edge =
        |radius_m: f64| settings.electrode_edge_m.unwrap_or(radius_m / 3.0).min(edge_m);
    let patch_edges_m: Vec<f64> = discs.iter().map(|disc| patch_edge(disc.radius_m)).collect();
    let pierced = outline.pierced(&discs);
    let (mut rim, field) = rim::cut(&pierced, &intervals, settings, edge_m, &patch_edges_m)?;
    patch::widen(&mut rim, &discs);
    let filled = interior::fill(&rim, &field, settings.node_limit)?;
    let mut skin = smooth::smooth(filled, rim.points.len(), &field, settings.smoothing_rounds);
    let patches = patch::join(&mut skin, &rim, &discs, &field, settings)?;
    let nodes = skin.points.iter().map(|&p| on_shape(shape, p)).collect();
    let surface = Surface::new(nodes, skin.triangles)?;
    let mut placed: Vec<(usize, Electrode)> = Vec::new();
    placed.extend(
        electrodes.rim.iter().map(|e| e.0).zip(rim.electrodes.into_iter().map(Electrode::Rim)),
    );
    placed.extend(
        electrodes.patches.iter().map(|e| e.0).zip(patches.into_iter().map(Electrode::Patch)),
    );
    placed.sort_by_key(|(index, _)| *index);
    let mesh = Mesh::new(surface, placed.into_iter().map(|(_, electrode)| electrode).collect())?;
    event!(
        DEBUG,
        "meshed the skin",
        nodes = mesh.surface().nodes().len(),
        triangles = mesh.surface().triangles().len(),
        electrodes = mesh.electrodes().len(),
        edge_m = edge_m,
    );
    match *shape {
        SkinShape::Hemisphere { radius_m } => mesh.with_midpoints(|_, p| onto_sphere(p, radius_m)),
        _ => Ok(mesh.with_arcs(&rim.arc_midpoints)),
    }
}

/// Projects a point onto the sphere around the origin; points on the equator stay on it.
fn onto_sphere(point: [f64; 3], radius_m: f64) -> [f64; 3] {
    let scale = radius_m / norm(point);
    point.map(|x| scale * x)
}

/// Maps a point inside the outline to the skin.
fn on_shape(shape: &SkinShape, [x, y]: [f64; 2]) -> [f64; 3] {
    match *shape {
        SkinShape::Hemisphere { radius_m } => {
            let square = (x * x + y * y) / (radius_m * radius_m);
            let factor = 2.0 / (1.0 + square);
            // rim nodes get a height of exactly 0, without the rounding error of their coordinates
            let height = (1.0 - square) * (0.5 * factor);
            let height = if height.abs() < 1e-14 { 0.0 } else { height };
            [factor * x, factor * y, radius_m * height]
        }
        _ => [x, y, 0.0],
    }
}
