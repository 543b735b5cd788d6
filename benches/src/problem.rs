//! The timed problems: a unit disc with 16 electrodes, each covering half of its sixteenth of the
//! rim; adjacent drive and measurement without driven electrodes (208 values); 1 A.

use crate::Result;
use eit_fem::{ForwardModel, PairProtocol};
use eit_mesh::{Electrode, Mesh, MeshSettings, RimElectrodes, SkinShape, Surface};

/// Number of electrodes on the disc.
pub const ELECTRODES: usize = 16;

/// Contact impedance, ohm metres: 0.01 of sheet resistance times radius, as used by the peers.
pub const CONTACT_IMPEDANCE: f64 = 0.01;

/// Returns the peers' mesh with about `target` nodes (500, 2000, 5000 or 20000).
///
/// Prints a `skipped:` line and returns `None` if the peers' folder is missing.
///
/// # Errors
/// A file that exists but cannot be used.
pub fn peers_mesh(target: usize) -> Result<Option<Mesh>> {
    let Some(arrays) = fixtures::disc_mesh(target)? else { return Ok(None) };
    let nodes = arrays.nodes.rows().into_iter().map(|r| [r[0], r[1], 0.0]).collect();
    let surface = Surface::new(nodes, arrays.triangles.clone())?;
    let electrodes = arrays.edges_per_electrode().into_iter().map(Electrode::Rim).collect();
    Ok(Some(Mesh::new(surface, electrodes)?))
}

/// The same disc for our own mesh generator.
pub fn disc() -> (SkinShape, RimElectrodes) {
    let width_m = std::f64::consts::PI / ELECTRODES as f64;
    (SkinShape::Disc { radius_m: 1.0 }, RimElectrodes::equally_spaced(ELECTRODES, width_m))
}

/// Returns settings that give about `nodes` nodes on [`disc`].
///
/// # Errors
/// As `MeshSettings::for_nodes`.
pub fn mesh_settings(nodes: usize) -> Result<MeshSettings> {
    let (shape, electrodes) = disc();
    Ok(MeshSettings::default().for_nodes(&shape, &electrodes, nodes)?)
}

/// Returns the model of a mesh of this disc.
///
/// # Errors
/// As `ForwardModel::new`.
pub fn model(mesh: &Mesh) -> Result<ForwardModel> {
    let protocol = PairProtocol { current_a: 1.0, ..PairProtocol::default() }.protocol()?;
    Ok(ForwardModel::new(mesh, &protocol, &[CONTACT_IMPEDANCE; ELECTRODES])?)
}

/// Pseudo-random conductivities between 1 and 1.1 S that any language can reproduce exactly:
/// `1 + 0.1 (2654435761 e mod 2^32) / 2^32` for element `e` (Knuth's multiplicative hash).
pub fn conductivity(elements: usize) -> Vec<f64> {
    let hash = |e: usize| (e as u32).wrapping_mul(2_654_435_761);
    (0..elements).map(|e| 1.0 + 0.1 * (f64::from(hash(e)) / 4_294_967_296.0)).collect()
}

/// Adjacent drive on all electrodes, without the grounded last one: for each electrode its currents
/// under `ELECTRODES - 1` patterns, amperes.
pub fn currents() -> impl Iterator<Item = [f64; ELECTRODES - 1]> {
    (0..ELECTRODES - 1).map(|electrode| {
        std::array::from_fn(|pattern| match electrode.checked_sub(pattern) {
            Some(0) => 1.0,
            Some(1) => -1.0,
            _ => 0.0,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conductivities_are_those_of_the_script() {
        // compare.py: 1 + 0.1 * ((e * 2654435761) % 2**32) / 2**32
        let sigma = conductivity(3);
        assert_eq!(sigma[0], 1.0);
        assert_eq!(sigma[2], 1.0 + 0.1 * (1_013_904_226.0 / 4_294_967_296.0));
    }

    #[test]
    fn a_generated_disc_has_about_the_nodes_asked_for() {
        let (shape, electrodes) = disc();
        let mesh = eit_mesh::generate(&shape, &electrodes, &mesh_settings(2000).unwrap()).unwrap();
        // 10 %: guaranteed by `for_nodes`
        let nodes = mesh.surface().nodes().len();
        assert!((1800..=2200).contains(&nodes), "{nodes}");
        assert_eq!(model(&mesh).unwrap().protocol().measurements(), 208);
    }
}
