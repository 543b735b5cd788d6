//! Properties of every solution: closed form, symmetry, conservation, derivative, convergence.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

use crate::common::{
    adjacent, largest, noise, random_conductivity, ring_disc, ring_disc_angles, rough_strip,
    round_disc, strip,
};
use eit_fem::analytic::DiscSeries;
use eit_fem::{DrivenElectrodes, ElementOrder, ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Electrode, Mesh, Surface};
use ndarray::Array2;

const IMPEDANCE: f64 = 0.05;

fn model(mesh: &Mesh, protocol: &Protocol, impedance: &[f64], order: ElementOrder) -> ForwardModel {
    ForwardModel::with_element_order(mesh, protocol, impedance, order).unwrap()
}

const BOTH: [ElementOrder; 2] = [ElementOrder::Linear, ElementOrder::Quadratic];

/// A strip carries a uniform current. Linear potentials are exact, so only rounding errors remain:
/// `V = I (length / (sigma width) + 2 z / width)`, and element `e` of area `A_e` has
/// `dV/dsigma_e = -A_e I / (sigma width)^2`.
#[test]
fn strip_has_its_closed_form_resistance_and_jacobian() {
    let (length, width, sigma, z, current) = (0.3, 0.1, 2e-5, 40.0, 1e-4);
    let mesh = rough_strip(length, width, 12, 5);
    let protocol = Protocol::from_quadruples(2, &[[0, 1, 0, 1]], current).unwrap();
    for order in BOTH {
        let model = model(&mesh, &protocol, &[z, z], order);
        let mut workspace = model.workspace().unwrap();
        let mut solution = model.solve(&vec![sigma; model.elements()], &mut workspace).unwrap();
        let found = solution.measurements()[0];
        let wanted = current * (length / (sigma * width) + 2.0 * z / width);
        // the condition number of this matrix is about 1e5
        assert!((found - wanted).abs() < 1e-11 * wanted, "{order:?}: {found} {wanted}");
        let jacobian = solution.jacobian();
        for (found, area) in jacobian.row(0).iter().zip(mesh.surface().areas_m2()) {
            let wanted = -area * current / (sigma * width).powi(2);
            // gradients lose one more digit
            assert!((found - wanted).abs() < 1e-10 * wanted.abs(), "{order:?}: {found} {wanted}");
        }
        assert!(solution.report().backward_error < 1e-13);
    }
}

/// The same strip with patch electrodes: current enters over an area. Far from the ends the
/// field is uniform, so two long strips differ by the resistance of the added length.
#[test]
fn patch_electrodes_carry_the_current() {
    let resistance = |columns: usize| {
        let (length, width, rows) = (0.01 * columns as f64, 0.05, 5);
        let bare = strip(length, width, columns, rows);
        let count = bare.surface().triangles().len() as u32;
        let patch = 2 * rows as u32;
        let electrodes = vec![
            Electrode::Patch((0..patch).collect()),
            Electrode::Patch((count - patch..count).collect()),
        ];
        let mesh = Mesh::new(bare.surface().clone(), electrodes).unwrap();
        let protocol = Protocol::from_quadruples(2, &[[0, 1, 0, 1]], 1.0).unwrap();
        let model = ForwardModel::new(&mesh, &protocol, &[1e-3, 1e-3]).unwrap();
        model.forward(&vec![0.5; model.elements()]).unwrap()[0]
    };
    let wanted = 0.01 * 20.0 / (0.5 * 0.05);
    // the disturbance at the ends decays as exp(-pi x / width): 4e-17 over the shorter strip
    assert!((resistance(80) - resistance(60) - wanted).abs() < 1e-10 * wanted);
}

