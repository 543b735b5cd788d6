//! The mesh chosen for a required accuracy is fine enough, but not much finer than needed.

use crate::common::{
    CONDUCTIVITY_S, IMPEDANCE_OHM_M, PAPER_VOLTAGES, RADIUS_M, WIDTH_M, even, model_of,
    paper_electrodes, paper_protocol, relative,
};
use eit_fem::{
    ChosenMesh, ElementOrder, FemError, ForwardModel, MeshSearch, PairProtocol, Protocol,
    RequiredAccuracy,
};
use eit_mesh::{Mesh, MeshSettings, PlacedElectrode, SkinShape, generate, generate_placed};
use ndarray::Array1;

fn search<'a>(protocol: &'a Protocol, impedance: &'a [f64], accuracy: f64) -> MeshSearch<'a> {
    MeshSearch {
        protocol,
        contact_impedance: impedance,
        conductivity_s: CONDUCTIVITY_S,
        required: RequiredAccuracy::Relative(accuracy),
        element_order: None,
        most_nodes: 40_000,
    }
}

fn disc(scale: f64) -> Result<Mesh, FemError> {
    let skin = SkinShape::Disc { radius_m: RADIUS_M };
    let settings = MeshSettings::default().similar(&skin, WIDTH_M, scale).unwrap();
    Ok(generate(&skin, &paper_electrodes(), &settings).unwrap())
}

/// Checks the error of a chosen mesh. It may exceed the requirement by a half, because the estimate
/// is approximate on irregular meshes (largest ratio found: docs/validation/forward.md).
fn assert_error(chosen: &ChosenMesh, protocol: &Protocol, impedance: &[f64], exact: &Array1<f64>) {
    let model = model_of(&chosen.mesh, protocol, impedance, chosen.element_order);
    let error = relative(&even(&model, CONDUCTIVITY_S), exact);
    let required = chosen.required;
    println!("{required:.0e}: {}, true {error:.1e}", description(chosen));
    assert!(chosen.error <= required);
    assert!(error < 1.5 * required, "{error:e} for {required:e}");
}

fn description(chosen: &ChosenMesh) -> String {
    let nodes = chosen.mesh.surface().nodes().len();
    format!("{:?}, {nodes} nodes, estimated {:.1e}", chosen.element_order, chosen.error)
}

/// Against the mesh-free series, for each order of elements and for the cheaper of the two.
#[test]
fn chosen_meshes_of_the_disc_have_the_error_that_was_required() {
    let (protocol, impedance) = (paper_protocol(), [IMPEDANCE_OHM_M; 16]);
    let exact = &PAPER_VOLTAGES[1];
    for (kind, accuracies) in [
        (None, &[1e-2, 1e-4][..]),
        (Some(ElementOrder::Linear), &[1e-2, 3e-3, 1.5e-3]),
        (Some(ElementOrder::Quadratic), &[1e-2, 1e-3, 1e-4, 1e-5]),
    ] {
        let mut nodes = 0;
        for &accuracy in accuracies {
            let search =
                MeshSearch { element_order: kind, ..search(&protocol, &impedance, accuracy) };
            let chosen = search.run(disc).unwrap();
            assert_error(&chosen, &protocol, &impedance, exact);
            assert!(kind.is_none_or(|kind| kind == chosen.element_order));
            let found = chosen.mesh.surface().nodes().len();
            assert!(found >= nodes || kind.is_none());
            nodes = found;
            let fewer = chosen.trials.iter().filter(|t| t.nodes < found);
            let mut fewer = fewer.filter(|t| t.element_order == chosen.element_order);
            assert!(fewer.all(|t| t.error.unwrap() > accuracy));
        }
    }
}

/// An accuracy in volts gives the same mesh as the same accuracy relative to the largest voltage.
#[test]
fn volts_are_measured_by_the_largest_voltage() {
    let (protocol, impedance) = (paper_protocol(), [IMPEDANCE_OHM_M; 16]);
    let relative = search(&protocol, &impedance, 1e-3).run(disc).unwrap();
    let volts = RequiredAccuracy::Volts(1e-3 * relative.largest_v);
    let search = MeshSearch { required: volts, ..search(&protocol, &impedance, 0.5) };
    let found = search.run(disc).unwrap();
    // the largest voltages of coarse meshes differ in the third digit
    assert_eq!(found.trials.len(), relative.trials.len());
    assert_eq!(found.mesh.surface().nodes().len(), relative.mesh.surface().nodes().len());
    assert!((found.required - 1e-3).abs() < 1e-5);
}

