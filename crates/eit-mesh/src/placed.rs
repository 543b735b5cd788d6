//! Places electrodes on any surface, by position: on its rim with a width, inside it with a radius.
//!
//! Steps: positions are projected to the surface; electrode ends become rim nodes ([`rim`]);
//! triangles near electrodes are bisected until they follow the size field ([`refine`]); triangles
//! are cut along the outlines of patches ([`patch`]). The surface keeps its shape, because every
//! new node lies on an existing edge.

mod electrode;
mod patch;
mod refine;
mod rim;

use crate::geometry::RESOLUTION;
use crate::rim_electrodes::{RimInterval, SMALLEST, check_gaps};
use crate::{Electrode, Mesh, MeshError, MeshSettings, Surface};
use eit_core::vector::{norm, sub};
pub use electrode::{Contact, PlacedElectrode};
use patch::Ball;
use refine::refine;
use rim::Rims;

/// Positions further from the surface than this fraction of its longest side are rejected. It
/// allows for measurement error and for facets that cut across a curved link.
const OFF_SURFACE: f64 = 1e-2;

/// Places electrodes on a surface, by position.
///
/// A rim electrode covers `width_m` of rim, half on each side of the rim point nearest to its
/// position. Its ends become nodes; a rim node within 1e-4 of an edge length of an end is used
/// instead. A patch covers the triangles inside the sphere of `radius_m` around the nearest point
/// of the surface, which are cut along the sphere. The cut consists of chords of at most a third of
/// the radius, so the area falls short of the disc's by about one percent, and the deficit
/// decreases with the square of [`MeshSettings::electrode_edge_m`]. [`Mesh::electrode_measure`]
/// returns the actual area.
///
/// The settings `electrode_edge_m`, `grading` and `node_limit` mean the same as for
/// [`generate`](crate::generate); `edge_m`, if given, is the longest edge allowed anywhere. Edges
/// that are too long are bisected; nothing is coarsened and no node moves, so triangles are about
/// as good as those of the surface.
///
/// # Errors
/// [`MeshError::ElectrodeSize`], [`MeshError::OffSurface`], [`MeshError::NoRim`],
/// [`MeshError::OverlappingElectrodes`], [`MeshError::TouchingElectrodes`] or
/// [`MeshError::OutOfRange`] before any meshing; [`MeshError::BadPatch`] for a patch that extends
/// beyond the rim, [`MeshError::OverlappingPatches`], [`MeshError::RefinementIncomplete`].
///
/// # Example
/// ```
/// use eit_mesh::{MeshSettings, PlacedElectrode, Surface, place_electrodes};
///
/// let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, 0.5]];
/// let roof = Surface::new(corners, vec![[0, 1, 2], [0, 2, 3]])?;
/// let electrodes = [
///     PlacedElectrode::rim([0.5, 0.0, 0.0], 0.2),
///     PlacedElectrode::patch([0.5, 0.5, 0.25], 0.1),
/// ];
/// let mesh = place_electrodes(&roof, &electrodes, &MeshSettings::default())?;
/// let length_m = mesh.electrode_measure(0).unwrap_or(0.0);
/// assert!((length_m - 0.2).abs() < 1e-12);
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
pub fn place_electrodes(
    surface: &Surface,
    electrodes: &[PlacedElectrode],
    settings: &MeshSettings,
) -> Result<Mesh, MeshError> {
    settings.validate()?;
    let size_m = crate::repair::size_m(surface.nodes());
    let resolution_m = RESOLUTION * size_m;
    for (index, electrode) in electrodes.iter().enumerate() {
        electrode.check(index + 1, SMALLEST * resolution_m)?;
    }
    let mut skin =
        Skin { nodes: surface.nodes().to_vec(), triangles: surface.triangles().to_vec() };
    let rims = Rims::new(&skin);
    let tolerance_m = OFF_SURFACE * size_m;
    let intervals = intervals(&rims, &skin, electrodes, tolerance_m, resolution_m)?;
    let balls = balls(surface, electrodes, tolerance_m)?;
    let ends_m = rim::insert_ends(&mut skin, &rims, &intervals);
    let field = Field::new(electrodes, &ends_m, &balls, settings, resolution_m)?;
    refine(&mut skin, |at| field.at(at), settings.node_limit)?;
    balls.iter().for_each(|ball| ball.cut(&mut skin));
    let rims = Rims::new(&skin);
    let edges = rims.edges_of(&skin, &intervals);
    let patches = patch::triangles_of(&skin, &balls)?;
    let surface = Surface::new(skin.nodes, skin.triangles)?;
    let mut covered: Vec<Option<Electrode>> = vec![None; electrodes.len()];
    for (interval, edges) in intervals.iter().zip(edges) {
        covered[interval.electrode] = Some(Electrode::Rim(edges));
    }
    for (ball, triangles) in balls.iter().zip(patches) {
        covered[ball.electrode] = Some(Electrode::Patch(triangles));
    }
    Mesh::new(surface, covered.into_iter().flatten().collect())
}

