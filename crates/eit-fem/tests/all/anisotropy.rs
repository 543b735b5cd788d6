//! Sheets that conduct better along than across: the affine map onto a scalar sheet, unrolled curved
//! sheets, Taylor remainders, both solve paths, convergence.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

use crate::common::{adjacent, largest, noise, random_conductivity, ring_disc};
use eit_fem::{Anisotropy, ElementOrder, FemError, ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Electrode, Mesh, MeshSettings, RimElectrodes, SkinShape, Surface, generate};
use ndarray::{Array1, ArrayView1};

const ORDERS: [ElementOrder; 2] = [ElementOrder::Linear, ElementOrder::Quadratic];

/// A disc with patches in place of rim electrodes: the map that makes its sheet scalar preserves areas,
/// and so the contacts of patches, but not the lengths of rim electrodes.
fn patches() -> Mesh {
    let disc = ring_disc(8);
    let count = disc.surface().triangles().len() as u32;
    let patch = |k: u32| Electrode::Patch(vec![count - 1 - 14 * k, count - 2 - 14 * k]);
    Mesh::new(disc.surface().clone(), (0..8).map(patch).collect()).unwrap()
}

fn moved(mesh: &Mesh, to: impl Fn([f64; 3]) -> [f64; 3]) -> Mesh {
    let nodes = mesh.surface().nodes().iter().map(|p| to(*p)).collect();
    let surface = Surface::new(nodes, mesh.surface().triangles().to_vec()).unwrap();
    Mesh::new(surface, mesh.electrodes().to_vec()).unwrap()
}

fn model(mesh: &Mesh, impedance: &[f64], order: ElementOrder) -> ForwardModel {
    let protocol = adjacent(impedance.len());
    ForwardModel::with_element_order(mesh, &protocol, impedance, order).unwrap()
}

fn knit(
    mesh: &Mesh,
    impedance: &[f64],
    order: ElementOrder,
    ratio: f64,
    angle: f64,
) -> ForwardModel {
    let sheet = Anisotropy::uniform(mesh.surface(), ratio, angle).unwrap();
    model(mesh, impedance, order).with_anisotropy(&sheet).unwrap()
}

/// Closed form: the map `x -> M^(-1/2) x` turns the sheet into a scalar one of the same conductivities.
/// Voltages and Jacobians of both agree to rounding, in every order of elements and on the path that
/// eliminates electrodes.
#[test]
fn an_ellipse_of_a_scalar_sheet_gives_the_same() {
    let mesh = patches();
    let impedance: Vec<f64> = noise(7, 8).iter().map(|x| 0.05 + x).collect();
    for (ratio, angle) in [(1.3, 0.4), (2.5, 1.9), (0.1, -0.7), (30.0, 0.0)] {
        let (sin, cos) = f64::sin_cos(angle);
        let across = f64::powf(ratio, 0.25);
        let ellipse = moved(&mesh, |[x, y, _]| {
            let (u, v) = ((cos * x + sin * y) / across, (cos * y - sin * x) * across);
            [cos * u - sin * v, sin * u + cos * v, 0.0]
        });
        for order in ORDERS {
            let (of_knit, plain) =
                (knit(&mesh, &impedance, order, ratio, angle), model(&ellipse, &impedance, order));
            let sigma = random_conductivity(&plain, 2);
            let near = |a: &Array1<f64>, b: &Array1<f64>| {
                let error = largest(&(a - b)) / largest(b);
                // rounding times a condition number of some 1e4, and the ratio
                assert!(error < 1e-11, "{ratio} {angle} {order:?}: {error:e}");
            };
            near(&of_knit.forward(&sigma).unwrap(), &plain.forward(&sigma).unwrap());
            let flat = |model: &ForwardModel| model.jacobian(&sigma).unwrap().flatten().to_owned();
            near(&flat(&of_knit), &flat(&plain));
            if order == ElementOrder::Linear {
                let finest = |model: &ForwardModel| {
                    let mut workspace = model.workspace().unwrap();
                    model.solve_to(&sigma, 1e-15, &mut workspace).unwrap().measurements()
                };
                let error = largest(&(&finest(&of_knit) - &finest(&plain)));
                // positions of the ellipse are rounded
                assert!(error < 1e-13 * largest(&finest(&plain)), "{ratio} {angle}: {error:e}");
            }
        }
    }
}

/// Shunts and ideal current sources have no lengths in their contacts: rim electrodes map too.
#[test]
fn limits_of_contact_impedance_map_too() {
    let mesh = ring_disc(8);
    let impedance: Vec<f64> = (0..12).map(|l| if l < 6 { 0.0 } else { f64::INFINITY }).collect();
    // only the sources' currents enter evenly over their lengths, so drive and measure on shunts
    let protocol = Protocol::from_quadruples(12, &[[0, 2, 3, 5], [1, 4, 0, 3]], 1.0).unwrap();
    let ellipse = moved(&mesh, |[x, y, _]| [x / 1.2, y * 1.2, 0.0]);
    let plain = ForwardModel::new(&ellipse, &protocol, &impedance).unwrap();
    let sheet = Anisotropy::uniform(mesh.surface(), f64::powi(1.2, 4), 0.0).unwrap();
    let of_knit = ForwardModel::new(&mesh, &protocol, &impedance).unwrap();
    let of_knit = of_knit.with_anisotropy(&sheet).unwrap();
    let sigma = random_conductivity(&plain, 2);
    let [a, b] = [of_knit, plain].map(|model| model.forward(&sigma).unwrap());
    assert!(largest(&(&a - &b)) < 1e-12 * largest(&b), "{a} {b}");
}

