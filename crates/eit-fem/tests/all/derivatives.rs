//! Derivatives with respect to contacts, nodes and electrodes: Taylor remainders, closed forms,
//! symmetry, and differences of independent solutions.

use crate::common::{
    CONDUCTIVITY_S as SIGMA_S, RADIUS_M, WIDTH_M, adjacent, assert_slope_two, deformed,
    five_points, kept, largest, moved, noise, paper_electrodes, paper_protocol, paper_series,
    patched_disc, random_conductivity, refused, relative, ring_disc, series_voltages, strip,
    uneven, with_electrodes,
};
use eit_fem::analytic::DiscSeries;
use eit_fem::{
    Anisotropy, Displacement, DrivenElectrodes, ElectrodeMotion, FemError, ForwardModel,
    PairProtocol, Protocol, Solution,
};
use eit_mesh::{Electrode, Mesh, MeshSettings, Placement, RimElectrodes, SkinShape, generate};
use ndarray::{Array1, Axis, aview1};
use std::f64::consts::TAU;
use std::sync::LazyLock;

const MOTIONS: [ElectrodeMotion; 6] = [
    ElectrodeMotion::Slide,
    ElectrodeMotion::Widen,
    ElectrodeMotion::CarriedAlong,
    ElectrodeMotion::CarriedOutward,
    ElectrodeMotion::Carried([0.3, -0.5, 0.8]),
    ElectrodeMotion::Stretched,
];

/// A skin in a random state: unequal contacts, conductivities from 0.5 to 1.5, and a patch.
struct State {
    mesh: Mesh,
    model: ForwardModel,
    impedance: Vec<f64>,
    sigma: Vec<f64>,
}

impl State {
    fn new() -> Self {
        Self::on(patched_disc())
    }

    fn on(mesh: Mesh) -> Self {
        let impedance = uneven(7, 12, 0.05);
        let model = ForwardModel::new(&mesh, &kept(), &impedance).unwrap();
        let sigma = random_conductivity(&model, 3);
        Self { mesh, model, impedance, sigma }
    }

    fn voltages(&self, nodes: &[[f64; 3]], impedance: &[f64]) -> Array1<f64> {
        deformed(&self.model, nodes, impedance, &self.sigma)
    }

    fn moved(&self, displacement: &Displacement, amount: f64) -> Array1<f64> {
        let mut nodes = self.mesh.surface().nodes().to_vec();
        displacement.apply(amount, &mut nodes).unwrap();
        self.voltages(&nodes, &self.impedance)
    }

    fn nodes(&self) -> &[[f64; 3]] {
        self.mesh.surface().nodes()
    }

    /// All motions of all electrodes that support them, with the electrode's number.
    fn motions(&self) -> Vec<(ElectrodeMotion, usize, Displacement)> {
        let mut found = Vec::new();
        for motion in MOTIONS {
            for l in 0..12 {
                match motion.displacement(&self.mesh, l) {
                    Ok(displacement) => found.push((motion, l, displacement)),
                    Err(error) => assert!(
                        l == 11 && matches!(error, FemError::Immovable { electrode: 12, .. }),
                        "{motion:?}: {error}"
                    ),
                }
            }
        }
        found
    }
}

#[test]
fn taylor_contacts() {
    let state = State::new();
    let mut workspace = state.model.workspace().unwrap();
    let mut solution = state.model.solve(&state.sigma, &mut workspace).unwrap();
    let jacobian = solution.contact_jacobian().unwrap();
    for l in 0..12 {
        let at = |t: f64| {
            let mut impedance = state.impedance.clone();
            impedance[l] += t;
            state.voltages(state.nodes(), &impedance)
        };
        let step = 1e-2 * state.impedance[l];
        assert_slope_two(&format!("contact {}", l + 1), jacobian.column(l), step, at);
        let found = five_points(step, at);
        let error = largest(&(&found - &jacobian.column(l))) / largest(jacobian.column(l));
        // h^4 = 1e-8 of a fifth derivative 24 times the first, over 30; rounding 1e-13 / h
        assert!(error < 1e-7, "contact {}: {error:e}", l + 1);
    }
}

