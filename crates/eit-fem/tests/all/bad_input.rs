//! Invalid input to models and the error messages. Those of protocols are in `protocol.rs`.

use crate::common::{adjacent, kept, ring_disc, says, strip};
use eit_fem::analytic::DiscSeries;
use eit_fem::{FemError, ForwardModel, PairPattern, PairProtocol, Protocol};
use ndarray::{Array2, array};
use proptest::prelude::*;

fn try_model(impedance: &[f64]) -> Result<ForwardModel, FemError> {
    ForwardModel::new(&ring_disc(4), &adjacent(12), impedance)
}

fn model() -> ForwardModel {
    try_model(&[0.05; 12]).unwrap()
}

#[test]
fn counts_must_agree_and_values_be_possible() {
    says(
        ForwardModel::new(&ring_disc(4), &adjacent(16), &[0.05; 16]),
        "the protocol is for 16 electrodes, but the mesh has 12",
    );
    says(
        try_model(&[0.05; 11]),
        "contact impedance (one per electrode): 11 values given, 12 needed",
    );
    for value in [-1.0, f64::NAN, f64::NEG_INFINITY] {
        let mut impedance = [0.05; 12];
        impedance[2] = value;
        let wanted = format!(
            "the contact impedance of electrode 3 is {value}: it must be zero (a shunt), above \
             zero, or infinite (an ideal current source)"
        );
        says(try_model(&impedance), &wanted);
    }
    let model = model();
    for value in [0.0, -1e-5, f64::NAN, f64::INFINITY] {
        let mut conductivity = vec![1.0; model.elements()];
        conductivity[7] = value;
        let wanted = format!(
            "the conductivity of element 7 is {value} S: it must be finite and above zero (1 of \
             the elements are not; model a hole by leaving elements out of the mesh)"
        );
        says(model.forward(&conductivity), &wanted);
        says(model.jacobian(&conductivity), &wanted);
    }
    says(model.forward(&[1.0; 5]), "conductivity (one per element): 5 values given, 96 needed");
}

/// Every mismatched workspace is rejected, but one of another model with equal sizes is accepted.
#[test]
fn workspaces_of_other_models_are_refused() {
    let model = model();
    let conductivity = vec![1.0; model.elements()];
    let refused = |other: &ForwardModel, what: &str| {
        let mut workspace = other.workspace().unwrap();
        match model.solve(&conductivity, &mut workspace).unwrap_err() {
            FemError::WrongLength { what: found, .. } => {
                assert_eq!(found, format!("workspace of another model: its {what}"));
            }
            error => panic!("{error}"),
        }
    };
    let finer = ForwardModel::new(&ring_disc(8), &adjacent(12), &[0.05; 12]).unwrap();
    refused(&finer, "matrix");
    let on_the_same_mesh =
        |protocol: &Protocol| ForwardModel::new(&ring_disc(4), protocol, &[0.05; 12]).unwrap();
    let one_drive = Protocol::from_quadruples(12, &[[0, 1, 4, 5]], 1e-4).unwrap();
    // twelve stimulations, but fewer independent fields
    let narrow = (0..12).map(|d| [d % 6, d % 6 + 1, d / 6, 3]);
    let narrow: Vec<[u32; 4]> = narrow.filter(|q| q[2] != q[3]).collect();
    let narrow = Protocol::from_quadruples(12, &narrow, 1e-4).unwrap();
    // the same stimulations with opposite measurements: more combined fields
    let measure = PairPattern::Opposite;
    let opposite = PairProtocol { electrodes: 12, measure, ..Default::default() };
    for (protocol, what) in [
        (one_drive, "electrode potentials"),
        (narrow, "electrode potentials"),
        (opposite.protocol().unwrap(), "gradients"),
    ] {
        refused(&on_the_same_mesh(&protocol), what);
    }
    let mut same_sizes = on_the_same_mesh(&kept()).workspace().unwrap();
    let wanted = model.forward(&conductivity).unwrap();
    assert_eq!(model.solve(&conductivity, &mut same_sizes).unwrap().measurements(), wanted);
    // nodes, edges, electrodes but one, and their nodes: 217 + 600 + 11 + 33 and 61 + 156 + 11 + 22
    says(
        model.solve(&conductivity, &mut finer.workspace().unwrap()).map(|_| ()),
        "workspace of another model: its matrix: 861 values given, 250 needed",
    );
}

