//! Accurate solves with stiff contacts, high contrast and slivers, against 400-bit solutions and
//! exact rational arithmetic. The file is long because it contains the rational reference solver.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "tests")]

use crate::common;
use crate::common::{largest, noise, ring_disc, strip};
use eit_fem::{DrivenElectrodes, FemError, ForwardModel, PairProtocol, Protocol, SolvePath};
use eit_mesh::{Electrode, Mesh, MeshSettings, RimElectrodes, SkinShape, Surface, generate};
use num_rational::BigRational;
use proptest::prelude::*;

/// The smallest required accuracy that is accepted.
const FINEST: f64 = 1e-15;

/// Every value of every case is accurate to 4 eps of the value (rounding of the result and of the
/// file), and the reported bound holds.
#[test]
fn every_extreme_case_keeps_every_digit() {
    let Some(extreme) = fixtures::extreme::load().unwrap() else { return };
    let protocol = PairProtocol { current_a: 1.0, ..Default::default() }.protocol().unwrap();
    for case in &extreme.cases {
        let name = &case.name;
        let mesh = common::mesh_of(&extreme.mesh_of(case));
        let model = ForwardModel::new(&mesh, &protocol, &case.contact_impedance.to_vec()).unwrap();
        let mut workspace = model.workspace().unwrap();
        let conductivity = case.conductivity.to_vec();
        let mut solution = model.solve_to(&conductivity, FINEST, &mut workspace).unwrap();
        let (found, bounds) = (solution.measurements(), solution.measurement_bounds());
        let report = solution.report();
        assert_eq!(report.path, SolvePath::ExtendedPrecision);
        let mut worst = 0.0_f64;
        for ((v, wanted), bound) in found.iter().zip(&case.voltages).zip(bounds) {
            worst = worst.max((v - wanted).abs() / wanted.abs());
            assert!((v - wanted).abs() <= bound, "{name}: {v:e} {wanted:e}, bound {bound:e}");
        }
        println!(
            "{name:>12}: worst value {worst:.1e}, bound {:.1e} of the largest, {:.1e} of each, \
             condition {:.0e}, backward error {:.0e}, {:.1} ms",
            report.error_bound,
            report.value_error_bound,
            report.condition,
            report.backward_error,
            1e3 * report.time_s
        );
        assert!(worst < 4.0 * f64::EPSILON, "{name}: {worst:e}");
        assert!(report.value_error_bound < 1e-8, "{name}: {:e}", report.value_error_bound);
    }
}

/// The same cases to eight digits: every bound holds, and extreme contact impedances alone never
/// need twice the precision.
#[test]
fn extreme_cases_to_eight_digits_by_the_cheapest_path() {
    let Some(extreme) = fixtures::extreme::load().unwrap() else { return };
    let protocol = PairProtocol { current_a: 1.0, ..Default::default() }.protocol().unwrap();
    for case in &extreme.cases {
        let name = &case.name;
        let mesh = common::mesh_of(&extreme.mesh_of(case));
        let model = ForwardModel::new(&mesh, &protocol, &case.contact_impedance.to_vec()).unwrap();
        let mut workspace = model.workspace().unwrap();
        let conductivity = case.conductivity.to_vec();
        let mut solution = model.solve_to(&conductivity, 1e-8, &mut workspace).unwrap();
        let (found, bounds) = (solution.measurements(), solution.measurement_bounds());
        let report = solution.report();
        let mut worst = 0.0_f64;
        for ((v, wanted), bound) in found.iter().zip(&case.voltages).zip(bounds) {
            worst = worst.max((v - wanted).abs());
            assert!((v - wanted).abs() <= bound, "{name}: {v:e} {wanted:e}, bound {bound:e}");
        }
        println!(
            "{name:>12}: {:?}, worst {:.1e} of the largest, bound {:.1e}, {:.1} ms",
            report.path,
            worst / largest(&case.voltages),
            report.error_bound,
            1e3 * report.time_s
        );
        assert!(report.error_bound <= 1e-8, "{name}");
        let even = conductivity.iter().all(|s| *s == conductivity[0]);
        assert!(!even || name == "sliver" || report.path != SolvePath::ExtendedPrecision, "{name}");
    }
}

