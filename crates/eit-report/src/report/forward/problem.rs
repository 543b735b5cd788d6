//! The forward problem of a skin, on families of meshes and on reference meshes.
//!
//! Each mesh of a family is finer than the previous one by a factor of the square root of two.
//! *even*: the same edge length everywhere. *graded*: twice that length in the interior; at
//! electrode ends and re-entrant corners, initially a quarter of an electrode's width, decreasing
//! with the square of the edge length, so that the remaining singularity error there decreases like
//! the rest. On patch outlines, which have no singularity, it decreases with the edge length.

use super::super::cases::Case;
use crate::comparison::{Finger, SequenceSettings, TouchSequence};
use crate::error::ReportError;
use eit_fem::{ElementOrder, ForwardModel};
use eit_mesh::{Contact, Mesh, MeshSettings, SkinShape};
use eit_skin::scene::{ElectrodeSource, MeshSource, Scene};

/// How the meshes of a family are refined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MeshFamily {
    Even,
    Graded,
}

impl MeshFamily {
    pub(crate) const ALL: [Self; 2] = [Self::Even, Self::Graded];

    /// Name in tables and legends.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Even => "even",
            Self::Graded => "graded",
        }
    }
}

/// Edges of the coarsest even mesh along the side of the square that has the skin's area: about 500
/// nodes.
const EDGES_A_SIDE: f64 = 18.0;
/// The same for the reference mesh: without fingers, where only electrodes need fine elements, and
/// with conductivity that varies from element to element.
const REFERENCE_EDGES: [f64; 2] = [40.0, 240.0];
/// Edge of the reference mesh at electrode ends relative to the electrode's width. The remaining
/// error of a singularity like the square root of the distance is of this order.
const REFERENCE_END: f64 = 1e-5;
/// Edges along the radius of a patch on the reference mesh, whose patch outlines are polygons.
const REFERENCE_RADIUS: f64 = 60.0;
/// Growth of edges away from electrode ends on the reference mesh.
const REFERENCE_GRADING: f64 = 0.15;

/// A skin and the conductivity used for its forward problem.
pub(super) struct ForwardProblem {
    pub scene: Scene,
    /// Side of the square that has the skin's area (for a hemisphere, in its flat chart), metres.
    side_m: f64,
    /// Largest ratio of an edge in space to that in the chart.
    stretch: f64,
    /// Width of the narrowest electrode or diameter of the smallest patch, metres.
    electrode_m: f64,
    has_patches: bool,
    /// Stationary fingers.
    touch: Option<TouchSequence>,
}

impl ForwardProblem {
    pub(crate) fn new(case: &Case) -> Result<Self, ReportError> {
        let scene = Scene::load(&case.scene)?;
        let source = scene.mesh(None)?;
        let MeshSource::Generated { shape, electrodes, .. } = &source else {
            return Err(ReportError::input(format!(
                "{}: a mesh file provides only one mesh",
                case.scene
            )));
        };
        let (electrode_m, has_patches) = match electrodes {
            ElectrodeSource::Rim(rim) => (rim.width_m, false),
            ElectrodeSource::Placed(placed) => {
                placed.iter().fold((f64::INFINITY, false), |(least, has), e| match e.contact {
                    Contact::Rim { width_m } => (least.min(width_m), has),
                    Contact::Patch { radius_m } => (least.min(2.0 * radius_m), true),
                    _ => (least, has),
                })
            }
        };
        let touch = match case.forward_change() {
            Some(change) => {
                let finger = Finger { change, ..Default::default() };
                let settings =
                    SequenceSettings { touches: 2, frames: 1, finger, ..Default::default() };
                Some(TouchSequence::random(&source, &settings)?)
            }
            None => None,
        };
        Ok(Self {
            side_m: shape.outline()?.area_m2().sqrt(),
            stretch: if matches!(shape, SkinShape::Hemisphere { .. }) { 2.0 } else { 1.0 },
            scene,
            electrode_m,
            has_patches,
            touch,
        })
    }

