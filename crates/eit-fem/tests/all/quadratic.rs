//! Quadratic elements: closed forms, convergence, conservation, moved nodes, invalid input. Properties that
//! both orders share are in `properties.rs`.

use crate::common::{
    adjacent, deformed, even, halving_orders, largest, model_of, moved, random_conductivity,
    refused, relative, rough_strip, round_disc, strip, with_electrodes,
};
use eit_fem::ElementOrder::{Linear, Quadratic};
use eit_fem::{Anisotropy, ForwardModel, Protocol};
use eit_mesh::{Electrode, Mesh, MeshSettings, RimElectrodes, SkinShape, generate};

const IMPEDANCE: f64 = 0.05;

fn quadratic(mesh: &Mesh) -> ForwardModel {
    model_of(mesh, &adjacent(12), &[IMPEDANCE; 12], Quadratic)
}

/// A patch over the whole strip feeds current evenly in the limit of a large impedance; all current
/// leaves at x = 0, and the potential is quadratic along the strip. The resistance is
/// `l / (sigma width) coth(length / l)` with `l = sqrt(z sigma)`, of which the skin contributes about
/// `length / (3 sigma width)`. The unevenness of the current is `length^2 / (2 sigma z)`.
#[test]
fn quadratic_potentials_are_exact() {
    let (length, width, sigma, z) = (0.3, 0.1, 2.0, 0.02);
    let bare = rough_strip(length, width, 9, 3);
    let count = bare.surface().triangles().len() as u32;
    let mesh = with_electrodes(&bare, |list| list[1] = Electrode::Patch((0..count).collect()));
    let protocol = Protocol::from_quadruples(2, &[[1, 0, 1, 0]], 1.0).unwrap();
    let unevenness = 1e-3;
    let patch = length * length / (2.0 * sigma * unevenness);
    let l = f64::sqrt(patch * sigma);
    let wanted = l / (sigma * width) / (length / l).tanh() + z / width;
    let skin = length / (3.0 * sigma * width);
    let [linear, quadratic] = [Linear, Quadratic].map(|order| {
        (even(&model_of(&mesh, &protocol, &[z, patch], order), sigma)[0] - wanted).abs() / skin
    });
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
    let (transfer, depth) = (f64::sqrt(z * sigma), length / 3.0);
    let contact = transfer / (sigma * width) / (depth / transfer).tanh();
    let wanted = (length - 2.0 * depth) / (sigma * width) + 2.0 * contact;
    let errors = [6, 12, 24].map(|columns| {
        let bare = strip(length, width, columns, columns / 3);
        let count = bare.surface().triangles().len() as u32;
        let mesh = with_electrodes(&bare, |list| {
            list[0] = Electrode::Patch((0..count / 3).collect());
            list[1] = Electrode::Patch((2 * count / 3..count).collect());
        });
        (even(&model_of(&mesh, &protocol, &[z, z], Quadratic), sigma)[0] - wanted).abs() / wanted
    });
    let orders = halving_orders(&errors);
    println!("errors {errors:?}, orders {orders:.2?}");
    // the solution is smooth on each element; a voltage is an energy and converges with order four
    assert!(orders.iter().all(|o| (o - 4.0).abs() < 0.3), "{orders:?}");
}

/// Quadratic elements on a coarse mesh against linear elements on finer and finer ones: a polygon
/// with a hole, and a disc that conducts better along than across.
#[test]
fn linear_elements_converge_to_quadratic_ones() {
    let square = |half: f64| vec![[-half, -half], [half, -half], [half, half], [-half, half]];
    let polygon = SkinShape::Polygon { outline_m: square(1.0), holes_m: vec![square(0.3)] };
    let disc = SkinShape::Disc { radius_m: 1.0 };
    let electrodes = RimElectrodes::equally_spaced(8, 0.4);
    for (skin, ratio, quadratic_nodes, least) in
        [(polygon, 1.0, 1500, 8.0), (disc, 1.8, 3000, 10.0)]
    {
        let voltages = |nodes: usize, order| {
            let ends = 0.1 * (400.0 / nodes as f64).sqrt();
            let settings = MeshSettings { electrode_edge_m: Some(ends), ..Default::default() };
            let settings = settings.for_nodes(&skin, &electrodes, nodes).unwrap();
            let mesh = generate(&skin, &electrodes, &settings).unwrap();
            let sheet = Anisotropy::uniform(mesh.surface(), ratio, 0.5).unwrap();
            let model = model_of(&mesh, &adjacent(8), &[0.2; 8], order);
            even(&model.with_anisotropy(&sheet).unwrap(), 1.0)
        };
        let found = voltages(quadratic_nodes, Quadratic);
        let apart = [1500, 6000, 24000]
            .map(|nodes| largest(&(voltages(nodes, Linear) - &found)) / largest(&found));
        println!("linear elements are apart by {apart:?}");
        // order two, up to the quadratic solution's own error of h^(4/3) at the corners of the hole
        assert!(apart[0] / apart[2] > least && apart[2] < 5e-4, "{ratio}: {apart:?}");
    }
}

