//! Complex admittivity against the real model, closed forms, a dense real solve of twice the size,
//! SciPy, and the laws of circuits.

use crate::common::textbook::{self, Number};
use crate::common::{
    adjacent, halving_orders, kept, mesh_of, noise, refused, ring_disc, says, uneven,
};
use eit_fem::{AdmittivityModel, Complex64, ForwardModel, PairProtocol, Protocol};
use eit_mesh::Mesh;
use ndarray::{Array, Array1, Array2, ArrayView, Dimension};

const I: Complex64 = Complex64::new(0.0, 1.0);

fn largest<D: Dimension>(values: ArrayView<'_, Complex64, D>) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(v.norm()))
}

/// Largest difference, relative to the largest value.
fn differ<D: Dimension>(found: &Array<Complex64, D>, wanted: &Array<Complex64, D>) -> f64 {
    largest((found - wanted).view()) / largest(wanted.view())
}

fn complex(list: &[f64]) -> Vec<Complex64> {
    list.iter().map(|x| Complex64::from(*x)).collect()
}

impl Number for Complex64 {
    fn of(x: f64) -> Self {
        x.into()
    }
    fn size(&self) -> f64 {
        self.norm()
    }
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
    let (mesh, protocol) = (ring_disc(8), kept());
    let z = uneven(7, 12, 0.05);
    let real = ForwardModel::new(&mesh, &protocol, &z).unwrap();
    let sigma = uneven(3, real.elements(), 0.1);
    let model = AdmittivityModel::new(&mesh, &protocol, &complex(&z)).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&complex(&sigma), &mut workspace).unwrap();
    let (voltages, jacobian) = (solution.measurements(), solution.jacobian());
    // imaginary parts stay exactly zero
    assert!(voltages.iter().chain(&jacobian).all(|v| v.im == 0.0));
    let mut real_workspace = real.workspace().unwrap();
    let mut reference = real.solve(&sigma, &mut real_workspace).unwrap();
    let error = differ(&voltages, &reference.measurements().mapv(Complex64::from));
    let slope = differ(&jacobian, &reference.jacobian().mapv(Complex64::from));
    let potentials = reference.node_potentials().mapv(Complex64::from);
    let potential = differ(&solution.node_potentials().to_owned(), &potentials);
    println!("voltages {error:.1e}, Jacobian {slope:.1e}, potentials {potential:.1e}");
    // condition number about 1e4
    assert!(error < 1e-12 && slope < 1e-12 && potential < 1e-12);
    let report = solution.report();
    assert_eq!(report.phase_span_deg, 0.0);
    // the squared norm of each row of a real factor is the diagonal entry
    assert!((report.growth - 1.0).abs() < 1e-13, "{}", report.growth);
    assert!(report.backward_error < 1e-14, "{}", report.backward_error);
}

/// `V(t gamma, z / t) = V(gamma, z) / t` for every complex `t`, and the Jacobian scales with `1 / t^2`.
/// A rotation by 90 degrees turns all conductors into pure capacitors.
#[test]
fn a_common_phase_turns_the_voltages_and_no_more() {
    let (mesh, protocol) = (ring_disc(8), adjacent(12));
    let z = uneven(7, 12, 0.05);
    let real = ForwardModel::new(&mesh, &protocol, &z).unwrap();
    let sigma = uneven(3, real.elements(), 0.1);
    let wanted = real.forward(&sigma).unwrap().mapv(Complex64::from);
    let slopes = real.jacobian(&sigma).unwrap().mapv(Complex64::from);
    for turn in [I, -I, Complex64::from_polar(3e-5, 0.7), Complex64::from_polar(20.0, -1.4)] {
        let z: Vec<_> = z.iter().map(|z| Complex64::from(*z) / turn).collect();
        let gamma: Vec<_> = sigma.iter().map(|s| turn * s).collect();
        let model = AdmittivityModel::new(&mesh, &protocol, &z).unwrap();
        let mut workspace = model.workspace().unwrap();
        let mut solution = model.solve(&gamma, &mut workspace).unwrap();
        let error = differ(&solution.measurements().mapv(|v| v * turn), &wanted);
        let slope = differ(&solution.jacobian().mapv(|j| j * turn * turn), &slopes);
        println!("{turn}: voltages {error:.1e}, Jacobian {slope:.1e}");
        assert!(error < 1e-12 && slope < 1e-12);
        // rounding of the phases of 384 elements
        assert!(solution.report().phase_span_deg < 1e-12);
        assert!((solution.report().growth - 1.0).abs() < 1e-12);
    }
}

