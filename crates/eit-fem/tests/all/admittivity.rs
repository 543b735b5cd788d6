//! Complex admittivity against the real model, closed forms, a dense real solve of twice the size,
//! SciPy, and the laws of circuits. The file is long because it contains the dense reference
//! solver.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{mesh_of, noise, ring_disc, ring_disc_angles, says, series_voltages, strip};
use eit_fem::analytic::DiscSeries;
use eit_fem::{
    AdmittivityModel, Complex64, DrivenElectrodes, FemError, ForwardModel, PairProtocol, Protocol,
};
use eit_mesh::{Electrode, Mesh};
use ndarray::{Array1, Array2, ArrayView, Dimension};

const I: Complex64 = Complex64::new(0.0, 1.0);

fn largest<D: Dimension>(values: ArrayView<'_, Complex64, D>) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.norm()))
}

/// Largest difference, relative to the largest value.
fn differ(found: &Array1<Complex64>, wanted: &Array1<Complex64>) -> f64 {
    largest((found - wanted).view()) / largest(wanted.view())
}

fn protocol(driven_electrodes: DrivenElectrodes) -> Protocol {
    let settings =
        PairProtocol { electrodes: 12, driven_electrodes, current_a: 0.5, ..Default::default() };
    settings.protocol().unwrap()
}

/// Elements that conduct, store charge or do both, with magnitudes over two decades.
fn fabric(elements: usize) -> Vec<Complex64> {
    let (size, phase) = (noise(3, elements), noise(4, elements));
    let element = |e: usize| {
        let size = 10f64.powf(2.0 * size[e] - 1.0);
        match e % 7 {
            0 => Complex64::new(size, 0.0),
            1 => Complex64::new(0.0, size),
            _ => Complex64::from_polar(size, phase[e] * std::f64::consts::FRAC_PI_2),
        }
    };
    (0..elements).map(element).collect()
}

/// Capacitive contacts, one of them purely capacitive.
fn contacts() -> Vec<Complex64> {
    let (re, im) = (noise(7, 12), noise(8, 12));
    (0..12)
        .map(|l| Complex64::new(if l == 5 { 0.0 } else { 0.02 + re[l] }, -0.01 - im[l]))
        .collect()
}

#[test]
fn without_capacitance_it_is_the_real_model() {
    let (mesh, protocol) = (ring_disc(8), protocol(DrivenElectrodes::Keep));
    let z: Vec<f64> = noise(7, 12).iter().map(|x| 0.05 + x).collect();
    let real = ForwardModel::new(&mesh, &protocol, &z).unwrap();
    let sigma: Vec<f64> = noise(3, real.elements()).iter().map(|x| 0.1 + x).collect();
    let complex = |list: &[f64]| list.iter().map(|x| Complex64::from(*x)).collect::<Vec<_>>();
    let model = AdmittivityModel::new(&mesh, &protocol, &complex(&z)).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&complex(&sigma), &mut workspace).unwrap();
    let (voltages, jacobian) = (solution.measurements(), solution.jacobian());
    // imaginary parts stay exactly zero
    assert!(voltages.iter().chain(&jacobian).all(|v| v.im == 0.0));
    let error = differ(&voltages, &real.forward(&sigma).unwrap().mapv(Complex64::from));
    let wanted = real.jacobian(&sigma).unwrap().mapv(Complex64::from);
    let slope = largest((&jacobian - &wanted).view()) / largest(wanted.view());
    let inside = solution.node_potentials();
    let mut real_workspace = real.workspace().unwrap();
    let mut reference = real.solve(&sigma, &mut real_workspace).unwrap();
    let potentials = reference.node_potentials().mapv(Complex64::from);
    let potential = largest((inside - &potentials).view()) / largest(potentials.view());
    println!("voltages {error:.1e}, Jacobian {slope:.1e}, potentials {potential:.1e}");
    // condition number about 1e4
    assert!(error < 1e-12 && slope < 1e-12 && potential < 1e-12);
    let report = solution.report();
    assert_eq!(report.phase_span_deg, 0.0);
    // the squared norm of each row of a real factor is the diagonal entry
    assert!((report.growth - 1.0).abs() < 1e-13, "{}", report.growth);
    assert!(report.backward_error < 1e-14, "{}", report.backward_error);
}