/// A scalar sheet is one of ratio 1, whatever its direction.
#[test]
fn a_ratio_of_one_changes_nothing() {
    let mesh = ring_disc(8);
    for order in ORDERS {
        let (of_knit, plain) =
            (knit(&mesh, &[0.1; 12], order, 1.0, 0.3), model(&mesh, &[0.1; 12], order));
        let sigma = random_conductivity(&plain, 2);
        assert_eq!(of_knit.forward(&sigma).unwrap(), plain.forward(&sigma).unwrap());
        assert_eq!(of_knit.jacobian(&sigma).unwrap(), plain.jacobian(&sigma).unwrap());
    }
}

/// Drive and measurement may be exchanged: the tensor is symmetric.
#[test]
fn reciprocity() {
    let quadruples: Vec<[u32; 4]> = vec![[0, 4, 2, 7], [2, 7, 0, 4], [1, 2, 8, 10], [8, 10, 1, 2]];
    let protocol = Protocol::from_quadruples(12, &quadruples, 1.0).unwrap();
    let mesh = ring_disc(8);
    let sheet = Anisotropy::uniform(mesh.surface(), 2.2, 0.6).unwrap();
    let model = ForwardModel::new(&mesh, &protocol, &[0.1; 12]).unwrap();
    let model = model.with_anisotropy(&sheet).unwrap();
    let v = model.forward(&random_conductivity(&model, 2)).unwrap();
    assert!((v[0] - v[1]).abs().max((v[2] - v[3]).abs()) < 1e-13 * largest(&v), "{v}");
}

