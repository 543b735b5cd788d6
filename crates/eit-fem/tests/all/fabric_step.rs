//! A skin that is stepped: the frames of a script, errors, changing times between frames, and derivatives instead of solves.

use crate::common::refused;
use crate::common::skins::{disc, dome, fabric, finger, key, script};
use eit_fem::FemError;
use eit_fem::fabric::{
    Contact, Fabric, FabricSettings, LinearResponse, PlayCircle, SimulatedSkin, SimulationSettings,
    Tip, Touch, TouchScript,
};
use eit_mesh::{Mesh, Raster};

const SEED: u64 = 5;

/// The fingers of a script at a frame.
fn contacts(script: &TouchScript, frame: usize) -> Vec<Contact> {
    let contact = |touch| {
        let Touch { finger, tip, position_m, force_n, radius_m, .. } = touch;
        Contact { finger, tip, position_m, force_n, radius_m }
    };
    script.touches(frame).into_iter().map(contact).collect()
}

fn built_in(mesh: &Mesh, name: &str) -> TouchScript {
    let script = TouchScript::built_in(name, &PlayCircle::of(mesh), SEED).unwrap();
    TouchScript { frames: script.frames.min(45), ..script }
}

const FINGER: Contact =
    Contact { finger: 1, tip: Tip::Round, position_m: [0.03, 0.01], force_n: 1.0, radius_m: 0.01 };

/// Every process of fabric and instrument, stepped with the contacts of a script's frames, gives its frames to the last bit.
#[test]
fn steps_are_the_frames_of_a_script() {
    let mesh = disc(0.016);
    let raster = Raster::new(mesh.surface(), 16).unwrap();
    let rough = |s: &mut FabricSettings| {
        s.instrument.loose = vec![3, 7];
        s.instrument.loose_rate_hz = 2.0;
        s.instrument.lost = vec![11];
        (s.instrument.torn, s.instrument.spiked) = (0.2, 0.2);
        (s.instrument.flicker_v, s.instrument.mains_v) = (1e-6, 1e-6);
        s.drift.warming_per_min = 0.01;
        (s.piezo.ring, s.print.ratio, s.print.roll_m) = (0.4, 1.5, 0.002);
        s.instrument.compliance_v = Some(20.0);
    };
    let linear = |s: &mut FabricSettings| {
        s.linear = Some(LinearResponse { change_per_newton: 0.1 });
    };
    for fabric in [fabric(&mesh, |_| {}), fabric(&mesh, rough), fabric(&mesh, linear)] {
        for name in ["two-fingers", "random", "tapping"] {
            let script = built_in(&mesh, name);
            let how = SimulationSettings { seed: SEED, threads: 2, keep_elements: false };
            let made = fabric.simulate(&script, &raster, &how, &mut |_| {}).unwrap();
            let mut skin = SimulatedSkin::new(&fabric, SEED).unwrap();
            assert_eq!(skin.reference_v(), made.reference_v.as_slice().unwrap());
            for frame in 0..script.frames {
                let stepped =
                    skin.step(&contacts(&script, frame), 1.0 / script.frame_rate_hz).unwrap();
                assert_eq!(stepped.number, frame);
                assert_eq!(stepped.values_v, made.frames_v.row(frame).as_slice().unwrap());
                assert_eq!(stepped.exact_v, made.exact_v.row(frame).as_slice().unwrap());
                assert_eq!(stepped.quality, made.truth.quality.row(frame).as_slice().unwrap());
                let true_touches = made.truth.touches.iter().filter(|t| t.frame == frame);
                assert!(stepped.touches.iter().eq(true_touches), "{name} {frame}");
            }
        }
    }
}

/// In a scan that takes time, contacts move on straight lines between steps: those of a script whose keys lie half a frame
/// after its frames.
#[test]
fn contacts_move_within_a_scan() {
    let mesh = disc(0.016);
    let raster = Raster::new(mesh.surface(), 16).unwrap();
    let fabric = fabric(&mesh, |s| s.instrument.scan_share = 0.9);
    let keys = [(3.0, 0.0, 0.0), (4.0, 0.0, 1.0), (8.0, 0.04, 0.5), (9.0, 0.04, 0.0)];
    let keys = keys.map(|(frame, x, force_n)| key((frame + 0.5) / 10.0, [x, 0.02], force_n));
    let script = script(14, 2, vec![finger(1, Tip::Round, keys.to_vec())]);
    let how = SimulationSettings { seed: SEED, ..Default::default() };
    let made = fabric.simulate(&script, &raster, &how, &mut |_| {}).unwrap();
    // of twice as many frames, every second one lies half a frame later
    let twice = TouchScript { frame_rate_hz: 20.0, ..script.clone() };
    let mut skin = SimulatedSkin::new(&fabric, SEED).unwrap();
    for frame in 0..script.frames {
        let stepped = skin.step(&contacts(&twice, 2 * frame + 1), 0.1).unwrap();
        assert!((stepped.time_s - 0.1 * frame as f64).abs() < 1e-12);
        for (v, wanted) in stepped.exact_v.iter().zip(made.exact_v.row(frame)) {
            // rounding of places and forces, which the solves amplify
            assert!((v / wanted - 1.0).abs() < 1e-10, "{frame}: {v} {wanted}");
        }
    }
}

