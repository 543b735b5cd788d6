//! Curved skins and patch electrodes against closed forms.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

use crate::common::paper_voltages;
use eit_fem::{ForwardModel, PairProtocol, Protocol};
use eit_mesh::{
    Electrode, Mesh, MeshSettings, PlacedElectrode, RimElectrodes, SkinShape, generate,
    generate_placed, parse_stl, place_electrodes,
};
use ndarray::Array1;
use std::collections::HashMap;
use std::f64::consts::TAU;

const RADIUS_M: f64 = 0.1;
const WIDTH_M: f64 = 0.0196;
const CONDUCTIVITY_S: f64 = 1e-5;
const IMPEDANCE_OHM_M: f64 = 1e3;

fn protocol() -> Protocol {
    PairProtocol::default().protocol().unwrap()
}

fn voltages(mesh: &Mesh) -> Array1<f64> {
    let model = ForwardModel::new(mesh, &protocol(), &[IMPEDANCE_OHM_M; 16]).unwrap();
    model.forward(&vec![CONDUCTIVITY_S; mesh.surface().triangles().len()]).unwrap()
}

/// Largest relative error of all 208 voltages.
fn error(mesh: &Mesh, exact: &Array1<f64>) -> f64 {
    ((voltages(mesh) - exact) / exact).iter().fold(0.0, |m, e| m.max(e.abs()))
}

/// Convergence orders in the edge length, taken as 1 / sqrt(nodes), between successive meshes.
fn orders(nodes: &[usize], errors: &[f64]) -> Vec<f64> {
    let ratio = |k: usize| (nodes[k] as f64 / nodes[k - 1] as f64).ln();
    (1..errors.len()).map(|k| 2.0 * (errors[k - 1] / errors[k]).ln() / ratio(k)).collect()
}

/// The stereographic projection preserves angles, and thereby Laplace's equation and currents. On
/// the equator it preserves lengths, and thereby contact impedances. So a hemisphere with
/// electrodes on its rim has the voltages of the flat disc.
#[test]
fn a_hemisphere_has_the_voltages_of_the_flat_disc() {
    let exact = paper_voltages(16, 4000);
    let skin = SkinShape::Hemisphere { radius_m: RADIUS_M };
    let electrodes = RimElectrodes::equally_spaced(16, WIDTH_M);
    let (mut nodes, mut errors) = (Vec::new(), Vec::new());
    for wanted in [500, 2000, 8000, 32000] {
        // a similar family of meshes, as in convergence.rs
        let ends = WIDTH_M / 4.0 * (500.0 / f64::from(wanted)).sqrt();
        let graded = MeshSettings { electrode_edge_m: Some(ends), ..Default::default() };
        let settings = graded.for_nodes(&skin, &electrodes, wanted as usize).unwrap();
        let mesh = generate(&skin, &electrodes, &settings).unwrap();
        nodes.push(mesh.surface().nodes().len());
        errors.push(error(&mesh, &exact));
    }
    let orders = orders(&nodes, &errors);
    println!("nodes {nodes:?}, errors {errors:.6?}, orders {orders:.2?}");
    // as for the flat disc: order 2, reduced by log(1/h) at electrode ends; the coarsest mesh is
    // left out
    assert!(orders[1..].iter().all(|o| (o - 2.0).abs() < 0.35), "{orders:?}");
    assert!(errors[3] < 1e-3, "{errors:?}");
}

/// The same skin as from a CAD model: triangles of a subdivided octahedron, projected onto the
/// sphere, from a binary STL file in millimetres, with electrodes given by position.
#[test]
fn a_hemisphere_from_an_stl_file_has_them_as_well() {
    let exact = paper_voltages(16, 4000);
    let (mut nodes, mut errors) = (Vec::new(), Vec::new());
    for halvings in [4, 5, 6, 7] {
        let file = half_sphere_stl(halvings, 1e3 * RADIUS_M);
        let (surface, repairs) = parse_stl(&file, "link.stl", 1e-3).unwrap();
        assert_eq!(surface.triangles().len(), 4usize.pow(halvings + 1));
        assert!(repairs.notes().is_empty(), "{repairs}");
        let at = |l: i32| {
            let (sin, cos) = (TAU * f64::from(l) / 16.0).sin_cos();
            PlacedElectrode::rim([RADIUS_M * cos, RADIUS_M * sin, 0.0], WIDTH_M)
        };
        let electrodes: Vec<PlacedElectrode> = (0..16).map(at).collect();
        let ends = WIDTH_M / 3.0 * 0.5f64.powi(halvings as i32 - 4);
        let settings = MeshSettings { electrode_edge_m: Some(ends), ..Default::default() };
        let mesh = place_electrodes(&surface, &electrodes, &settings).unwrap();
        nodes.push(mesh.surface().nodes().len());
        errors.push(error(&mesh, &exact));
    }
    let orders = orders(&nodes, &errors);
    println!("nodes {nodes:?}, errors {errors:.6?}, orders {orders:.2?}");
    // as above; meshes made by splitting long edges are less similar to each other
    assert!(orders[1..].iter().all(|o| (o - 2.0).abs() < 0.4), "{orders:?}");
    assert!(errors[3] < 1e-3, "{errors:?}");
}

