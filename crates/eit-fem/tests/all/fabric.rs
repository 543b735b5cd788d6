//! The simulated fabric as a whole: determinism, switching effects off, ground truth, invalid
//! input. The file is long because all these tests share their scene.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use eit_fem::fabric::{
    Drift, Fabric, FabricSettings, Finger, Instrument, Interpolation, Key, PlayCircle, Rim,
    Simulation, SimulationSettings, Tip, TouchScript, TrueQuality, Weave,
};
use eit_fem::{ForwardModel, PairProtocol, Protocol};
use eit_mesh::{Mesh, MeshSettings, Raster, RimElectrodes, SkinShape, generate};

const SIGMA: f64 = 1e-5;

fn mesh() -> Mesh {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    generate(&skin, &electrodes, &MeshSettings::with_edge(0.012)).unwrap()
}

fn protocol() -> Protocol {
    PairProtocol::default().protocol().unwrap()
}

fn simulate(
    settings: &FabricSettings,
    script: &TouchScript,
    seed: u64,
    threads: usize,
) -> Simulation {
    let mesh = mesh();
    let fabric = Fabric::new(&mesh, &protocol(), SIGMA, &[1e3; 16], settings).unwrap();
    let raster = Raster::new(mesh.surface(), 32).unwrap();
    let how = SimulationSettings { seed, threads, keep_elements: true };
    fabric.simulate(script, &raster, &how, &mut |_| {}).unwrap()
}

/// A press at one place from 0.4 s to 1.2 s, at 10 frames per second.
fn press(position_m: [f64; 2], force_n: f64) -> TouchScript {
    let key = |time_s, force_n| Key { time_s, position_m, force_n, radius_m: 0.01 };
    TouchScript {
        name: "press".to_owned(),
        frame_rate_hz: 10.0,
        frames: 20,
        quiet_frames: 4,
        fingers: vec![Finger {
            id: 7,
            tip: Tip::Round,
            interpolation: Interpolation::Linear,
            keys: vec![key(0.4, 0.0), key(0.6, force_n), key(1.2, force_n), key(1.4, 0.0)],
        }],
    }
}

fn random_script() -> TouchScript {
    let mut script = TouchScript::built_in("random", &PlayCircle::of(&mesh()), 3).unwrap();
    script.frames = 90;
    script
}

/// All effects switched on.
fn everything() -> FabricSettings {
    FabricSettings {
        instrument: Instrument {
            loose: vec![3],
            loose_rate_hz: 1.0,
            lost: vec![9],
            compliance_v: Some(20.0),
            ..Default::default()
        },
        ..Default::default()
    }
}

/// Values from the first release with the simulated fabric, all effects switched on. On another
/// processor the order of sums differs, which changes frames by 1e-12 of the largest value; other
/// random numbers change them by 1e-4 and more.
#[test]
fn a_seed_gives_the_frames_it_has_always_given() {
    let made = simulate(&everything(), &random_script(), 5, 2);
    for (at, wanted_v) in [
        ([0, 0], -0.890_798_591_693_774_5),
        // a measurement of the lost electrode, which floats
        ([30, 17], 0.069_943_181_424_004_9),
        ([60, 100], 0.088_405_948_242_314_06),
        ([89, 207], -0.760_721_819_855_040_7),
    ] {
        let found_v = made.frames_v[at];
        assert!((found_v - wanted_v).abs() < 1e-10, "{at:?}: {found_v} for {wanted_v}");
    }
}

