//! The Jacobian against the energy identity and scalings.

use crate::common::{
    BOTH, adjacent, five_points, kept, largest, model_of, random_conductivity, refused, relative,
    ring_disc, round_disc, textbook, uneven,
};
use eit_fem::{ElementOrder, ForwardModel, PairProtocol};
use ndarray::{Array1, Array2, Axis, aview1};

/// Voltage is energy: `v = sum_e -J_e sigma_e + sum_l 1/z_l integral (U - u)(U* - u*)`, with random
/// conductivity and impedances. For linear elements the second sum is the part of the contacts in
/// the textbook matrix between both fields. It is also `sum_l z_l dv/dz_l` (Euler: `v` is
/// homogeneous of degree -1 in sigma and 1/z), which differences confirm for both.
#[test]
fn jacobian_and_contacts_add_up_to_the_voltage() {
    let (mesh, protocol, impedance) = (round_disc(8), kept(), uneven(7, 12, 0.05));
    for order in BOTH {
        let model = model_of(&mesh, &protocol, &impedance, order);
        let sigma = random_conductivity(&model, 3);
        let mut workspace = model.workspace().unwrap();
        let mut solution = model.solve(&sigma, &mut workspace).unwrap();
        let voltages = solution.measurements();
        let mut contacts = &voltages + &solution.jacobian().dot(&aview1(&sigma));
        if order == ElementOrder::Linear {
            let admittance: Vec<f64> = impedance.iter().map(|z| 1.0 / z).collect();
            let matrix = textbook::matrix(&mesh, &[], &admittance);
            let (inside, outside) = (solution.node_potentials(), solution.electrode_potentials());
            let fields = ndarray::concatenate![Axis(1), inside, outside];
            let flows = fields.dot(&Array2::from_shape_fn((229, 229), |(i, j)| matrix[i][j]));
            // pair (m, m + 1) is also drive m: its field for one ampere is the adjoint field
            let energy =
                |&[a, _, m, _]: &[u32; 4]| flows.row(a as usize).dot(&fields.row(m as usize)) / 0.5;
            let energies: Array1<f64> = protocol.quadruples().unwrap().iter().map(energy).collect();
            let error = largest(&(&contacts - &energies)) / largest(&voltages);
            println!("energy identity: {error:.1e}");
            // condition number about 1e4
            assert!(error < 1e-12, "{error:e}");
            contacts = energies;
        }
        // five points: h^4 = 1e-12 of the fifth derivative, rounding 1e-14 / h
        let slope = five_points(1e-3, |t| {
            let scaled: Vec<f64> = impedance.iter().map(|z| (1.0 + t) * z).collect();
            model_of(&mesh, &protocol, &scaled, order).forward(&sigma).unwrap()
        });
        let error = largest(&(&slope - &contacts)) / largest(&voltages);
        println!("derivative along the impedances: {error:.1e}");
        assert!(error < 1e-10, "{order:?}: {error:e}");
    }
}

/// `v(t sigma, z / t) = v(sigma, z) / t`, and the Jacobian scales with `1 / t^2`. Fields do not
/// depend on the scale of the currents, down to currents whose squares underflow.
#[test]
fn scaling_conductivity_and_impedance_scales_voltages() {
    let at = |t: f64, current_a: f64| {
        let protocol = PairProtocol { electrodes: 12, current_a, ..Default::default() };
        let protocol = protocol.protocol().unwrap();
        let model = ForwardModel::new(&ring_disc(8), &protocol, &[0.05 / t; 12]).unwrap();
        let sigma = random_conductivity(&model, 5).iter().map(|s| s * t).collect::<Vec<_>>();
        (model.forward(&sigma).unwrap(), model.jacobian(&sigma).unwrap())
    };
    let (v, jacobian) = at(1.0, 1.0);
    // a power of two changes no rounding; other factors leave it times the condition number, 1e4
    let (scaled, steep) = at(1024.0, 1.0);
    assert_eq!(scaled * 1024.0, v);
    assert_eq!(steep * 1024.0 * 1024.0, jacobian);
    let (scaled, steep) = at(3.7e-5, 1.0);
    assert!(relative(&(scaled * 3.7e-5), &v) < 1e-12);
    assert!(relative(&(steep * 3.7e-5 * 3.7e-5), &jacobian) < 1e-12);
    for current_a in [1e-200, 1e200] {
        // one more rounding
        assert!(relative(&(at(1.0, current_a).1 / current_a), &jacobian) < 1e-14);
    }
}

/// Rows of sets of measurements that are multiples of each other, in both number types, and into
/// memory whose rows are not contiguous.
#[test]
fn unique_rows_and_their_factors_are_the_jacobian() {
    let model = ForwardModel::new(&ring_disc(8), &adjacent(12), &[0.05; 12]).unwrap();
    let sets = model.unique_measurements();
    // 12 x 9 measurements, in reciprocal pairs
    assert_eq!((sets.len(), sets.iter().map(Vec::len).sum::<usize>()), (54, 108));
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&random_conductivity(&model, 3), &mut workspace).unwrap();
    let (voltages, jacobian) = (solution.measurements(), solution.jacobian());
    let (double, single) = (solution.unique_jacobian::<f64>(), solution.unique_jacobian::<f32>());
    let mut columns = Array2::<f64>::zeros((model.elements(), sets.len()));
    solution.unique_jacobian_into(columns.view_mut().reversed_axes()).unwrap();
    for (row, set) in sets.iter().enumerate() {
        assert_eq!(set[0].1, 1.0);
        for &(datum, factor) in set {
            // the condition number of a voltage is about 1e4
            let difference = voltages[datum] - factor * voltages[set[0].0];
            assert!(difference.abs() <= 1e-11 * largest(&voltages));
            for (element, value) in jacobian.row(datum).iter().enumerate() {
                // two roundings from the factors
                let found = factor * double[[row, element]];
                assert!((found - value).abs() <= 2.0 * f64::EPSILON * value.abs());
                let found = factor * f64::from(single[[row, element]]);
                assert!((found - value).abs() <= f64::from(f32::EPSILON) * value.abs());
                assert_eq!(columns[[element, row]], double[[row, element]]);
            }
        }
    }
    let mut wrong = Array2::<f32>::zeros((108, model.elements()));
    refused(solution.unique_jacobian_into(wrong.view_mut()), "108");
}
