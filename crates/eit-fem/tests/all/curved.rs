//! Curved skins and patch electrodes against closed forms.

use crate::common::{
    CONDUCTIVITY_S, IMPEDANCE_OHM_M, PAPER_VOLTAGES, RADIUS_M, WIDTH_M, even, largest, orders,
    paper_protocol, with_electrodes,
};
use eit_fem::{ForwardModel, Protocol};
use eit_mesh::{
    Electrode, Mesh, MeshSettings, PlacedElectrode, RimElectrodes, SkinShape, generate,
    generate_placed, parse_stl, place_electrodes,
};
use std::f64::consts::TAU;

/// Largest relative error of all 208 voltages.
fn error(mesh: &Mesh) -> f64 {
    let model = ForwardModel::new(mesh, &paper_protocol(), &[IMPEDANCE_OHM_M; 16]).unwrap();
    let exact = &PAPER_VOLTAGES[1];
    largest(&((even(&model, CONDUCTIVITY_S) - exact) / exact))
}

/// Checks the order two of the errors on finer and finer meshes.
fn assert_order_two(nodes: &[usize], errors: &[f64], within: f64) {
    let orders = orders(nodes, errors);
    println!("nodes {nodes:?}, errors {errors:.6?}, orders {orders:.2?}");
    assert!(orders.iter().all(|o| (o - 2.0).abs() < within), "{orders:?}");
    assert!(errors[2] < 1e-3, "{errors:?}");
}

/// A hemisphere as from a CAD model, a binary STL file in millimetres with electrodes given by position,
/// has the voltages of the flat disc (see `quadratic_rates.rs`).
#[test]
fn a_hemisphere_from_an_stl_file_has_the_voltages_of_the_disc() {
    let dome = SkinShape::Hemisphere { radius_m: RADIUS_M };
    let (mut nodes, mut errors) = (Vec::new(), Vec::new());
    for h in [1.0, 0.5, 0.25] {
        let bare = generate(&dome, &RimElectrodes::none(), &MeshSettings::with_edge(0.016 * h));
        let mut file = vec![0; 80];
        let bare = bare.unwrap();
        let count = bare.surface().triangles().len();
        file.extend((count as u32).to_le_bytes());
        for corners in (0..count).map(|t| bare.surface().corners(t)) {
            file.extend([0; 12]);
            file.extend(corners.iter().flatten().flat_map(|x| ((1e3 * x) as f32).to_le_bytes()));
            file.extend([0; 2]);
        }
        let (surface, repairs) = parse_stl(&file, "link.stl", 1e-3).unwrap();
        assert_eq!(surface.triangles().len(), count);
        assert!(repairs.notes().is_empty(), "{repairs}");
        let at = |l: i32| {
            let (sin, cos) = (TAU * f64::from(l) / 16.0).sin_cos();
            PlacedElectrode::rim([RADIUS_M * cos, RADIUS_M * sin, 0.0], WIDTH_M)
        };
        let electrodes: Vec<PlacedElectrode> = (0..16).map(at).collect();
        let settings =
            MeshSettings { electrode_edge_m: Some(WIDTH_M / 3.0 * h), ..Default::default() };
        let mesh = place_electrodes(&surface, &electrodes, &settings).unwrap();
        nodes.push(mesh.surface().nodes().len());
        errors.push(error(&mesh));
    }
    // reduced by log(1/h) at electrode ends; meshes made by splitting long edges are less similar
    assert_order_two(&nodes, &errors, 0.4);
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

/// A round patch in the centre of a disc, with the whole rim as the other electrode. Under the patch
/// `u - U` is proportional to `I_0(r / s)` with `s^2 = sigma z`; outside, `u` is logarithmic.
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
        let h = 0.01 * (500.0 / f64::from(wanted)).sqrt();
        let settings = MeshSettings { electrode_edge_m: Some(h), ..MeshSettings::with_edge(h) };
        let patch = [PlacedElectrode::patch([0.0; 3], patch_m)];
        let mesh = generate_placed(&disc, &patch, &settings).unwrap();
        let rim = Electrode::Rim(mesh.surface().rim_edges().to_vec());
        let mesh = with_electrodes(&mesh, |list| list.insert(0, rim));
        let protocol = Protocol::from_quadruples(2, &[[1, 0, 1, 0]], current_a).unwrap();
        let model = ForwardModel::new(&mesh, &protocol, &[rim_z, patch_z]).unwrap();
        nodes.push(mesh.surface().nodes().len());
        errors.push((even(&model, CONDUCTIVITY_S)[0] / exact - 1.0).abs());
    }
    // the solution is smooth on both sides of the patch's outline, which the mesh follows
    assert_order_two(&nodes, &errors, 0.3);
}