/// With ordinary values and accuracy, nodal assembly is used and the results are bit-identical to
/// `solve`.
#[test]
fn the_plain_path_is_taken_where_it_suffices() {
    let protocol = PairProtocol { electrodes: 12, ..Default::default() }.protocol().unwrap();
    let model = ForwardModel::new(&ring_disc(8), &protocol, &[0.05; 12]).unwrap();
    let conductivity = vec![1.0; model.elements()];
    let (mut one, mut two) = (model.workspace().unwrap(), model.workspace().unwrap());
    let mut wished = model.solve_to(&conductivity, 1e-9, &mut one).unwrap();
    assert_eq!(wished.report().path, SolvePath::NodalAssembly);
    assert!(wished.report().error_bound <= 1e-9);
    let plain = model.solve(&conductivity, &mut two).unwrap();
    assert_eq!(wished.measurements(), plain.measurements());
    let mut finest = model.solve_to(&conductivity, FINEST, &mut one).unwrap();
    assert_eq!(finest.report().path, SolvePath::ExtendedPrecision);
    let change = finest.measurements() - plain.measurements();
    // the condition number of this matrix is about 1e4
    assert!(largest(&change) < 1e-12 * largest(&plain.measurements()));
    for wish in [0.0, -1.0, f64::NAN, 1.0, f64::EPSILON] {
        let refused = model.solve_to(&conductivity, wish, &mut two);
        assert!(matches!(refused, Err(FemError::OutOfRange { .. })), "{wish}");
    }
}

/// The paper's disc: accuracy of nodal assembly and cost of electrode elimination.
#[test]
fn the_papers_disc_keeps_twelve_digits_on_the_plain_path() {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let mesh = generate(&skin, &electrodes, &MeshSettings::default()).unwrap();
    let protocol = PairProtocol::default().protocol().unwrap();
    let model = ForwardModel::new(&mesh, &protocol, &[1e3; 16]).unwrap();
    let conductivity: Vec<f64> =
        noise(6, model.elements()).iter().map(|x| 1e-5 * (0.5 + x)).collect();
    let (mut one, mut two) = (model.workspace().unwrap(), model.workspace().unwrap());
    let plain = model.solve(&conductivity, &mut one).unwrap().measurements();
    let mut solution = model.solve_to(&conductivity, FINEST, &mut two).unwrap();
    let exact = solution.measurements();
    let (report, error) = (solution.report(), largest(&(&plain - &exact)) / largest(&exact));
    println!(
        "{} nodes: nodal assembly wrong by {error:.1e} of the largest voltage; electrode elimination {:.0} ms, \
         {} entries, bound {:.1e}",
        mesh.surface().nodes().len(),
        1e3 * report.time_s,
        report.factor_entries,
        report.error_bound
    );
    // the condition number is about 1e4
    assert!(error < 1e-12, "{error:e}");
}

/// Fields of both paths agree where both are accurate, with the same reference potential.
#[test]
fn fields_and_jacobian_of_both_paths_agree() {
    let kept = PairProtocol {
        electrodes: 12,
        driven_electrodes: DrivenElectrodes::Keep,
        current_a: 1e-3,
        ..Default::default()
    };
    let protocol = kept.protocol().unwrap();
    let impedance: Vec<f64> = noise(3, 12).iter().map(|x| 0.01 + x).collect();
    let model = ForwardModel::new(&ring_disc(8), &protocol, &impedance).unwrap();
    let conductivity: Vec<f64> = noise(4, model.elements()).iter().map(|x| 0.5 + x).collect();
    let (mut one, mut two) = (model.workspace().unwrap(), model.workspace().unwrap());
    let mut plain = model.solve(&conductivity, &mut one).unwrap();
    let mut exact = model.solve_to(&conductivity, FINEST, &mut two).unwrap();
    // 1e-12: rounding of nodal assembly with a condition number of about 1e4
    let near = |a: Vec<f64>, b: Vec<f64>| {
        let worst = a.iter().zip(&b).fold(0.0_f64, |m, (x, y)| m.max((x - y).abs()));
        assert!(worst < 1e-12 * largest(&a), "{worst:e} of {:e}", largest(&a));
    };
    let flat = |a: ndarray::Array2<f64>| a.iter().copied().collect::<Vec<f64>>();
    near(plain.measurements().to_vec(), exact.measurements().to_vec());
    near(flat(plain.electrode_potentials()), flat(exact.electrode_potentials()));
    near(flat(plain.node_potentials()), flat(exact.node_potentials()));
    near(flat(plain.jacobian()), flat(exact.jacobian()));
}