#[test]
fn same_bytes_for_any_number_of_threads() {
    let script = random_script();
    let same = |a: &Simulation, b: &Simulation| {
        assert!(a.frames_v == b.frames_v && a.exact_v == b.exact_v);
        // images are NaN outside the skin, so compare bits
        let bits = |s: &Simulation| {
            let images = s.truth.pressure_pa.iter().chain(&s.truth.conductivity_change_s);
            images.map(|v| v.to_bits()).collect::<Vec<_>>()
        };
        assert!(bits(a) == bits(b));
        assert_eq!(a.truth.touches, b.truth.touches);
        assert_eq!(a.truth.electrode_shift_m, b.truth.electrode_shift_m);
        assert_eq!(a.truth.contact_impedance, b.truth.contact_impedance);
        assert_eq!(a.truth.quality, b.truth.quality);
    };
    let mut rough = everything();
    (rough.print.ratio, rough.print.roll_m, rough.piezo.saturation) = (1.5, 1e-3, Some(0.5));
    rough.instrument.scan_share = 0.8;
    (rough.instrument.torn, rough.instrument.spiked) = (0.2, 0.2);
    let scanned = simulate(&rough, &script, 5, 1);
    same(&scanned, &simulate(&rough, &script, 5, 2));
    let one = simulate(&everything(), &script, 5, 1);
    for threads in [2, 3, usize::MAX] {
        same(&one, &simulate(&everything(), &script, 5, threads));
    }
    let other = simulate(&everything(), &script, 6, 1);
    assert!(one.frames_v != other.frames_v, "another seed is another fabric");
    // the first frames of a longer script equal those of a shorter one
    let mut short = script.clone();
    short.frames = 50;
    for (long, settings) in [(one, everything()), (scanned, rough)] {
        let short = simulate(&settings, &short, 5, 2);
        assert!(long.frames_v.slice_axis(ndarray::Axis(0), (0..50).into()) == short.frames_v);
    }
}

/// With all effects off, frames are plain solves with the ground-truth conductivities.
#[test]
fn the_ideal_fabric_is_a_plain_solve() {
    let made = simulate(&FabricSettings::ideal(), &press([0.03, 0.02], 2.0), 1, 1);
    let model = ForwardModel::new(&mesh(), &protocol(), &[1e3; 16]).unwrap();
    let untouched = model.forward(&vec![SIGMA; model.elements()]).unwrap();
    assert_eq!(made.frames_v, made.exact_v, "no instrument");
    assert_eq!(made.reference_v, untouched);
    for quiet in [0, 3, 4, 14, 19] {
        assert_eq!(made.frames_v.row(quiet), untouched, "frame {quiet}: no touch, no memory");
    }
    let changes = made.truth.element_change_s.as_ref().unwrap();
    let sigma: Vec<f64> = changes.row(8).iter().map(|c| SIGMA + c).collect();
    let wanted = model.forward(&sigma).unwrap();
    let largest = untouched.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    // difference and sum of the same numbers: rounding
    assert!((&made.frames_v.row(8) - &wanted).iter().all(|d| d.abs() < 1e-12 * largest));
    assert!(made.truth.electrode_shift_m.iter().all(|s| *s == 0.0));
    assert!(made.truth.contact_impedance.iter().all(|z| *z == 1e3));
}