/// `V(t gamma, z / t) = V(gamma, z) / t` for every complex `t`, and the Jacobian scales with `1 /
/// t^2`. A rotation by 90 degrees turns all conductors into pure capacitors.
#[test]
fn a_common_phase_turns_the_voltages_and_no_more() {
    let (mesh, protocol) = (ring_disc(8), protocol(DrivenElectrodes::Drop));
    let z: Vec<f64> = noise(7, 12).iter().map(|x| 0.05 + x).collect();
    let real = ForwardModel::new(&mesh, &protocol, &z).unwrap();
    let sigma: Vec<f64> = noise(3, real.elements()).iter().map(|x| 0.1 + x).collect();
    let wanted = real.forward(&sigma).unwrap().mapv(Complex64::from);
    let slopes = real.jacobian(&sigma).unwrap().mapv(Complex64::from);
    for turn in [I, -I, Complex64::from_polar(3e-5, 0.7), Complex64::from_polar(20.0, -1.4)] {
        let z: Vec<_> = z.iter().map(|z| Complex64::from(*z) / turn).collect();
        let gamma: Vec<_> = sigma.iter().map(|s| turn * s).collect();
        let model = AdmittivityModel::new(&mesh, &protocol, &z).unwrap();
        let mut workspace = model.workspace().unwrap();
        let mut solution = model.solve(&gamma, &mut workspace).unwrap();
        let error = differ(&solution.measurements().mapv(|v| v * turn), &wanted);
        let jacobian = solution.jacobian().mapv(|j| j * turn * turn);
        let slope = largest((jacobian - &slopes).view()) / largest(slopes.view());
        println!("{turn}: voltages {error:.1e}, Jacobian {slope:.1e}");
        assert!(error < 1e-12 && slope < 1e-12);
        // rounding of the phases of 384 elements
        assert!(solution.report().phase_span_deg < 1e-12);
        assert!((solution.report().growth - 1.0).abs() < 1e-12);
    }
}

/// The mesh-free series is real; for a homogeneous disc, scaling by a complex factor extends it.
#[test]
fn homogeneous_disc_converges_to_the_turned_series() {
    let protocol = protocol(DrivenElectrodes::Drop);
    let turn = Complex64::from_polar(1.0, 0.9);
    let series = DiscSeries {
        radius_m: 1.0,
        conductivity_s: 0.8,
        electrode_angles_rad: ring_disc_angles(),
        electrode_width_m: std::f64::consts::TAU / 24.0,
        contact_impedance_ohm_m: 0.3,
        degree: 12,
        harmonics: 3000,
    };
    let exact = series_voltages(&series, &protocol, &[0.3; 12]).mapv(|v| v / turn);
    let error = |rings: usize| {
        let z = [Complex64::from(0.3) / turn; 12];
        let model = AdmittivityModel::new(&ring_disc(rings), &protocol, &z).unwrap();
        let voltages = model.forward(&vec![turn * 0.8; model.elements()]).unwrap();
        differ(&voltages, &exact)
    };
    let errors = [8, 16, 32].map(error);
    println!("{errors:?}");
    // order 2 with the logarithm of the electrode ends, as in the real model
    assert!(errors[1] < 0.3 * errors[0] && errors[2] < 0.3 * errors[1], "{errors:?}");
    assert!(errors[2] < 3e-3, "{errors:?}");
}

/// A strip carries a uniform current: `V = I (length / (gamma width) + (z_1 + z_2) / width)` and
/// `dV/dgamma_e = -A_e I / (gamma width)^2`, with unrelated phases.
#[test]
fn strip_has_its_closed_form() {
    let (length, width, current) = (0.3, 0.1, 1e-4);
    let gamma = Complex64::new(2e-5, 3e-5);
    let z = [Complex64::new(40.0, -90.0), Complex64::new(0.0, -15.0)];
    let mesh = strip(length, width, 12, 5);
    let protocol = Protocol::from_quadruples(2, &[[0, 1, 0, 1]], current).unwrap();
    let model = AdmittivityModel::new(&mesh, &protocol, &z).unwrap();
    let gammas = vec![gamma; model.elements()];
    let wanted = (length / (gamma * width) + (z[0] + z[1]) / width) * current;
    let found = model.forward(&gammas).unwrap()[0];
    // condition number about 1e4
    assert!((found - wanted).norm() < 1e-12 * wanted.norm(), "{found} {wanted}");
    let jacobian = model.jacobian(&gammas).unwrap();
    for (found, area) in jacobian.row(0).iter().zip(mesh.surface().areas_m2()) {
        let wanted = -area * current / (gamma * width).powi(2);
        // gradients lose one more digit
        assert!((found - wanted).norm() < 1e-11 * wanted.norm(), "{found} {wanted}");
    }
}

