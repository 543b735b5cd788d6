//! A linear skin: voltages follow from the image of the fingers alone.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use eit_fem::fabric::{
    Drift, Fabric, FabricSettings, Finger, Interpolation, Key, LinearResponse, Membrane,
    Piezoresistance, Rim, Simulation, SimulationSettings, Tip, TouchScript, Weave,
};
use eit_fem::{FemError, ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Mesh, MeshSettings, Raster, RimElectrodes, SkinShape, generate};
use std::f64::consts::{SQRT_2, TAU};

const SIGMA: f64 = 1e-5;
/// The second frame with a finger; both fingers touch.
const BOTH: usize = 3;

fn mesh() -> Mesh {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    generate(&skin, &electrodes, &MeshSettings::with_edge(0.012)).unwrap()
}

fn protocol() -> Protocol {
    PairProtocol::default().protocol().unwrap()
}

/// Two frames without touch, one with a round tip of 2 N, two with an additional flat tip of 1 N.
fn script() -> TouchScript {
    let finger = |id, tip, radius_m, position_m, force_n, from: f64| {
        let key = |time_s| Key { time_s, position_m, force_n, radius_m };
        Finger { id, tip, interpolation: Interpolation::Linear, keys: vec![key(from), key(0.4)] }
    };
    TouchScript {
        name: "two".to_owned(),
        frame_rate_hz: 10.0,
        frames: 5,
        quiet_frames: 2,
        fingers: vec![
            finger(1, Tip::Round, 0.01, [0.03, -0.02], 2.0, 0.2),
            finger(2, Tip::Flat, 0.02, [-0.05, 0.0], 1.0, 0.3),
        ],
    }
}

fn try_simulate(settings: &FabricSettings, script: &TouchScript) -> Result<Simulation, FemError> {
    let mesh = mesh();
    let fabric = Fabric::new(&mesh, &protocol(), SIGMA, &[1e3; 16], settings)?;
    let raster = Raster::new(mesh.surface(), 64).unwrap();
    let how = SimulationSettings { keep_elements: true, ..Default::default() };
    fabric.simulate(script, &raster, &how, &mut |_| {})
}

fn simulate(settings: &FabricSettings) -> Simulation {
    try_simulate(settings, &script()).unwrap()
}

/// The module's formula, written out.
fn change(c: [f64; 3]) -> f64 {
    let bell = (c[0] - 0.03).powi(2) + (c[1] + 0.02).powi(2);
    let pad = (c[0] + 0.05).powi(2) + c[1].powi(2);
    0.3 * 2.0 * (-bell / 2e-4).exp() + if pad <= 4e-4 { 0.3 } else { 0.0 }
}

/// Each frame is the forward solve of its conductivity; equal frames are bit-identical; frames
/// without touch equal the reference.
#[test]
fn frames_are_forward_solves() {
    let made = simulate(&FabricSettings::linear(0.3));
    let model = ForwardModel::new(&mesh(), &protocol(), &[1e3; 16]).unwrap();
    let conductivity: Vec<f64> =
        mesh().surface().centroids().into_iter().map(|c| SIGMA * (1.0 + change(c))).collect();
    let wanted = model.forward(&conductivity).unwrap();
    let largest = wanted.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let found = made.exact_v.row(BOTH);
    // the same formula in another order: rounding of the conductivities
    assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 1e-12 * largest));
    let response = LinearResponse { change_per_newton: 0.3 };
    let touches = script().touches(BOTH);
    let own = response.conductivity_s(SIGMA, &touches, &mesh().surface().centroids());
    assert_eq!(made.exact_v.row(BOTH), model.forward(&own).unwrap());
    assert_eq!(made.exact_v.row(0), made.reference_v);
    assert_eq!(made.exact_v.row(BOTH), made.exact_v.row(BOTH + 1), "no memory");
    assert_ne!(made.exact_v.row(BOTH), made.exact_v.row(BOTH - 1));
    assert_eq!(made.frames_v, made.exact_v, "no instrument");
}

