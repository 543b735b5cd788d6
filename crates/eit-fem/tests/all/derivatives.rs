//! Derivatives with respect to contacts, nodes and electrodes: Taylor remainders, closed forms,
//! symmetry, and differences of independent solutions. The file is long because all these tests
//! share their skins.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "tests"
)]

use crate::common::{largest, noise, paper_series, ring_disc, series_voltages, strip};
use eit_fem::analytic::DiscSeries;
use eit_fem::{
    Anisotropy, Displacement, DrivenElectrodes, ElectrodeMotion, FemError, ForwardModel,
    PairProtocol, Protocol, Solution,
};
use eit_mesh::{
    Electrode, Mesh, MeshSettings, Placement, RimElectrodes, SkinShape, Surface, generate,
};
use ndarray::{Array1, Array2, ArrayView1, aview1};
use std::f64::consts::TAU;

const MOTIONS: [ElectrodeMotion; 6] = [
    ElectrodeMotion::Slide,
    ElectrodeMotion::Widen,
    ElectrodeMotion::CarriedAlong,
    ElectrodeMotion::CarriedOutward,
    ElectrodeMotion::Carried([0.3, -0.5, 0.8]),
    ElectrodeMotion::Stretched,
];

/// Includes measurements on driven electrodes, where contacts matter most.
fn protocol(electrodes: usize) -> Protocol {
    let driven_electrodes = DrivenElectrodes::Keep;
    let current_a = 0.5;
    PairProtocol { electrodes, driven_electrodes, current_a, ..Default::default() }
        .protocol()
        .unwrap()
}

/// A skin in a random state: unequal contacts, conductivities from 0.5 to 1.5, and a patch.
struct State {
    mesh: Mesh,
    model: ForwardModel,
    impedance: Vec<f64>,
    sigma: Vec<f64>,
}

impl State {
    fn new() -> Self {
        let disc = ring_disc(8);
        let mut electrodes = disc.electrodes().to_vec();
        electrodes[11] = Electrode::Patch(vec![0, 1, 2, 3]);
        let mesh = Mesh::new(disc.surface().clone(), electrodes).unwrap();
        let impedance: Vec<f64> = noise(7, 12).iter().map(|x| 0.05 + x).collect();
        let model = ForwardModel::new(&mesh, &protocol(12), &impedance).unwrap();
        let sigma = noise(3, model.elements()).iter().map(|x| 0.5 + x).collect();
        Self { mesh, model, impedance, sigma }
    }

