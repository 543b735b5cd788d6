//! Quadratic elements: closed forms, homogeneity, conservation, moved nodes, invalid input. Properties that both
//! orders share are in `properties.rs`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{
    adjacent, largest, noise, random_conductivity, ring_disc, rough_strip, round_disc, strip,
};
use eit_fem::{ElementOrder, FemError, ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Electrode, Mesh, MeshSettings, RimElectrodes, SkinShape, Surface, generate};
use ndarray::{Array1, aview1};

const IMPEDANCE: f64 = 0.05;

fn quadratic(mesh: &Mesh, protocol: &Protocol, impedance: &[f64]) -> ForwardModel {
    ForwardModel::with_element_order(mesh, protocol, impedance, ElementOrder::Quadratic).unwrap()
}

/// Quadratic potentials are exact. A patch over the whole strip feeds current evenly in the limit
/// of a large impedance; all current leaves at x = 0, and the potential is quadratic along the
/// strip. The resistance is `l / (sigma width) coth(length / l)` with `l = sqrt(z sigma)`, of which
/// the skin contributes about `length / (3 sigma width)`. The unevenness of the current is
/// `length^2 / (2 sigma z)`.
#[test]
fn quadratic_potentials_are_exact() {
    let (length, width, sigma, z) = (0.3, 0.1, 2.0, 0.02);
    let bare = rough_strip(length, width, 9, 3);
    let count = bare.surface().triangles().len() as u32;
    let mut electrodes = bare.electrodes().to_vec();
    electrodes[1] = Electrode::Patch((0..count).collect());
    let mesh = Mesh::new(bare.surface().clone(), electrodes).unwrap();
    let protocol = Protocol::from_quadruples(2, &[[1, 0, 1, 0]], 1.0).unwrap();
    let unevenness = 1e-3;
    let patch = length * length / (2.0 * sigma * unevenness);
    let l = f64::sqrt(patch * sigma);
    let wanted = l / (sigma * width) / (length / l).tanh() + z / width;
    let skin = length / (3.0 * sigma * width);
    let error = |elements: ElementOrder| {
        let model =
            ForwardModel::with_element_order(&mesh, &protocol, &[z, patch], elements).unwrap();
        let found = model.forward(&vec![sigma; model.elements()]).unwrap()[0];
        (found - wanted).abs() / skin
    };
    let (linear, quadratic) = (error(ElementOrder::Linear), error(ElementOrder::Quadratic));
    println!("linear {linear:.1e}, quadratic {quadratic:.1e}");
    // the non-quadratic part is a thousandth, and its energy the square of that
    assert!(quadratic < 1e-5, "{quadratic:e}");
    assert!(linear > 1e-3, "the mesh is coarse enough to tell: {linear:e}");
}

/// A contact of depth `a` on a strip carries current over its length as a transmission line:
/// resistance `l / (sigma width) coth(a / l)` with `l = sqrt(z sigma)` for patches over both ends.
#[test]
fn patch_electrodes_are_transmission_lines() {
    let (length, width, sigma, z) = (0.3, 0.1, 2.0, 0.002);
    let protocol = Protocol::from_quadruples(2, &[[0, 1, 0, 1]], 1.0).unwrap();
    let transfer = f64::sqrt(z * sigma);
    let depth = length / 3.0;
    let contact = transfer / (sigma * width) / (depth / transfer).tanh();
    let wanted = (length - 2.0 * depth) / (sigma * width) + 2.0 * contact;
    let errors: Vec<f64> = [6, 12, 24]
        .into_iter()
        .map(|columns| {
            let bare = strip(length, width, columns, columns / 3);
            let count = bare.surface().triangles().len() as u32;
            let electrodes = vec![
                Electrode::Patch((0..count / 3).collect()),
                Electrode::Patch((2 * count / 3..count).collect()),
            ];
            let mesh = Mesh::new(bare.surface().clone(), electrodes).unwrap();
            let model = quadratic(&mesh, &protocol, &[z, z]);
            let found = model.forward(&vec![sigma; model.elements()]).unwrap()[0];
            (found - wanted).abs() / wanted
        })
        .collect();
    let orders: Vec<f64> = errors.windows(2).map(|e| (e[0] / e[1]).log2()).collect();
    println!("errors {errors:?}, orders {orders:.2?}");
    // the solution is smooth on each element; a voltage is an energy and converges with order four
    assert!(orders.iter().all(|o| (o - 4.0).abs() < 0.3), "{orders:?}");
}

