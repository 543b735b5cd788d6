//! Invalid input to models and the error messages. Those of protocols are in `protocol.rs`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{ring_disc, says, strip};
use eit_fem::analytic::DiscSeries;
use eit_fem::{DrivenElectrodes, FemError, ForwardModel, PairProtocol, Protocol};
use ndarray::{Array2, array};
use proptest::prelude::*;

fn protocol() -> Protocol {
    PairProtocol { electrodes: 12, ..Default::default() }.protocol().unwrap()
}

fn model() -> ForwardModel {
    ForwardModel::new(&ring_disc(4), &protocol(), &[0.05; 12]).unwrap()
}

#[test]
fn electrode_counts_must_agree() {
    let other = PairProtocol::default().protocol().unwrap();
    let mesh = ring_disc(4);
    says(
        ForwardModel::new(&mesh, &other, &[0.05; 16]),
        "the protocol is for 16 electrodes, but the mesh has 12",
    );
    says(
        ForwardModel::new(&mesh, &protocol(), &[0.05; 11]),
        "contact impedance (one per electrode): 11 values given, 12 needed",
    );
}

#[test]
fn impedances_must_not_be_negative() {
    for (value, text) in [(-1.0, "-1"), (f64::NAN, "NaN"), (f64::NEG_INFINITY, "-inf")] {
        let mut impedance = [0.05; 12];
        impedance[2] = value;
        says(
            ForwardModel::new(&ring_disc(4), &protocol(), &impedance),
            &format!(
                "the contact impedance of electrode 3 is {text}: it must be zero (a shunt), above \
                 zero, or infinite (an ideal current source)"
            ),
        );
    }
}

#[test]
fn conductivities_must_be_positive_numbers() {
    let model = model();
    for (value, text) in
        [(0.0, "0"), (-1e-5, "-0.00001"), (f64::NAN, "NaN"), (f64::INFINITY, "inf")]
    {
        let mut conductivity = vec![1.0; model.elements()];
        conductivity[7] = value;
        let wanted = format!(
            "the conductivity of element 7 is {text} S: it must be finite and above zero (1 of \
                 the elements are not; model a hole by leaving elements out of the mesh)"
        );
        says(model.forward(&conductivity), &wanted);
        says(model.jacobian(&conductivity), &wanted);
    }
    says(model.forward(&[1.0; 5]), "conductivity (one per element): 5 values given, 96 needed");
}

/// Every kind of mismatched workspace is rejected, but one of another model with equal sizes is
/// accepted.
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
    let finer = ForwardModel::new(&ring_disc(8), &protocol(), &[0.05; 12]).unwrap();
    refused(&finer, "matrix");
    let on_the_same_mesh =
        |protocol: &Protocol| ForwardModel::new(&ring_disc(4), protocol, &[0.05; 12]).unwrap();
    let one_drive = Protocol::from_quadruples(12, &[[0, 1, 4, 5]], 1e-4).unwrap();
    refused(&on_the_same_mesh(&one_drive), "electrode potentials");
    // twelve stimulations, but fewer independent fields
    let narrow: Vec<[u32; 4]> = (0..12).map(|d| [d % 6, d % 6 + 1, d / 6, 3]).collect();
    let narrow: Vec<[u32; 4]> = narrow.into_iter().filter(|q| q[2] != q[3]).collect();
    refused(
        &on_the_same_mesh(&Protocol::from_quadruples(12, &narrow, 1e-4).unwrap()),
        "electrode potentials",
    );
    // the same stimulations with opposite measurements: more combined fields
    let opposite = PairProtocol {
        electrodes: 12,
        measure: eit_fem::PairPattern::Opposite,
        ..Default::default()
    };
    refused(&on_the_same_mesh(&opposite.protocol().unwrap()), "gradients");
    let keep = PairProtocol {
        electrodes: 12,
        driven_electrodes: DrivenElectrodes::Keep,
        ..Default::default()
    };
    let mut same_sizes = on_the_same_mesh(&keep.protocol().unwrap()).workspace().unwrap();
    let wanted = model.forward(&conductivity).unwrap();
    assert_eq!(model.solve(&conductivity, &mut same_sizes).unwrap().measurements(), wanted);
    // nodes, edges, electrodes except one, and their nodes: 217 + 600 + 11 + 33 and 61 + 156 + 11 +
    // 22
    says(
        model.solve(&conductivity, &mut finer.workspace().unwrap()).map(|_| ()),
        "workspace of another model: its matrix: 861 values given, 250 needed",
    );
}

#[test]
fn buffers_must_have_the_shape_of_the_answer() {
    let model = model();
    let conductivity = vec![1.0; model.elements()];
    let mut workspace = model.workspace().unwrap();
    let mut solution = model.solve(&conductivity, &mut workspace).unwrap();
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

/// Values at the ends of the floating-point range give an error, never NaN.
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
    let range = |quantity: &str, value: &str| {
        format!(
            "{quantity} is {value}: it must be above zero and finite (the covered part: below one)"
        )
    };
    let refused = |series: DiscSeries, wanted: String| {
        says(series.electrode_potentials(currents.view()), &wanted);
    };
    series().electrode_potentials(currents.view()).unwrap();
    refused(DiscSeries { radius_m: 0.0, ..series() }, range("radius_m", "0"));
    refused(DiscSeries { radius_m: f64::INFINITY, ..series() }, range("radius_m", "inf"));
    refused(DiscSeries { conductivity_s: -1.0, ..series() }, range("conductivity_s", "-1"));
    refused(
        DiscSeries { electrode_width_m: f64::NAN, ..series() },
        range("electrode_width_m", "NaN"),
    );
    refused(
        DiscSeries { contact_impedance_ohm_m: 0.0, ..series() },
        range("contact_impedance_ohm_m", "0"),
    );
    refused(DiscSeries { harmonics: 0, ..series() }, range("harmonics", "0"));
    let wide = DiscSeries { electrode_width_m: std::f64::consts::TAU / 2.0, ..series() };
    refused(wide, range("covered part of the rim", "1.5"));
    refused(
        DiscSeries { electrode_angles_rad: vec![0.0, 3.0], ..series() },
        "the protocol is for 3 electrodes, but the mesh has 2".into(),
    );
    // two electrodes at the same place: their equations are linearly dependent
    let twice = DiscSeries {
        electrode_angles_rad: vec![0.0, 0.0, 3.0],
        contact_impedance_ohm_m: 1e-300,
        ..series()
    };
    refused(
        twice,
        "degree (the series is too long for these electrodes) is 4: it must be lower".into(),
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
        let model = ForwardModel::new(&ring_disc(4), &protocol(), &impedance).unwrap();
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