    /// Whether the conductivity is uniform.
    pub(crate) fn is_even(&self) -> bool {
        self.touch.is_none()
    }

    /// Mesh settings of a step in a family; step 0 is the coarsest.
    pub(crate) fn settings(&self, family: MeshFamily, step: i32) -> MeshSettings {
        let scale = 0.5_f64.powf(0.5 * f64::from(step));
        let edge_m = scale * self.side_m / EDGES_A_SIDE;
        let (edge_m, end_m) = match family {
            MeshFamily::Even => (edge_m, edge_m),
            MeshFamily::Graded => {
                let end_scale = if self.has_patches { scale } else { scale * scale };
                (2.0 * edge_m, 0.25 * end_scale * self.electrode_m)
            }
        };
        self.with_edges(edge_m, end_m)
    }

    /// Mesh settings for edge lengths in the chart.
    fn with_edges(&self, edge_m: f64, end_m: f64) -> MeshSettings {
        MeshSettings {
            edge_m: Some(self.stretch * edge_m),
            electrode_edge_m: Some(end_m),
            ..Default::default()
        }
    }

    /// Meshes the skin with the given settings.
    pub(crate) fn mesh(&self, settings: &MeshSettings) -> Result<Mesh, ReportError> {
        let settings = settings.clone();
        let made = match self.scene.mesh(None)? {
            MeshSource::Generated { shape, electrodes, base, .. } => {
                MeshSource::Generated { shape, electrodes, settings, base }
            }
            file => file,
        };
        Ok(made.build()?.mesh)
    }

    /// Creates a reference mesh for quadratic elements. Smaller `scale` gives a finer mesh; 1 is
    /// the finest that is fast enough. The mesh is strongly refined towards electrode ends and
    /// re-entrant corners.
    pub(crate) fn reference_mesh(&self, scale: f64) -> Result<Mesh, ReportError> {
        let edges = REFERENCE_EDGES[usize::from(!self.is_even())];
        let end_m = match self.has_patches {
            true => 0.5 * self.electrode_m / REFERENCE_RADIUS,
            false => self.electrode_m * REFERENCE_END,
        };
        let settings = MeshSettings {
            grading: scale * REFERENCE_GRADING,
            ..self.with_edges(scale * self.side_m / edges, scale * end_m)
        };
        self.mesh(&settings)
    }

    /// Conductivity of each element, siemens; under fingers, that at its centroid.
    pub(crate) fn conductivity_s(&self, mesh: &Mesh) -> Vec<f64> {
        let centroids = mesh.surface().centroids();
        let background_s = self.scene.skin.conductivity_s;
        match &self.touch {
            Some(touch) => {
                touch.response.conductivity_s(background_s, &touch.script.touches(0), &centroids)
            }
            None => vec![background_s; centroids.len()],
        }
    }

    pub(crate) fn model(
        &self,
        mesh: &Mesh,
        elements: ElementOrder,
    ) -> Result<ForwardModel, ReportError> {
        let electrodes = mesh.electrodes().len();
        let protocol = self.scene.protocol(electrodes)?;
        let impedance = self.scene.contact_impedance(electrodes)?;
        Ok(ForwardModel::with_element_order(mesh, &protocol, &impedance, elements)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The families start with the same mesh size and become finer.
    #[test]
    fn families_become_finer() {
        for case in Case::built_in() {
            let problem = ForwardProblem::new(&case).unwrap();
            for family in MeshFamily::ALL {
                let nodes = [0, 2].map(|step| {
                    let mesh = problem.mesh(&problem.settings(family, step)).unwrap();
                    mesh.surface().nodes().len() as f64
                });
                assert!((300.0..2500.0).contains(&nodes[0]), "{}: {nodes:?}", case.scene);
                assert!((1.2..4.2).contains(&(nodes[1] / nodes[0])), "{}: {nodes:?}", case.scene);
            }
        }
    }
}