/// Half an octahedron as a binary STL file, with every side bisected and the nodes projected onto
/// the sphere.
fn half_sphere_stl(halvings: u32, radius: f64) -> Vec<u8> {
    let mut corners: Vec<[f64; 3]> =
        vec![[1., 0., 0.], [0., 1., 0.], [-1., 0., 0.], [0., -1., 0.], [0., 0., 1.]];
    let mut triangles: Vec<[usize; 3]> = vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
    for _ in 0..halvings {
        let mut middles: HashMap<[usize; 2], usize> = HashMap::new();
        let mut finer = Vec::new();
        for [a, b, c] in triangles {
            let mut middle = |a: usize, b: usize| {
                *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                    let sum: [f64; 3] = std::array::from_fn(|k| corners[a][k] + corners[b][k]);
                    let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
                    corners.push(sum.map(|x| x / length));
                    corners.len() - 1
                })
            };
            let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
            finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        triangles = finer;
    }
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for t in triangles {
        bytes.extend([0; 12]);
        for x in t.iter().flat_map(|&n| corners[n]) {
            bytes.extend(((radius * x) as f32).to_le_bytes());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

/// Modified Bessel functions `I_0` and `I_1`, by their series.
fn bessel(x: f64) -> (f64, f64) {
    let (mut zero, mut one, mut term) = (0.0, 0.0, 1.0);
    for k in 1..60 {
        zero += term;
        one += term * 0.5 * x / f64::from(k);
        term *= 0.25 * x * x / f64::from(k * k);
    }
    (zero, one)
}

/// A round patch in the centre of a disc, with the whole rim as the other electrode. Under the
/// patch, `u - U` is proportional to `I_0(r / s)` with `s^2 = sigma z`; outside, `u` is
/// logarithmic.
#[test]
fn a_patch_in_the_middle_of_a_disc_converges_to_the_closed_form() {
    let (current_a, patch_m, rim_z, patch_z) = (1e-4, 0.03, 1e3, 20.0);
    let screen_m = f64::sqrt(CONDUCTIVITY_S * patch_z);
    let (zero, one) = bessel(patch_m / screen_m);
    let under = screen_m * zero / (TAU * patch_m * CONDUCTIVITY_S * one);
    let around = (RADIUS_M / patch_m).ln() / (TAU * CONDUCTIVITY_S);
    let exact = current_a * (under + around + rim_z / (TAU * RADIUS_M));
    let disc = SkinShape::Disc { radius_m: RADIUS_M };
    let (mut nodes, mut errors) = (Vec::new(), Vec::new());
    for wanted in [500, 2000, 8000] {
        let edge = 0.01 * (500.0 / f64::from(wanted)).sqrt();
        let settings =
            MeshSettings { electrode_edge_m: Some(edge), ..MeshSettings::with_edge(edge) };
        let patch = [PlacedElectrode::patch([0.0; 3], patch_m)];
        let mesh = generate_placed(&disc, &patch, &settings).unwrap();
        let rim = Electrode::Rim(mesh.surface().rim_edges().to_vec());
        let electrodes = vec![rim, mesh.electrodes()[0].clone()];
        let mesh = Mesh::new(mesh.surface().clone(), electrodes).unwrap();
        let protocol = Protocol::from_quadruples(2, &[[1, 0, 1, 0]], current_a).unwrap();
        let model = ForwardModel::new(&mesh, &protocol, &[rim_z, patch_z]).unwrap();
        let found =
            model.forward(&vec![CONDUCTIVITY_S; mesh.surface().triangles().len()]).unwrap()[0];
        nodes.push(mesh.surface().nodes().len());
        errors.push((found / exact - 1.0).abs());
    }
    let orders = orders(&nodes, &errors);
    println!("exact {exact} V: nodes {nodes:?}, errors {errors:.6?}, orders {orders:.2?}");
    // the solution is smooth on both sides of the patch's outline, which the mesh follows: clean
    // order 2
    assert!(orders.iter().all(|o| (o - 2.0).abs() < 0.3), "{orders:?}");
    assert!(errors[2] < 1e-3, "{errors:?}");
}