/// A shunt is the limit of small impedances, an ideal current source that of large ones.
#[test]
fn limits_of_contact_impedance_are_limits() {
    let protocol = PairProtocol { electrodes: 12, current_a: 1.0, ..Default::default() };
    let protocol = protocol.protocol().unwrap();
    let solve = |z: f64, accuracy: Option<f64>| {
        let mut impedance = [0.05; 12];
        (impedance[2], impedance[3], impedance[11]) = (z, z, z);
        let model = ForwardModel::new(&ring_disc(8), &protocol, &impedance).unwrap();
        let mut workspace = model.workspace().unwrap();
        let conductivity: Vec<f64> = noise(5, model.elements()).iter().map(|x| 0.5 + x).collect();
        let mut solution = match accuracy {
            None => model.solve(&conductivity, &mut workspace).unwrap(),
            Some(accuracy) => model.solve_to(&conductivity, accuracy, &mut workspace).unwrap(),
        };
        let path = if accuracy.is_none() {
            SolvePath::ElectrodesEliminated
        } else {
            SolvePath::ExtendedPrecision
        };
        assert_eq!(solution.report().path, path);
        assert!(solution.report().error_bound < 1e-9);
        (solution.measurements(), solution.jacobian(), solution.node_potentials())
    };
    for (limit, near) in [(0.0, 1e-40), (f64::INFINITY, 1e40)] {
        let ((v, j, u), (w, k, _)) = (solve(limit, Some(FINEST)), solve(near, Some(FINEST)));
        assert!(u.iter().all(|u| u.is_finite()));
        // both are accurate to the last digit
        assert!(largest(&(&v - &w)) <= 4.0 * f64::EPSILON * largest(&v));
        assert!(largest(&(&j - &k)) <= 1e-14 * largest(&j));
        // f64 with a condition number of about 1e4
        let (w, k, _) = solve(limit, None);
        assert!(largest(&(&v - &w)) <= 1e-11 * largest(&v));
        assert!(largest(&(&j - &k)) <= 1e-11 * largest(&j));
    }
}

/// An electrode that carries current through an infinite impedance has no finite voltage.
#[test]
fn infinite_voltages_are_refused() {
    let kept = PairProtocol {
        electrodes: 12,
        driven_electrodes: DrivenElectrodes::Keep,
        ..Default::default()
    };
    let mut impedance = [0.05; 12];
    impedance[4] = f64::INFINITY;
    let model = ForwardModel::new(&ring_disc(4), &kept.protocol().unwrap(), &impedance).unwrap();
    let refused = model.forward(&vec![1.0; model.elements()]).unwrap_err();
    assert!(matches!(refused, FemError::NonFinitePotential { electrode: 5, .. }), "{refused}");
}