fn textbook(mesh: &Mesh, gamma: &[Complex64], z: &[Complex64]) -> Vec<Vec<Complex64>> {
    let admittance: Vec<Complex64> = z.iter().map(|z| 1.0 / z).collect();
    textbook::matrix(mesh, gamma, &admittance)
}

/// Voltages of `(B + i C)(x + i y) = f` as `[B -C; C B] [x; y] = [f; 0]`, the last electrode at zero.
fn solved_in_reals(mesh: &Mesh, protocol: &Protocol, a: Vec<Vec<Complex64>>) -> Array1<Complex64> {
    let (nodes, a) = (mesh.surface().nodes().len(), textbook::grounded(a));
    let n = a.len();
    let block = |row: &[Complex64], turn: Complex64| -> Vec<f64> {
        let turned = [turn, turn * I].map(|turn| row.iter().map(move |x| (x * turn).re));
        turned.into_iter().flatten().collect()
    };
    // real parts of the rows, and of the rows times -i: the imaginary parts
    let doubled = [Complex64::from(1.0), -I];
    let doubled = doubled.into_iter().flat_map(|turn| a.iter().map(move |row| block(row, turn)));
    let stimulations = protocol.stimulations_a();
    let currents = stimulations.rows().into_iter().map(|currents| {
        let mut f = vec![0.0; 2 * n];
        f[nodes..n].copy_from_slice(&currents.to_vec()[..n - nodes]);
        f
    });
    let fields = textbook::solve(doubled.collect(), &currents.collect::<Vec<_>>(), nodes);
    let patterns = protocol.measurement_patterns();
    let voltage = |&[s, m]: &[u32; 2]| {
        let x = &fields[s as usize];
        let potentials = (nodes..n).map(|k| Complex64::new(x[k], x[n + k]));
        patterns.row(m as usize).iter().zip(potentials).map(|(w, u)| u * w).sum()
    };
    protocol.data().iter().map(voltage).collect()
}

#[test]
fn voltages_are_those_of_a_dense_solve_in_real_numbers() {
    let (mesh, protocol) = (ring_disc(4), kept());
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
        let wanted = solved_in_reals(&mesh, &protocol, textbook(&mesh, gamma, &contacts()));
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
    let joined = |[re, im]: &[Array1<f64>; 2]| -> Vec<Complex64> {
        re.iter().zip(im).map(|(re, im)| Complex64::new(*re, *im)).collect()
    };
    let protocol = PairProtocol { current_a: 1.0, ..Default::default() }.protocol().unwrap();
    let model =
        AdmittivityModel::new(&mesh, &protocol, &joined(&golden.contact_impedance)).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&joined(&golden.admittivity), &mut workspace).unwrap();
    let error = differ(&solution.measurements(), &joined(&golden.voltages).into());
    let along = solution.jacobian().dot(&Array1::from(joined(&golden.direction)));
    let slope = differ(&along, &joined(&golden.derivative).into());
    println!("voltages {error:.1e}, derivative {slope:.1e}");
    // the condition number is about 1e5 on both sides
    assert!(error < 1e-12 && slope < 1e-12, "{error:e} {slope:e}");
}