/// An effect with amplitude zero changes no byte of the frames, and every effect that is on changes
/// them.
#[test]
fn parts_switch_off_one_by_one() {
    let script = press([0.07, 0.0], 2.0);
    let ideal = FabricSettings::ideal();
    let base = simulate(&ideal, &script, 1, 1);
    let on: [(&str, FabricSettings); 9] = [
        ("movement", FabricSettings { membrane: Default::default(), ..ideal.clone() }),
        ("memory", FabricSettings { piezo: Default::default(), ..ideal.clone() }),
        (
            "contact",
            FabricSettings { rim: Rim { contact_gain: 1.0, ..ideal.rim }, ..ideal.clone() },
        ),
        ("weave", FabricSettings { weave: Weave::default(), ..ideal.clone() }),
        (
            "sheet drift",
            FabricSettings { drift: Drift { conductivity: 1e-3, ..ideal.drift }, ..ideal.clone() },
        ),
        (
            "contact drift",
            FabricSettings { drift: Drift { contact: 1e-3, ..ideal.drift }, ..ideal.clone() },
        ),
        (
            "noise",
            FabricSettings {
                instrument: Instrument { noise_v: [4e-7, 1.4e-6], ..ideal.instrument.clone() },
                ..ideal.clone()
            },
        ),
        (
            "gain",
            FabricSettings {
                instrument: Instrument { gain_error: 1e-3, ..ideal.instrument.clone() },
                ..ideal.clone()
            },
        ),
        (
            "bits",
            FabricSettings {
                instrument: Instrument { bits: 16, ..ideal.instrument.clone() },
                ..ideal.clone()
            },
        ),
    ];
    for (name, settings) in on {
        assert!(simulate(&settings, &script, 1, 1).frames_v != base.frames_v, "{name}");
    }
    type Change = fn(&mut FabricSettings);
    let rough: [(&str, Change); 12] = [
        ("direction", |s| s.weave.ratio = 1.6),
        ("ring", |s| s.piezo.ring = 0.5),
        ("warming", |s| s.drift.warming_per_min = 0.01),
        ("common mode", |s| s.instrument.common_mode_db = Some(55.0)),
        ("slow noise", |s| s.instrument.flicker_v = 1e-6),
        ("mains", |s| s.instrument.mains_v = 1e-6),
        ("ellipse", |s| s.print.ratio = 1.5),
        ("roll", |s| s.print.roll_m = 1e-3),
        ("saturation", |s| s.piezo.saturation = Some(0.5)),
        ("scan", |s| s.instrument.scan_share = 0.8),
        ("torn frames", |s| s.instrument.torn = 0.5),
        ("spikes", |s| s.instrument.spiked = 0.5),
    ];
    for (name, change) in rough {
        let mut settings = ideal.clone();
        change(&mut settings);
        assert!(simulate(&settings, &script, 1, 1).frames_v != base.frames_v, "{name}");
    }
    // other settings of an effect that is off do not matter
    let mut off = ideal.clone();
    off.weave.correlation_m = 0.5;
    off.drift.time_s = 1.0;
    off.instrument.loose_time_s = 9.0;
    off.instrument.range_v = Some(1e-9);
    off.instrument.open_factor = 7.0;
    off.weave.angle_deg = 40.0;
    off.piezo.ring_radius_m = 0.04;
    off.drift.warming_unevenness = 2.0;
    off.instrument.mains_hz = 3.0;
    off.print.squash_n = 2.0;
    off.print.roll_deg = 20.0;
    off.print.roll_s = 9.0;
    assert_eq!(simulate(&off, &script, 99, 1).frames_v, base.frames_v, "nor has the seed");
    // switching one effect off does not change the random numbers of the others
    let noisy = |weave: Weave| {
        let instrument = Instrument { noise_v: [1e-6, 1e-6], ..ideal.instrument.clone() };
        let made = simulate(&FabricSettings { weave, instrument, ..ideal.clone() }, &script, 1, 1);
        &made.frames_v - &made.exact_v
    };
    let difference = noisy(Weave::default()) - noisy(ideal.weave);
    // rounding of voltages near 10 V
    assert!(difference.iter().all(|d| d.abs() < 1e-14));
}

/// The ground-truth pressure integrates to the force; touches and electrode movement match the
/// script.
#[test]
fn the_truth_holds_the_force() {
    let script = press([0.03, -0.02], 2.0);
    let made = simulate(&FabricSettings::default(), &script, 1, 1);
    let raster = Raster::new(mesh().surface(), 32).unwrap();
    let pressed = made.truth.pressure_pa.index_axis(ndarray::Axis(0), 8);
    let areas = raster.masked_pixels().iter().zip(raster.covered_areas_m2());
    let force_n: f64 = areas.map(|(&[i, j], area)| pressed[[i, j]] * area).sum();
    // sixteen points per pixel of 6 mm, on a contact area 10 mm wide
    assert!((force_n / 2.0 - 1.0).abs() < 0.1, "{force_n}");
    let touch = made.truth.touches.iter().find(|t| t.frame == 8).unwrap();
    assert_eq!((touch.finger, touch.force_n, touch.position_m), (7, 2.0, [0.03, -0.02]));
    assert!(touch.contact_radius_m > 0.003 && touch.contact_radius_m < 0.01, "{touch:?}");
    assert_eq!(made.truth.touches.len(), 9, "frames 5 to 13");
    let image = made.truth.conductivity_change_s.index_axis(ndarray::Axis(0), 8);
    let [row, column] = raster.pixel_at([0.03, -0.02]).unwrap();
    let largest = image.iter().copied().filter(|v| v.is_finite()).fold(0.0, f64::max);
    assert!(image[[row, column]] > 0.5 * largest && largest > 0.1 * SIGMA, "{largest:e}");
}