    /// Voltages after changing nodes and contacts.
    fn voltages(&self, nodes: &[[f64; 3]], impedance: &[f64]) -> Array1<f64> {
        let mut geometry = self.model.geometry();
        self.model.deform(nodes, impedance, &mut geometry).unwrap();
        let mut workspace = self.model.workspace().unwrap();
        self.model.solve_deformed(&geometry, &self.sigma, &mut workspace).unwrap().measurements()
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

/// Checks that the remainder `|V(t) - V(0) - t J|` falls as `t^2`, from the slopes between halved
/// steps.
///
/// The remainder is `t^2 |V''| / 2 + t^3 ..`. With the largest step a few per cent of an electrode,
/// the slope is 2 to within 2 %. Rounding (1e-14 of the voltages) stays four digits below the last
/// remainder.
fn assert_slope_two(
    what: &str,
    zero: &Array1<f64>,
    slope: ArrayView1<'_, f64>,
    step: f64,
    at: impl Fn(f64) -> Array1<f64>,
) {
    let remainder = |t: f64| largest(&(&at(t) - zero - &(&slope * t)));
    let steps = [step, 0.5 * step, 0.25 * step];
    let [a, b, c] = steps.map(remainder);
    let slopes = [(a / b).log2(), (b / c).log2()];
    assert!(
        slopes.iter().all(|s| (s - 2.0).abs() < 0.1),
        "{what}: {slopes:?} of {a:e} {b:e} {c:e}"
    );
    // the derivative is not zero
    assert!(
        largest(slope) * step > 10.0 * a,
        "{what}: first order {:e}, rest {a:e}",
        largest(slope) * step
    );
}

/// `(8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / 12 h`, with the error `h^4 f^(5) / 30`.
fn five_points(h: f64, at: impl Fn(f64) -> Array1<f64>) -> Array1<f64> {
    (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
}

#[test]
fn taylor_contacts() {
    let state = State::new();
    let zero = state.voltages(state.nodes(), &state.impedance);
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
        assert_slope_two(&format!("contact {}", l + 1), &zero, jacobian.column(l), step, at);
        let found = five_points(step, at);
        let error = largest(&(&found - &jacobian.column(l))) / largest(jacobian.column(l));
        // h^4 = 1e-8 of a fifth derivative 24 times the first, over 30; rounding 1e-13 / h
        assert!(error < 1e-7, "contact {}: {error:e}", l + 1);
    }
}

#[test]
fn taylor_nodes_and_electrodes() {
    check_movement(&State::new());
    // ratios from 0.5 to 2.5, and directions in space, whose part in the plane moves with it
    let state = State::new();
    let count = state.model.elements();
    let ratios: Vec<f64> = noise(13, count).iter().map(|x| 0.5 + 2.0 * x).collect();
    let parts = noise(17, 3 * count);
    let directions: Vec<[f64; 3]> =
        parts.chunks_exact(3).map(|d| std::array::from_fn(|k| 0.2 + d[k])).collect();
    let sheet = Anisotropy::new(&ratios, &directions).unwrap();
    check_movement(&State { model: state.model.clone().with_anisotropy(&sheet).unwrap(), ..state });
}

fn check_movement(state: &State) {
    let zero = state.voltages(state.nodes(), &state.impedance);
    let mut workspace = state.model.workspace().unwrap();
    let mut solution = state.model.solve(&state.sigma, &mut workspace).unwrap();
    // all nodes in all directions, including out of the plane (a second-order effect)
    let shifts = noise(9, 3 * state.nodes().len());
    let field: Vec<[f64; 3]> =
        shifts.chunks_exact(3).map(|s| std::array::from_fn(|k| 2.0 * s[k] - 1.0)).collect();
    let mut motions = state.motions();
    // 5 motions of 11 rim electrodes, and one of all electrodes
    assert_eq!(motions.len(), 5 * 11 + 12);
    motions.push((ElectrodeMotion::Carried([0.0; 3]), 99, Displacement::of_field(&field)));
    let displacements: Vec<Displacement> = motions.iter().map(|m| m.2.clone()).collect();
    let jacobian = solution.movement_jacobian(&displacements).unwrap();
    for (k, (motion, l, displacement)) in motions.iter().enumerate() {
        let what = format!("{motion:?} of electrode {}", l + 1);
        let at = |t: f64| state.moved(displacement, t);
        // an electrode is 0.26 long, an edge 0.13
        assert_slope_two(&what, &zero, jacobian.column(k), 2e-3, at);
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

/// Relative error of the voltages' change by a displacement in the plane, against the dented mesh.
fn error_of_dent(edge_m: f64) -> f64 {
    let disc = Disc::paper(1e3, DrivenElectrodes::Drop);
    let mesh = disc.mesh(edge_m);
    let (height, width, centre) = (1e-3, 0.02, [0.045, 0.02]);
    let from_centre = |node: &[f64; 3]| [node[0] - centre[0], node[1] - centre[1]];
    let bell = |[x, y]: [f64; 2]| (-(x * x + y * y) / (2.0 * width * width)).exp();
    let nodes = mesh.surface().nodes();
    let dented = |node: &[f64; 3]| [node[0], node[1], height * bell(from_centre(node))];
    let dented: Vec<[f64; 3]> = nodes.iter().map(dented).collect();
    let pulled = |node: &[f64; 3]| {
        let way = from_centre(node);
        let factor = -(height / (2.0 * width) * bell(way)).powi(2);
        [factor * way[0], factor * way[1], 0.0]
    };
    let field: Vec<[f64; 3]> = nodes.iter().map(pulled).collect();
    let model = disc.model(&mesh);
    let sigma = vec![SIGMA_S; model.elements()];
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&sigma, &mut workspace).unwrap();
    let before = solution.measurements();
    let of_plane = solution.movement_jacobian(&[Displacement::of_field(&field)]).unwrap();
    let mut geometry = model.geometry();
    model.deform(&dented, &[1e3; 16], &mut geometry).unwrap();
    let of_dent = model.solve_deformed(&geometry, &sigma, &mut workspace).unwrap().measurements();
    relative(&of_plane.column(0).to_owned(), &(of_dent - before))
}

/// The same on a non-planar skin, bent into a bowl.
#[test]
fn taylor_on_a_curved_skin() {
    let flat = ring_disc(8);
    let bowl: Vec<[f64; 3]> = flat
        .surface()
        .nodes()
        .iter()
        .map(|p| [p[0], p[1], 0.6 * (p[0] * p[0] + 0.5 * p[1] * p[1])])
        .collect();
    let surface = Surface::new(bowl, flat.surface().triangles().to_vec()).unwrap();
    let mesh = Mesh::new(surface, flat.electrodes().to_vec()).unwrap();
    let model = ForwardModel::new(&mesh, &protocol(12), &[0.2; 12]).unwrap();
    let sigma = noise(3, model.elements()).iter().map(|x| 0.5 + x).collect();
    let state = State { mesh, model, impedance: vec![0.2; 12], sigma };
    let zero = state.voltages(state.nodes(), &state.impedance);
    let mut workspace = state.model.workspace().unwrap();
    let mut solution = state.model.solve(&state.sigma, &mut workspace).unwrap();
    for motion in MOTIONS {
        let displacement = motion.displacement(&state.mesh, 4).unwrap();
        let slope = solution.movement_jacobian(std::slice::from_ref(&displacement)).unwrap();
        let at = |t: f64| state.moved(&displacement, t);
        assert_slope_two(&format!("{motion:?}"), &zero, slope.column(0), 2e-3, at);
    }
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
    let field = |along: &dyn Fn(&[f64; 3]) -> [f64; 3]| {
        let nodes: Vec<[f64; 3]> = mesh.surface().nodes().iter().map(along).collect();
        Displacement::of_field(&nodes)
    };
    let longer = field(&|p| [p[0] / length, 0.0, 0.0]);
    let wider = field(&|p| [0.0, p[1] / width, 0.0]);
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
    let field = |f: &dyn Fn(&[f64; 3]) -> [f64; 3]| {
        Displacement::of_field(&state.nodes().iter().map(f).collect::<Vec<_>>())
    };
    let rigid = [
        field(&|_| [1.0, 2.0, -1.0]),
        field(&|p| [-p[1], p[0], 0.0]),
        field(&|p| [0.0, -p[2], p[1]]),
        field(&|p| [p[2], 0.3, -p[0]]),
        field(&|p| *p),
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

/// Rotating a symmetric skin by 60 degrees only renumbers electrodes and measurements.
#[test]
fn turning_a_symmetric_skin_renumbers() {
    let mesh = ring_disc(8);
    let protocol = protocol(12);
    let model = ForwardModel::new(&mesh, &protocol, &[0.1; 12]).unwrap();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&vec![1.0; model.elements()], &mut workspace).unwrap();
    let quadruples = protocol.quadruples().unwrap().to_vec();
    let turned = |q: &[u32; 4]| q.map(|e| (e + 2) % 12);
    let row = |q: [u32; 4]| quadruples.iter().position(|other| *other == q).unwrap();
    let check = |what: &str, jacobian: &Array2<f64>| {
        for (i, q) in quadruples.iter().enumerate() {
            let other = row(turned(q));
            for l in 0..12 {
                let difference = jacobian[[i, l]] - jacobian[[other, (l + 2) % 12]];
                // condition number about 1e4
                assert!(difference.abs() < 1e-11 * largest(jacobian), "{what}: {difference:e}");
            }
        }
    };
    check("contacts", &solution.contact_jacobian().unwrap());
    for motion in MOTIONS.into_iter().filter(|m| !matches!(m, ElectrodeMotion::Carried(_))) {
        let displacements = motion.displacements(&mesh).unwrap();
        check(&format!("{motion:?}"), &solution.movement_jacobian(&displacements).unwrap());
    }
}

/// The paper's skin.
struct Disc {
    angles: Vec<f64>,
    width_m: f64,
    impedance: f64,
    driven_electrodes: DrivenElectrodes,
}

const RADIUS_M: f64 = 0.1;
const SIGMA_S: f64 = 1e-5;

impl Disc {
    fn paper(impedance: f64, driven_electrodes: DrivenElectrodes) -> Self {
        let angles = (0..16).map(|l| TAU * l as f64 / 16.0).collect();
        Self { angles, width_m: 0.0196, impedance, driven_electrodes }
    }

    fn protocol(&self) -> Protocol {
        let driven_electrodes = self.driven_electrodes;
        PairProtocol { driven_electrodes, ..Default::default() }.protocol().unwrap()
    }

    /// Mesh-free voltages.
    fn exact(&self) -> Array1<f64> {
        let series = DiscSeries {
            electrode_angles_rad: self.angles.clone(),
            electrode_width_m: self.width_m,
            ..paper_series(12, 3000)
        };
        series_voltages(&series, &self.protocol(), &[self.impedance; 16])
    }

    fn mesh(&self, edge_m: f64) -> Mesh {
        let at = |a: &f64| [RADIUS_M * a.cos(), RADIUS_M * a.sin()];
        let electrodes = RimElectrodes {
            width_m: self.width_m,
            placement: Placement::At(self.angles.iter().map(at).collect()),
        };
        let settings = MeshSettings {
            edge_m: Some(edge_m),
            electrode_edge_m: Some(0.25 * edge_m),
            ..Default::default()
        };
        generate(&SkinShape::Disc { radius_m: RADIUS_M }, &electrodes, &settings).unwrap()
    }

    fn model(&self, mesh: &Mesh) -> ForwardModel {
        ForwardModel::new(mesh, &self.protocol(), &[self.impedance; 16]).unwrap()
    }

    /// The disc with electrode 3 moved along the rim.
    fn slid(&self, by_m: f64) -> Self {
        let mut angles = self.angles.clone();
        angles[2] += by_m / RADIUS_M;
        Self { angles, ..*self }
    }

    fn widened(&self, by_m: f64) -> Self {
        Self { angles: self.angles.clone(), width_m: self.width_m + by_m, ..*self }
    }

    fn with_contacts(&self, impedance: f64) -> Self {
        Self { angles: self.angles.clone(), impedance, ..*self }
    }
}

/// Derivatives of the discrete voltages, [measurement].
struct OfMesh {
    voltages: Array1<f64>,
    /// Sliding of electrode 3: by its displacement, by its end nodes alone, by the boundary form.
    slide: [Array1<f64>; 3],
    /// Widening of all electrodes.
    widen: Array1<f64>,
    /// Change of all contact impedances.
    contacts: Array1<f64>,
}

fn of_mesh(disc: &Disc, mesh: &Mesh) -> OfMesh {
    let model = disc.model(mesh);
    let mut workspace = model.workspace().unwrap();
    let sigma = vec![SIGMA_S; model.elements()];
    let mut solution = model.solve(&sigma, &mut workspace).unwrap();
    let mut motions = ElectrodeMotion::Widen.displacements(mesh).unwrap();
    let slide = ElectrodeMotion::Slide.displacement(mesh, 2).unwrap();
    let ends = ends(mesh);
    let at_ends = slide.nodes().iter().copied().filter(|(node, _)| ends.contains(node)).collect();
    motions.extend([slide, Displacement::new(at_ends)]);
    let slopes = solution.movement_jacobian(&motions).unwrap();
    let widen: Array1<f64> = slopes.rows().into_iter().map(|r| r.iter().take(16).sum()).collect();
    let contacts = solution.contact_jacobian().unwrap().sum_axis(ndarray::Axis(1));
    let boundary = boundary_form(disc, &mut solution, ends);
    let slide = [slopes.column(16).to_owned(), slopes.column(17).to_owned(), boundary];
    OfMesh { voltages: solution.measurements(), slide, widen, contacts }
}

/// First and last node of electrode 3 along the rim.
fn ends(mesh: &Mesh) -> [u32; 2] {
    let Electrode::Rim(edges) = &mesh.electrodes()[2] else { panic!() };
    [edges[0][0], edges[edges.len() - 1][1]]
}

/// Boundary form: `dV = ((U - u)(U* - u*) at the start - the same at the end) / z`.
fn boundary_form(disc: &Disc, solution: &mut Solution<'_>, ends: [u32; 2]) -> Array1<f64> {
    let (inside, outside) = (solution.node_potentials(), solution.electrode_potentials());
    let protocol = disc.protocol();
    let current = protocol.stimulations_a()[[0, 0]].abs();
    let at = |node: u32, [a, _, m, _]: [u32; 4]| {
        let [f, g] = [a, m].map(|s| outside[[s as usize, 2]] - inside[[s as usize, node as usize]]);
        f * g / (disc.impedance * current)
    };
    protocol.quadruples().unwrap().iter().map(|q| at(ends[0], *q) - at(ends[1], *q)).collect()
}

fn relative(found: &Array1<f64>, exact: &Array1<f64>) -> f64 {
    largest(&(found - exact)) / largest(exact)
}

/// Derivatives against finite differences of the mesh-free series.
///
/// Bounds are twice the measured errors. Without driven electrodes and with high contact
/// impedances, a millimetre of width changes the voltages by 6e-5 of the largest, less than the
/// discretisation error, so there is no bound for that case.
#[test]
fn disc_derivatives_converge_to_those_of_the_series() {
    for (impedance, driven, bounds) in [
        (1e3, DrivenElectrodes::Drop, [8e-3, f64::INFINITY, 5e-2]),
        (50.0, DrivenElectrodes::Drop, [6e-3, 6e-2, 0.2]),
        (1e3, DrivenElectrodes::Keep, [4e-3, 9e-3, 7e-4]),
    ] {
        let disc = Disc::paper(impedance, driven);
        let exact = disc.exact();
        let h = 2e-4;
        let slide = five_points(h, |t| disc.slid(t).exact());
        let widen = five_points(h, |t| disc.widened(t).exact());
        let contacts = five_points(0.01 * impedance, |t| disc.with_contacts(impedance + t).exact());
        println!(
            "z {impedance}, driven electrodes {driven:?}: largest voltage {:.2e} V; changes for 1 mm \
             along {:.1e}, 1 mm wider {:.1e}, 1 % of z {:.1e}",
            largest(&exact),
            1e-3 * largest(&slide),
            1e-3 * largest(&widen),
            0.01 * impedance * largest(&contacts)
        );
        let mut before = [f64::INFINITY; 2];
        for edge_m in [0.012, 0.006, 0.003] {
            let mesh = disc.mesh(edge_m);
            let found = of_mesh(&disc, &mesh);
            let errors = [relative(&found.widen, &widen), relative(&found.contacts, &contacts)];
            let slides = found.slide.each_ref().map(|s| relative(s, &slide));
            println!(
                "{} nodes: voltages {:.1e}, slide {:.1e} (ends alone {:.1e}, boundary form {:.1e}), \
                 widen {:.1e}, contacts {:.1e}",
                mesh.surface().nodes().len(),
                relative(&found.voltages, &exact),
                slides[0],
                slides[1],
                slides[2],
                errors[0],
                errors[1],
            );
            // half the edge length: at least first order
            assert!(errors.iter().zip(&before).all(|(e, b)| *e < 0.7 * b), "{errors:?}");
            before = errors;
            if edge_m == 0.003 {
                let [slide, widen, contacts] = bounds;
                assert!(slides[0] < slide && errors[0] < widen && errors[1] < contacts);
                // with low contact impedances the current density is unbounded at the ends
                let [reaching, ends_alone, boundary] = slides;
                assert!(impedance > 50.0 || 3.0 * reaching < ends_alone.min(boundary));
            }
        }
    }
}

/// Sliding against finite differences of solutions on new meshes with electrode 3 moved.
#[test]
fn slide_is_the_difference_of_remeshed_skins() {
    let disc = Disc::paper(1e3, DrivenElectrodes::Drop);
    let edge_m = 0.004;
    let voltages = |by_m: f64| -> Array1<f64> {
        let disc = disc.slid(by_m);
        let model = disc.model(&disc.mesh(edge_m));
        model.forward(&vec![SIGMA_S; model.elements()]).unwrap()
    };
    let slope = &of_mesh(&disc, &disc.mesh(edge_m)).slide[0];
    let h = 2e-3;
    let found = (voltages(h) - voltages(-h)) / (2.0 * h);
    let error = relative(slope, &found);
    println!("remeshed by {h} m: {error:.1e}");
    // third derivative over 2 mm of a 19.6 mm electrode: 1e-3; differences between meshes: 1e-4 of
    // a change of 5e-2
    assert!(error < 6e-3, "{error:e}");
}

/// Shunts and ideal current sources have derivatives along displacements, from the fields of
/// electrode elimination, but none with respect to their own impedance.
#[test]
fn movement_at_the_limits_of_contact_impedance() {
    let state = State::new();
    let quadruples: Vec<[u32; 4]> = (0..12u32)
        .flat_map(|d| (2..11).map(move |k| [d, (d + 1) % 12, (d + k) % 12, (d + k + 1) % 12]))
        .filter(|q| q[3] != q[0])
        .collect();
    let protocol = Protocol::from_quadruples(12, &quadruples, 0.5).unwrap();
    let mut impedance = state.impedance.clone();
    (impedance[2], impedance[5]) = (0.0, f64::INFINITY);
    let model = ForwardModel::new(&state.mesh, &protocol, &impedance).unwrap();
    let voltages = |displacement: &Displacement, amount: f64| {
        let mut nodes = state.nodes().to_vec();
        displacement.apply(amount, &mut nodes).unwrap();
        let mut geometry = model.geometry();
        model.deform(&nodes, &impedance, &mut geometry).unwrap();
        let mut workspace = model.workspace().unwrap();
        model.solve_deformed(&geometry, &state.sigma, &mut workspace).unwrap().measurements()
    };
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&state.sigma, &mut workspace).unwrap();
    for l in [2, 5, 6] {
        for motion in [ElectrodeMotion::Slide, ElectrodeMotion::Widen] {
            let displacement = motion.displacement(&state.mesh, l).unwrap();
            let slope = solution.movement_jacobian(std::slice::from_ref(&displacement)).unwrap();
            let found = five_points(1e-3, |t| voltages(&displacement, t));
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
    let model = ForwardModel::new(&state.mesh, &protocol(12), &impedance).unwrap();
    let voltages = |impedance: &[f64]| {
        let mut geometry = model.geometry();
        model.change_contacts(impedance, &mut geometry).unwrap();
        let mut workspace = model.workspace().unwrap();
        let solution =
            model.solve_deformed_to(&geometry, &state.sigma, 1e-13, &mut workspace).unwrap();
        solution.measurements()
    };
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve_to(&state.sigma, 1e-13, &mut workspace).unwrap();
    let jacobian = solution.contact_jacobian().unwrap();
    let zero = solution.measurements();
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
    let patch = ElectrodeMotion::Slide.displacements(&state.mesh).unwrap_err().to_string();
    assert_eq!(
        patch,
        "electrode 12 cannot move along the rim: it is a patch, which has no ends on the rim"
    );
    let missing = ElectrodeMotion::Slide.displacement(&state.mesh, 12).unwrap_err().to_string();
    assert!(
        missing.contains("refers to electrode 13, but the skin has electrodes 1 to 12"),
        "{missing}"
    );
    // both electrodes of the strip end at corners
    let corner = ElectrodeMotion::Widen.displacements(&strip(0.3, 0.1, 6, 4)).unwrap_err();
    assert!(corner.to_string().contains("electrode 1 cannot"), "{corner}");
    assert!(corner.to_string().contains("an end is at a corner of the skin"), "{corner}");
    // but the skin can carry or stretch them
    assert!(ElectrodeMotion::Stretched.displacements(&strip(0.3, 0.1, 6, 4)).is_ok());
    let disc = ring_disc(8);
    let mut electrodes = disc.electrodes().to_vec();
    let Electrode::Rim(edges) = &electrodes[3] else { panic!() };
    let touching = edges[1];
    electrodes[3] = Electrode::Rim(vec![edges[0]]);
    electrodes[4] = Electrode::Rim(vec![touching]);
    let touching = Mesh::new(disc.surface().clone(), electrodes.clone()).unwrap();
    let error = ElectrodeMotion::Slide.displacement(&touching, 4).unwrap_err().to_string();
    assert!(error.contains("electrode 5 cannot move along the rim: it touches another"), "{error}");
    let Electrode::Rim(far) = &disc.electrodes()[8] else { panic!() };
    electrodes[4] = Electrode::Rim(vec![touching_edge(&disc), far[0]]);
    electrodes[8] = Electrode::Rim(vec![far[1]]);
    let torn = Mesh::new(disc.surface().clone(), electrodes).unwrap();
    let error = ElectrodeMotion::Slide.displacement(&torn, 4).unwrap_err().to_string();
    assert!(error.contains("not one piece of rim"), "{error}");

    let mut workspace = state.model.workspace().unwrap();
    let mut solution = state.model.solve(&state.sigma, &mut workspace).unwrap();
    let far = Displacement::new(vec![(217, [1.0, 0.0, 0.0])]);
    let error = solution.movement_jacobian(&[far]).unwrap_err();
    assert_eq!(error, FemError::NoSuchNode { node: 217, nodes: 217 });
    let nan = Displacement::new(vec![(5, [f64::NAN, 0.0, 0.0])]);
    let error = solution.movement_jacobian(&[nan]).unwrap_err();
    assert!(matches!(error, FemError::NonFinitePosition { node: 5, .. }));
}

fn touching_edge(disc: &Mesh) -> [u32; 2] {
    let Electrode::Rim(edges) = &disc.electrodes()[4] else { panic!() };
    edges[0]
}