/// The textbook matrix of all node and electrode potentials, dense: gradients of hat functions
/// from edge normals, masses of edges. Shares no code with the library.
fn textbook(mesh: &Mesh, gamma: &[Complex64], z: &[Complex64]) -> Array2<Complex64> {
    let nodes = mesh.surface().nodes();
    let mut a = Array2::zeros((nodes.len() + z.len(), nodes.len() + z.len()));
    for (triangle, gamma) in mesh.surface().triangles().iter().zip(gamma) {
        let [p, q, r] = triangle.map(|n| nodes[n as usize]);
        let area = 0.5 * ((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]));
        let edges =
            [[r[0] - q[0], r[1] - q[1]], [p[0] - r[0], p[1] - r[1]], [q[0] - p[0], q[1] - p[1]]];
        for i in 0..3 {
            for j in 0..3 {
                let dot = edges[i][0] * edges[j][0] + edges[i][1] * edges[j][1];
                a[[triangle[i] as usize, triangle[j] as usize]] += gamma * (dot / (4.0 * area));
            }
        }
    }
    for (l, (electrode, z)) in mesh.electrodes().iter().zip(z).enumerate() {
        let Electrode::Rim(edges) = electrode else { panic!("rim electrodes") };
        let own = nodes.len() + l;
        for edge in edges {
            let [i, j] = edge.map(|n| n as usize);
            let h = (nodes[i][0] - nodes[j][0]).hypot(nodes[i][1] - nodes[j][1]);
            for (k, m, share) in [(i, i, 3.0), (j, j, 3.0), (i, j, 6.0), (j, i, 6.0)] {
                a[[k, m]] += Complex64::from(h / share) / z;
            }
            for k in [i, j] {
                a[[k, own]] -= Complex64::from(0.5 * h) / z;
                a[[own, k]] -= Complex64::from(0.5 * h) / z;
            }
            a[[own, own]] += Complex64::from(h) / z;
        }
    }
    a
}

/// Solves `(B + i C)(x + i y) = f` as `[B -C; C B] [x; y] = [f; 0]` by Gaussian elimination with
/// row exchanges; the last unknown is fixed at zero.
fn solve_in_reals(a: &Array2<Complex64>, f: &[f64]) -> Vec<Complex64> {
    let n = a.nrows() - 1;
    let mut m = Array2::<f64>::zeros((2 * n, 2 * n + 1));
    for i in 0..n {
        for j in 0..n {
            m[[i, j]] = a[[i, j]].re;
            m[[i, n + j]] = -a[[i, j]].im;
            m[[n + i, j]] = a[[i, j]].im;
            m[[n + i, n + j]] = a[[i, j]].re;
        }
        m[[i, 2 * n]] = f[i];
    }
    for k in 0..2 * n {
        let best = (k..2 * n).max_by(|&i, &j| m[[i, k]].abs().total_cmp(&m[[j, k]].abs())).unwrap();
        for j in 0..=2 * n {
            m.swap([k, j], [best, j]);
        }
        for i in k + 1..2 * n {
            let factor = m[[i, k]] / m[[k, k]];
            for j in k..=2 * n {
                let taken = factor * m[[k, j]];
                m[[i, j]] -= taken;
            }
        }
    }
    for k in (0..2 * n).rev() {
        let known: f64 = (k + 1..2 * n).map(|j| m[[k, j]] * m[[j, 2 * n]]).sum();
        m[[k, 2 * n]] = (m[[k, 2 * n]] - known) / m[[k, k]];
    }
    let value = |i: usize| {
        if i < n { Complex64::new(m[[i, 2 * n]], m[[n + i, 2 * n]]) } else { 0.0.into() }
    };
    (0..=n).map(value).collect()
}

fn voltages_in_reals(mesh: &Mesh, protocol: &Protocol, a: &Array2<Complex64>) -> Array1<Complex64> {
    let nodes = mesh.surface().nodes().len();
    let solve = |currents: ndarray::ArrayView1<'_, f64>| {
        let mut f = vec![0.0; nodes];
        f.extend(currents.iter());
        solve_in_reals(a, &f)
    };
    let fields: Vec<_> = protocol.stimulations_a().rows().into_iter().map(solve).collect();
    let patterns = protocol.measurement_patterns();
    let voltage = |&[s, m]: &[u32; 2]| {
        let potentials = &fields[s as usize][nodes..];
        patterns.row(m as usize).iter().zip(potentials).map(|(w, u)| u * w).sum()
    };
    protocol.data().iter().map(voltage).collect()
}