/// The pixels integrate to the fingers' area, and the pressures to their force.
#[test]
fn the_truth_has_the_shape_of_the_fingers() {
    let made = simulate(&FabricSettings::linear(0.3));
    let raster = Raster::new(mesh().surface(), 64).unwrap();
    let pixel_m2 = raster.pixel_m().powi(2);
    let pressures = made.truth.pressure_pa.index_axis(ndarray::Axis(0), BOTH);
    let force_n: f64 = pressures.iter().filter(|p| p.is_finite()).sum::<f64>() * pixel_m2;
    // 16 points per pixel of 3 mm, at the edge of a pad of 20 mm
    assert!((force_n / 3.0 - 1.0).abs() < 1e-2, "{force_n}");
    let mut pixels = vec![0.0; raster.masked_pixels().len()];
    let response = LinearResponse { change_per_newton: 0.3 };
    response.pixel_changes_into(&script().touches(BOTH), &raster, &mut pixels);
    let amount = pixels.iter().sum::<f64>() * pixel_m2;
    let wanted = 0.3 * (2.0 * TAU * 1e-4 + 0.5 * TAU * 4e-4);
    assert!((amount / wanted - 1.0).abs() < 1e-2, "{amount} {wanted}");
    // the image from elements of 12 mm agrees, but is coarser
    let images = made.truth.conductivity_change_s.index_axis(ndarray::Axis(0), BOTH);
    let of_elements = images.iter().filter(|s| s.is_finite()).sum::<f64>() * pixel_m2 / SIGMA;
    assert!((of_elements / amount - 1.0).abs() < 0.1, "{of_elements} {amount}");
    let [round, flat] = [1, 2].map(|k| made.truth.touches[k]);
    assert_eq!((round.finger, round.contact_radius_m, round.depth_m), (1, 0.01, 0.0));
    assert_eq!((flat.finger, flat.contact_radius_m, flat.depth_m), (2, 0.02, 0.0));
}

/// A round tip and a flat tip with sqrt(2) times the radius have the same total change.
#[test]
fn both_tips_hold_the_same_amount() {
    let raster = Raster::new(mesh().surface(), 128).unwrap();
    let amount = |tip, radius_m| {
        let mut script = script();
        script.fingers.truncate(1);
        script.fingers[0].tip = tip;
        script.fingers[0].keys.iter_mut().for_each(|key| key.radius_m = radius_m);
        let mut pixels = vec![0.0; raster.masked_pixels().len()];
        let response = LinearResponse { change_per_newton: 1.0 };
        response.pixel_changes_into(&script.touches(2), &raster, &mut pixels);
        pixels.iter().sum::<f64>()
    };
    let ratio = amount(Tip::Flat, SQRT_2 * 0.012) / amount(Tip::Round, 0.012);
    assert!((ratio - 1.0).abs() < 1e-2, "{ratio}");
}

/// Membrane, piezoresistive law and rim have no effect; unevenness, drift and instrument do.
#[test]
fn only_the_mechanics_is_replaced() {
    let linear = FabricSettings::linear(0.3);
    let base = simulate(&linear);
    let mechanics = FabricSettings {
        membrane: Membrane::default(),
        piezo: Piezoresistance::default(),
        rim: Rim::default(),
        ..linear.clone()
    };
    assert_eq!(simulate(&mechanics).frames_v, base.frames_v);
    let mut noisy = linear.clone();
    noisy.instrument.noise_v = [1e-6; 2];
    let drift = Drift { conductivity: 1e-3, ..linear.drift };
    for (name, settings) in [
        ("weave", FabricSettings { weave: Weave::default(), ..linear.clone() }),
        ("drift", FabricSettings { drift, ..linear.clone() }),
        ("noise", noisy),
    ] {
        assert_ne!(simulate(&settings).frames_v, base.frames_v, "{name}");
    }
    // a force too large for the contact model
    let mut hard = script();
    hard.fingers[0].keys.iter_mut().for_each(|key| key.force_n = 1e3);
    let refused = try_simulate(&FabricSettings::ideal(), &hard).unwrap_err();
    assert!(matches!(refused, FemError::ForceTooLarge { .. }), "{refused}");
    assert!(try_simulate(&linear, &hard).is_ok());
}

#[test]
fn a_conductivity_stays_above_zero() {
    let most = FabricSettings::linear(-0.49);
    assert!(try_simulate(&most, &script()).is_ok());
    let refused = try_simulate(&FabricSettings::linear(-1.0), &script()).unwrap_err();
    assert!(refused.to_string().contains("above zero"), "{refused}");
    for change_per_newton in [f64::NAN, f64::INFINITY] {
        let refused = FabricSettings::linear(change_per_newton).validate(16).unwrap_err();
        assert!(refused.to_string().contains("fabric.linear.change_per_newton is"), "{refused}");
    }
}
