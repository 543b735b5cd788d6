//! Sheets that conduct better along than across: the affine map onto a scalar sheet, unrolled curved
//! sheets, Taylor remainders, both solve paths. Convergence is in `quadratic.rs`.

use crate::common::{
    BOTH, adjacent, assert_reciprocal, assert_slope_two, model_of, moved, random_conductivity,
    refused, relative, ring_disc, strip, uneven, with_electrodes,
};
use eit_core::vector::{dot, normal, unit};
use eit_fem::{Anisotropy, ElementOrder, ForwardModel, Protocol};
use eit_mesh::{Electrode, Mesh, MeshSettings, RimElectrodes, SkinShape, generate};
use ndarray::ArrayView1;

/// A disc with patches in place of rim electrodes: the map that makes its sheet scalar preserves areas,
/// and so the contacts of patches, but not the lengths of rim electrodes.
fn patches() -> Mesh {
    let disc = ring_disc(8);
    let count = disc.surface().triangles().len() as u32;
    let patch = |k: u32| Electrode::Patch(vec![count - 1 - 14 * k, count - 2 - 14 * k]);
    with_electrodes(&disc, |list| *list = (0..8).map(patch).collect())
}

fn model(mesh: &Mesh, z: &[f64], order: ElementOrder) -> ForwardModel {
    model_of(mesh, &adjacent(z.len()), z, order)
}

fn knit(mesh: &Mesh, z: &[f64], order: ElementOrder, ratio: f64, angle: f64) -> ForwardModel {
    let sheet = Anisotropy::uniform(mesh.surface(), ratio, angle).unwrap();
    model(mesh, z, order).with_anisotropy(&sheet).unwrap()
}