/// A tube of flat facets unrolls without stretching: with the direction transported around it, its
/// voltages are those of the flat sheet.
#[test]
fn a_tube_gives_what_its_unrolled_sheet_gives() {
    let (columns, rows, edge, turn) = (10_usize, 6_usize, 0.1, 0.5);
    let node = |i: usize, j: usize| (i * (rows + 1) + j) as u32;
    let mut triangles = Vec::new();
    for i in 0..columns {
        for j in 0..rows {
            let [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let places = |to: &dyn Fn(usize) -> [f64; 2]| -> Vec<[f64; 3]> {
        (0..=columns)
            .flat_map(|i| (0..=rows).map(move |j| (i, j)))
            .map(|(i, j)| {
                let [x, z] = to(i);
                [x, edge * j as f64, z]
            })
            .collect()
    };
    // chords that turn by the same angle; the middle one lies along x
    let tube = |i: usize| {
        let chord = |k: usize| turn * (k as f64 - 0.5 * (columns as f64 - 1.0));
        (0..i).fold([0.0, 0.0], |[x, z], k| [x + edge * chord(k).cos(), z - edge * chord(k).sin()])
    };
    let electrodes: Vec<Electrode> = [node(0, 0), node(4, 0), node(9, 0)]
        .into_iter()
        .map(|a| Electrode::Rim(vec![[a, a + rows as u32 + 1]]))
        .chain([1, 6].map(|i| Electrode::Rim(vec![[node(i + 1, rows), node(i, rows)]])))
        .collect();
    let [flat, tube] = [places(&|i| [edge * i as f64, 0.0]), places(&tube)].map(|nodes| {
        Mesh::new(Surface::new(nodes, triangles.clone()).unwrap(), electrodes.clone()).unwrap()
    });
    for (ratio, angle) in [(2.0, 0.0), (2.0, 0.7), (0.4, 1.2)] {
        let sheets =
            [&flat, &tube].map(|mesh| knit(mesh, &[0.1; 5], ElementOrder::Linear, ratio, angle));
        let sigma = random_conductivity(&sheets[0], 2);
        let [a, b] = sheets.map(|model| model.forward(&sigma).unwrap());
        assert!(largest(&(&a - &b)) < 1e-12 * largest(&a), "{ratio} {angle}: {a} {b}");
    }
}

/// On a dome the transported directions are unit vectors in the planes of their triangles.
#[test]
fn directions_lie_in_the_sheet() {
    let shape = SkinShape::Hemisphere { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.01);
    let mesh = generate(&shape, &electrodes, &MeshSettings::with_edge(0.01)).unwrap();
    let sheet = Anisotropy::uniform(mesh.surface(), 1.5, 0.3).unwrap();
    for (triangle, direction) in sheet.directions().enumerate() {
        let normal =
            eit_core::vector::unit(eit_core::vector::normal(mesh.surface().corners(triangle)));
        let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
        assert!(dot(normal, direction).abs() < 1e-12, "{triangle}: {direction:?}");
        assert!((dot(direction, direction) - 1.0).abs() < 1e-12, "{triangle}: {direction:?}");
    }
}

/// Remainders of second order in ratio and angle, at a ratio of 1 too.
#[test]
fn taylor_ratio_and_angle() {
    let mesh = ring_disc(8);
    for order in ORDERS {
        for (ratio, angle) in [(1.0_f64, 0.2_f64), (1.7, 0.9), (0.3, -0.4)] {
            let here = knit(&mesh, &[0.1; 12], order, ratio, angle);
            let sigma = random_conductivity(&here, 2);
            let mut workspace = here.workspace().unwrap();
            let mut solution = here.solve(&sigma, &mut workspace).unwrap();
            let zero = solution.measurements();
            let jacobian = solution.anisotropy_jacobian().unwrap();
            let at = |ratio: f64, angle: f64| {
                knit(&mesh, &[0.1; 12], order, ratio, angle).forward(&sigma).unwrap()
            };
            let slope_two =
                |what: &str, slope: ArrayView1<f64>, at: &dyn Fn(f64) -> Array1<f64>| {
                    let remainder = |t: f64| largest(&(&at(t) - &zero - &(&slope * t)));
                    let [a, b, c] = [2e-2, 1e-2, 5e-3].map(remainder);
                    let slopes = [(a / b).log2(), (b / c).log2()];
                    // the third order is a few per cent of the second
                    let is_two = slopes.iter().all(|s| (s - 2.0).abs() < 0.1);
                    assert!(is_two, "{what} {order:?} {ratio}: {slopes:?} of {a:e} {b:e} {c:e}");
                    assert!(largest(slope) * 2e-2 > 10.0 * a, "{what}: the derivative is not zero");
                };
            slope_two("ratio", jacobian.column(0), &|t| at(ratio * t.exp(), angle));
            if ratio == 1.0 {
                let eighth = std::f64::consts::FRAC_PI_4;
                slope_two("turned", jacobian.column(1), &|t| at(t.exp(), angle + eighth));
            } else {
                let by_angle = &jacobian.column(1) * (2.0 * ratio.ln());
                slope_two("angle", by_angle.view(), &|t| at(ratio, angle + t));
            }
        }
    }
}

/// Linear and quadratic elements converge to one solution, linear ones with order two.
#[test]
fn elements_of_both_orders_converge() {
    let skin = SkinShape::Disc { radius_m: 1.0 };
    let electrodes = RimElectrodes::equally_spaced(8, 0.4);
    let protocol = PairProtocol { electrodes: 8, ..Default::default() }.protocol().unwrap();
    let voltages = |nodes: usize, order: ElementOrder| -> Array1<f64> {
        let ends = 0.1 * (400.0 / nodes as f64).sqrt();
        let settings = MeshSettings { electrode_edge_m: Some(ends), ..Default::default() };
        let settings = settings.for_nodes(&skin, &electrodes, nodes).unwrap();
        let mesh = generate(&skin, &electrodes, &settings).unwrap();
        let sheet = Anisotropy::uniform(mesh.surface(), 1.8, 0.5).unwrap();
        let model = ForwardModel::with_element_order(&mesh, &protocol, &[0.2; 8], order).unwrap();
        let model = model.with_anisotropy(&sheet).unwrap();
        model.forward(&vec![1.0; model.elements()]).unwrap()
    };
    let found = voltages(3000, ElementOrder::Quadratic);
    let apart = [1500, 6000, 24000]
        .map(|nodes| largest(&(voltages(nodes, ElementOrder::Linear) - &found)) / largest(&found));
    println!("linear elements are apart by {apart:?}");
    assert!(apart[0] / apart[2] > 10.0 && apart[2] < 5e-4, "{apart:?}");
}

#[test]
fn what_cannot_be_is_refused() {
    let mesh = ring_disc(8);
    let surface = mesh.surface();
    fn says<T: std::fmt::Debug>(result: Result<T, FemError>, wanted: &str) {
        let error = result.unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    }
    says(Anisotropy::uniform(surface, 0.0, 0.0), "ratio of the conductivities along and across");
    says(Anisotropy::uniform(surface, f64::NAN, 0.0), "ratio of the conductivities");
    says(Anisotropy::uniform(surface, 1.5, f64::INFINITY), "angle of the conductivity along");
    says(Anisotropy::new(&[1.0, 2.0], &[[1.0, 0.0, 0.0]]), "directions of the conductivity");
    says(Anisotropy::new(&[1.0], &[[0.0; 3]]), "length of a direction");
    let count = surface.triangles().len();
    let model = model(&mesh, &[0.1; 12], ElementOrder::Linear);
    let few = Anisotropy::new(&[1.0], &[[1.0, 0.0, 0.0]]).unwrap();
    says(model.clone().with_anisotropy(&few).map(|_| ()), "elements of the anisotropy");
    let upright = Anisotropy::new(&vec![2.0; count], &vec![[0.0, 0.0, 1.0]; count]).unwrap();
    says(model.clone().with_anisotropy(&upright).map(|_| ()), "at right angles");
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&vec![1.0; count], &mut workspace).unwrap();
    says(solution.anisotropy_jacobian(), "no direction of conductivity");
}