/// Near the rim, the electrodes beside the finger move most, inwards by tenths of a millimetre; a
/// touch in the centre hardly moves any.
#[test]
fn electrodes_move_towards_a_finger_near_the_rim() {
    let electrode_shift = |position_m: [f64; 2]| {
        let made = simulate(&FabricSettings::default(), &press(position_m, 2.0), 1, 1);
        let shifts = made.truth.electrode_shift_m.index_axis(ndarray::Axis(0), 8).to_owned();
        let size = |l: usize| shifts.row(l).iter().map(|s| s * s).sum::<f64>().sqrt();
        let sizes: Vec<f64> = (0..16).map(size).collect();
        let impedances = made.truth.contact_impedance.row(8).to_vec();
        assert!(made.report.least_area_ratio > 0.3, "{}", made.report.least_area_ratio);
        (shifts, sizes, impedances)
    };
    // the first electrode is centred on +x
    let (shifts, sizes, impedances) = electrode_shift([0.085, 0.0]);
    assert!(sizes.iter().skip(1).all(|s| *s < sizes[0]), "{sizes:?}");
    assert!(shifts[[0, 0]] < 0.0, "inwards: {}", shifts[[0, 0]]);
    assert!(shifts[[1, 1]] < 0.0 && shifts[[15, 1]] > 0.0, "neighbours towards it");
    // pulled down by millimetres, drawn in by tenths of a millimetre
    assert!((1e-3..1e-2).contains(&sizes[0]), "{sizes:?}");
    assert!((-1e-3..-1e-4).contains(&shifts[[0, 0]]), "{}", shifts[[0, 0]]);
    assert!(impedances[0] < impedances[1] && impedances[1] < impedances[8], "{impedances:?}");
    let (_, middle, _) = electrode_shift([0.0, 0.0]);
    assert!(middle.iter().all(|s| *s < 0.1 * sizes[0]), "{middle:?}");
}

/// A moving finger drags the electrodes beside it; a finger at rest or without friction does not.
/// Closed form at the rim: compliance mu F (1 + nu)(3 - nu) / 4 pi Y ln(L / r).
#[test]
fn a_moving_finger_drags_the_fabric() {
    let shift_y = |friction: f64| {
        let mut settings = FabricSettings::default();
        settings.membrane.friction = friction;
        let mut script = press([0.06, 0.0], 1.5);
        script.fingers[0].keys[1].position_m[1] = -0.03;
        script.fingers[0].keys[0].position_m[1] = -0.03;
        script.fingers[0].keys[2].position_m[1] = 0.03;
        let made = simulate(&settings, &script, 1, 1);
        // frame 9 is in the middle of the upward stroke; electrode 1 is centred on +x
        made.truth.electrode_shift_m[[9, 0, 1]]
    };
    let (with, without) = (shift_y(0.4), shift_y(0.0));
    assert!(without.abs() < 1e-5, "symmetric but for the mesh: {without:e}");
    let wanted =
        0.7 * 0.4 * 1.5 * 1.3 * 2.7 / (4.0 * std::f64::consts::PI * 300.0) * (0.1_f64 / 0.04).ln();
    // the electrode is 20 mm wide: the mean of the logarithm over it is 2 % lower
    assert!(((with - without) / wanted - 1.0).abs() < 0.05, "{with:e} {wanted:e}");
}

/// Noise has the stated standard deviation, quantised values are multiples of the step, and a small
/// range saturates and marks the values.
#[test]
fn the_instrument_does_what_it_says() {
    let mut script = press([0.0, 0.0], 1.0);
    script.frames = 400;
    let mut settings = FabricSettings::ideal();
    settings.instrument.noise_v = [1e-6, 1e-6];
    let made = simulate(&settings, &script, 1, 2);
    let noise = &made.frames_v - &made.exact_v;
    let std = (noise.iter().map(|n| n * n).sum::<f64>() / noise.len() as f64).sqrt();
    // 83 200 samples: four standard errors of 0.25 %
    assert!((std / 1e-6 - 1.0).abs() < 0.01, "{std:e}");
    let lag: f64 = (0..399).map(|f| noise.row(f).dot(&noise.row(f + 1))).sum();
    assert!(lag.abs() < 0.02 * noise.iter().map(|n| n * n).sum::<f64>(), "frames are independent");

    script.frames = 12;
    settings.instrument.noise_v = [0.0, 0.0];
    settings.instrument.bits = 12;
    settings.instrument.range_v = Some(0.5);
    let made = simulate(&settings, &script, 1, 1);
    let step = 0.5 / 2048.0;
    for ((v, exact), quality) in made.frames_v.iter().zip(&made.exact_v).zip(&made.truth.quality) {
        assert_eq!((v / step).fract(), 0.0);
        if *quality == TrueQuality::Saturated {
            assert!(exact.abs() > 0.5 - 2.0 * step, "{exact}");
        } else {
            assert!((v - exact).abs() <= 0.5 * step);
        }
    }
    assert!(made.truth.quality.iter().any(|q| *q == TrueQuality::Saturated));
    // the default range of the untouched skin does not saturate
    let made = simulate(&FabricSettings::default(), &script, 1, 1);
    assert!(made.truth.quality.iter().all(|q| *q == TrueQuality::Good));
}