/// Exchanging current and voltage changes nothing; rotating a skin of six-fold symmetry by two
/// electrodes only renumbers them.
#[test]
fn reciprocity_and_rotation() {
    let (mesh, protocol) = (round_disc(8), adjacent(12));
    let quadruples = protocol.quadruples().unwrap();
    for order in BOTH {
        let model = model(&mesh, &protocol, &[IMPEDANCE; 12], order);
        let v = model.forward(&random_conductivity(&model, 1)).unwrap();
        for (i, &[a, b, m, n]) in quadruples.iter().enumerate() {
            let j = quadruples.iter().position(|&q| q == [m, n, a, b]).unwrap();
            // both values come from one symmetric matrix: rounding only
            assert!((v[i] - v[j]).abs() < 1e-13 * largest(&v));
        }
        let v = model.forward(&vec![1.3; model.elements()]).unwrap();
        for (k, voltage) in v.iter().enumerate() {
            let turned = v[(k + 2 * 9) % 108];
            // another elimination order with a condition number of about 1e4
            assert!((voltage - turned).abs() < 1e-12 * largest(&v), "{order:?} {k}");
        }
    }
}

/// The current through each electrode, computed from the potentials on it, is the prescribed one,
/// and the potentials solve the system to rounding.
#[test]
fn electrode_currents_are_the_pattern() {
    let mesh = ring_disc(8);
    let impedance: Vec<f64> = noise(7, 12).iter().map(|x| 0.01 + x).collect();
    let protocol = adjacent(12);
    let model = ForwardModel::new(&mesh, &protocol, &impedance).unwrap();
    let conductivity = random_conductivity(&model, 2);
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&conductivity, &mut workspace).unwrap();
    // 1e-13: a few hundred roundings of 1.1e-16
    assert!(solution.report().backward_error < 1e-13);
    let (inside, outside) = (solution.node_potentials(), solution.electrode_potentials());
    for (s, pattern) in protocol.stimulations_a().rows().into_iter().enumerate() {
        assert!(outside.row(s).sum().abs() < 1e-13 * largest(outside.row(s)));
        for (l, electrode) in mesh.electrodes().iter().enumerate() {
            let Electrode::Rim(edges) = electrode else { panic!("rim electrodes") };
            let current: f64 = edges
                .iter()
                .map(|e| {
                    let [p, q] = e.map(|n| mesh.surface().nodes()[n as usize]);
                    let length = ((p[0] - q[0]).powi(2) + (p[1] - q[1]).powi(2)).sqrt();
                    let mean = 0.5 * (inside[[s, e[0] as usize]] + inside[[s, e[1] as usize]]);
                    length * (outside[[s, l]] - mean) / impedance[l]
                })
                .sum();
            // differences of potentials of order one, divided by impedances down to 0.01
            assert!((current - pattern[l]).abs() < 1e-11, "{current} {}", pattern[l]);
        }
    }
}

/// Slope 2 of the Taylor remainder, and agreement with central differences, in a random
/// direction around a random conductivity, for pairs and for general patterns.
#[test]
fn jacobian_passes_the_taylor_test() {
    let mesh = round_disc(4);
    let trigonometric = Array2::from_shape_fn((12, 7), |(e, p)| {
        let angle = ring_disc_angles()[e] * (p / 2 + 1) as f64;
        if p % 2 == 0 { angle.cos() } else { angle.sin() }
    });
    let differences = Array2::from_shape_fn((12, 12), |(e, m)| {
        f64::from(u8::from(e == m)) - f64::from(u8::from(e == (m + 1) % 12))
    });
    let keep = PairProtocol {
        electrodes: 12,
        drive: eit_fem::PairPattern::Opposite,
        driven_electrodes: DrivenElectrodes::Keep,
        ..Default::default()
    };
    let protocols = [
        adjacent(12),
        keep.protocol().unwrap(),
        Protocol::from_patterns(trigonometric.view(), differences.view()).unwrap(),
    ];
    for (protocol, order) in protocols.iter().flat_map(|p| BOTH.map(|order| (p, order))) {
        let model = model(&mesh, protocol, &[IMPEDANCE; 12], order);
        let sigma = random_conductivity(&model, 3);
        let direction: Vec<f64> = noise(4, sigma.len()).iter().map(|x| x - 0.5).collect();
        let at = |t: f64| {
            let moved: Vec<f64> = sigma.iter().zip(&direction).map(|(s, d)| s + t * d).collect();
            model.forward(&moved).unwrap()
        };
        let base = at(0.0);
        let slope = model.jacobian(&sigma).unwrap().dot(&ndarray::aview1(&direction));
        let remainder = |t: f64| largest(&(at(t) - &base - &slope * t));
        let rates: Vec<f64> = [1e-1, 1e-2, 1e-3]
            .windows(2)
            .map(|t| (remainder(t[0]) / remainder(t[1])).log10())
            .collect();
        // third-order terms affect the first rate; rounding is far below the last remainder
        assert!(rates.iter().all(|r| (r - 2.0).abs() < 0.1), "{rates:?}");
        let central = (at(1e-4) - at(-1e-4)) / 2e-4;
        // central differences: h^2 = 1e-8 of the third derivative
        assert!(largest(&(&central - &slope)) < 1e-7 * largest(&slope));
    }
}