#[test]
fn taylor_nodes_and_electrodes() {
    check_movement(&State::new());
    // a bowl with ratios from 0.5 to 2.5, and directions whose part in the sheet moves with it
    let bowl = |p: [f64; 3]| [p[0], p[1], 0.6 * (p[0] * p[0] + 0.5 * p[1] * p[1])];
    let state = State::on(moved(&patched_disc(), bowl));
    let count = state.model.elements();
    let ratios: Vec<f64> = noise(13, count).iter().map(|x| 0.5 + 2.0 * x).collect();
    let parts = uneven(17, 3 * count, 0.2);
    let sheet = Anisotropy::new(&ratios, parts.as_chunks().0).unwrap();
    check_movement(&State { model: state.model.clone().with_anisotropy(&sheet).unwrap(), ..state });
}

fn check_movement(state: &State) {
    let mut workspace = state.model.workspace().unwrap();
    let mut solution = state.model.solve(&state.sigma, &mut workspace).unwrap();
    // all nodes in all directions, including out of the plane (a second-order effect)
    let moves: Vec<f64> = noise(9, 3 * state.nodes().len()).iter().map(|x| 2.0 * x - 1.0).collect();
    let mut motions = state.motions();
    // 5 motions of 11 rim electrodes, and one of all electrodes
    assert_eq!(motions.len(), 5 * 11 + 12);
    motions.push((
        ElectrodeMotion::Carried([0.0; 3]),
        99,
        Displacement::of_field(moves.as_chunks().0),
    ));
    let displacements: Vec<Displacement> = motions.iter().map(|m| m.2.clone()).collect();
    let jacobian = solution.movement_jacobian(&displacements).unwrap();
    for (k, (motion, l, displacement)) in motions.iter().enumerate() {
        let what = format!("{motion:?} of electrode {}", l + 1);
        let at = |t: f64| state.moved(displacement, t);
        // an electrode is 0.26 long, an edge 0.13
        assert_slope_two(&what, jacobian.column(k), 2e-3, at);
        let found = five_points(1e-3, at);
        let error = largest(&(&found - &jacobian.column(k))) / largest(jacobian.column(k));
        // h / edge = 1e-2, to the fourth; rounding 1e-13 / h
        assert!(error < 1e-6, "{what}: {error:e}");
    }
    // one at a time and all together give the same sums
    let one = solution.movement_jacobian(&displacements[5..6]).unwrap();
    let error = largest(&(&one.column(0) - &jacobian.column(5)));
    assert!(error <= 1e-14 * largest(&one), "{error:e}");
}

/// A dent `w(r)` lengthens the sheet along its slope by `w'^2 / 2`. Only the part of this strain without a trace changes
/// the voltages of a sheet, and a displacement in the plane has the same part:
///
/// ```text
/// u(r) = -r / 2 integral from r of w'^2 / s ds      w = h exp(-r^2 / 2 s^2):  u = -r h^2 / (4 s^2) exp(-r^2 / s^2)
/// ```
///
/// So touches may be modelled by displacements in the plane (`eit_skin::touches`).
#[test]
fn a_dent_is_a_displacement_in_the_plane() {
    let errors = [3e-3, 1.5e-3, 0.75e-3].map(error_of_dent);
    println!("a dent against its displacement: {errors:.3?}");
    // in an even field the effect is zero, so that what is left of it needs fine elements; of first order at least
    assert!(errors[1] < 0.6 * errors[0] && errors[2] < 0.6 * errors[1], "{errors:?}");
    assert!(errors[2] < 0.12, "{errors:?}");
}

/// Displacement of each node as a function of its place.
fn field(mesh: &Mesh, of: impl Fn(&[f64; 3]) -> [f64; 3]) -> Displacement {
    Displacement::of_field(&mesh.surface().nodes().iter().map(of).collect::<Vec<_>>())
}

