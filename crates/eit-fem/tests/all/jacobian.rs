//! The Jacobian against closed forms and the energy identity.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{largest, noise, ring_disc};
use eit_fem::{DrivenElectrodes, ForwardModel, PairProtocol};
use eit_mesh::Electrode;
use ndarray::{Array1, Array2, aview1};

/// Voltage is energy: `v = sum_e -J_e sigma_e + sum_l 1/z_l integral (U - u)(U* - u*)`, the second
/// sum from node potentials and edge integrals, with random conductivity and impedances.
/// The second sum is also `sum_l z_l dv/dz_l` (Euler: `v` is homogeneous of degree -1 in sigma and
/// 1/z), which central differences confirm.
#[test]
fn jacobian_and_contacts_add_up_to_the_voltage() {
    let mesh = ring_disc(8);
    let impedance: Vec<f64> = noise(7, 12).iter().map(|x| 0.05 + x).collect();
    let current_a = 0.5;
    let keep = PairProtocol {
        electrodes: 12,
        driven_electrodes: DrivenElectrodes::Keep,
        current_a,
        ..Default::default()
    };
    let protocol = keep.protocol().unwrap();
    let model = ForwardModel::new(&mesh, &protocol, &impedance).unwrap();
    let sigma: Vec<f64> = noise(3, model.elements()).iter().map(|x| 0.5 + x).collect();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&sigma, &mut workspace).unwrap();
    let (voltages, jacobian) = (solution.measurements(), solution.jacobian());
    let (inside, outside) = (solution.node_potentials(), solution.electrode_potentials());
    let contacts: Array1<f64> = protocol
        .quadruples()
        .unwrap()
        .iter()
        // pair (m, m + 1) is also drive m: its field for one ampere is the adjoint field
        .map(|&[a, _, m, _]| {
            contact_energy(&mesh, &impedance, &inside, &outside, [a, m]) / current_a
        })
        .collect();
    let inner = -jacobian.dot(&aview1(&sigma));
    let error = largest(&(&inner + &contacts - &voltages)) / largest(&voltages);
    println!("energy identity: {error:.1e}");
    // condition number about 1e4
    assert!(error < 1e-12, "{error:e}");

    let at = |factor: f64| {
        let scaled: Vec<f64> = impedance.iter().map(|z| factor * z).collect();
        ForwardModel::new(&mesh, &protocol, &scaled).unwrap().forward(&sigma).unwrap()
    };
    // five points: h^4 = 1e-12 of the fifth derivative, rounding 1e-14 / h
    let h = 1e-3;
    let slope =
        (8.0 * (at(1.0 + h) - at(1.0 - h)) - (at(1.0 + 2.0 * h) - at(1.0 - 2.0 * h))) / (12.0 * h);
    let error = largest(&(&slope - &contacts)) / largest(&voltages);
    println!("derivative along the impedances: {error:.1e}");
    assert!(error < 1e-10, "{error:e}");
}

/// `1/z_l integral (U - u)(U* - u*)` summed over the electrodes; P1 on an edge of length `h`:
/// `h/6 (2 p0 q0 + p0 q1 + p1 q0 + 2 p1 q1)`.
fn contact_energy(
    mesh: &eit_mesh::Mesh,
    impedance: &[f64],
    inside: &Array2<f64>,
    outside: &Array2<f64>,
    drives: [u32; 2],
) -> f64 {
    let mut energy = 0.0;
    for (l, electrode) in mesh.electrodes().iter().enumerate() {
        let Electrode::Rim(edges) = electrode else { panic!("rim electrodes") };
        for edge in edges {
            let [p, q] = edge.map(|n| mesh.surface().nodes()[n as usize]);
            let length = (p[0] - q[0]).hypot(p[1] - q[1]);
            let [[p0, p1], [q0, q1]] = drives
                .map(|d| edge.map(|n| outside[[d as usize, l]] - inside[[d as usize, n as usize]]));
            let mean = (2.0 * p0 * q0 + p0 * q1 + p1 * q0 + 2.0 * p1 * q1) / 6.0;
            energy += length * mean / impedance[l];
        }
    }
    energy
}

/// `v(t sigma, z / t) = v(sigma, z) / t`, and the Jacobian scales with `1 / t^2`.
#[test]
fn scaling_conductivity_and_impedance_scales_voltages() {
    let mesh = ring_disc(8);
    let protocol = PairProtocol { electrodes: 12, ..Default::default() }.protocol().unwrap();
    let sigma =
        noise(5, mesh.surface().triangles().len()).iter().map(|x| 0.5 + x).collect::<Vec<_>>();
    let at = |t: f64| {
        let model = ForwardModel::new(&mesh, &protocol, &[0.05 / t; 12]).unwrap();
        let scaled: Vec<f64> = sigma.iter().map(|s| s * t).collect();
        (model.forward(&scaled).unwrap(), model.jacobian(&scaled).unwrap())
    };
    let (v, jacobian) = at(1.0);
    // a power of two changes no rounding; other factors leave rounding times the condition number,
    // 1e4
    let (scaled, steep) = at(1024.0);
    assert_eq!(scaled * 1024.0, v);
    assert_eq!(steep * 1024.0 * 1024.0, jacobian);
    let (scaled, steep) = at(3.7e-5);
    assert!(largest(&(scaled * 3.7e-5 - &v)) < 1e-12 * largest(&v));
    assert!(largest(&(steep * 3.7e-5 * 3.7e-5 - &jacobian)) < 1e-12 * largest(&jacobian));
}

/// Fields do not depend on the scale of the currents, down to currents whose squares underflow.
#[test]
fn tiny_and_huge_currents_scale_the_jacobian() {
    let mesh = ring_disc(8);
    let jacobian = |current_a: f64| {
        let settings = PairProtocol { electrodes: 12, current_a, ..Default::default() };
        let model = ForwardModel::new(&mesh, &settings.protocol().unwrap(), &[0.05; 12]).unwrap();
        model.jacobian(&vec![1.0; model.elements()]).unwrap()
    };
    let one = jacobian(1.0);
    for current in [1e-200, 1e200] {
        // one more rounding
        assert!(largest(&(jacobian(current) / current - &one)) < 1e-14 * largest(&one));
    }
}

/// Rows of sets of measurements that are multiples of each other, in both number types, and into
/// memory whose rows are not contiguous.
#[test]
fn unique_rows_and_their_factors_are_the_jacobian() {
    let protocol = PairProtocol { electrodes: 12, ..Default::default() }.protocol().unwrap();
    let model = ForwardModel::new(&ring_disc(8), &protocol, &[0.05; 12]).unwrap();
    let sets = model.unique_measurements();
    // 12 x 9 measurements, in reciprocal pairs
    assert_eq!((sets.len(), sets.iter().map(Vec::len).sum::<usize>()), (54, 108));
    let sigma: Vec<f64> = noise(3, model.elements()).iter().map(|x| 0.5 + x).collect();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&sigma, &mut workspace).unwrap();
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
    let refused = solution.unique_jacobian_into(wrong.view_mut()).unwrap_err();
    assert!(refused.to_string().contains("108"), "{refused}");
}