/// Nodes and triangles during refinement: consistently oriented, otherwise unchecked.
struct Skin {
    nodes: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Skin {
    fn at(&self, node: u32) -> [f64; 3] {
        self.nodes[node as usize]
    }

    fn length(&self, [a, b]: [u32; 2]) -> f64 {
        norm(sub(self.at(b), self.at(a)))
    }

    fn push(&mut self, position: [f64; 3]) -> u32 {
        self.nodes.push(position);
        // the node limit and the input's own count keep this in range; `Surface` checks it again
        (self.nodes.len() - 1) as u32
    }
}

/// Interpolates between two points.
fn between(a: [f64; 3], b: [f64; 3], t: f64) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
}

/// The part of the rim covered by an electrode.
struct Covered {
    /// Index of the electrode.
    electrode: usize,
    interval: RimInterval,
}

/// Returns the validated rim interval of each rim electrode.
fn intervals(
    rims: &Rims,
    skin: &Skin,
    electrodes: &[PlacedElectrode],
    tolerance_m: f64,
    resolution_m: f64,
) -> Result<Vec<Covered>, MeshError> {
    let mut covered = Vec::new();
    let mut centres = Vec::new();
    for (index, placed) in electrodes.iter().enumerate() {
        let Contact::Rim { width_m } = placed.contact else { continue };
        let electrode = index + 1;
        let (loop_index, centre_m, distance_m) =
            rims.nearest(skin, placed.position_m).ok_or(MeshError::NoRim { electrode })?;
        placed.check_distance(electrode, distance_m, tolerance_m, "point of its rim")?;
        let length_m = rims.length_m(loop_index);
        let interval =
            placed.interval(electrode, (loop_index, centre_m), length_m, resolution_m)?;
        covered.push(Covered { electrode: index, interval });
        centres.push((electrode, loop_index, centre_m, width_m));
    }
    if let (Some(node), false) = (rims.pinched(), covered.is_empty()) {
        return Err(MeshError::PinchedRim { node: node as usize, position_m: skin.at(node) });
    }
    check_gaps(&centres, |l| rims.length_m(l), resolution_m)?;
    Ok(covered)
}

/// Returns the sphere of each patch.
fn balls(
    surface: &Surface,
    electrodes: &[PlacedElectrode],
    tolerance_m: f64,
) -> Result<Vec<Ball>, MeshError> {
    let mut balls = Vec::new();
    for (electrode, placed) in electrodes.iter().enumerate() {
        let Contact::Patch { radius_m } = placed.contact else { continue };
        let (centre, distance_m) = patch::nearest(surface, placed.position_m);
        placed.check_distance(electrode + 1, distance_m, tolerance_m, "point of the skin")?;
        balls.push(Ball { electrode, centre, radius: radius_m });
    }
    Ok(balls)
}

/// Requested edge length, as in [`crate::size_field`] but in space and with spheres as sources.
struct Field {
    edge_m: f64,
    grading: f64,
    /// Centre, radius (0: a point) and requested edge length of each source.
    sources: Vec<([f64; 3], f64, f64)>,
}

impl Field {
    fn new(
        electrodes: &[PlacedElectrode],
        ends_m: &[[[f64; 3]; 2]],
        balls: &[Ball],
        settings: &MeshSettings,
        resolution_m: f64,
    ) -> Result<Self, MeshError> {
        let must = "at least 1e-9 of the skin's size (shorter edges are lost in rounding)";
        settings.check_edges(resolution_m, must)?;
        let edge_m = settings.edge_m.unwrap_or(f64::INFINITY);
        let size = |e: &PlacedElectrode| {
            settings.electrode_edge_m.unwrap_or(e.width_m() / 6.0).min(edge_m)
        };
        let rim = |e: &&PlacedElectrode| matches!(e.contact, Contact::Rim { .. });
        let mut sources = Vec::new();
        for (electrode, ends) in electrodes.iter().filter(rim).zip(ends_m) {
            sources.extend(ends.iter().map(|&end| (end, 0.0, size(electrode))));
        }
        for ball in balls {
            // edges inside a patch are as short as on its outline: longer ones would reach across
            // it
            let electrode = &electrodes[ball.electrode];
            let wanted = size(electrode).min(0.5 * ball.radius);
            sources.push((ball.centre, ball.radius, wanted));
        }
        Ok(Self { edge_m, grading: settings.grading, sources })
    }

    fn at(&self, position: [f64; 3]) -> f64 {
        let from = |&(centre, radius, size): &([f64; 3], f64, f64)| {
            size + self.grading * (norm(sub(position, centre)) - radius).max(0.0)
        };
        self.sources.iter().map(from).fold(self.edge_m, f64::min)
    }
}