/// Relative error of the voltages' change by a displacement in the plane, against the dented mesh.
fn error_of_dent(edge_m: f64) -> f64 {
    let disc = Disc::paper(1e3);
    let mesh = disc.mesh(edge_m);
    let (height, width, centre) = (1e-3, 0.02, [0.045, 0.02]);
    let nodes = mesh.surface().nodes();
    let from_centre = |node: &[f64; 3]| [node[0] - centre[0], node[1] - centre[1]];
    let bell = |[x, y]: [f64; 2]| (-(x * x + y * y) / (2.0 * width * width)).exp();
    let dented = |node: &[f64; 3]| [node[0], node[1], height * bell(from_centre(node))];
    let dented: Vec<[f64; 3]> = nodes.iter().map(dented).collect();
    let pulled = |node: &[f64; 3]| {
        let [x, y] = from_centre(node);
        let factor = -(height / (2.0 * width) * bell([x, y])).powi(2);
        [factor * x, factor * y, 0.0]
    };
    let model = disc.model(&mesh);
    let sigma = vec![SIGMA_S; model.elements()];
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&sigma, &mut workspace).unwrap();
    let of_plane = solution.movement_jacobian(&[field(&mesh, pulled)]).unwrap();
    let of_dent = deformed(&model, &dented, &[1e3; 16], &sigma);
    let undriven = |change: Array1<f64>| change.select(Axis(0), &UNDRIVEN);
    relative(&undriven(of_plane.column(0).to_owned()), &undriven(of_dent - solution.measurements()))
}

/// Analytic derivatives of `V = I (length / (sigma width) + (z1 + z2) / width)`.
#[test]
fn strip_has_its_closed_form_derivatives() {
    let (length, width, sigma, current) = (0.3, 0.1, 2e-5, 1e-4);
    let z = [40.0, 900.0];
    let mesh = strip(length, width, 12, 5);
    let protocol = Protocol::from_quadruples(2, &[[0, 1, 0, 1]], current).unwrap();
    let model = ForwardModel::new(&mesh, &protocol, &z).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&vec![sigma; model.elements()], &mut workspace).unwrap();
    let close = |found: f64, wanted: f64, what: &str| {
        // condition number about 1e4
        assert!((found - wanted).abs() < 1e-11 * wanted.abs(), "{what}: {found} {wanted}");
    };
    let contacts = solution.contact_jacobian().unwrap();
    close(contacts[[0, 0]], current / width, "contact 1");
    close(contacts[[0, 1]], current / width, "contact 2");
    let longer = field(&mesh, |p| [p[0] / length, 0.0, 0.0]);
    let wider = field(&mesh, |p| [0.0, p[1] / width, 0.0]);
    let slopes = solution.movement_jacobian(&[longer, wider]).unwrap();
    close(slopes[[0, 0]], current / (sigma * width), "length");
    let sheet = length / sigma + z[0] + z[1];
    close(slopes[[0, 1]], -current * sheet / (width * width), "width");
}

/// Rigid motion of the whole skin changes nothing. Scaling it changes the effect of contact
/// impedances in ohm metre: `dV/dt = -sum z dV/dz` for rim electrodes, twice that for patches.
#[test]
fn rigid_motion_and_dilation() {
    let state = State::new();
    let mut workspace = state.model.workspace().unwrap();
    let mut solution = state.model.solve(&state.sigma, &mut workspace).unwrap();
    let rigid = [
        field(&state.mesh, |_| [1.0, 2.0, -1.0]),
        field(&state.mesh, |p| [-p[1], p[0], 0.0]),
        field(&state.mesh, |p| [0.0, -p[2], p[1]]),
        field(&state.mesh, |p| [p[2], 0.3, -p[0]]),
        field(&state.mesh, |p| *p),
    ];
    let slopes = solution.movement_jacobian(&rigid).unwrap();
    let contacts = solution.contact_jacobian().unwrap();
    let voltages = solution.measurements();
    for k in 0..4 {
        // derivative per displacement of one radius; rounding of 200 elements
        assert!(largest(slopes.column(k)) < 1e-12 * largest(&voltages), "{k}");
    }
    let mut weights: Vec<f64> = state.impedance.iter().map(|z| -z).collect();
    weights[11] *= 2.0;
    let wanted = contacts.dot(&aview1(&weights));
    let error = largest(&(&slopes.column(4) - &wanted)) / largest(&wanted);
    // condition number about 1e4
    assert!(error < 1e-11, "{error:e}");
}