/// With a contrast beyond 32 digits, a solve fails or reaches the limit of a perfect conductor.
#[test]
fn contrast_beyond_all_digits_is_refused_or_right() {
    let protocol = PairProtocol { electrodes: 12, ..Default::default() }.protocol().unwrap();
    let model = ForwardModel::new(&ring_disc(8), &protocol, &[0.05; 12]).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut solve = |island: f64| {
        let mut conductivity = vec![1.0; model.elements()];
        conductivity[..60].fill(island);
        model.solve_to(&conductivity, 1e-12, &mut workspace).map(|s| s.measurements())
    };
    let limit = solve(1e16).unwrap();
    match solve(1e45) {
        Err(FemError::AccuracyNotReached { .. } | FemError::NotPositiveDefinite { .. }) => {}
        Err(other) => unreachable!("{other}"),
        // 1e-12 was required; `limit` itself is off by 1e-16
        Ok(v) => assert!(largest(&(&v - &limit)) < 2e-12 * largest(&limit)),
    }
}

/// Electrodes of the rational reference: the two ends, one edge at the bottom and one at the top.
/// With `touching`, the bottom electrode starts at the corner of the left end.
fn small_skin(thinness: i32, jitter: &[f64], touching: bool) -> Mesh {
    let (columns, rows) = (4, 2);
    let flat = strip(4.0, 2.0, columns, rows);
    let node = |i: usize, j: usize| (i * (rows + 1) + j) as u32;
    let mut nodes = flat.surface().nodes().to_vec();
    for i in 1..columns {
        // inner nodes along the strip, at dyadic coordinates
        nodes[node(i, 1) as usize][0] += (jitter[i] * 64.0).round() / 256.0;
    }
    nodes.iter_mut().for_each(|n| n[1] *= 2f64.powi(-thinness));
    let surface = Surface::new(nodes, flat.surface().triangles().to_vec()).unwrap();
    let lower = if touching { [node(0, 0), node(1, 0)] } else { [node(1, 0), node(2, 0)] };
    let ends = |i: usize| Electrode::Rim((0..rows).map(|j| [node(i, j), node(i, j + 1)]).collect());
    let edges = |edge: [u32; 2]| Electrode::Rim(vec![edge]);
    let electrodes =
        vec![ends(0), edges(lower), ends(columns), edges([node(2, rows), node(3, rows)])];
    Mesh::new(surface, electrodes).unwrap()
}

fn exact(x: f64) -> BigRational {
    BigRational::from_float(x).unwrap()
}

/// The textbook system `[K + M/z, -m/z; -m^T/z, length/z]` with the last electrode at 0 V, solved
/// by elimination in exact rational numbers: potentials of the other electrodes for each current.
fn rational_transfer(
    mesh: &Mesh,
    conductivity: &[f64],
    impedance: &[f64],
) -> Vec<Vec<BigRational>> {
    let nodes = mesh.surface().nodes();
    let electrodes = impedance.len() - 1;
    let size = nodes.len() + electrodes;
    let zero = exact(0.0);
    let mut a = vec![vec![zero.clone(); size + electrodes]; size];
    for (triangle, &sigma) in mesh.surface().triangles().iter().zip(conductivity) {
        let place = |k: usize, c: usize| exact(nodes[triangle[k % 3] as usize][c]);
        // gradient of hat function k times twice the area: the opposite edge, rotated
        let opposite = |k: usize| [0, 1].map(|c| place(k + 2, c) - place(k + 1, c));
        let (e0, e1) = (opposite(0), opposite(1));
        let double = (&e0[0] * &e1[1]) - (&e0[1] * &e1[0]);
        let double = if double < zero { -double } else { double };
        for k in 0..3 {
            for l in 0..3 {
                let (p, q) = (opposite(k), opposite(l));
                let dot = &p[0] * &q[0] + &p[1] * &q[1];
                a[triangle[k] as usize][triangle[l] as usize] +=
                    exact(sigma) * dot / (exact(2.0) * &double);
            }
        }
    }
    for (l, electrode) in mesh.electrodes().iter().enumerate() {
        let Electrode::Rim(edges) = electrode else { unreachable!("rim electrodes") };
        for edge in edges {
            let ends = edge.map(|n| n as usize);
            // parallel to an axis, so the length is rational
            let lengths = [0, 1].map(|c| (nodes[ends[0]][c] - nodes[ends[1]][c]).abs());
            assert!(lengths[0] == 0.0 || lengths[1] == 0.0);
            let g = exact(lengths[0] + lengths[1]) / exact(impedance[l]);
            for i in ends {
                for j in ends {
                    a[i][j] += &g / exact(if i == j { 3.0 } else { 6.0 });
                }
                if l < electrodes {
                    a[i][nodes.len() + l] -= &g / exact(2.0);
                    a[nodes.len() + l][i] -= &g / exact(2.0);
                }
            }
            if l < electrodes {
                a[nodes.len() + l][nodes.len() + l] += &g;
            }
        }
    }
    (0..electrodes).for_each(|l| a[nodes.len() + l][size + l] = exact(1.0));
    for k in 0..size {
        let pivot_row = a[k].clone();
        for row in a.iter_mut().skip(k + 1).filter(|row| row[k] != zero) {
            let factor = &row[k] / &pivot_row[k];
            for j in k..size + electrodes {
                if pivot_row[j] != zero {
                    row[j] -= &factor * &pivot_row[j];
                }
            }
        }
    }
    // electrodes come last, so their potentials need only the trailing block
    let mut u = vec![vec![zero.clone(); electrodes]; electrodes];
    for k in (0..electrodes).rev() {
        for l in 0..electrodes {
            let row = &a[nodes.len() + k];
            let known = (k + 1..electrodes).map(|j| &row[nodes.len() + j] * &u[j][l]);
            let rest = known.fold(row[size + l].clone(), |rest, term| rest - term);
            u[k][l] = rest / &row[nodes.len() + k];
        }
    }
    u
}