/// Closed form: the map `x -> M^(-1/2) x` turns the sheet into a scalar one of the same conductivities
/// and voltages, in every order of elements and on the path that eliminates electrodes.
#[test]
fn an_ellipse_of_a_scalar_sheet_gives_the_same() {
    let (mesh, impedance) = (patches(), uneven(7, 8, 0.05));
    for (ratio, angle) in [(1.3, 0.4), (2.5, 1.9), (0.1, -0.7), (30.0, 0.0)] {
        let (sin, cos) = f64::sin_cos(angle);
        let across = f64::powf(ratio, 0.25);
        let ellipse = moved(&mesh, |[x, y, _]| {
            let (u, v) = ((cos * x + sin * y) / across, (cos * y - sin * x) * across);
            [cos * u - sin * v, sin * u + cos * v, 0.0]
        });
        for order in BOTH {
            let (of_knit, plain) =
                (knit(&mesh, &impedance, order, ratio, angle), model(&ellipse, &impedance, order));
            let sigma = random_conductivity(&plain, 2);
            let near = |error: f64| {
                // rounding times a condition number of some 1e4, and the ratio
                assert!(error < 1e-11, "{ratio} {angle} {order:?}: {error:e}");
            };
            let voltages = |model: &ForwardModel| model.forward(&sigma).unwrap();
            near(relative(&voltages(&of_knit), &voltages(&plain)));
            assert_reciprocal(&adjacent(8), &voltages(&of_knit));
            let jacobian = |model: &ForwardModel| model.jacobian(&sigma).unwrap();
            near(relative(&jacobian(&of_knit), &jacobian(&plain)));
            if order == ElementOrder::Linear {
                let finest = |model: &ForwardModel| {
                    let mut workspace = model.workspace().unwrap();
                    model.solve_to(&sigma, 1e-15, &mut workspace).unwrap().measurements()
                };
                let error = relative(&finest(&of_knit), &finest(&plain));
                // positions of the ellipse are rounded
                assert!(error < 1e-13, "{ratio} {angle}: {error:e}");
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
    assert!(relative(&a, &b) < 1e-12, "{a} {b}");
}

#[test]
fn a_ratio_of_one_changes_nothing() {
    let mesh = ring_disc(8);
    for order in BOTH {
        let (of_knit, plain) =
            (knit(&mesh, &[0.1; 12], order, 1.0, 0.3), model(&mesh, &[0.1; 12], order));
        let sigma = random_conductivity(&plain, 2);
        assert_eq!(of_knit.forward(&sigma).unwrap(), plain.forward(&sigma).unwrap());
        assert_eq!(of_knit.jacobian(&sigma).unwrap(), plain.jacobian(&sigma).unwrap());
    }
}

/// A tube of flat facets unrolls without stretching: its voltages are those of the flat sheet.
#[test]
fn a_tube_gives_what_its_unrolled_sheet_gives() {
    let (columns, rows, edge, turn) = (10, 6, 0.1, 0.5);
    let node = |i: u32, j: u32| i * (rows + 1) + j;
    let sides = [0, 4, 9].map(|i| [node(i, 0), node(i + 1, 0)]);
    let ends = [1, 6].map(|i| [node(i + 1, rows), node(i, rows)]);
    let flat = strip(1.0, 0.6, columns, rows as usize);
    let flat = with_electrodes(&flat, |list| {
        let edges = sides.into_iter().chain(ends);
        *list = edges.map(|edge| Electrode::Rim(vec![edge])).collect();
    });
    // chords that turn by the same angle; the middle one lies along x
    let tube = moved(&flat, |[x, y, _]| {
        let chord = |k: usize| turn * (k as f64 - 0.5 * (columns as f64 - 1.0));
        let steps = (0..(x / edge).round() as usize).map(|k| f64::sin_cos(chord(k)));
        let [x, z] = steps.fold([0.0, 0.0], |[x, z], (sin, cos)| [x + edge * cos, z - edge * sin]);
        [x, y, z]
    });
    for (ratio, angle) in [(2.0, 0.0), (2.0, 0.7), (0.4, 1.2)] {
        let sheets =
            [&flat, &tube].map(|mesh| knit(mesh, &[0.1; 5], ElementOrder::Linear, ratio, angle));
        let sigma = random_conductivity(&sheets[0], 2);
        let [a, b] = sheets.map(|model| model.forward(&sigma).unwrap());
        assert!(relative(&b, &a) < 1e-12, "{ratio} {angle}: {a} {b}");
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
        let normal = unit(normal(mesh.surface().corners(triangle)));
        assert!(dot(normal, direction).abs() < 1e-12, "{triangle}: {direction:?}");
        assert!((dot(direction, direction) - 1.0).abs() < 1e-12, "{triangle}: {direction:?}");
    }
}

/// Remainders of second order in ratio and angle, at a ratio of 1 too.
#[test]
fn taylor_ratio_and_angle() {
    let mesh = ring_disc(8);
    for order in BOTH {
        for (ratio, angle) in [(1.0_f64, 0.2_f64), (1.7, 0.9), (0.3, -0.4)] {
            let here = knit(&mesh, &[0.1; 12], order, ratio, angle);
            let sigma = random_conductivity(&here, 2);
            let mut workspace = here.workspace().unwrap();
            let mut solution = here.solve(&sigma, &mut workspace).unwrap();
            let jacobian = solution.anisotropy_jacobian().unwrap();
            let at = |ratio: f64, angle: f64| {
                knit(&mesh, &[0.1; 12], order, ratio, angle).forward(&sigma).unwrap()
            };
            let slope_two = |what: &str, slope: ArrayView1<'_, f64>, at: &dyn Fn(f64) -> _| {
                assert_slope_two(&format!("{what} {order:?} {ratio}"), slope, 2e-2, at);
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

#[test]
fn what_cannot_be_is_refused() {
    let mesh = ring_disc(8);
    let surface = mesh.surface();
    for (ratio, angle, wanted) in [
        (0.0, 0.0, "ratio of the conductivities along and across"),
        (f64::NAN, 0.0, "ratio of the conductivities"),
        (1.5, f64::INFINITY, "angle of the conductivity along"),
    ] {
        refused(Anisotropy::uniform(surface, ratio, angle), wanted);
    }
    refused(Anisotropy::new(&[1.0, 2.0], &[[1.0, 0.0, 0.0]]), "directions of the conductivity");
    refused(Anisotropy::new(&[1.0], &[[0.0; 3]]), "length of a direction");
    let count = surface.triangles().len();
    let model = model(&mesh, &[0.1; 12], ElementOrder::Linear);
    let few = Anisotropy::new(&[1.0], &[[1.0, 0.0, 0.0]]).unwrap();
    refused(model.clone().with_anisotropy(&few), "elements of the anisotropy");
    let upright = Anisotropy::new(&vec![2.0; count], &vec![[0.0, 0.0, 1.0]; count]).unwrap();
    refused(model.clone().with_anisotropy(&upright), "at right angles");
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&vec![1.0; count], &mut workspace).unwrap();
    refused(solution.anisotropy_jacobian(), "no direction of conductivity");
}