/// Tilting a skin in space does not change its voltages.
#[test]
fn a_skin_tilted_in_space_measures_the_same() {
    let flat = ring_disc(8);
    let (s, c) = 0.7_f64.sin_cos();
    let tilted = flat
        .surface()
        .nodes()
        .iter()
        .map(|p| [p[0] + 3.0, c * p[1] - s * p[2], s * p[1] + c * p[2]])
        .collect();
    let surface = Surface::new(tilted, flat.surface().triangles().to_vec()).unwrap();
    let tilted = Mesh::new(surface, flat.electrodes().to_vec()).unwrap();
    let sigma =
        noise(5, flat.surface().triangles().len()).iter().map(|x| x + 0.5).collect::<Vec<_>>();
    let solve = |mesh: &Mesh| {
        ForwardModel::new(mesh, &adjacent(12), &[IMPEDANCE; 12]).unwrap().forward(&sigma).unwrap()
    };
    let (a, b) = (solve(&flat), solve(&tilted));
    // coordinates have one more rounding, at a distance of 3
    assert!(largest(&(&a - &b)) < 1e-12 * largest(&a));
}

/// Order of convergence on refined ring discs against the mesh-free series. The contact impedance
/// gives a boundary layer (z sigma = 0.5) wider than the coarsest element; thinner layers reach the
/// order only once elements resolve them.
#[test]
fn voltages_converge_to_the_series_with_order_two() {
    let protocol = adjacent(12);
    let series = DiscSeries {
        radius_m: 1.0,
        conductivity_s: 1.0,
        electrode_angles_rad: ring_disc_angles(),
        electrode_width_m: std::f64::consts::TAU / 24.0,
        contact_impedance_ohm_m: 0.5,
        degree: 12,
        harmonics: 4000,
    };
    let exact = series.electrode_potentials(protocol.stimulations_a()).unwrap();
    // the difference from a shorter series bounds the error of the longer one
    let shorter = DiscSeries { degree: 8, harmonics: 2000, ..series.clone() };
    let change =
        largest(&(shorter.electrode_potentials(protocol.stimulations_a()).unwrap() - &exact));
    let mut errors = Vec::new();
    for rings in [8, 16, 32, 64] {
        let mesh = ring_disc(rings);
        let model = ForwardModel::new(&mesh, &protocol, &[0.5; 12]).unwrap();
        let mut workspace = model.workspace().unwrap();
        let sigma = vec![1.0; model.elements()];
        let found = model.solve(&sigma, &mut workspace).unwrap().electrode_potentials();
        // relative to the largest electrode potential
        errors.push(largest(&(found - &exact)) / largest(&exact));
    }
    println!("errors {errors:?}, change of the series {change:.1e}");
    // at an electrode end the potential behaves like r log r, so on uniform meshes second order has
    // a factor log(1/h): error / (h^2 log(1/h)) is constant (measured: to 2 %)
    let constants: Vec<f64> = errors
        .iter()
        .zip([8.0_f64, 16.0, 32.0, 64.0])
        .map(|(e, rings)| e * rings * rings / rings.ln())
        .collect();
    println!("error / (h^2 log(1/h)): {constants:?}");
    assert!(constants.iter().all(|c| (c / constants[3] - 1.0).abs() < 0.05), "{constants:?}");
    assert!(change < 0.05 * errors[3], "the series is the better one: {change:e}");
}