proptest! {
    #![proptest_config(fixtures::cases(24))]

    /// With contrast up to 1e8, contact impedances over 16 decades and triangles as flat as 1 :
    /// 16000, each value is accurate to its last digits and within its bound, compared with exact
    /// rational arithmetic.
    #[test]
    fn every_digit_of_random_skins_is_right(
        sigma in proptest::collection::vec(-4.0..4.0, 16),
        z in proptest::collection::vec(-8.0..8.0, 4),
        jitter in proptest::collection::vec(-1.0..1.0, 4),
        thinness in 0..14,
        touching: bool,
    ) {
        let mesh = small_skin(thinness, &jitter, touching);
        let conductivity: Vec<f64> = sigma.iter().map(|x| 10f64.powf(*x)).collect();
        let impedance: Vec<f64> = z.iter().map(|x| 10f64.powf(*x)).collect();
        let quadruples =
            [[0, 2, 1, 3], [0, 1, 2, 3], [1, 3, 0, 2], [0, 2, 0, 2], [0, 3, 1, 2], [1, 2, 1, 3]];
        let protocol = Protocol::from_quadruples(4, &quadruples, 1.0).unwrap();
        let model = ForwardModel::new(&mesh, &protocol, &impedance).unwrap();
        let mut workspace = model.workspace().unwrap();
        let transfer = rational_transfer(&mesh, &conductivity, &impedance);
        let at = |k: u32, l: u32| match (transfer.get(k as usize), l) {
            (Some(row), 0..3) => row[l as usize].clone(),
            _ => exact(0.0),
        };
        for accuracy in [FINEST, 1e-6] {
            let mut solution = model.solve_to(&conductivity, accuracy, &mut workspace).unwrap();
            let (found, bounds) = (solution.measurements(), solution.measurement_bounds());
            let is_bound = solution.report().path != SolvePath::NodalAssembly;
            for ((&v, &bound), [a, b, m, n]) in found.iter().zip(&bounds).zip(quadruples) {
                let wanted = at(m, a) - at(m, b) - at(n, a) + at(n, b);
                let error = exact(v) - wanted;
                let error = if error < exact(0.0) { -error } else { error };
                prop_assert!(error <= exact(bound) || !is_bound, "{} within {}", v, bound);
                // bounds are not trivially large; a value of 1e-20 of the largest may lose its last
                // digits
                let idle = bound > 1e-8 * v.abs() && bound > 1e-20 * largest(&found);
                prop_assert!(!idle || accuracy > FINEST);
            }
        }
    }
}