#[test]
fn voltages_are_those_of_a_dense_solve_in_real_numbers() {
    let (mesh, protocol) = (ring_disc(4), protocol(DrivenElectrodes::Keep));
    let model = AdmittivityModel::new(&mesh, &protocol, &contacts()).unwrap();
    let passive = fabric(model.elements());
    // both inductive and capacitive, up to 70 degrees each way: not a Higham matrix
    let turned: Vec<Complex64> = noise(11, model.elements())
        .iter()
        .zip(&passive)
        .map(|(x, y)| Complex64::from_polar(y.norm(), (140.0 * x - 70.0).to_radians()))
        .collect();
    let mut workspace = model.workspace().unwrap();
    for (gamma, growth) in [(&passive, 3.0), (&turned, 40.0)] {
        let wanted = voltages_in_reals(&mesh, &protocol, &textbook(&mesh, gamma, &contacts()));
        let mut solution = model.solve(gamma, &mut workspace).unwrap();
        let error = differ(&solution.measurements(), &wanted);
        let report = solution.report();
        println!("{error:.1e}: {report:?}");
        assert!(error < 1e-12, "{error:e}");
        assert!(report.backward_error < 1e-13 && error < report.expected_loss);
        assert!(report.growth < growth, "{}", report.growth);
    }
}

/// Voltages and a directional derivative against SciPy's complex sparse LU on a nodal assembly in
/// NumPy (`fixtures/golden/admittivity.py`).
#[test]
fn voltages_and_derivative_are_those_of_scipy() {
    let golden = fixtures::admittivity::load().unwrap();
    let mesh = mesh_of(&golden.mesh);
    let complex = |[re, im]: &[Array1<f64>; 2]| -> Vec<Complex64> {
        re.iter().zip(im).map(|(re, im)| Complex64::new(*re, *im)).collect()
    };
    let protocol = PairProtocol { current_a: 1.0, ..Default::default() }.protocol().unwrap();
    let model =
        AdmittivityModel::new(&mesh, &protocol, &complex(&golden.contact_impedance)).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&complex(&golden.admittivity), &mut workspace).unwrap();
    let error = differ(&solution.measurements(), &complex(&golden.voltages).into());
    let along = solution.jacobian().dot(&Array1::from(complex(&golden.direction)));
    let slope = differ(&along, &complex(&golden.derivative).into());
    println!("voltages {error:.1e}, derivative {slope:.1e}");
    // the condition number is about 1e5 on both sides
    assert!(error < 1e-12 && slope < 1e-12, "{error:e} {slope:e}");
}

#[test]
fn exchanging_current_and_voltage_changes_nothing() {
    let mesh = ring_disc(8);
    let pairs = [[0, 1, 4, 5], [4, 5, 0, 1], [2, 9, 3, 7], [3, 7, 2, 9], [0, 1, 0, 1]];
    let protocol = Protocol::from_quadruples(12, &pairs, 1.0).unwrap();
    let model = AdmittivityModel::new(&mesh, &protocol, &contacts()).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&fabric(model.elements()), &mut workspace).unwrap();
    let v = solution.measurements();
    // condition number about 1e4
    assert!((v[0] - v[1]).norm() < 1e-12 * v[4].norm());
    assert!((v[2] - v[3]).norm() < 1e-12 * v[4].norm());
    // reciprocal measurements share one product
    let jacobian = solution.jacobian();
    assert_eq!(jacobian.row(0), jacobian.row(1));
    let potentials = solution.electrode_potentials();
    for row in potentials.rows() {
        assert!(row.sum().norm() < 1e-14 * largest(row) * 12.0);
    }
}