/// A polygonal outline with a hole: quadratic elements on a coarse mesh against linear elements on
/// finer and finer meshes.
#[test]
fn polygon_agrees_with_fine_linear_elements() {
    let square = |half: f64| vec![[-half, -half], [half, -half], [half, half], [-half, half]];
    let skin = SkinShape::Polygon { outline_m: square(1.0), holes_m: vec![square(0.3)] };
    let electrodes = RimElectrodes::equally_spaced(8, 0.4);
    let protocol = PairProtocol { electrodes: 8, ..Default::default() }.protocol().unwrap();
    let voltages = |nodes: usize, elements: ElementOrder| -> Array1<f64> {
        let ends = 0.1 * (400.0 / nodes as f64).sqrt();
        let settings = MeshSettings { electrode_edge_m: Some(ends), ..Default::default() };
        let settings = settings.for_nodes(&skin, &electrodes, nodes).unwrap();
        let mesh = generate(&skin, &electrodes, &settings).unwrap();
        let model =
            ForwardModel::with_element_order(&mesh, &protocol, &[0.2; 8], elements).unwrap();
        model.forward(&vec![1.0; model.elements()]).unwrap()
    };
    let found = voltages(1500, ElementOrder::Quadratic);
    let apart: Vec<f64> = [1500, 6000, 24000]
        .map(|nodes| largest(&(voltages(nodes, ElementOrder::Linear) - &found)) / largest(&found))
        .to_vec();
    println!("linear elements are apart by {apart:?}");
    // linear elements converge to the quadratic solution with order two, up to its own error of
    // h^(4/3) at the corners of the hole
    assert!(apart[0] / apart[2] > 8.0, "{apart:?}");
    assert!(apart[2] < 5e-4, "{apart:?}");
}

/// `v(t sigma, z / t) = v(sigma, z) / t`, so by Euler `v` is minus its derivative along the
/// conductivities (the Jacobian) plus that along the impedances (five-point differences).
#[test]
fn voltages_are_homogeneous() {
    let mesh = round_disc(4);
    let protocol = adjacent(12);
    let impedance: Vec<f64> = noise(7, 12).iter().map(|x| 0.05 + x).collect();
    let model = quadratic(&mesh, &protocol, &impedance);
    let sigma = random_conductivity(&model, 2);
    let v = model.forward(&sigma).unwrap();
    let along = model.jacobian(&sigma).unwrap().dot(&aview1(&sigma));
    let at = |factor: f64| {
        let scaled: Vec<f64> = impedance.iter().map(|z| factor * z).collect();
        quadratic(&mesh, &protocol, &scaled).forward(&sigma).unwrap()
    };
    // five points: h^4 = 1e-12 of the fifth derivative, rounding 1e-14 / h
    let h = 1e-3;
    let contacts =
        (8.0 * (at(1.0 + h) - at(1.0 - h)) - (at(1.0 + 2.0 * h) - at(1.0 - 2.0 * h))) / (12.0 * h);
    let error = largest(&(&contacts - &along - &v)) / largest(&v);
    println!("energy identity: {error:.1e}");
    assert!(error < 1e-10, "{error:e}");
}

/// Current is conserved: potentials sum to zero, and the choice of the ground electrode (the last,
/// whose equation is not in the system) does not matter.
#[test]
fn the_system_is_solved_and_balanced() {
    let mesh = round_disc(8);
    let model = quadratic(&mesh, &adjacent(12), &[IMPEDANCE; 12]);
    let sigma = random_conductivity(&model, 3);
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&sigma, &mut workspace).unwrap();
    let report = solution.report();
    assert!(report.backward_error < 1e-13, "{report:?}");
    // nodes, edges (Euler: nodes + triangles - 1) and all electrodes except one
    let [nodes, triangles] = [mesh.surface().nodes().len(), mesh.surface().triangles().len()];
    assert_eq!(model.cost().unknowns, nodes + (nodes + triangles - 1) + 11);
    assert_eq!(report.unknowns, model.cost().unknowns);
    assert_eq!(solution.node_potentials().dim(), (12, nodes));
    let potentials = solution.electrode_potentials();
    assert!(potentials.rows().into_iter().all(|row| row.sum().abs() < 1e-13 * largest(row)));

    let mut electrodes = mesh.electrodes().to_vec();
    electrodes.rotate_left(1);
    let other = Mesh::new(mesh.surface().clone(), electrodes).unwrap();
    let other = other.with_midpoints(|edge, p| mesh.midpoint_m(edge).unwrap_or(p)).unwrap();
    let turned = quadratic(&other, &adjacent(12), &[IMPEDANCE; 12]).forward(&sigma).unwrap();
    let voltages = solution.measurements();
    for (k, v) in turned.iter().enumerate() {
        // drive 0 of the rotated list is drive 1 of the original; the condition number is about 1e4
        let apart = (v - voltages[(k + 9) % 108]).abs();
        assert!(apart < 1e-11 * largest(&voltages), "{k}: {apart:e}");
    }
}