/// The same where the derivatives along all coordinates are more than is held at a time: 104 products of 31 000.
#[test]
fn dilation_of_a_fine_skin() {
    let disc = SkinShape::Disc { radius_m: RADIUS_M };
    let mesh = generate(&disc, &paper_electrodes(), &MeshSettings::with_edge(1.6e-3)).unwrap();
    let nodes = mesh.surface().nodes();
    assert!(nodes.len() > 12_000, "{}", nodes.len());
    let model = ForwardModel::new(&mesh, &paper_protocol(), &[1e3; 16]).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&vec![SIGMA_S; model.elements()], &mut workspace).unwrap();
    let slopes = solution.movement_jacobian(&[Displacement::of_field(nodes)]).unwrap();
    let wanted = solution.contact_jacobian().unwrap().sum_axis(Axis(1)) * -1e3;
    let error = largest(&(&slopes.column(0) - &wanted)) / largest(&wanted);
    println!("{} nodes: {error:.1e}", nodes.len());
    // measured 4e-13; condition number about 1e5
    assert!(error < 1e-11, "{error:e}");
}

/// The paper's skin, with measurements on driven electrodes too.
#[derive(Clone)]
struct Disc {
    angles: Vec<f64>,
    width_m: f64,
    impedance: f64,
}

fn protocol() -> Protocol {
    let driven_electrodes = DrivenElectrodes::Keep;
    PairProtocol { driven_electrodes, ..Default::default() }.protocol().unwrap()
}

/// Places of the measurements on other electrodes than the driven ones.
static UNDRIVEN: LazyLock<Vec<usize>> = LazyLock::new(|| {
    let undriven = |[a, b, m, n]: [u32; 4]| ![a, b].contains(&m) && ![a, b].contains(&n);
    (0..256).filter(|k| undriven(protocol().quadruples().unwrap()[*k])).collect()
});

impl Disc {
    fn paper(impedance: f64) -> Self {
        let angles = (0..16).map(|l| TAU * l as f64 / 16.0).collect();
        Self { angles, width_m: WIDTH_M, impedance }
    }

    /// Mesh-free voltages.
    fn exact(&self) -> Array1<f64> {
        let (electrode_angles_rad, electrode_width_m) = (self.angles.clone(), self.width_m);
        let series =
            DiscSeries { electrode_angles_rad, electrode_width_m, ..paper_series(10, 2000) };
        series_voltages(&series, &protocol(), &[self.impedance; 16])
    }

    fn mesh(&self, edge_m: f64) -> Mesh {
        let at = |a: &f64| [RADIUS_M * a.cos(), RADIUS_M * a.sin()];
        let placement = Placement::At(self.angles.iter().map(at).collect());
        let electrodes = RimElectrodes { width_m: self.width_m, placement };
        let electrode_edge_m = Some(0.25 * edge_m);
        let settings = MeshSettings { electrode_edge_m, ..MeshSettings::with_edge(edge_m) };
        generate(&SkinShape::Disc { radius_m: RADIUS_M }, &electrodes, &settings).unwrap()
    }

    fn model(&self, mesh: &Mesh) -> ForwardModel {
        ForwardModel::new(mesh, &protocol(), &[self.impedance; 16]).unwrap()
    }

    /// The disc with electrode 3 moved along the rim.
    fn slid(&self, by_m: f64) -> Self {
        let mut slid = self.clone();
        slid.angles[2] += by_m / RADIUS_M;
        slid
    }
}

/// Derivatives of the voltages: sliding of electrode 3 (by its displacement, by its end nodes alone,
/// by the boundary form), widening of all electrodes, change of all contacts.
fn derivatives(disc: &Disc, mesh: &Mesh) -> [Array1<f64>; 5] {
    let model = disc.model(mesh);
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&vec![SIGMA_S; model.elements()], &mut workspace).unwrap();
    let mut motions = ElectrodeMotion::Widen.displacements(mesh).unwrap();
    let slide = ElectrodeMotion::Slide.displacement(mesh, 2).unwrap();
    let ends = ends(mesh);
    let at_ends = slide.nodes().iter().copied().filter(|(node, _)| ends.contains(node)).collect();
    motions.extend([slide, Displacement::new(at_ends)]);
    let slopes = solution.movement_jacobian(&motions).unwrap();
    let widen: Array1<f64> = slopes.rows().into_iter().map(|r| r.iter().take(16).sum()).collect();
    let contacts = solution.contact_jacobian().unwrap().sum_axis(Axis(1));
    let boundary = boundary_form(disc, &mut solution, ends);
    [slopes.column(16).to_owned(), slopes.column(17).to_owned(), boundary, widen, contacts]
}

/// First and last node of electrode 3 along the rim.
fn ends(mesh: &Mesh) -> [u32; 2] {
    let Electrode::Rim(edges) = &mesh.electrodes()[2] else { panic!() };
    [edges[0][0], edges[edges.len() - 1][1]]
}

