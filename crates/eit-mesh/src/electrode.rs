//! Electrodes on a surface, and the mesh that combines the two.

use crate::surface::{middle, sides, sorted};
use crate::{MeshError, Surface};
use eit_core::vector::{norm, sub};
use std::collections::HashMap;

/// The part of the skin that an electrode covers.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Electrode {
    /// Rim edges as node pairs. Contact impedance in ohm metres.
    Rim(Vec<[u32; 2]>),
    /// Triangles of the surface. Contact impedance in ohm square metres.
    Patch(Vec<u32>),
}

/// A skin: a surface and the electrodes on it, in order of electrode number.
///
/// Always valid: every rim electrode lies on the rim, every patch consists of existing triangles,
/// and no edge or triangle belongs to two electrodes. Electrodes may share a node.
///
/// ```
/// use eit_mesh::{Electrode, Mesh, Surface};
///
/// // a square of two triangles; its left side is an electrode
/// let nodes_m = vec![[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.1, 0.0]];
/// let surface = Surface::new(nodes_m, vec![[0, 1, 2], [0, 2, 3]])?;
/// let mesh = Mesh::new(surface, vec![Electrode::Rim(vec![[3, 0]])])?;
/// assert_eq!(mesh.electrode_measure(0), Some(0.1));
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "crate::serialised::MeshParts", into = "crate::serialised::MeshParts")
)]
pub struct Mesh {
    surface: Surface,
    electrodes: Vec<Electrode>,
    /// Edges known to be curved (smaller node first, in ascending order), with the midpoint of each
    /// curve.
    midpoints_m: Vec<([u32; 2], [f64; 3])>,
}

impl Mesh {
    /// Adds electrodes to a surface. The triangles of each patch are sorted in ascending order.
    ///
    /// # Errors
    /// [`MeshError::EmptyElectrode`], [`MeshError::NotOnRim`], [`MeshError::UnknownTriangle`] or
    /// [`MeshError::OverlappingElements`].
    pub fn new(surface: Surface, mut electrodes: Vec<Electrode>) -> Result<Self, MeshError> {
        let mut rim: HashMap<[u32; 2], usize> =
            surface.rim_edges().iter().map(|e| (sorted(*e), 0)).collect();
        let mut patch = vec![0; surface.triangles().len()];
        for (index, electrode) in electrodes.iter().enumerate() {
            let electrode_number = index + 1;
            match electrode {
                Electrode::Rim(edges) => claim_edges(&mut rim, electrode_number, edges)
                    .map_err(|error| at_place(error, &surface))?,
                Electrode::Patch(triangles) => {
                    claim_triangles(&mut patch, electrode_number, triangles)?;
                }
            }
        }
        for electrode in &mut electrodes {
            if let Electrode::Patch(triangles) = electrode {
                triangles.sort_unstable();
            }
        }
        Ok(Self { surface, electrodes, midpoints_m: Vec::new() })
    }

    /// Returns the triangle mesh without its electrodes.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Returns the electrodes, starting with electrode 1.
    pub fn electrodes(&self) -> &[Electrode] {
        &self.electrodes
    }

    /// Sets the midpoints of curved edges, for curved elements.
    ///
    /// `middle` receives the nodes and the straight midpoint (metres) of every edge, smaller node
    /// first and in ascending order. It returns the midpoint of the curve that the edge
    /// approximates, for example the nearest point of a sphere. Edges whose midpoint is returned
    /// unchanged are straight. Triangles, areas and electrode measures remain those of the straight
    /// edges. [`generate`] does this for the arcs of its outlines.
    ///
    /// # Errors
    /// [`MeshError::BadMidpoint`] if a midpoint is not finite or is farther from the straight one
    /// than half the edge length (a semicircle).
    ///
    /// [`generate`]: crate::generate
    pub fn with_midpoints(
        mut self,
        mut middle: impl FnMut([u32; 2], [f64; 3]) -> [f64; 3],
    ) -> Result<Self, MeshError> {
        let mut edges: Vec<[u32; 2]> =
            self.surface.triangles().iter().flat_map(|t| sides(*t)).collect();
        edges.sort_unstable();
        edges.dedup();
        let mut midpoints_m = Vec::new();
        for edge in edges {
            let straight = self.straight_middle(edge);
            let position_m = middle(edge, straight);
            if position_m != straight {
                self.check_midpoint(edge, position_m)?;
                midpoints_m.push((edge, position_m));
            }
        }
        self.midpoints_m = midpoints_m;
        Ok(self)
    }

    /// Returns the midpoint of the curve that an edge approximates, metres, or `None` if the edge
    /// is straight or no midpoint was set.
    pub fn midpoint_m(&self, edge: [u32; 2]) -> Option<[f64; 3]> {
        let place = self.midpoints_m.binary_search_by_key(&sorted(edge), |(edge, _)| *edge).ok()?;
        Some(self.midpoints_m[place].1)
    }