/// Curved edges move with the skin: rotation changes nothing, nor does scaling both skin and
/// contact impedances by t, and a disc stretched to an ellipse equals the model of the ellipse's
/// own mesh.
#[test]
fn curved_edges_move_with_the_skin() {
    let mesh = round_disc(4);
    let model = quadratic(&mesh, &adjacent(12), &[IMPEDANCE; 12]);
    let sigma = random_conductivity(&model, 5);
    let still = model.forward(&sigma).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut geometry = model.geometry();
    let mut moved = |place: &dyn Fn([f64; 3]) -> [f64; 3], z: f64| {
        let nodes: Vec<[f64; 3]> = mesh.surface().nodes().iter().map(|p| place(*p)).collect();
        model.deform(&nodes, &[z; 12], &mut geometry).unwrap();
        model.solve_deformed(&geometry, &sigma, &mut workspace).unwrap().measurements()
    };
    assert_eq!(moved(&|p| p, IMPEDANCE), still);
    let (sin, cos) = 0.7_f64.sin_cos();
    let turn = |p: [f64; 3]| {
        [3.0 * p[0], 3.0 * (cos * p[1] - sin * p[2]), 3.0 * (sin * p[1] + cos * p[2])]
    };
    let turned = moved(&turn, 3.0 * IMPEDANCE);
    // rounding of positions, amplified by the condition number of about 1e4
    assert!(largest(&(&turned - &still)) < 1e-11 * largest(&still));

    let stretch = |p: [f64; 3]| [1.3 * p[0] + 0.2 * p[1], 0.8 * p[1], p[2]];
    let stretched = moved(&stretch, IMPEDANCE);
    let nodes = mesh.surface().nodes().iter().map(|p| stretch(*p)).collect();
    let surface = Surface::new(nodes, mesh.surface().triangles().to_vec()).unwrap();
    let ellipse = Mesh::new(surface, mesh.electrodes().to_vec())
        .unwrap()
        .with_midpoints(|edge, straight| mesh.midpoint_m(edge).map_or(straight, stretch))
        .unwrap();
    let wanted = quadratic(&ellipse, &adjacent(12), &[IMPEDANCE; 12]).forward(&sigma).unwrap();
    assert!(largest(&(&stretched - &wanted)) < 1e-11 * largest(&wanted));
    assert!(largest(&(&stretched - &still)) > 0.1 * largest(&still), "another skin");
}

#[test]
fn what_quadratic_elements_cannot_do_is_said() {
    let mesh = round_disc(4);
    let protocol = adjacent(12);
    for (z, word) in [(0.0, "is 0"), (f64::INFINITY, "is inf")] {
        let mut impedance = [IMPEDANCE; 12];
        impedance[4] = z;
        let model =
            ForwardModel::with_element_order(&mesh, &protocol, &impedance, ElementOrder::Quadratic);
        let message = model.unwrap_err().to_string();
        assert!(message.contains("electrode 5") && message.contains(word), "{message}");
        let model = quadratic(&mesh, &protocol, &[IMPEDANCE; 12]);
        let mut geometry = model.geometry();
        let error = model.deform(mesh.surface().nodes(), &impedance, &mut geometry).unwrap_err();
        assert!(matches!(error, FemError::LimitOfImpedance { electrode: 5, .. }), "{error}");
    }
    let model = quadratic(&mesh, &protocol, &[IMPEDANCE; 12]);
    let sigma = vec![1.0; model.elements()];
    let mut workspace = model.workspace().unwrap();
    let plain = model.forward(&sigma).unwrap();
    assert_eq!(model.solve_to(&sigma, 1e-6, &mut workspace).unwrap().measurements(), plain);
    let error = model.solve_to(&sigma, 1e-15, &mut workspace).unwrap_err();
    assert!(matches!(error, FemError::NodalAssemblyOnly { required: 1e-15, .. }), "{error}");

    // an edge bent by 0.4 of its length into a triangle inverts the triangle
    let [a, b] = mesh.electrodes().first().map(first_edge).unwrap();
    let bent = mesh.with_midpoints(|edge, p| {
        let inwards = if edge == [a.min(b), a.max(b)] { 0.9 } else { 1.0 };
        p.map(|x| inwards * x)
    });
    let model = ForwardModel::with_element_order(
        &bent.unwrap(),
        &protocol,
        &[IMPEDANCE; 12],
        ElementOrder::Quadratic,
    );
    assert!(matches!(model.unwrap_err(), FemError::FoldedElement { .. }));
}

fn first_edge(electrode: &Electrode) -> [u32; 2] {
    match electrode {
        Electrode::Rim(edges) => edges[0],
        Electrode::Patch(_) => panic!("a rim electrode"),
    }
}

/// A mesh without edge midpoints has straight elements: the ring disc is then a polygon.
#[test]
fn straight_edges_stay_straight() {
    let (flat, round) = (ring_disc(4), round_disc(4));
    let voltages = |mesh: &Mesh| {
        let model = quadratic(mesh, &adjacent(12), &[IMPEDANCE; 12]);
        model.forward(&vec![1.0; model.elements()]).unwrap()
    };
    let (polygon, disc) = (voltages(&flat), voltages(&round));
    let apart = largest(&(&polygon - &disc)) / largest(&disc);
    println!("polygon of 24 sides and disc: {apart:.1e}");
    // sides of 15 degrees: electrodes shorter by 3e-3, area smaller by 1e-2
    assert!((1e-4..3e-2).contains(&apart), "{apart:e}");
}
