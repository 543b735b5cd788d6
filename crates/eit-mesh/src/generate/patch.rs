//! Round patches of a flat skin: the skin is meshed with a hole for each patch, each hole is meshed
//! with the nodes on its outline, and the meshes are joined.

use super::interior::{Triangulation, fill};
use super::rim::Rim;
use crate::MeshError;
use crate::geometry::{Disc, cross};
use crate::settings::MeshSettings;
use crate::size_field::SizeField;
use crate::smooth;
use std::f64::consts::PI;

/// Moves the nodes on the outlines of patches outwards until each polygon has the area of its disc,
/// because the contact impedance is divided by the area. With edges of a third of the radius, the
/// nodes move by 0.9 %. The outline edges stay straight, even in quadratic elements.
pub(super) fn widen(rim: &mut Rim, discs: &[Disc]) {
    for (k, disc) in discs.iter().enumerate() {
        let nodes = loop_nodes(&rim.starts, discs.len(), k);
        rim.arc_midpoints.retain(|(edge, _)| !nodes.contains(&(edge[0] as usize)));
        let points = &mut rim.points[nodes];
        let from_centre = |p: [f64; 2]| [p[0] - disc.centre_m[0], p[1] - disc.centre_m[1]];
        let count = points.len();
        // holes run clockwise
        let twice_area: f64 = (0..count)
            .map(|i| cross(from_centre(points[(i + 1) % count]), from_centre(points[i])))
            .sum();
        let factor = (2.0 * PI * disc.radius_m * disc.radius_m / twice_area).sqrt();
        for p in points {
            let [x, y] = from_centre(*p);
            *p = [disc.centre_m[0] + factor * x, disc.centre_m[1] + factor * y];
        }
    }
}

/// Node indices of a patch outline; the last loops belong to the patches.
fn loop_nodes(starts: &[usize], patches: usize, patch: usize) -> std::ops::Range<usize> {
    let index = starts.len() - 1 - patches + patch;
    starts[index]..starts[index + 1]
}

/// Meshes the patches into their holes and returns the triangles of each patch.
pub(super) fn join(
    skin: &mut Triangulation,
    rim: &Rim,
    discs: &[Disc],
    field: &SizeField,
    settings: &MeshSettings,
) -> Result<Vec<Vec<u32>>, MeshError> {
    let mut patches = Vec::with_capacity(discs.len());
    for k in 0..discs.len() {
        // counter-clockwise, like the outline of a skin
        let outline: Vec<usize> = loop_nodes(&rim.starts, discs.len(), k).rev().collect();
        let count = outline.len();
        let edges = (0..count).map(|i| [i, (i + 1) % count].map(|n| n as u32)).collect();
        let points = outline.iter().map(|&n| rim.points[n]).collect();
        let own = Rim { points, edges, starts: vec![0, count], ..Rim::default() };
        let left = settings.node_limit.saturating_sub(skin.points.len()).saturating_add(count);
        let filled = fill(&own, field, left).map_err(|error| match error {
            MeshError::RefinementIncomplete { .. } => {
                let (nodes, limit) = (skin.points.len(), settings.node_limit);
                MeshError::RefinementIncomplete { nodes, limit }
            }
            other => other,
        })?;
        let patch = smooth::smooth(filled, count, field, settings.smoothing_rounds);
        let first_inner = skin.points.len();
        let number = |n: u32| match outline.get(n as usize) {
            Some(&on_outline) => on_outline as u32,
            None => (first_inner + n as usize - count) as u32,
        };
        let first = skin.triangles.len() as u32;
        skin.triangles.extend(patch.triangles.iter().map(|t| t.map(number)));
        skin.points.extend_from_slice(&patch.points[count..]);
        patches.push((first..skin.triangles.len() as u32).collect());
    }
    Ok(patches)
}