/// Current is conserved: potentials sum to zero, and the choice of the ground electrode (the last,
/// whose equation is not in the system) does not matter.
#[test]
fn the_system_is_solved_and_balanced() {
    let mesh = round_disc(8);
    let model = quadratic(&mesh);
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

    let other = with_electrodes(&mesh, |list| list.rotate_left(1));
    let other = other.with_midpoints(|edge, p| mesh.midpoint_m(edge).unwrap_or(p)).unwrap();
    let voltages = solution.measurements();
    for (k, v) in quadratic(&other).forward(&sigma).unwrap().iter().enumerate() {
        // drive 0 of the rotated list is drive 1 of the original; the condition number is about 1e4
        let apart = (v - voltages[(k + 9) % 108]).abs();
        assert!(apart < 1e-11 * largest(&voltages), "{k}: {apart:e}");
    }
}

/// Curved edges move with the skin: a disc stretched to an ellipse equals the ellipse's own model.
#[test]
fn curved_edges_move_with_the_skin() {
    let mesh = round_disc(4);
    let model = quadratic(&mesh);
    let sigma = random_conductivity(&model, 5);
    let still = model.forward(&sigma).unwrap();
    let stretch = |p: [f64; 3]| [1.3 * p[0] + 0.2 * p[1], 0.8 * p[1], p[2]];
    let ellipse = moved(&mesh, stretch)
        .with_midpoints(|edge, straight| mesh.midpoint_m(edge).map_or(straight, stretch))
        .unwrap();
    let wanted = quadratic(&ellipse).forward(&sigma).unwrap();
    // rounding of positions, amplified by the condition number of about 1e4
    for (skin, wanted, bound) in [(&mesh, &still, 0.0), (&ellipse, &wanted, 1e-11)] {
        let found = deformed(&model, skin.surface().nodes(), &[IMPEDANCE; 12], &sigma);
        assert!(relative(&found, wanted) <= bound);
    }
    assert!(relative(&wanted, &still) > 0.1, "another skin");
}

#[test]
fn what_quadratic_elements_cannot_do_is_said() {
    let mesh = round_disc(4);
    let model = quadratic(&mesh);
    let build = |mesh: &Mesh, impedance: &[f64]| {
        ForwardModel::with_element_order(mesh, &adjacent(12), impedance, Quadratic)
    };
    for z in [0.0, f64::INFINITY] {
        let mut impedance = [IMPEDANCE; 12];
        impedance[4] = z;
        let words = format!("electrode 5 is {z}: quadratic elements need it above zero");
        refused(build(&mesh, &impedance), &words);
        refused(model.deform(mesh.surface().nodes(), &impedance, &mut model.geometry()), &words);
    }
    let sigma = vec![1.0; model.elements()];
    let mut workspace = model.workspace().unwrap();
    let plain = model.forward(&sigma).unwrap();
    assert_eq!(model.solve_to(&sigma, 1e-6, &mut workspace).unwrap().measurements(), plain);
    refused(model.solve_to(&sigma, 1e-15, &mut workspace), "but 1e-15 was required: use linear");

    // an edge bent by 0.4 of its length into a triangle inverts the triangle
    let Electrode::Rim(edges) = &mesh.electrodes()[0] else { panic!("a rim electrode") };
    let [a, b] = edges[0];
    let bent = mesh.with_midpoints(|edge, p| {
        let inwards = if edge == [a.min(b), a.max(b)] { 0.9 } else { 1.0 };
        p.map(|x| inwards * x)
    });
    refused(build(&bent.unwrap(), &[IMPEDANCE; 12]), "folds over");
}
