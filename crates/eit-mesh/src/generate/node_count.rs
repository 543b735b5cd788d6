//! Finds the edge length that gives a requested number of nodes.

use super::{generate, generate_placed};
use crate::settings::{MeshSettings, NODES_PER_SQUARE_EDGE, stretch};
use crate::{Mesh, MeshError, PlacedElectrode, RimElectrodes, SkinShape};

impl MeshSettings {
    /// Returns these settings with the interior edge length that gives about `nodes` nodes: within
    /// 2 %, or within 10 % if the mesh is too coarse to match the number. The length is found by
    /// meshing a few times without smoothing.
    ///
    /// # Errors
    /// As [`generate`], and [`MeshError::OutOfRange`] if electrode ends and corners alone need more
    /// nodes than that.
    pub fn for_nodes(
        &self,
        shape: &SkinShape,
        electrodes: &RimElectrodes,
        nodes: usize,
    ) -> Result<Self, MeshError> {
        self.for_about(shape, nodes, |trial| generate(shape, electrodes, trial))
    }

    /// Does the same as [`for_nodes`](Self::for_nodes) for electrodes given by position.
    ///
    /// # Errors
    /// As [`generate_placed`], and [`MeshError::OutOfRange`] as in [`for_nodes`](Self::for_nodes).
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
        let (quantity, value) = ("number of nodes", nodes as f64);
        MeshError::check_range(nodes >= 3, quantity, value, "at least 3")?;
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
        let must = "enough for the electrode ends and corners (raise electrode_edge_m or grading, or \
                    ask for more)";
        MeshError::check_range(best.0 <= 0.1, quantity, value, must)?;
        Ok(Self { edge_m: Some(best.1), ..self.clone() })
    }
}