/// `conj(U) . I = sum over elements of gamma |grad u|^2 + contacts`: the power of the currents is
/// dissipated in conductors (real part) and stored in capacitors (imaginary part). It is the energy
/// of the textbook matrix, whose rows also reproduce the currents.
#[test]
fn power_and_currents_are_conserved() {
    let (mesh, protocol) = (ring_disc(8), protocol(DrivenElectrodes::Keep));
    let model = AdmittivityModel::new(&mesh, &protocol, &contacts()).unwrap();
    let gamma = fabric(model.elements());
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&gamma, &mut workspace).unwrap();
    let (inside, outside) = (solution.node_potentials(), solution.electrode_potentials());
    let a = textbook(&mesh, &gamma, &contacts());
    for (s, currents) in protocol.stimulations_a().rows().into_iter().enumerate() {
        let x: Array1<Complex64> = inside.row(s).iter().chain(outside.row(s)).copied().collect();
        let flows = a.dot(&x);
        let nodes = inside.ncols();
        // a few hundred products of entries up to 100 and potentials of order one
        for (flow, current) in flows.iter().skip(nodes).zip(currents) {
            assert!((flow - current).norm() < 1e-12, "{flow} {current}");
        }
        assert!(flows.iter().take(nodes).all(|flow| flow.norm() < 1e-12));
        let stored: Complex64 = x.iter().zip(&flows).map(|(x, flow)| x.conj() * flow).sum();
        let given: Complex64 = outside.row(s).iter().zip(currents).map(|(u, i)| u.conj() * i).sum();
        assert!((stored - given).norm() < 1e-12 * given.norm());
        // dissipated and stored power are both positive in a passive skin
        assert!(given.re > 0.0 && given.im > 0.0, "{given}");
    }
}

/// The remainder after subtracting the Jacobian falls with the square of the step, for complex
/// directions and steps.
#[test]
fn taylor_remainders_have_slope_two() {
    let (mesh, protocol) = (ring_disc(8), protocol(DrivenElectrodes::Keep));
    let model = AdmittivityModel::new(&mesh, &protocol, &contacts()).unwrap();
    // away from the edges of the sector, so that every step stays inside
    let gamma: Vec<Complex64> =
        fabric(model.elements()).iter().map(|y| y + Complex64::new(0.3, 0.3)).collect();
    let (re, im) = (noise(21, gamma.len()), noise(22, gamma.len()));
    let direction: Array1<Complex64> =
        re.iter().zip(&im).map(|(x, y)| Complex64::new(x - 0.5, y - 0.5)).collect();
    let voltages = model.forward(&gamma).unwrap();
    let along = model.jacobian(&gamma).unwrap().dot(&direction);
    for phase in [0.0, 0.6, 1.5] {
        let remainder = |size: f64| {
            let step = Complex64::from_polar(size, phase);
            let moved: Vec<_> = gamma.iter().zip(&direction).map(|(y, d)| y + d * step).collect();
            let change = model.forward(&moved).unwrap() - &voltages;
            largest((change - along.mapv(|a| a * step)).view())
        };
        let remainders: Vec<f64> = (4..10).map(|k| remainder(0.5_f64.powi(k))).collect();
        let slopes: Vec<f64> = remainders.windows(2).map(|r| (r[0] / r[1]).log2()).collect();
        println!("phase {phase}: slopes {slopes:.3?}");
        // the third-order term is below a hundredth of the second-order term at the last steps
        assert!(slopes.iter().all(|s| (s - 2.0).abs() < 0.1), "{slopes:?}");
        assert!((slopes[4] - 2.0).abs() < 0.01, "{slopes:?}");
    }
}

/// Cauchy-Riemann: a step along `i d` changes the voltages by `i` times the change along `d`.
#[test]
fn voltages_are_holomorphic() {
    let (mesh, protocol) = (ring_disc(4), protocol(DrivenElectrodes::Keep));
    let model = AdmittivityModel::new(&mesh, &protocol, &contacts()).unwrap();
    let gamma: Vec<Complex64> =
        fabric(model.elements()).iter().map(|y| y + Complex64::new(0.3, 0.3)).collect();
    let direction = noise(23, gamma.len());
    let slope = |turn: Complex64| {
        let h = 1e-4;
        let at = |h: f64| {
            let moved = gamma.iter().zip(&direction).map(|(y, d)| y + turn * d * h);
            model.forward(&moved.collect::<Vec<_>>()).unwrap()
        };
        (at(h) - at(-h)).mapv(|v| v / (2.0 * h))
    };
    let (real, imaginary) = (slope(Complex64::from(1.0)), slope(I));
    // central differences: h^2 = 1e-8 of the third derivative
    assert!(differ(&imaginary, &real.mapv(|v| I * v)) < 1e-6);
}