/// A plate with corners, a hole and patches, compared with quadratic elements on four times the
/// nodes of the finest mesh tried. Same tolerance as on the disc.
#[test]
fn chosen_meshes_of_a_plate_with_patches() {
    let skin = SkinShape::Polygon {
        outline_m: vec![[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]],
        holes_m: vec![vec![[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [-0.03, 0.03]]],
    };
    let electrodes = [
        PlacedElectrode::rim([-0.1, -0.1, 0.0], 0.02),
        PlacedElectrode::patch([0.1, -0.05, 0.0], 0.008),
        PlacedElectrode::rim([0.15, 0.0, 0.0], 0.03),
        PlacedElectrode::patch([0.1, 0.05, 0.0], 0.008),
        PlacedElectrode::rim([-0.1, 0.1, 0.0], 0.02),
        PlacedElectrode::rim([-0.03, 0.0, 0.0], 0.01),
    ];
    let impedance = [1e3, 1.0, 1e3, 1.0, 1e3, 1e3];
    let protocol = PairProtocol { electrodes: 6, ..Default::default() }.protocol().unwrap();
    let mesh = |scale| {
        let settings = MeshSettings::default().similar(&skin, 0.01, scale).unwrap();
        Ok::<_, FemError>(generate_placed(&skin, &electrodes, &settings).unwrap())
    };
    let fine = mesh(0.07).unwrap();
    println!("judged by {} nodes", fine.surface().nodes().len());
    let exact =
        even(&model_of(&fine, &protocol, &impedance, ElementOrder::Quadratic), CONDUCTIVITY_S);
    for accuracy in [1e-2, 1e-3, 1e-4] {
        let chosen = search(&protocol, &impedance, accuracy).run(mesh).unwrap();
        assert_error(&chosen, &protocol, &impedance, &exact);
    }
}

/// Shunts support linear elements only, whose error is then estimated from finer linear elements.
#[test]
fn shunts_are_searched_with_linear_elements() {
    let mut impedance = [IMPEDANCE_OHM_M; 16];
    impedance[3] = 0.0;
    let chosen = search(&paper_protocol(), &impedance, 2e-2).run(disc).unwrap();
    assert_eq!(chosen.element_order, ElementOrder::Linear);
    assert!(chosen.error <= 2e-2);
    assert!(chosen.trials.iter().all(|t| t.element_order == ElementOrder::Linear));
    println!("shunt: {}", description(&chosen));
}

#[test]
fn what_cannot_be_had_is_refused_with_what_can() {
    let (protocol, impedance) = (paper_protocol(), [IMPEDANCE_OHM_M; 16]);
    let few = MeshSearch { most_nodes: 2000, ..search(&protocol, &impedance, 1e-9) };
    let error = few.run(disc).unwrap_err();
    let FemError::NoMeshSuffices { reached, nodes, required, most_nodes: 2000 } = error else {
        panic!("{error}")
    };
    assert!(reached > 1e-6 && reached < 1e-3 && nodes < 1200, "{reached} {nodes}");
    assert!((required - 1e-9).abs() < 1e-20);
    for bad in [0.0, -1.0, 1.0, f64::NAN, f64::INFINITY] {
        let found = search(&protocol, &impedance, bad).run(disc);
        assert!(matches!(found, Err(FemError::OutOfRange { .. })), "{bad}: {found:?}");
    }
    let volts = RequiredAccuracy::Volts(f64::NAN);
    let bad = MeshSearch { required: volts, ..search(&protocol, &impedance, 0.5) };
    assert!(matches!(bad.run(disc), Err(FemError::OutOfRange { .. })));
    // errors of `mesh_of` are passed on
    let error = FemError::ElectrodeCount { protocol: 1, mesh: 2 };
    assert_eq!(search(&protocol, &impedance, 1e-2).run(|_| Err(error.clone())).err(), Some(error));
}

/// For single meshes, the estimate agrees with the series within a factor of 1.5.
#[test]
fn linear_elements_are_judged_by_quadratic_ones_on_the_same_mesh() {
    let (protocol, impedance) = (paper_protocol(), [IMPEDANCE_OHM_M; 16]);
    for scale in [1.0, 0.4, 0.15] {
        let mesh = disc(scale).unwrap();
        let nodes = mesh.surface().nodes().len();
        let found = search(&protocol, &impedance, 0.5).of_linear(&mesh).unwrap().error;
        let model = ForwardModel::new(&mesh, &protocol, &impedance).unwrap();
        let error = relative(&even(&model, CONDUCTIVITY_S), &PAPER_VOLTAGES[1]);
        println!("{nodes} nodes: estimated {found:.2e}, true {error:.2e}");
        assert!(found / error < 1.5 && error / found < 1.5, "{found:e} for {error:e}");
    }
}