#[test]
fn an_error_leaves_the_skin_as_it_was() {
    let fabric = fabric(&disc(0.016), |_| {});
    let [mut one, mut other] = [(); 2].map(|()| SimulatedSkin::new(&fabric, 1).unwrap());
    let wrong = [
        (Contact { position_m: [0.3, 0.0], ..FINGER }, 0.1),
        (Contact { force_n: 1e4, ..FINGER }, 0.1),
        (Contact { force_n: -1.0, ..FINGER }, 0.1),
        (Contact { radius_m: 0.0, ..FINGER }, 0.1),
        (Contact { position_m: [f64::NAN, 0.0], ..FINGER }, 0.1),
        (FINGER, 0.0),
        (FINGER, f64::INFINITY),
        (FINGER, f64::MIN_POSITIVE),
        (FINGER, 1e9),
    ];
    for k in 0..4 {
        for (contact, dt_s) in wrong {
            one.step(&[contact], dt_s).unwrap_err();
        }
        let moved = Contact { position_m: [0.03, 0.01 * f64::from(k)], ..FINGER };
        let wanted = other.step(&[moved], 0.05).unwrap().values_v.to_vec();
        assert_eq!(one.step(&[moved], 0.05).unwrap().values_v, wanted);
    }
    let error = one.step(&[Contact { position_m: [0.3, 0.0], ..FINGER }], 0.05).unwrap_err();
    assert!(matches!(error, FemError::OutsideSkin { finger: 1, x_m: 0.3, .. }), "{error}");
}

/// Drift, relaxation and warming go on in time whatever the frame rate: 2 s in steps of 0.1 s and 0.05 s.
#[test]
fn time_passes_at_any_rate() {
    let fabric = fabric(&disc(0.016), |s| {
        s.drift.time_s = 2.0;
        s.drift.conductivity = 0.05;
        s.drift.warming_per_min = 0.5;
    });
    let last = |steps: &[(usize, f64)]| {
        let mut skin = SimulatedSkin::new(&fabric, 1).unwrap();
        let mut last = (0.0, Vec::new());
        skin.step(&[FINGER], steps[0].1).unwrap();
        for &(count, dt_s) in steps {
            for _ in 0..count {
                let frame = skin.step(&[FINGER], dt_s).unwrap();
                last = (frame.time_s, frame.exact_v.to_vec());
            }
        }
        last
    };
    let (time_s, wanted) = last(&[(20, 0.1)]);
    assert!((time_s - 2.0).abs() < 1e-12);
    for steps in [&[(40, 0.05)][..], &[(10, 0.1), (20, 0.05)], &[(20, 0.05), (4, 0.1), (2, 0.3)]] {
        let (time_s, found) = last(steps);
        assert!((time_s - 2.0).abs() < 1e-12, "{time_s}");
        for (v, wanted) in found.iter().zip(&wanted) {
            // relaxation is exact for ramps, and the first step is one of another length: 2e-3 of the touch, 1e-4 of the voltage
            assert!((v / wanted - 1.0).abs() < 1e-3, "{steps:?}: {v} {wanted}");
        }
    }
}

/// Distance of the changes that touches make, linearised and solved, relative to their size.
fn distance(fabric: &Fabric, script: &TouchScript) -> f64 {
    let mut full = SimulatedSkin::new(fabric, SEED).unwrap();
    let mut fast = SimulatedSkin::linearised(fabric, SEED).unwrap();
    let reference = full.reference_v().to_vec();
    let (mut error, mut size) = (0.0, 0.0);
    for frame in 0..script.frames {
        let contacts = contacts(script, frame);
        let wanted = full.step(&contacts, 0.1).unwrap().exact_v.to_vec();
        let found = fast.step(&contacts, 0.1).unwrap().exact_v;
        for ((found, wanted), reference) in found.iter().zip(&wanted).zip(&reference) {
            error += (found - wanted).powi(2);
            size += (wanted - reference).powi(2);
        }
    }
    (error / size).sqrt()
}

/// Linearised voltages are those of full solves up to the second order of the touches.
#[test]
fn linearised_frames_are_near_solved_ones() {
    let mesh = disc(0.007);
    let quiet = |mesh: &Mesh, change: fn(&mut FabricSettings)| {
        fabric(mesh, |s| {
            (s.drift.conductivity, s.drift.contact) = (0.0, 0.0);
            change(s);
        })
    };
    let knit = |s: &mut FabricSettings| {
        (s.weave.ratio, s.weave.angle_deg) = (1.7, 20.0);
        (s.print.ratio, s.piezo.ring) = (1.4, 0.3);
    };
    let linear = |s: &mut FabricSettings| {
        s.linear = Some(LinearResponse { change_per_newton: 0.02 });
    };
    // measured 0.006, 0.06, 0.09, 0.001 and 0.15: strains of solved frames are those of elements of 7 mm, a contact's radius,
    // and those of linearised ones are exact
    let cases = [
        ("nodes at rest", quiet(&mesh, |s| s.membrane.moves_nodes = false), 0.02),
        ("fabric", quiet(&mesh, |_| {}), 0.1),
        ("knit", quiet(&mesh, knit), 0.15),
        ("linear", quiet(&mesh, linear), 0.01),
        ("dome", quiet(&dome(0.009), |_| {}), 0.2),
    ];
    for (name, fabric, bound) in cases {
        for script in ["two-fingers", "stroking"].map(|name| built_in(&mesh, name)) {
            let distance = distance(&fabric, &script);
            println!("{name}, {}: {distance:.4}", script.name);
            assert!(distance < bound, "{name}, {}: {distance}", script.name);
        }
    }
}

#[test]
fn what_is_not_linear_is_refused() {
    let mesh = disc(0.02);
    type Change = fn(&mut FabricSettings);
    let changes: [(&str, Change); 3] = [
        ("number of loose contacts", |s| s.instrument.loose = vec![2]),
        ("compliance_v", |s| s.instrument.compliance_v = Some(5.0)),
        ("common_mode_db", |s| s.instrument.common_mode_db = Some(50.0)),
    ];
    for (quantity, change) in changes {
        refused(SimulatedSkin::linearised(&fabric(&mesh, change), 1), quantity);
    }
}