#[test]
fn buffers_must_have_the_shape_of_the_answer() {
    let model = model();
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&vec![1.0; model.elements()], &mut workspace).unwrap();
    says(
        solution.measurements_into(&mut [0.0; 107]),
        "voltages (one per measurement): 107 values given, 108 needed",
    );
    let mut into = |rows, columns| {
        let mut buffer = Array2::from_elem((rows, columns), 7.0);
        let result = solution.jacobian_into(buffer.view_mut());
        assert!(result.is_ok() || buffer.iter().all(|x| *x == 7.0), "refused before any write");
        result
    };
    says(into(109, 96), "rows of the Jacobian: 109 values given, 108 needed");
    says(into(108, 95), "columns of the Jacobian: 95 values given, 96 needed");
    says(into(96, 108), "rows of the Jacobian: 96 values given, 108 needed");
    into(108, 96).unwrap();
}

#[test]
fn overflow_is_an_error() {
    let mesh = strip(1.0, 1.0, 2, 2);
    let at = |current, sigma, z| {
        let protocol = Protocol::from_quadruples(2, &[[0, 1, 0, 1]], current).unwrap();
        ForwardModel::new(&mesh, &protocol, &[z, z]).unwrap().forward(&[sigma; 8])
    };
    says(
        at(1e300, 1e-100, 1e100),
        "the potential of electrode 1 under stimulation 0 is NaN V: the currents, conductivities \
         and contact impedances together exceed the floating-point range",
    );
    // matrix entries overflow
    says(
        at(1.0, 1.0, 5e-324),
        "the system matrix lost positive definiteness at unknown 0 of 10: the conductivities or \
         contact impedances span too many decades for this mesh",
    );
}

fn series() -> DiscSeries {
    DiscSeries {
        radius_m: 1.0,
        conductivity_s: 1.0,
        electrode_angles_rad: vec![0.0, 2.0, 4.0],
        electrode_width_m: 0.3,
        contact_impedance_ohm_m: 0.1,
        degree: 4,
        harmonics: 50,
    }
}

#[test]
fn disc_series_refuses_what_is_no_disc() {
    let currents = array![[1.0, -1.0, 0.0]];
    let refused = |change: &dyn Fn(&mut DiscSeries), wanted: &str| {
        let mut series = series();
        change(&mut series);
        says(series.electrode_potentials(currents.view()), wanted);
    };
    series().electrode_potentials(currents.view()).unwrap();
    type Change = fn(&mut DiscSeries);
    let out_of_range: [(Change, &str); 7] = [
        (|s| s.radius_m = 0.0, "radius_m is 0"),
        (|s| s.radius_m = f64::INFINITY, "radius_m is inf"),
        (|s| s.conductivity_s = -1.0, "conductivity_s is -1"),
        (|s| s.electrode_width_m = f64::NAN, "electrode_width_m is NaN"),
        (|s| s.contact_impedance_ohm_m = 0.0, "contact_impedance_ohm_m is 0"),
        (|s| s.harmonics = 0, "harmonics is 0"),
        (|s| s.electrode_width_m = std::f64::consts::PI, "covered part of the rim is 1.5"),
    ];
    for (change, what) in out_of_range {
        let must = "it must be above zero and finite (the covered part: below one)";
        refused(&change, &format!("{what}: {must}"));
    }
    refused(
        &|s| s.electrode_angles_rad = vec![0.0, 3.0],
        "the protocol is for 3 electrodes, but the mesh has 2",
    );
    // two electrodes at the same place: their equations are linearly dependent
    refused(
        &|s| {
            s.electrode_angles_rad = vec![0.0, 0.0, 3.0];
            s.contact_impedance_ohm_m = 1e-300;
        },
        "degree (the series is too long for these electrodes) is 4: it must be lower",
    );
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    /// Any conductivities and impedances over hundreds of decades give finite voltages or an error.
    #[test]
    fn extreme_values_give_numbers_or_an_error(
        sigma in proptest::collection::vec(-300.0..300.0, 96),
        z in proptest::collection::vec(-300.0..300.0, 12),
        spread in 0.0..1.0,
    ) {
        let power = |x: &f64| 10f64.powf(spread * x);
        let impedance: Vec<f64> = z.iter().map(power).collect();
        let conductivity: Vec<f64> = sigma.iter().map(power).collect();
        let model = try_model(&impedance).unwrap();
        match model.forward(&conductivity) {
            Ok(voltages) => prop_assert!(voltages.iter().all(|v| v.is_finite())),
            Err(e) => {
                let known = matches!(e, FemError::NotPositiveDefinite { .. })
                    || matches!(e, FemError::NonFinitePotential { .. });
                prop_assert!(known, "{}", e);
            }
        }
    }
}