/// Boundary form: `dV = ((U - u)(U* - u*) at the start - the same at the end) / z`.
fn boundary_form(disc: &Disc, solution: &mut Solution<'_>, ends: [u32; 2]) -> Array1<f64> {
    let (inside, outside) = (solution.node_potentials(), solution.electrode_potentials());
    let protocol = protocol();
    let current = protocol.stimulations_a()[[0, 0]].abs();
    let at = |node: u32, [a, _, m, _]: [u32; 4]| {
        let [f, g] = [a, m].map(|s| outside[[s as usize, 2]] - inside[[s as usize, node as usize]]);
        f * g / (disc.impedance * current)
    };
    protocol.quadruples().unwrap().iter().map(|q| at(ends[0], *q) - at(ends[1], *q)).collect()
}

/// Derivatives against finite differences of the mesh-free series.
///
/// Bounds are twice the measured errors. Without driven electrodes and with high contact
/// impedances, a millimetre of width changes the voltages by 6e-5 of the largest, less than the
/// discretisation error, so there is no bound for that case.
#[test]
fn disc_derivatives_converge_to_those_of_the_series() {
    let (undriven, all) = (&*UNDRIVEN, &(0..256).collect());
    for (impedance, sets) in [
        (1e3, vec![(undriven, [8e-3, f64::INFINITY, 5e-2]), (all, [4e-3, 9e-3, 7e-4])]),
        (50.0, vec![(undriven, [6e-3, 6e-2, 0.2])]),
    ] {
        let disc = Disc::paper(impedance);
        // central differences; five points change them by less than a thousandth of a bound
        let slope = |h: f64, at: &dyn Fn(f64) -> Disc| (at(h).exact() - at(-h).exact()) / (2.0 * h);
        let slide = slope(1e-4, &|t| disc.slid(t));
        let widen = slope(1e-4, &|t| Disc { width_m: WIDTH_M + t, ..disc.clone() });
        let contacts =
            slope(1e-3 * impedance, &|t| Disc { impedance: impedance + t, ..disc.clone() });
        let mut before = vec![[f64::INFINITY; 2]; sets.len()];
        for edge_m in [0.012, 0.006, 0.003] {
            let found = derivatives(&disc, &disc.mesh(edge_m));
            for ((set, bounds), before) in sets.iter().zip(&mut before) {
                let of_set = |values: &Array1<f64>| values.select(Axis(0), set);
                let wanted = [&slide, &slide, &slide, &widen, &contacts];
                let errors: Vec<f64> = found
                    .iter()
                    .zip(wanted)
                    .map(|(f, w)| relative(&of_set(f), &of_set(w)))
                    .collect();
                println!("z {impedance}, {} values, edge {edge_m}: {errors:.5?}", set.len());
                let [reaching, ends_alone, boundary, widen, contacts] = errors[..] else {
                    panic!()
                };
                // half the edge length: at least first order
                assert!(widen < 0.7 * before[0] && contacts < 0.7 * before[1], "{before:?}");
                *before = [widen, contacts];
                if edge_m == 0.003 {
                    assert!(reaching < bounds[0] && widen < bounds[1] && contacts < bounds[2]);
                    // with low contact impedances the current density is unbounded at the ends
                    assert!(impedance > 50.0 || 3.0 * reaching < ends_alone.min(boundary));
                }
            }
        }
    }
}

/// Shunts and ideal current sources have derivatives along displacements, from the fields of
/// electrode elimination, but none with respect to their own impedance.
#[test]
fn movement_at_the_limits_of_contact_impedance() {
    let state = State::new();
    let mut impedance = state.impedance.clone();
    (impedance[2], impedance[5]) = (0.0, f64::INFINITY);
    let model = ForwardModel::new(&state.mesh, &adjacent(12), &impedance).unwrap();
    let state = State { model, impedance, ..state };
    let mut workspace = state.model.workspace().unwrap();
    let mut solution = state.model.solve(&state.sigma, &mut workspace).unwrap();
    for l in [2, 5, 6] {
        for motion in [ElectrodeMotion::Slide, ElectrodeMotion::Widen] {
            let displacement = motion.displacement(&state.mesh, l).unwrap();
            let slope = solution.movement_jacobian(std::slice::from_ref(&displacement)).unwrap();
            let found = five_points(1e-3, |t| state.moved(&displacement, t));
            let error = largest(&(&found - &slope.column(0))) / largest(&slope);
            // h / edge = 1e-2, to the fourth
            assert!(error < 1e-6, "{motion:?} of electrode {}: {error:e}", l + 1);
        }
    }
    let error = solution.contact_jacobian().unwrap_err();
    assert_eq!(error, FemError::ContactLimit { electrode: 3, value: 0.0 });
}

