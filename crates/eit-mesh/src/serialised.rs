//! Serialised forms of the types that are always valid: read through the constructors that check them.

use crate::{Electrode, Mesh, MeshError, Surface};
use std::collections::BTreeMap;

/// What a [`Surface`] is made from; areas and rim follow.
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SurfaceParts {
    nodes_m: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl From<Surface> for SurfaceParts {
    fn from(surface: Surface) -> Self {
        Self { nodes_m: surface.nodes().to_vec(), triangles: surface.triangles().to_vec() }
    }
}

impl TryFrom<SurfaceParts> for Surface {
    type Error = MeshError;

    fn try_from(parts: SurfaceParts) -> Result<Self, MeshError> {
        Self::new(parts.nodes_m, parts.triangles)
    }
}

/// What a [`Mesh`] is made from.
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MeshParts {
    surface: Surface,
    electrodes: Vec<Electrode>,
    /// Edges (smaller node first) and the midpoints of their curves; absent if all are straight.
    #[serde(default)]
    midpoints_m: Vec<([u32; 2], [f64; 3])>,
}

impl From<Mesh> for MeshParts {
    fn from(mesh: Mesh) -> Self {
        Self {
            surface: mesh.surface().clone(),
            electrodes: mesh.electrodes().to_vec(),
            midpoints_m: mesh.midpoints_m().to_vec(),
        }
    }
}

impl TryFrom<MeshParts> for Mesh {
    type Error = MeshError;

    fn try_from(parts: MeshParts) -> Result<Self, MeshError> {
        let mesh = Self::new(parts.surface, parts.electrodes)?;
        if parts.midpoints_m.is_empty() {
            return Ok(mesh);
        }
        let mut left: BTreeMap<[u32; 2], [f64; 3]> = parts.midpoints_m.into_iter().collect();
        let mesh = mesh.with_midpoints(|edge, straight| left.remove(&edge).unwrap_or(straight))?;
        match left.pop_first() {
            // an edge that the surface does not have
            Some((edge, position_m)) => Err(MeshError::BadMidpoint { edge, position_m }),
            None => Ok(mesh),
        }
    }
}