/// A lost electrode affects exactly the measurements that involve it; a loose one does so at times;
/// a source at half the needed voltage halves the measurements.
#[test]
fn bad_contacts_are_marked() {
    let mut settings = FabricSettings::ideal();
    settings.instrument.lost = vec![9];
    settings.instrument.loose = vec![3];
    let mut script = press([0.0, 0.0], 1.0);
    script.frames = 200;
    let made = simulate(&settings, &script, 1, 2);
    let quadruples: Vec<[usize; 4]> =
        protocol().quadruples().unwrap().iter().map(|q| q.map(|l| l as usize)).collect();
    for (k, quadruple) in quadruples.iter().enumerate() {
        let lost = made.truth.quality.column(k).iter().all(|q| *q == TrueQuality::Lost);
        assert_eq!(lost, quadruple.contains(&8), "{quadruple:?}");
        // a lost electrode floats at a tenth of the largest voltage; `exact_v` shows only the poor
        // contact
        let off = (&made.frames_v.column(k) - &made.exact_v.column(k)).mapv(f64::abs);
        let large = 1e-3 * made.reference_v.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        assert_eq!(off.iter().all(|v| *v < large), !lost, "{quadruple:?}");
        let loose =
            made.truth.quality.column(k).iter().filter(|q| **q == TrueQuality::Loose).count();
        let may = quadruple.contains(&2) && !quadruple.contains(&8);
        assert_eq!(loose > 0, may, "{quadruple:?}");
        assert!(loose < 150);
    }
    assert_eq!(made.truth.contact_impedance[[0, 8]], 1e6);

    let mut limited = FabricSettings::ideal();
    let driven = {
        let model = ForwardModel::new(&mesh(), &protocol(), &[1e3; 16]).unwrap();
        let mut workspace = model.workspace().unwrap();
        let sigma = vec![SIGMA; model.elements()];
        let u = model.solve(&sigma, &mut workspace).unwrap().electrode_potentials();
        u[[0, 0]] - u[[0, 1]]
    };
    limited.instrument.compliance_v = Some(0.5 * driven.abs());
    let made = simulate(&limited, &press([0.0, 0.0], 1.0), 1, 1);
    let ratio = made.exact_v[[0, 0]] / made.reference_v[0];
    assert!((ratio - 0.5).abs() < 1e-12, "rounding: {ratio}");
    assert_eq!(made.truth.quality[[0, 0]], TrueQuality::SourceLimited);
}

/// The change of voltages by a touch is nearly the same on a mesh with four times the nodes.
#[test]
fn finer_meshes_tell_the_same() {
    let change = |edge_m: f64| {
        let skin = SkinShape::Disc { radius_m: 0.1 };
        let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
        let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(edge_m)).unwrap();
        let mut settings = FabricSettings::ideal();
        settings.membrane.moves_nodes = true;
        let fabric = Fabric::new(&mesh, &protocol(), SIGMA, &[1e3; 16], &settings).unwrap();
        let raster = Raster::new(mesh.surface(), 16).unwrap();
        let script = press([0.06, 0.02], 2.0);
        let made =
            fabric.simulate(&script, &raster, &SimulationSettings::default(), &mut |_| {}).unwrap();
        &made.exact_v.row(8) - &made.reference_v
    };
    let (coarse, fine) = (change(0.006), change(0.003));
    let error = (&coarse - &fine).mapv(|d| d * d).sum().sqrt() / fine.mapv(|d| d * d).sum().sqrt();
    // a dent of 5 mm on edges of 6 mm; second order would leave a few per cent
    assert!(error < 0.1, "{error}");
}