    /// Curved edges (smaller node first, in ascending order) and their midpoints, metres.
    #[cfg(feature = "serde")]
    pub(crate) fn midpoints_m(&self) -> &[([u32; 2], [f64; 3])] {
        &self.midpoints_m
    }

    /// Does the same as [`Mesh::with_midpoints`] for the edges that the generator cut from arcs.
    pub(crate) fn with_arcs(mut self, midpoints: &[([u32; 2], [f64; 2])]) -> Self {
        let flat = |&(edge, [x, y]): &([u32; 2], [f64; 2])| (sorted(edge), [x, y, 0.0]);
        self.midpoints_m = midpoints.iter().map(flat).collect();
        self.midpoints_m.sort_unstable_by_key(|(edge, _)| *edge);
        self
    }

    fn straight_middle(&self, edge: [u32; 2]) -> [f64; 3] {
        middle(&edge.map(|n| self.surface.nodes()[n as usize]))
    }

    fn check_midpoint(&self, edge: [u32; 2], position_m: [f64; 3]) -> Result<(), MeshError> {
        let [a, b] = edge.map(|n| self.surface.nodes()[n as usize]);
        // NaN fails this comparison
        if norm(sub(position_m, self.straight_middle(edge))) <= 0.5 * norm(sub(b, a)) {
            return Ok(());
        }
        Err(MeshError::BadMidpoint { edge, position_m })
    }

    /// Returns the length in metres (rim) or area in square metres (patch) of an electrode (index
    /// from 0), by which the contact impedance is divided. `None` if the electrode does not exist.
    pub fn electrode_measure(&self, electrode: usize) -> Option<f64> {
        Some(self.parts(electrode)?.iter().map(|(measure, _)| measure).sum())
    }

    /// Returns the centroid of an electrode (index from 0), weighted by length or area, metres.
    /// `None` if the electrode does not exist.
    pub fn electrode_centre_m(&self, electrode: usize) -> Option<[f64; 3]> {
        let parts = self.parts(electrode)?;
        let total: f64 = parts.iter().map(|(measure, _)| measure).sum();
        let moment =
            |k: usize| parts.iter().map(|(measure, centre)| measure * centre[k]).sum::<f64>();
        Some([moment(0) / total, moment(1) / total, moment(2) / total])
    }

    /// Returns the length or area and the centre of each edge or triangle of an electrode, whose
    /// indices [`Mesh::new`] has checked.
    fn parts(&self, electrode: usize) -> Option<Vec<(f64, [f64; 3])>> {
        let surface = &self.surface;
        let edge = |e: &[u32; 2]| {
            let [a, b] = e.map(|n| surface.nodes()[n as usize]);
            (norm(sub(b, a)), middle(&[a, b]))
        };
        let triangle =
            |&t: &u32| (surface.areas_m2()[t as usize], middle(&surface.corners(t as usize)));
        Some(match self.electrodes.get(electrode)? {
            Electrode::Rim(edges) => edges.iter().map(edge).collect(),
            Electrode::Patch(triangles) => triangles.iter().map(triangle).collect(),
        })
    }
}

/// Adds the position of an edge that is not on the rim, if its nodes exist.
fn at_place(error: MeshError, surface: &Surface) -> MeshError {
    match error {
        MeshError::NotOnRim { electrode, edge, .. } => {
            let at = |n: u32| surface.nodes().get(n as usize).copied().unwrap_or([f64::NAN; 3]);
            MeshError::NotOnRim { electrode, edge, position_m: middle(&edge.map(at)) }
        }
        other => other,
    }
}

fn claim_edges(
    rim: &mut HashMap<[u32; 2], usize>,
    electrode: usize,
    edges: &[[u32; 2]],
) -> Result<(), MeshError> {
    if edges.is_empty() {
        return Err(MeshError::EmptyElectrode { electrode });
    }
    for &edge in edges {
        let not_on_rim = MeshError::NotOnRim { electrode, edge, position_m: [f64::NAN; 3] };
        let owner = rim.get_mut(&sorted(edge)).ok_or(not_on_rim)?;
        if *owner != 0 {
            let place = format!("edge {edge:?}");
            return Err(MeshError::OverlappingElements { first: *owner, second: electrode, place });
        }
        *owner = electrode;
    }
    Ok(())
}

fn claim_triangles(
    owners: &mut [usize],
    electrode: usize,
    triangles: &[u32],
) -> Result<(), MeshError> {
    if triangles.is_empty() {
        return Err(MeshError::EmptyElectrode { electrode });
    }
    let count = owners.len();
    for &triangle in triangles {
        let owner = owners.get_mut(triangle as usize).ok_or(MeshError::UnknownTriangle {
            electrode,
            triangle,
            triangles: count,
        })?;
        if *owner != 0 {
            let place = format!("triangle {triangle}");
            return Err(MeshError::OverlappingElements { first: *owner, second: electrode, place });
        }
        *owner = electrode;
    }
    Ok(())
}