/// `conj(U) . I = sum over elements of gamma |grad u|^2 + contacts`: the power is dissipated (real
/// part) and stored (imaginary part). The rows of the textbook matrix also reproduce the currents.
#[test]
fn power_and_currents_are_conserved() {
    let (mesh, protocol) = (ring_disc(8), kept());
    let model = AdmittivityModel::new(&mesh, &protocol, &contacts()).unwrap();
    let gamma = fabric(model.elements());
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&gamma, &mut workspace).unwrap();
    let (inside, outside) = (solution.node_potentials(), solution.electrode_potentials());
    // exchanging current and voltage changes nothing; the condition number is about 1e4
    let (v, jacobian) = (solution.measurements(), solution.jacobian());
    let quadruples = protocol.quadruples().unwrap();
    for (i, &[a, b, m, n]) in quadruples.iter().enumerate() {
        let j = quadruples.iter().position(|&q| q == [m, n, a, b]).unwrap();
        assert!((v[i] - v[j]).norm() < 1e-12 * largest(v.view()));
        // reciprocal measurements share one product
        assert_eq!(jacobian.row(i), jacobian.row(j));
    }
    assert!(outside.rows().into_iter().all(|row| row.sum().norm() < 1.2e-13 * largest(row)));
    let a = textbook(&mesh, &gamma, &contacts());
    for (s, currents) in protocol.stimulations_a().rows().into_iter().enumerate() {
        let x: Array1<Complex64> = inside.row(s).iter().chain(outside.row(s)).copied().collect();
        let flows: Array1<Complex64> =
            a.iter().map(|row| row.iter().zip(&x).map(|(a, x)| a * x).sum()).collect();
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

/// Remainders fall with the square of complex steps in complex directions: voltages are holomorphic.
#[test]
fn taylor_remainders_have_slope_two() {
    let model = AdmittivityModel::new(&ring_disc(8), &kept(), &contacts()).unwrap();
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
        let slopes = halving_orders(&remainders);
        println!("phase {phase}: slopes {slopes:.3?}");
        // the third-order term is below a hundredth of the second-order term at the last steps
        assert!(slopes.iter().all(|s| (s - 2.0).abs() < 0.1), "{slopes:?}");
        assert!((slopes[4] - 2.0).abs() < 0.01, "{slopes:?}");
    }
}

/// Magnitudes over eight decades, all phases between conductor and capacitor, stiff contacts.
#[test]
fn growth_stays_below_three_in_passive_skins() {
    let (mesh, protocol) = (ring_disc(16), adjacent(12));
    for (seed, z) in [(31, 1e-3), (32, 1.0), (33, 1e3)] {
        let z = [Complex64::new(z, -z); 12];
        let model = AdmittivityModel::new(&mesh, &protocol, &z).unwrap();
        let (size, phase) = (noise(seed, model.elements()), noise(seed + 10, model.elements()));
        let gamma: Vec<Complex64> = size
            .iter()
            .zip(&phase)
            .map(|(s, p)| Complex64::from_polar(10f64.powf(8.0 * s - 4.0), p * 1.57))
            .collect();
        let report = model.solve(&gamma, &mut model.workspace().unwrap()).unwrap().report();
        // a real skin with the same magnitudes has componentwise errors that are no smaller
        let real = ForwardModel::new(&mesh, &protocol, &[z[0].norm(); 12]).unwrap();
        let sigma: Vec<f64> = gamma.iter().map(|y| y.norm()).collect();
        let found = real.solve(&sigma, &mut real.workspace().unwrap()).unwrap().report();
        println!("{report:?}; real {:.1e}", found.backward_error);
        assert!(report.growth < 3.0, "{}", report.growth);
        assert!(report.backward_error < 10.0 * found.backward_error);
    }
}

#[test]
fn bad_input_is_named() {
    let (mesh, protocol) = (ring_disc(4), adjacent(12));
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
    refused(model.solve(&good, &mut other.workspace().unwrap()), "values given, ");
    let mut workspace = model.workspace().unwrap();
    let solution = model.solve(&good, &mut workspace).unwrap();
    refused(solution.measurements_into(&mut [Complex64::from(0.0); 3]), "3 values given, ");
}

#[test]
fn a_second_solve_allocates_nothing() {
    let model = AdmittivityModel::new(&ring_disc(8), &kept(), &contacts()).unwrap();
    let (measurements, gamma) = (model.protocol().measurements(), fabric(model.elements()));
    let mut workspace = model.workspace().unwrap();
    let mut voltages = vec![Complex64::from(0.0); measurements];
    let mut jacobian = Array2::zeros((measurements, model.elements()));
    let mut solve = || {
        let mut solution = model.solve(&gamma, &mut workspace).unwrap();
        solution.measurements_into(&mut voltages).unwrap();
        solution.jacobian_into(jacobian.view_mut()).unwrap();
    };
    solve();
    let info = allocation_counter::measure(solve);
    assert_eq!(info.count_total, 0, "{info:?}");
}