/// With stiff contacts, where nodal assembly loses all digits, derivatives are as accurate as
/// electrode elimination, compared with finite differences on that path.
#[test]
fn contacts_over_sixteen_decades() {
    let state = State::new();
    let impedance: Vec<f64> = (0..12).map(|l| 10.0_f64.powi([-8, 8, 0][l % 3])).collect();
    let model = ForwardModel::new(&state.mesh, &kept(), &impedance).unwrap();
    let voltages = |impedance: &[f64]| {
        let mut geometry = model.geometry();
        model.change_contacts(impedance, &mut geometry).unwrap();
        let mut workspace = model.workspace().unwrap();
        let solved = model.solve_deformed_to(&geometry, &state.sigma, 1e-13, &mut workspace);
        solved.unwrap().measurements()
    };
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve_to(&state.sigma, 1e-13, &mut workspace).unwrap();
    let (jacobian, zero) = (solution.contact_jacobian().unwrap(), solution.measurements());
    for l in 0..12 {
        let h = 1e-2 * impedance[l];
        let found = five_points(h, |t| {
            let mut moved = impedance.clone();
            moved[l] += t;
            voltages(&moved)
        });
        let error = found.iter().zip(jacobian.column(l)).zip(&zero).map(|((a, b), v)| {
            // rounding of a difference of voltages, and h^4 of the slope
            (a - b).abs() / (1e-13 * v.abs() / h + 1e-7 * b.abs())
        });
        let error = error.fold(0.0, f64::max);
        assert!(error < 1.0, "electrode {}: {error:e}", l + 1);
    }
}

#[test]
fn what_cannot_move_is_refused() {
    let state = State::new();
    let (slide, corners) = (ElectrodeMotion::Slide, strip(0.3, 0.1, 6, 4));
    // of electrode 5, when it touches electrode 4, and when it is torn
    let disc = ring_disc(8);
    let edge = |l: usize, k: usize| match &disc.electrodes()[l] {
        Electrode::Rim(edges) => edges[k],
        Electrode::Patch(_) => panic!("a rim electrode"),
    };
    let touching = with_electrodes(&disc, |list| {
        list[3] = Electrode::Rim(vec![edge(3, 0)]);
        list[4] = Electrode::Rim(vec![edge(3, 1)]);
    });
    let torn = with_electrodes(&disc, |list| {
        list[4] = Electrode::Rim(vec![edge(4, 0), edge(8, 0)]);
        list[8] = Electrode::Rim(vec![edge(8, 1)]);
    });
    for (mesh, electrode, words) in [
        (&state.mesh, 11, "12 cannot move along the rim: it is a patch, which has no ends on the"),
        (&state.mesh, 12, "refers to electrode 13, but the skin has electrodes 1 to 12"),
        (&touching, 4, "electrode 5 cannot move along the rim: it touches another"),
        (&torn, 4, "not one piece of rim"),
    ] {
        refused(slide.displacement(mesh, electrode), words);
    }
    refused(ElectrodeMotion::Widen.displacements(&corners), "electrode 1 cannot");
    refused(slide.displacements(&corners), "an end is at a corner of the skin");
    // but the skin can carry or stretch them
    assert!(ElectrodeMotion::Stretched.displacements(&corners).is_ok());

    let mut workspace = state.model.workspace().unwrap();
    let mut solution = state.model.solve(&state.sigma, &mut workspace).unwrap();
    let mut moved = |node, x| {
        solution.movement_jacobian(&[Displacement::new(vec![(node, [x, 0.0, 0.0])])]).unwrap_err()
    };
    assert_eq!(moved(217, 1.0), FemError::NoSuchNode { node: 217, nodes: 217 });
    let error = moved(5, f64::NAN);
    assert!(matches!(error, FemError::NonFinitePosition { node: 5, .. }), "{error}");
}
