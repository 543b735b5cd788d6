//! Directions in which electrodes may move, and the derivatives of the voltages along them.

use crate::error::SkinError;
use crate::progress::Progress;
use crate::skin::Skin;
use eit_core::vector::{self, cross, unit};
use eit_fem::{Displacement, ElectrodeMotion};
use eit_mesh::{Electrode, Mesh, Surface};
use ndarray::Array2;

/// Derivatives of the background's voltages with respect to electrode displacements, [measurement,
/// displacement], volt per metre.
pub(crate) fn jacobian(
    background: &[f64],
    skin: &Skin,
    progress: &mut Progress,
) -> Result<Array2<f64>, SkinError> {
    progress.stage("electrode movement", || {
        let displacements = displacements(&skin.mesh)?;
        let mut workspace = skin.model.workspace()?;
        let mut solution = skin.solve(background, &mut workspace)?;
        Ok(solution.movement_jacobian(&displacements)?)
    })
}

/// Where each displacement of [`jacobian`] moves an electrode: its position, metres, and a unit vector.
pub(crate) fn directions(mesh: &Mesh) -> Result<Vec<[[f64; 3]; 2]>, SkinError> {
    let nodes_m = mesh.surface().nodes();
    let of = |displacement: &Displacement| {
        let (mut at_m, mut along, mut whole) = ([0.0; 3], [0.0; 3], 0.0);
        for &(node, vector) in displacement.nodes() {
            let weight = vector.iter().map(|v| v * v).sum::<f64>().sqrt();
            whole += weight;
            for k in 0..3 {
                at_m[k] += weight * nodes_m[node as usize][k];
                along[k] += vector[k];
            }
        }
        let length = along.iter().map(|a| a * a).sum::<f64>().sqrt();
        [at_m.map(|a| a / whole), along.map(|a| a / length)]
    };
    Ok(displacements(mesh)?.iter().map(of).collect())
}

/// Two displacements per electrode: along the rim and outward with the skin, or, for a patch, two along the
/// skin.
fn displacements(mesh: &Mesh) -> Result<Vec<Displacement>, SkinError> {
    let rim = [ElectrodeMotion::CarriedAlong, ElectrodeMotion::CarriedOutward];
    let patches = mesh.electrodes().iter().filter(|e| matches!(e, Electrode::Patch(_))).count();
    if patches == 0 {
        let [along, outward] = rim.map(|motion| motion.displacements(mesh));
        return Ok([along?, outward?].concat());
    }
    let mut found = Vec::with_capacity(2 * mesh.electrodes().len());
    for (l, electrode) in mesh.electrodes().iter().enumerate() {
        let motions = match electrode {
            Electrode::Rim(_) => rim,
            Electrode::Patch(triangles) => {
                tangents(mesh.surface(), triangles).map(ElectrodeMotion::Carried)
            }
        };
        for motion in motions {
            found.push(motion.displacement(mesh, l)?);
        }
    }
    Ok(found)
}

/// Two unit vectors along the skin under a patch, perpendicular to each other and to its mean normal.
fn tangents(surface: &Surface, triangles: &[u32]) -> [[f64; 3]; 2] {
    let mut normal = [0.0; 3];
    for &triangle in triangles {
        let twice_area = vector::normal(surface.corners(triangle as usize));
        (0..3).for_each(|k| normal[k] += twice_area[k]);
    }
    let normal = unit(normal);
    // the coordinate axis least aligned with the normal, projected onto the tangent plane
    let least = (0..3).min_by(|&i, &k| normal[i].abs().total_cmp(&normal[k].abs())).unwrap_or(0);
    let across = normal[least];
    let mut axis = normal.map(|n| -across * n);
    axis[least] += 1.0;
    let first = unit(axis);
    [first, cross(normal, first)]
}
