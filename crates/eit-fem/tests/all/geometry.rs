//! A solve on moved nodes and changed contacts equals that of a model built on the moved mesh.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{noise, ring_disc};
use eit_fem::{FemError, ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Electrode, Mesh, Surface};

fn protocol(electrodes: usize) -> Protocol {
    PairProtocol { electrodes, ..Default::default() }.protocol().unwrap()
}

/// A disc with 12 rim electrodes, or with a patch in place of the last.
fn mesh(patch: bool) -> Mesh {
    let mesh = ring_disc(8);
    let mut electrodes = mesh.electrodes().to_vec();
    if patch {
        electrodes[11] = Electrode::Patch(vec![0, 1, 2, 3]);
    }
    Mesh::new(mesh.surface().clone(), electrodes).unwrap()
}

/// Nodes moved by up to `size` in all three directions.
fn moved(mesh: &Mesh, size: f64) -> Vec<[f64; 3]> {
    let nodes = mesh.surface().nodes();
    let shifts = noise(7, 3 * nodes.len());
    let shift = |n: usize, k: usize| size * (2.0 * shifts[3 * n + k] - 1.0);
    (0..nodes.len()).map(|n| std::array::from_fn(|k| nodes[n][k] + shift(n, k))).collect()
}

/// Voltages, Jacobian and fields are bit-identical to those of the new model: both perform the same
/// operations in the same order, because the ordering depends only on the triangles.
#[test]
fn a_deformed_solve_is_that_of_a_fresh_model_on_the_moved_mesh() {
    for patch in [false, true] {
        let mesh = mesh(patch);
        let model = ForwardModel::new(&mesh, &protocol(12), &[0.05; 12]).unwrap();
        let nodes = moved(&mesh, 0.02);
        let impedance: Vec<f64> = noise(3, 12).iter().map(|x| 0.02 + x).collect();
        let sigma: Vec<f64> = noise(5, model.elements()).iter().map(|x| 0.5 + x).collect();

        let surface = Surface::new(nodes.clone(), mesh.surface().triangles().to_vec()).unwrap();
        let there = Mesh::new(surface, mesh.electrodes().to_vec()).unwrap();
        let fresh = ForwardModel::new(&there, &protocol(12), &impedance).unwrap();

        let mut geometry = model.geometry();
        model.deform(&nodes, &impedance, &mut geometry).unwrap();
        let mut workspace = model.workspace().unwrap();
        let mut solution = model.solve_deformed(&geometry, &sigma, &mut workspace).unwrap();
        let mut other = fresh.workspace().unwrap();
        let mut wanted = fresh.solve(&sigma, &mut other).unwrap();
        assert_eq!(solution.measurements(), wanted.measurements(), "patch {patch}");
        assert_eq!(solution.jacobian(), wanted.jacobian());
        assert_eq!(solution.node_potentials(), wanted.node_potentials());
        assert!(solution.report().backward_error < 1e-13, "rounding of one solve");
        // the effect is not negligible: moving nodes by 2 % of the radius changes voltages by some
        // per cent
        let still = model.forward(&sigma).unwrap();
        let change = (&solution.measurements() - &still).mapv(f64::abs).sum();
        assert!(change > 1e-2 * still.mapv(f64::abs).sum());
    }
}

/// Without movement the results are bit-identical, and the model itself never changes.
#[test]
fn the_own_geometry_changes_nothing() {
    let mesh = mesh(false);
    let model = ForwardModel::new(&mesh, &protocol(12), &[0.05; 12]).unwrap();
    let sigma = vec![1.0; model.elements()];
    let before = model.forward(&sigma).unwrap();
    let mut geometry = model.geometry();
    model.deform(&moved(&mesh, 0.02), &[0.1; 12], &mut geometry).unwrap();
    model.deform(mesh.surface().nodes(), &[0.05; 12], &mut geometry).unwrap();
    assert_eq!(geometry, model.geometry());
    let mut workspace = model.workspace().unwrap();
    let after = model.solve_deformed(&geometry, &sigma, &mut workspace).unwrap().measurements();
    assert_eq!(before, after);
    assert_eq!(before, model.forward(&sigma).unwrap());
}

/// Rigid motion and scaling: rotation changes nothing; a sheet scaled by t keeps its resistances if
/// contact impedances in ohm metre are scaled by t.
#[test]
fn turning_and_blowing_up() {
    let mesh = mesh(false);
    let model = ForwardModel::new(&mesh, &protocol(12), &[0.05; 12]).unwrap();
    let sigma = vec![1.0; model.elements()];
    let still = model.forward(&sigma).unwrap();
    let (sin, cos) = 0.7_f64.sin_cos();
    let nodes: Vec<[f64; 3]> = mesh
        .surface()
        .nodes()
        .iter()
        .map(|p| [3.0 * p[0], 3.0 * (cos * p[1] - sin * p[2]), 3.0 * (sin * p[1] + cos * p[2])])
        .collect();
    let mut geometry = model.geometry();
    model.deform(&nodes, &[0.15; 12], &mut geometry).unwrap();
    let mut workspace = model.workspace().unwrap();
    let turned = model.solve_deformed(&geometry, &sigma, &mut workspace).unwrap().measurements();
    let largest = still.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    // rounding of positions, amplified by the condition number of about 1e4
    assert!((&turned - &still).iter().all(|d| d.abs() < 1e-11 * largest));
}

#[test]
fn what_cannot_be_is_refused() {
    let mesh = mesh(false);
    let model = ForwardModel::new(&mesh, &protocol(12), &[0.05; 12]).unwrap();
    let nodes = mesh.surface().nodes().to_vec();
    let mut geometry = model.geometry();
    let mut says = |nodes: &[[f64; 3]], impedance: &[f64], wanted: &str| {
        let message = model.deform(nodes, impedance, &mut geometry).unwrap_err().to_string();
        assert!(message.contains(wanted), "{message}");
    };
    says(&nodes[1..], &[0.05; 12], "node positions (one per node): 216 values given, 217 needed");
    says(&nodes, &[0.05; 11], "contact impedance");
    let mut impedance = [0.05; 12];
    impedance[4] = f64::NAN;
    says(&nodes, &impedance, "electrode 5 is NaN");
    let mut broken = nodes.clone();
    broken[9][1] = f64::INFINITY;
    says(&broken, &[0.05; 12], "node 9 is moved to");
    let mut flat = nodes.clone();
    let [a, b, _] = mesh.surface().triangles()[20].map(|n| n as usize);
    flat[a] = flat[b];
    says(&flat, &[0.05; 12], "has the area 0e0 m^2");

    let other = ForwardModel::new(&ring_disc(4), &protocol(12), &[0.05; 12]).unwrap();
    let sigma = vec![1.0; model.elements()];
    let mut workspace = model.workspace().unwrap();
    let foreign = other.geometry();
    let error = model.solve_deformed(&foreign, &sigma, &mut workspace).unwrap_err();
    assert!(matches!(error, FemError::WrongLength { .. }), "{error}");
}