#[test]
fn bad_scripts_are_refused() {
    let mesh = mesh();
    let good = press([0.0, 0.0], 2.0);
    let says = |change: &dyn Fn(&mut TouchScript), wanted: &str| {
        let mut script = good.clone();
        change(&mut script);
        let message = script.validate(&mesh).unwrap_err().to_string();
        assert_eq!(message, wanted);
        // and the simulation does not start
        let fabric =
            Fabric::new(&mesh, &protocol(), SIGMA, &[1e3; 16], &FabricSettings::default()).unwrap();
        let raster = Raster::new(mesh.surface(), 16).unwrap();
        let mut steps = 0;
        let how = SimulationSettings::default();
        assert!(fabric.simulate(&script, &raster, &how, &mut |_| steps += 1).is_err());
        assert_eq!(steps, 0);
    };
    good.validate(&mesh).unwrap();
    let key =
        |f: &'static dyn Fn(&mut Key)| move |s: &mut TouchScript| f(&mut s.fingers[0].keys[2]);
    says(&key(&|k| k.force_n = -1.0), "finger 7, key 2: force_n is -1: it must be at least zero");
    says(
        &key(&|k| k.force_n = f64::NAN),
        "finger 7, key 2: force_n is NaN: it must be at least zero",
    );
    says(&key(&|k| k.radius_m = 0.0), "finger 7, key 2: radius_m is 0: it must be above zero");
    says(
        &key(&|k| k.time_s = 0.5),
        "finger 7, key 2: its time 0.5 s is not after the previous key at 0.6 s",
    );
    says(
        &key(&|k| k.position_m = [0.2, 0.0]),
        "finger 7, at key 2, 1.2 s: (0.2, 0) m is not on the skin",
    );
    says(
        &key(&|k| k.position_m[1] = f64::INFINITY),
        "finger 7, key 2: position_m[1] is inf: it must be finite",
    );
    says(
        &|s| s.quiet_frames = 10,
        "finger 7, key 1: time_s is 0.6: it must be after the quiet frames, since the finger presses",
    );
    says(&|s| s.frame_rate_hz = 0.0, "frame_rate_hz is 0: it must be finite and above zero");
    says(
        &|s| s.frames = 0,
        "frames is 0: it must be more than quiet_frames, and at most 10 million",
    );
    says(
        &|s| s.frames = 1_000_000_000_000,
        "frames is 1000000000000: it must be more than quiet_frames, and at most 10 million",
    );
}

#[test]
fn bad_settings_are_refused() {
    let mesh = mesh();
    let says = |change: &dyn Fn(&mut FabricSettings), wanted: &str| {
        let mut settings = FabricSettings::default();
        change(&mut settings);
        let error = Fabric::new(&mesh, &protocol(), SIGMA, &[1e3; 16], &settings).unwrap_err();
        assert!(error.to_string().contains(wanted), "{error}");
    };
    says(&|s| s.membrane.tension_n_per_m = 0.0, "fabric.membrane.tension_n_per_m is 0");
    says(&|s| s.piezo.hysteresis = 1.0, "fabric.piezo.hysteresis is 1");
    says(&|s| s.piezo.relaxing = vec![0.1], "one per share");
    says(&|s| s.piezo.thresholds[1] = f64::NAN, "fabric.piezo.thresholds is NaN");
    says(&|s| s.rim.compliance = 1.5, "fabric.rim.compliance is 1.5");
    says(&|s| s.weave.amplitude = -0.1, "fabric.weave.amplitude is -0.1");
    says(&|s| s.instrument.noise_v = [2e-6, 1e-6], "noise_v[1] - noise_v[0]");
    says(&|s| s.instrument.bits = 1, "fabric.instrument.bits is 1");
    says(&|s| s.print.ratio = 0.5, "fabric.print.ratio is 0.5");
    says(&|s| s.print.roll_m = -1e-3, "fabric.print.roll_m is -0.001");
    says(&|s| s.print.roll_s = 0.0, "fabric.print.roll_s is 0");
    says(&|s| s.piezo.saturation = Some(0.0), "fabric.piezo.saturation is 0");
    says(&|s| s.instrument.torn = 1.5, "fabric.instrument.torn is 1.5");
    says(&|s| s.instrument.spiked = f64::NAN, "fabric.instrument.spiked is NaN");
    says(&|s| s.instrument.scan_share = -0.1, "fabric.instrument.scan_share is -0.1");
    says(&|s| s.instrument.lost = vec![17], "fabric.instrument.lost refers to electrode 17");
    let hard = press([0.0, 0.0], 1000.0);
    let fabric =
        Fabric::new(&mesh, &protocol(), SIGMA, &[1e3; 16], &FabricSettings::default()).unwrap();
    let raster = Raster::new(mesh.surface(), 16).unwrap();
    let how = SimulationSettings::default();
    let error = fabric.simulate(&hard, &raster, &how, &mut |_| {}).unwrap_err().to_string();
    assert!(error.starts_with("finger 7, 0.5 s: 500"), "{error}");
    let mut rolling = FabricSettings::default();
    rolling.print.roll_m = 0.2;
    let fabric = Fabric::new(&mesh, &protocol(), SIGMA, &[1e3; 16], &rolling).unwrap();
    let error = fabric.simulate(&press([0.0, 0.0], 1.0), &raster, &how, &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("as its print rolls"), "{error}");
}

