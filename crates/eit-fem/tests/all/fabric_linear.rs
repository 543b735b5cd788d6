//! A linear skin: voltages follow from the image of the fingers alone.

use crate::common::skins::{changed, disc, finger, key, script, try_fabric, try_simulate};
use crate::common::{CONDUCTIVITY_S as SIGMA, IMPEDANCE_OHM_M, paper_protocol, refused, relative};
use eit_fem::fabric::{
    FabricSettings, Finger, LinearResponse, Simulation, Tip, TouchScript, Weave,
};
use eit_fem::{FemError, ForwardModel};
use eit_mesh::{Mesh, Raster};
use std::f64::consts::TAU;
use std::sync::LazyLock;

/// The second frame with a finger; both fingers touch.
const BOTH: usize = 3;
const RESPONSE: LinearResponse = LinearResponse { change_per_newton: 0.3 };

static MESH: LazyLock<Mesh> = LazyLock::new(|| disc(0.012));
static MADE: LazyLock<Simulation> = LazyLock::new(|| simulate(&FabricSettings::linear(0.3)));

/// Two frames without touch, one with a round tip of 2 N, two with an additional flat tip of 1 N.
fn fingers() -> TouchScript {
    let rests = |id, tip, radius_m, at_m, force_n, from: f64| -> Finger {
        let keys = [from, 0.4]
            .map(|time_s| changed(key(time_s, at_m, force_n), |k| k.radius_m = radius_m));
        finger(id, tip, keys.to_vec())
    };
    let round = rests(1, Tip::Round, 0.01, [0.03, -0.02], 2.0, 0.2);
    script(5, 2, vec![round, rests(2, Tip::Flat, 0.02, [-0.05, 0.0], 1.0, 0.3)])
}

fn simulated(settings: &FabricSettings, script: &TouchScript) -> Result<Simulation, FemError> {
    try_simulate(&MESH, &try_fabric(&MESH, settings)?, script, 64)
}

fn simulate(settings: &FabricSettings) -> Simulation {
    simulated(settings, &fingers()).unwrap()
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
    let made = &*MADE;
    let model = ForwardModel::new(&MESH, &paper_protocol(), &[IMPEDANCE_OHM_M; 16]).unwrap();
    let centroids = MESH.surface().centroids();
    let conductivity: Vec<f64> = centroids.iter().map(|c| SIGMA * (1.0 + change(*c))).collect();
    let wanted = model.forward(&conductivity).unwrap();
    // the same formula in another order: rounding of the conductivities
    assert!(relative(&made.exact_v.row(BOTH).to_owned(), &wanted) < 1e-12);
    let own = RESPONSE.conductivity_s(SIGMA, &fingers().touches(BOTH), &centroids);
    assert_eq!(made.exact_v.row(BOTH), model.forward(&own).unwrap());
    assert_eq!(made.exact_v.row(0), made.reference_v);
    assert_eq!(made.exact_v.row(BOTH), made.exact_v.row(BOTH + 1), "no memory");
    assert_ne!(made.exact_v.row(BOTH), made.exact_v.row(BOTH - 1));
    assert_eq!(made.frames_v, made.exact_v, "no instrument");
}

/// The pixels integrate to the fingers' area, and the pressures to their force.
#[test]
fn the_truth_has_the_shape_of_the_fingers() {
    let made = &*MADE;
    let raster = Raster::new(MESH.surface(), 64).unwrap();
    let pixel_m2 = raster.pixel_m().powi(2);
    let pressures = made.truth.pressure_pa.index_axis(ndarray::Axis(0), BOTH);
    let force_n: f64 = pressures.iter().filter(|p| p.is_finite()).sum::<f64>() * pixel_m2;
    // 16 points per pixel of 3 mm, at the edge of a pad of 20 mm
    assert!((force_n / 3.0 - 1.0).abs() < 1e-2, "{force_n}");
    let mut pixels = vec![0.0; raster.masked_pixels().len()];
    RESPONSE.pixel_changes_into(&fingers().touches(BOTH), &raster, &mut pixels);
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

/// Membrane, piezoresistive law and rim have no effect; unevenness, drift and instrument do.
#[test]
fn only_the_mechanics_is_replaced() {
    type Change = fn(&mut FabricSettings);
    let changes: [(&str, Change, bool); 4] = [
        ("mechanics", |s| (s.membrane, s.rim, s.piezo) = Default::default(), false),
        ("weave", |s| s.weave = Weave::default(), true),
        ("drift", |s| s.drift.conductivity = 1e-3, true),
        ("noise", |s| s.instrument.noise_v = [1e-6; 2], true),
    ];
    for (name, change, has_effect) in changes {
        let made = simulate(&changed(FabricSettings::linear(0.3), change));
        assert_eq!(made.frames_v != MADE.frames_v, has_effect, "{name}");
    }
    // a force too large for the contact model
    let hard = changed(fingers(), |s| s.fingers[0].keys.iter_mut().for_each(|k| k.force_n = 1e3));
    refused(simulated(&FabricSettings::ideal(), &hard), "gives a slope above one");
    assert!(simulated(&FabricSettings::linear(0.3), &hard).is_ok());
}

#[test]
fn a_conductivity_stays_above_zero() {
    assert!(simulated(&FabricSettings::linear(-0.49), &fingers()).is_ok());
    refused(simulated(&FabricSettings::linear(-1.0), &fingers()), "above zero");
    for change_per_newton in [f64::NAN, f64::INFINITY] {
        let settings = FabricSettings::linear(change_per_newton);
        refused(settings.validate(16), "fabric.linear.change_per_newton is");
    }
}
