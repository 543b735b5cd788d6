//! Calibration on exact frames, on noisy ones from a finer mesh, and of parameters that data cannot tell.

use crate::common::solve;
use eit_fem::{DrivenElectrodes, ForwardModel, PairProtocol, Protocol};
use eit_inverse::{Calibration, CalibrationSettings, CalibrationStatus, Contacts};
use eit_mesh::{MeshSettings, RimElectrodes, SkinShape, generate};
use fixtures::Random;
use ndarray::{Array1, Axis};

const SIGMA_S: f64 = 1e-5;
const CONTACT: f64 = 1e3;

fn protocol(driven_electrodes: DrivenElectrodes) -> Protocol {
    PairProtocol { driven_electrodes, ..Default::default() }.protocol().unwrap()
}

/// Finer at the ends of electrodes, to which measurements on driven electrodes are most sensitive, if asked for.
fn model(edge_m: f64, electrode_edge_m: Option<f64>, protocol: &Protocol) -> ForwardModel {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let settings = MeshSettings { electrode_edge_m, ..MeshSettings::with_edge(edge_m) };
    let mesh = generate(&skin, &electrodes, &settings).unwrap();
    ForwardModel::new(&mesh, protocol, &[CONTACT; 16]).unwrap()
}

fn voltages(model: &ForwardModel, sigma_s: f64, impedance: &[f64]) -> Vec<f64> {
    let mut geometry = model.geometry();
    model.change_contacts(impedance, &mut geometry).unwrap();
    let mut workspace = model.workspace().unwrap();
    let sigma = vec![sigma_s; model.elements()];
    model.solve_deformed(&geometry, &sigma, &mut workspace).unwrap().measurements().to_vec()
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// Impedances whose logarithms have this standard deviation.
fn contacts(random: &mut Random, spread: f64) -> Vec<f64> {
    (0..16).map(|_| CONTACT * (spread * random.normal()).exp()).collect()
}

#[test]
fn exact_frames_give_the_exact_skin() {
    let protocol = protocol(DrivenElectrodes::Keep);
    let model = model(0.01, None, &protocol);
    let truth = contacts(&mut Random::new(5), 1.5);
    let frame = voltages(&model, SIGMA_S, &truth);
    let settings = CalibrationSettings::starting_at(40.0 * SIGMA_S, &[5.0 * CONTACT; 16]);
    let found = Calibration::of_frame(&model, &frame, &settings).unwrap();
    assert_eq!(found.status, CalibrationStatus::Converged);
    // the least residual is 1e-8 of the frame; the prior can pull within that
    assert!((found.conductivity_s / SIGMA_S - 1.0).abs() < 1e-6);
    for (z, truth) in found.contact_impedance.iter().zip(&truth) {
        assert!((z / truth).ln().abs() < 1e-4, "{z} {truth}");
    }
    assert!(found.residual_before > 0.5 && found.residual_after < 1e-7);
    assert!(found.undetermined().is_empty());
}

/// Truth drawn from the prior, and noisy frames from a mesh with four times as many nodes: the squared
/// errors in units of the stated covariance are `p` on average.
#[test]
fn errors_are_those_of_the_covariance() {
    let protocol = protocol(DrivenElectrodes::Keep);
    let fine = model(0.003, Some(0.00025), &protocol);
    let model = model(0.004, Some(0.0005), &protocol);
    let (seeds, spread) = (40, 0.5);
    // noise known, noise estimated, and noise known with frames of the same mesh
    let mut squares = [0.0; 3];
    for seed in 0..seeds {
        let mut random = Random::new(1000 + seed);
        let truth = contacts(&mut random, spread);
        let clean = [&fine, &model].map(|model| voltages(model, SIGMA_S, &truth));
        // enough noise to hide most of the coarser mesh's error
        let noise = 0.05 * rms(&clean[0]);
        let frames = clean.map(|clean| random.noisy(&clean, noise));
        for (k, square) in squares.iter_mut().enumerate() {
            let (known, frame) = (k != 1, &frames[k / 2]);
            let settings = CalibrationSettings {
                contact_spread: spread,
                noise_std_v: known.then(|| vec![noise; frame.len()]),
                ..CalibrationSettings::starting_at(3.0 * SIGMA_S, &[CONTACT; 16])
            };
            let found = Calibration::of_frame(&model, frame, &settings).unwrap();
            assert_eq!(found.status, CalibrationStatus::Converged);
            assert!((0.6..1.5).contains(&found.reduced_chi_square));
            assert!((found.noise_std_v[0] / noise - 1.0).abs() < 0.2);
            let mut error = vec![(found.conductivity_s / SIGMA_S).ln()];
            error.extend(found.contact_impedance.iter().zip(&truth).map(|(z, t)| (z / t).ln()));
            // e' C^-1 e
            let error = Array1::from(error).insert_axis(Axis(1));
            let scaled = solve(found.covariance.clone(), error.clone());
            *square += (error * scaled).sum() / (17.0 * seeds as f64);
        }
    }
    // chi-square of 40 x 17 has a standard deviation of 0.054. Allowed are three of them, plus the
    // curvature of the model over its covariance; another mesh adds its own difference (found: 0.17).
    assert!((squares[2] - 1.0).abs() < 0.2, "{squares:?}");
    assert!(squares.iter().all(|s| (s - 1.0).abs() < 0.3), "{squares:?}");
}

/// Without measurements on driven electrodes, contacts have little effect. The result reports that the
/// prior decides, the conductivity is right nevertheless, and a gain becomes part of it.
#[test]
fn what_data_do_not_tell_is_reported() {
    let model = model(0.01, None, &protocol(DrivenElectrodes::Drop));
    let mut random = Random::new(3);
    let clean = voltages(&model, SIGMA_S, &[CONTACT; 16]);
    let frame = random.noisy(&clean, 0.2 * rms(&clean));
    let each = CalibrationSettings::starting_at(SIGMA_S, &[CONTACT; 16]);
    let found = Calibration::of_frame(&model, &frame, &each).unwrap();
    let std = found.std();
    assert!(!found.undetermined().is_empty());
    assert!(found.undetermined().iter().all(|&k| k > 0 && std[k] > 0.7 * std::f64::consts::LN_10));
    assert!((found.conductivity_s / SIGMA_S).ln().abs() < 4.0 * std[0]);

    let common = CalibrationSettings { contacts: Contacts::Common, ..each };
    let one = Calibration::of_frame(&model, &frame, &common).unwrap();
    assert_eq!(one.covariance.dim(), (2, 2));
    assert!(one.contact_impedance.iter().all(|z| *z == one.contact_impedance[0]));
    // a gain of 7 is a conductivity exactly 7 times lower and contacts, as their start, 7 times higher
    let loud: Vec<f64> = frame.iter().map(|v| 7.0 * v).collect();
    let moved = CalibrationSettings { contact_impedance: vec![7.0 * CONTACT; 16], ..common };
    let two = Calibration::of_frame(&model, &loud, &moved).unwrap();
    let sheet = 7.0 * two.conductivity_s / one.conductivity_s;
    let contact = two.contact_impedance[0] / (7.0 * one.contact_impedance[0]);
    // both stop within a thousandth of a standard deviation
    assert!((sheet.ln() / std[0]).abs() < 1e-2 && contact.ln().abs() < 1e-2, "{sheet} {contact}");
}

#[test]
fn bad_input_is_refused() {
    let model = model(0.02, None, &protocol(DrivenElectrodes::Keep));
    let frame = voltages(&model, SIGMA_S, &[CONTACT; 16]);
    let good = CalibrationSettings::starting_at(SIGMA_S, &[CONTACT; 16]);
    let says = |frame: &[f64], settings: &CalibrationSettings, wanted: &str| {
        let error = Calibration::of_frame(&model, frame, settings).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    };
    let minus: Vec<f64> = frame.iter().map(|v| -v).collect();
    says(&minus, &good, "voltages is -1.000: check the sign");
    says(&vec![0.0; frame.len()], &good, "voltages is NaN");
    says(&frame[1..], &good, "frame: 255 values, but 256 are needed");
    let mut broken = frame.clone();
    broken[17] = f64::NAN;
    says(&broken, &good, "measurement 17 is NaN");
    let without = (0..256).map(|i| i != 17).collect();
    let settings = CalibrationSettings { used: Some(without), ..good.clone() };
    assert!(Calibration::of_frame(&model, &broken, &settings).is_ok());
    for (contact_impedance, wanted) in [
        (vec![0.0; 16], "starting contact_impedance is 0"),
        (vec![1.0; 3], "contact_impedance: 3 values, but 16 are needed"),
    ] {
        says(&frame, &CalibrationSettings { contact_impedance, ..good.clone() }, wanted);
    }
    let zero = CalibrationSettings { conductivity_s: 0.0, ..good.clone() };
    says(&frame, &zero, "conductivity_s is 0");
    let never = CalibrationSettings { max_iterations: 0, ..good };
    refused!(Calibration::of_frame(&model, &frame, &never), OutOfRange { .. });
}
