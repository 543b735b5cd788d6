//! Properties of every solution: closed form, symmetry, conservation, derivative, convergence.

use crate::common::{
    BOTH, adjacent, assert_reciprocal, assert_slope_two, even, largest, model_of, noise,
    random_conductivity, ring_disc, ring_disc_angles, rough_strip, round_disc, textbook, uneven,
};
use eit_fem::analytic::DiscSeries;
use eit_fem::{DrivenElectrodes, ForwardModel, PairPattern, PairProtocol, Protocol};
use ndarray::{Array2, aview1};

const IMPEDANCE: f64 = 0.05;

/// A strip carries a uniform current. Linear potentials are exact, so only rounding errors remain:
/// `V = I (length / (sigma width) + 2 z / width)`, and element `e` of area `A_e` has
/// `dV/dsigma_e = -A_e I / (sigma width)^2`.
#[test]
fn strip_has_its_closed_form_resistance_and_jacobian() {
    let (length, width, sigma, z, current) = (0.3, 0.1, 2e-5, 40.0, 1e-4);
    let mesh = rough_strip(length, width, 12, 5);
    let protocol = Protocol::from_quadruples(2, &[[0, 1, 0, 1]], current).unwrap();
    for order in BOTH {
        let model = model_of(&mesh, &protocol, &[z, z], order);
        let mut workspace = model.workspace().unwrap();
        let mut solution = model.solve(&vec![sigma; model.elements()], &mut workspace).unwrap();
        let found = solution.measurements()[0];
        let wanted = current * (length / (sigma * width) + 2.0 * z / width);
        // the condition number of this matrix is about 1e5
        assert!((found - wanted).abs() < 1e-11 * wanted, "{order:?}: {found} {wanted}");
        for (found, area) in solution.jacobian().row(0).iter().zip(mesh.surface().areas_m2()) {
            let wanted = -area * current / (sigma * width).powi(2);
            // gradients lose one more digit
            assert!((found - wanted).abs() < 1e-10 * wanted.abs(), "{order:?}: {found} {wanted}");
        }
        assert!(solution.report().backward_error < 1e-13);
    }
}

/// Rotating a skin of six-fold symmetry by two electrodes only renumbers them.
#[test]
fn reciprocity_and_rotation() {
    let (mesh, protocol) = (round_disc(8), adjacent(12));
    for order in BOTH {
        let model = model_of(&mesh, &protocol, &[IMPEDANCE; 12], order);
        let v = model.forward(&random_conductivity(&model, 1)).unwrap();
        assert_reciprocal(&protocol, &v);
        let v = even(&model, 1.3);
        for (k, voltage) in v.iter().enumerate() {
            // another elimination order with a condition number of about 1e4
            assert!((voltage - v[(k + 2 * 9) % 108]).abs() < 1e-12 * largest(&v), "{order:?} {k}");
        }
    }
}

/// The currents that the textbook matrix makes of the potentials are those of the pattern at the
/// electrodes, and zero at each node; the potentials solve the system to rounding.
#[test]
fn electrode_currents_are_the_pattern() {
    let (mesh, protocol, impedance) = (ring_disc(8), adjacent(12), uneven(7, 12, 0.01));
    let model = ForwardModel::new(&mesh, &protocol, &impedance).unwrap();
    let conductivity = random_conductivity(&model, 2);
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&conductivity, &mut workspace).unwrap();
    // 1e-13: a few hundred roundings of 1.1e-16
    assert!(solution.report().backward_error < 1e-13);
    let (inside, outside) = (solution.node_potentials(), solution.electrode_potentials());
    let admittance: Vec<f64> = impedance.iter().map(|z| 1.0 / z).collect();
    let matrix = textbook::matrix(&mesh, &conductivity, &admittance);
    for (s, pattern) in protocol.stimulations_a().rows().into_iter().enumerate() {
        assert!(outside.row(s).sum().abs() < 1e-13 * largest(outside.row(s)));
        let field: Vec<f64> = inside.row(s).iter().chain(outside.row(s)).copied().collect();
        for (k, row) in matrix.iter().enumerate() {
            let wanted = k.checked_sub(inside.ncols()).map_or(0.0, |l| pattern[l]);
            // differences of potentials of order one, divided by impedances down to 0.01
            let current = aview1(row).dot(&aview1(&field));
            assert!((current - wanted).abs() < 1e-11, "{k}: {current} {wanted}");
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
    let (drive, driven_electrodes) = (PairPattern::Opposite, DrivenElectrodes::Keep);
    let keep = PairProtocol { electrodes: 12, drive, driven_electrodes, ..Default::default() };
    let protocols = [
        adjacent(12),
        keep.protocol().unwrap(),
        Protocol::from_patterns(trigonometric.view(), differences.view()).unwrap(),
    ];
    for (protocol, order) in protocols.iter().flat_map(|p| BOTH.map(|order| (p, order))) {
        let model = model_of(&mesh, protocol, &[IMPEDANCE; 12], order);
        let sigma = random_conductivity(&model, 3);
        let direction: Vec<f64> = noise(4, sigma.len()).iter().map(|x| x - 0.5).collect();
        let at = |t: f64| {
            let moved: Vec<f64> = sigma.iter().zip(&direction).map(|(s, d)| s + t * d).collect();
            model.forward(&moved).unwrap()
        };
        let slope = model.jacobian(&sigma).unwrap().dot(&aview1(&direction));
        assert_slope_two(&format!("{order:?}"), slope.view(), 4e-2, at);
        let central = (at(1e-4) - at(-1e-4)) / 2e-4;
        // central differences: h^2 = 1e-8 of the third derivative
        assert!(largest(&(&central - &slope)) < 1e-7 * largest(&slope));
    }
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
    let potentials =
        |series: &DiscSeries| series.electrode_potentials(protocol.stimulations_a()).unwrap();
    let exact = potentials(&series);
    // the difference from a shorter series bounds the error of the longer one
    let shorter = DiscSeries { degree: 8, harmonics: 2000, ..series };
    let change = largest(&(potentials(&shorter) - &exact));
    let mut errors = Vec::new();
    for rings in [8, 16, 32, 64] {
        let model = ForwardModel::new(&ring_disc(rings), &protocol, &[0.5; 12]).unwrap();
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