/// Magnitudes over eight decades, all phases between conductor and capacitor, stiff contacts.
#[test]
fn growth_stays_below_three_in_passive_skins() {
    let (mesh, protocol) = (ring_disc(16), protocol(DrivenElectrodes::Drop));
    for (seed, z) in [(31, 1e-3), (32, 1.0), (33, 1e3)] {
        let z = [Complex64::new(z, -z); 12];
        let model = AdmittivityModel::new(&mesh, &protocol, &z).unwrap();
        let (size, phase) = (noise(seed, model.elements()), noise(seed + 10, model.elements()));
        let gamma: Vec<Complex64> = size
            .iter()
            .zip(&phase)
            .map(|(s, p)| Complex64::from_polar(10f64.powf(8.0 * s - 4.0), p * 1.57))
            .collect();
        let mut workspace = model.workspace().unwrap();
        let report = model.solve(&gamma, &mut workspace).unwrap().report();
        // a real skin with the same magnitudes has componentwise errors that are no smaller
        let real = ForwardModel::new(&mesh, &protocol, &[z[0].norm(); 12]).unwrap();
        let sigma: Vec<f64> = gamma.iter().map(|y| y.norm()).collect();
        let mut real_workspace = real.workspace().unwrap();
        let found = real.solve(&sigma, &mut real_workspace).unwrap().report();
        println!("{report:?}; real {:.1e}", found.backward_error);
        assert!(report.growth < 3.0, "{}", report.growth);
        assert!(report.backward_error < 10.0 * found.backward_error);
    }
}

#[test]
fn bad_input_is_named() {
    let (mesh, protocol) = (ring_disc(4), protocol(DrivenElectrodes::Drop));
    let model = AdmittivityModel::new(&mesh, &protocol, &contacts()).unwrap();
    let good = fabric(model.elements());
    for (value, text) in [
        (Complex64::new(-1.0, 2.0), "-1+2i"),
        (Complex64::new(0.0, 0.0), "0+0i"),
        (Complex64::new(f64::NAN, 0.0), "NaN+0i"),
        (Complex64::new(1.0, f64::INFINITY), "1+infi"),
    ] {
        let mut gamma = good.clone();
        gamma[17] = value;
        says(
            model.forward(&gamma),
            &format!(
                "the admittivity of element 17 is {text} S: its real part must be zero or above, \
                 and not both parts zero (1 of the elements are invalid; model a hole by leaving \
                 elements out of the mesh)"
            ),
        );
        let mut z = contacts();
        z[2] = value;
        says(
            AdmittivityModel::new(&mesh, &protocol, &z),
            &format!(
                "the contact impedance of electrode 3 is {text}: with complex admittivities it \
                 must be finite and non-zero, with a real part of zero or above (only the real \
                 model supports shunts and ideal current sources)"
            ),
        );
    }
    says(model.forward(&good[1..]), "admittivity (one per element): 95 values given, 96 needed");
    says(
        AdmittivityModel::new(&mesh, &protocol, &contacts()[1..]),
        "contact impedance (one per electrode): 11 values given, 12 needed",
    );
    // a lossless inductor together with a purely capacitive contact
    let mut resonant = good.clone();
    resonant[0] = -I;
    says(
        model.forward(&resonant),
        "the phases of the admittivities and contact admittances range from -90.000 to 90.000 degrees: \
         they must span less than 180 degrees, or capacitors and inductors may cancel \
         (capacitive admittivities have positive imaginary parts, capacitive impedances negative \
         ones)",
    );
    let other = AdmittivityModel::new(&ring_disc(8), &protocol, &contacts()).unwrap();
    let mut workspace = other.workspace().unwrap();
    let found = model.solve(&good, &mut workspace).unwrap_err();
    assert!(matches!(found, FemError::WrongLength { .. }), "{found}");
    let mut few = [Complex64::from(0.0); 3];
    let mut workspace = model.workspace().unwrap();
    assert!(model.solve(&good, &mut workspace).unwrap().measurements_into(&mut few).is_err());
}

#[test]
fn a_second_solve_allocates_nothing() {
    let (mesh, protocol) = (ring_disc(8), protocol(DrivenElectrodes::Keep));
    let model = AdmittivityModel::new(&mesh, &protocol, &contacts()).unwrap();
    let gamma = fabric(model.elements());
    let mut workspace = model.workspace().unwrap();
    let mut voltages = vec![Complex64::from(0.0); protocol.measurements()];
    let mut jacobian = Array2::zeros((protocol.measurements(), model.elements()));
    let mut solve = || {
        let mut solution = model.solve(&gamma, &mut workspace).unwrap();
        solution.measurements_into(&mut voltages).unwrap();
        solution.jacobian_into(jacobian.view_mut()).unwrap();
    };
    solve();
    let info = allocation_counter::measure(solve);
    assert_eq!(info.count_total, 0, "{info:?}");
}