/// All built-in scripts are valid on the disc and start with 20 quiet frames; the paper's scripts
/// have the stated lengths.
#[test]
fn built_in_scripts_fit_the_skin() {
    let mesh = mesh();
    let circle = PlayCircle::of(&mesh);
    assert!((circle.radius_m - 0.1).abs() < 1e-3, "chords of the rim: {circle:?}");
    for name in TouchScript::BUILT_IN {
        let script = TouchScript::built_in(name, &circle, 11).unwrap();
        script.validate(&mesh).unwrap();
        assert_eq!(script.quiet_frames, 20);
        assert!((0..20).all(|f| script.touches(f).is_empty()), "{name}");
        let touched = (0..script.frames).filter(|f| !script.touches(*f).is_empty()).count();
        assert!(5 * touched > 2 * script.frames, "{name}: {touched} of {}", script.frames);
    }
    let one = TouchScript::built_in("one-finger", &circle, 1).unwrap();
    let two = TouchScript::built_in("two-fingers", &circle, 1).unwrap();
    assert_eq!((one.frames, two.frames), (397, 252));
    // the first is anticlockwise from the top, the second clockwise
    let place = |s: &TouchScript, f: usize| s.touches(f)[0].position_m;
    let angle = |s: &TouchScript, f: usize| {
        let [x, y] = place(s, f);
        y.atan2(x)
    };
    assert!(angle(&one, 60) > angle(&one, 30));
    assert!(angle(&two, 60) < angle(&two, 30));
    // the paper's, one frame a second: from snapshot 13 of 21 from the rim through the centre to the upper left
    let [paper_one, paper_two] = ["paper-one-finger", "paper-two-fingers"]
        .map(|name| TouchScript::built_in(name, &circle, 1).unwrap());
    assert_eq!((paper_one.frames, paper_two.frames), (397, 252));
    assert_eq!((paper_one.frame_rate_hz, paper_two.frame_rate_hz), (1.0, 1.0));
    assert!(angle(&paper_two, 60) < angle(&paper_two, 30));
    let touched: Vec<usize> = (0..397).filter(|f| !paper_one.touches(*f).is_empty()).collect();
    let snapshot = |k: usize| touched[(k - 1) * (touched.len() - 1) / 20];
    let from_centre = |k: usize| {
        let [x, y] = place(&paper_one, snapshot(k));
        x.hypot(y)
    };
    for k in 2..13 {
        assert!((from_centre(k) - 0.08).abs() < 1e-3, "snapshot {k}");
        let turned = (angle(&paper_one, snapshot(k)) - angle(&paper_one, snapshot(k - 1)))
            .rem_euclid(std::f64::consts::TAU);
        assert!((0.4..0.7).contains(&turned), "snapshot {k}: {turned}");
    }
    assert!(from_centre(14) < 0.075 && from_centre(17) < 3e-3, "{}", from_centre(17));
    let [x, y] = place(&paper_one, snapshot(20));
    assert!(x < -0.03 && y > 0.03 && (x + y).abs() < 1e-6, "{x} {y}");
    let error = TouchScript::built_in("dance", &circle, 1).unwrap_err().to_string();
    assert!(error.contains("dance") && error.contains("closing-in"), "{error}");
}
