//! The simulated fabric as a whole: determinism, switching effects off, ground truth, invalid input.

use crate::common::skins::{changed, disc, finger, key, script, try_fabric, try_simulate};
use crate::common::{
    CONDUCTIVITY_S as SIGMA, IMPEDANCE_OHM_M, even, largest, paper_protocol, refused, relative,
};
use eit_fem::ForwardModel;
use eit_fem::fabric::{
    FabricSettings, Instrument, Key, PlayCircle, Simulation, SimulationSettings, Tip, TouchScript,
    TrueQuality, Weave,
};
use eit_mesh::{Mesh, Raster};

fn mesh() -> Mesh {
    disc(0.012)
}

fn model(mesh: &Mesh) -> ForwardModel {
    ForwardModel::new(mesh, &paper_protocol(), &[IMPEDANCE_OHM_M; 16]).unwrap()
}

fn simulate_on(
    mesh: &Mesh,
    settings: &FabricSettings,
    script: &TouchScript,
    seed: u64,
    threads: usize,
) -> Simulation {
    let raster = Raster::new(mesh.surface(), 32).unwrap();
    let how = SimulationSettings { seed, threads, keep_elements: true };
    try_fabric(mesh, settings).unwrap().simulate(script, &raster, &how, &mut |_| {}).unwrap()
}

fn simulate(settings: &FabricSettings, script: &TouchScript) -> Simulation {
    simulate_on(&mesh(), settings, script, 1, 1)
}

/// A press at one place from 0.4 s to 1.2 s.
fn press(at_m: [f64; 2], force_n: f64) -> TouchScript {
    let keys = [(0.4, 0.0), (0.6, force_n), (1.2, force_n), (1.4, 0.0)];
    let keys = keys.map(|(time_s, force_n)| key(time_s, at_m, force_n)).to_vec();
    script(20, 4, vec![finger(7, Tip::Round, keys)])
}

fn random_script() -> TouchScript {
    let script = TouchScript::built_in("random", &PlayCircle::of(&mesh()), 3).unwrap();
    TouchScript { frames: 90, ..script }
}

/// All effects switched on.
fn everything() -> FabricSettings {
    let (loose, lost, compliance_v) = (vec![3], vec![9], Some(20.0));
    let instrument =
        Instrument { loose, loose_rate_hz: 1.0, lost, compliance_v, ..Default::default() };
    FabricSettings { instrument, ..Default::default() }
}

/// The ideal fabric with one effect.
fn ideal_but(change: impl FnOnce(&mut FabricSettings)) -> FabricSettings {
    changed(FabricSettings::ideal(), change)
}

/// Values from the first release with the simulated fabric, all effects switched on. On another
/// processor the order of sums differs, which changes frames by 1e-12 of the largest value; other
/// random numbers change them by 1e-4 and more.
#[test]
fn a_seed_gives_the_frames_it_has_always_given() {
    let made = simulate_on(&mesh(), &everything(), &random_script(), 5, 2);
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
    let (mesh, script) = (disc(0.02), random_script());
    let simulate = |settings: &FabricSettings, script: &TouchScript, seed, threads| {
        simulate_on(&mesh, settings, script, seed, threads)
    };
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
    let rough = changed(everything(), |s| {
        (s.print.ratio, s.print.roll_m, s.piezo.saturation) = (1.5, 1e-3, Some(0.5));
        (s.instrument.scan_share, s.instrument.torn, s.instrument.spiked) = (0.8, 0.2, 0.2);
    });
    let scanned = simulate(&rough, &script, 5, 1);
    same(&scanned, &simulate(&rough, &script, 5, 2));
    let one = simulate(&everything(), &script, 5, 1);
    for threads in [2, 3, usize::MAX] {
        same(&one, &simulate(&everything(), &script, 5, threads));
    }
    let other = simulate(&everything(), &script, 6, 1);
    assert!(one.frames_v != other.frames_v, "another seed is another fabric");
    // the first frames of a longer script equal those of a shorter one
    let short = TouchScript { frames: 50, ..script };
    for (long, settings) in [(one, everything()), (scanned, rough)] {
        let short = simulate(&settings, &short, 5, 2);
        assert!(long.frames_v.slice_axis(ndarray::Axis(0), (0..50).into()) == short.frames_v);
    }
}

#[test]
fn the_ideal_fabric_is_a_plain_solve() {
    let made = simulate(&FabricSettings::ideal(), &press([0.03, 0.02], 2.0));
    let model = model(&mesh());
    let untouched = even(&model, SIGMA);
    assert_eq!(made.frames_v, made.exact_v, "no instrument");
    assert_eq!(made.reference_v, untouched);
    for quiet in [0, 3, 4, 14, 19] {
        assert_eq!(made.frames_v.row(quiet), untouched, "frame {quiet}: no touch, no memory");
    }
    let changes = made.truth.element_change_s.as_ref().unwrap();
    let sigma: Vec<f64> = changes.row(8).iter().map(|c| SIGMA + c).collect();
    let wanted = model.forward(&sigma).unwrap();
    // difference and sum of the same numbers: rounding
    assert!(relative(&made.frames_v.row(8).to_owned(), &wanted) < 1e-12);
    assert!(made.truth.electrode_shift_m.iter().all(|s| *s == 0.0));
    assert!(made.truth.contact_impedance.iter().all(|z| *z == 1e3));
}

/// An effect of amplitude zero changes no byte of the frames, and every effect that is on does.
#[test]
fn parts_switch_off_one_by_one() {
    let script = press([0.07, 0.0], 2.0);
    let ideal = FabricSettings::ideal();
    let frames_v = |settings: &FabricSettings| simulate(settings, &script).frames_v;
    let base_v = frames_v(&ideal);
    type Change = fn(&mut FabricSettings);
    let effects: [(&str, Change); 21] = [
        ("movement", |s| s.membrane = Default::default()),
        ("memory", |s| s.piezo = Default::default()),
        ("contact", |s| s.rim.contact_gain = 1.0),
        ("weave", |s| s.weave = Weave::default()),
        ("sheet drift", |s| s.drift.conductivity = 1e-3),
        ("contact drift", |s| s.drift.contact = 1e-3),
        ("noise", |s| s.instrument.noise_v = [4e-7, 1.4e-6]),
        ("gain", |s| s.instrument.gain_error = 1e-3),
        ("bits", |s| s.instrument.bits = 16),
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
    for (name, change) in effects {
        assert!(frames_v(&ideal_but(change)) != base_v, "{name}");
    }
    // other settings of an effect that is off do not matter
    let off = ideal_but(|s| {
        (s.weave.correlation_m, s.weave.angle_deg) = (0.5, 40.0);
        (s.drift.time_s, s.drift.warming_unevenness) = (1.0, 2.0);
        (s.instrument.loose_time_s, s.instrument.range_v) = (9.0, Some(1e-9));
        (s.instrument.open_factor, s.instrument.mains_hz) = (7.0, 3.0);
        s.piezo.ring_radius_m = 0.04;
        (s.print.squash_n, s.print.roll_deg, s.print.roll_s) = (2.0, 20.0, 9.0);
    });
    let made = simulate_on(&mesh(), &off, &script, 99, 1);
    assert_eq!(made.frames_v, base_v, "nor has the seed");
    // switching one effect off does not change the random numbers of the others
    let noisy = |weave: Weave| {
        let settings = ideal_but(|s| (s.weave, s.instrument.noise_v) = (weave, [1e-6; 2]));
        let made = simulate(&settings, &script);
        &made.frames_v - &made.exact_v
    };
    let difference = noisy(Weave::default()) - noisy(ideal.weave);
    // rounding of voltages near 10 V
    assert!(difference.iter().all(|d| d.abs() < 1e-14));
}

/// The ground-truth pressure integrates to the force; touches match the script.
#[test]
fn the_truth_holds_the_force() {
    let made = simulate(&FabricSettings::default(), &press([0.03, -0.02], 2.0));
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
        let made = simulate(&FabricSettings::default(), &press(position_m, 2.0));
        let shifts = made.truth.electrode_shift_m.index_axis(ndarray::Axis(0), 8).to_owned();
        let size = |l: usize| shifts.row(l).iter().map(|s| s * s).sum::<f64>().sqrt();
        let sizes: Vec<f64> = (0..16).map(size).collect();
        assert!(made.report.least_area_ratio > 0.3, "{}", made.report.least_area_ratio);
        (shifts, sizes, made.truth.contact_impedance.row(8).to_vec())
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
        let settings = changed(FabricSettings::default(), |s| s.membrane.friction = friction);
        let mut script = press([0.06, -0.03], 1.5);
        script.fingers[0].keys[2].position_m[1] = 0.03;
        script.fingers[0].keys[3].position_m[1] = 0.0;
        // frame 9 is in the middle of the upward stroke; electrode 1 is centred on +x
        simulate(&settings, &script).truth.electrode_shift_m[[9, 0, 1]]
    };
    let (with, without) = (shift_y(0.4), shift_y(0.0));
    assert!(without.abs() < 1e-5, "symmetric but for the mesh: {without:e}");
    let wanted =
        0.7 * 0.4 * 1.5 * 1.3 * 2.7 / (4.0 * std::f64::consts::PI * 300.0) * (0.1_f64 / 0.04).ln();
    // the electrode is 20 mm wide: the mean of the logarithm over it is 2 % lower
    assert!(((with - without) / wanted - 1.0).abs() < 0.05, "{with:e} {wanted:e}");
}

/// Noise has its standard deviation, quantised values are multiples of the step, and a small range
/// saturates and marks the values.
#[test]
fn the_instrument_does_what_it_says() {
    let mut script = press([0.0, 0.0], 1.0);
    script.frames = 400;
    let noisy = ideal_but(|s| s.instrument.noise_v = [1e-6, 1e-6]);
    let made = simulate_on(&disc(0.02), &noisy, &script, 1, 2);
    let noise = &made.frames_v - &made.exact_v;
    let std = (noise.iter().map(|n| n * n).sum::<f64>() / noise.len() as f64).sqrt();
    // 83 200 samples: four standard errors of 0.25 %
    assert!((std / 1e-6 - 1.0).abs() < 0.01, "{std:e}");
    let lag: f64 = (0..399).map(|f| noise.row(f).dot(&noise.row(f + 1))).sum();
    assert!(lag.abs() < 0.02 * noise.iter().map(|n| n * n).sum::<f64>(), "frames are independent");

    script.frames = 12;
    let coarse = ideal_but(|s| (s.instrument.bits, s.instrument.range_v) = (12, Some(0.5)));
    let made = simulate(&coarse, &script);
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
    let made = simulate(&FabricSettings::default(), &script);
    assert!(made.truth.quality.iter().all(|q| *q == TrueQuality::Good));
}

/// A lost electrode affects exactly the measurements that involve it; a loose one does so at times;
/// a source at half the needed voltage halves the measurements.
#[test]
fn bad_contacts_are_marked() {
    let settings = ideal_but(|s| (s.instrument.lost, s.instrument.loose) = (vec![9], vec![3]));
    let mut script = press([0.0, 0.0], 1.0);
    script.frames = 200;
    let made = simulate_on(&mesh(), &settings, &script, 1, 2);
    let quadruples = paper_protocol().quadruples().unwrap().to_vec();
    let large = 1e-3 * largest(&made.reference_v);
    for (k, quadruple) in quadruples.iter().enumerate() {
        let lost = made.truth.quality.column(k).iter().all(|q| *q == TrueQuality::Lost);
        assert_eq!(lost, quadruple.contains(&8), "{quadruple:?}");
        // a lost electrode floats at a tenth of the largest voltage, except in `exact_v`
        let off = (&made.frames_v.column(k) - &made.exact_v.column(k)).mapv(f64::abs);
        assert_eq!(off.iter().all(|v| *v < large), !lost, "{quadruple:?}");
        let loose =
            made.truth.quality.column(k).iter().filter(|q| **q == TrueQuality::Loose).count();
        assert_eq!(loose > 0, quadruple.contains(&2) && !quadruple.contains(&8), "{quadruple:?}");
        assert!(loose < 150);
    }
    assert_eq!(made.truth.contact_impedance[[0, 8]], 1e6);

    let model = model(&mesh());
    let sigma = vec![SIGMA; model.elements()];
    let u = model.solve(&sigma, &mut model.workspace().unwrap()).unwrap().electrode_potentials();
    let needed_v = (u[[0, 0]] - u[[0, 1]]).abs();
    let limited = ideal_but(|s| s.instrument.compliance_v = Some(0.5 * needed_v));
    let made = simulate(&limited, &press([0.0, 0.0], 1.0));
    let ratio = made.exact_v[[0, 0]] / made.reference_v[0];
    assert!((ratio - 0.5).abs() < 1e-12, "rounding: {ratio}");
    assert_eq!(made.truth.quality[[0, 0]], TrueQuality::SourceLimited);
}

#[test]
fn finer_meshes_tell_the_same() {
    let change = |edge_m: f64| {
        let mesh = disc(edge_m);
        let fabric = try_fabric(&mesh, &ideal_but(|s| s.membrane.moves_nodes = true)).unwrap();
        let made = try_simulate(&mesh, &fabric, &press([0.06, 0.02], 2.0), 16).unwrap();
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
    good.validate(&mesh).unwrap();
    let fabric = try_fabric(&mesh, &FabricSettings::default()).unwrap();
    let raster = Raster::new(mesh.surface(), 16).unwrap();
    let says = |change: &dyn Fn(&mut TouchScript), wanted: &str| {
        let script = changed(good.clone(), change);
        assert_eq!(script.validate(&mesh).unwrap_err().to_string(), wanted);
        // and the simulation does not start
        let mut steps = 0;
        let how = SimulationSettings::default();
        assert!(fabric.simulate(&script, &raster, &how, &mut |_| steps += 1).is_err());
        assert_eq!(steps, 0);
    };
    type Change = fn(&mut Key);
    let bad_keys: [(Change, &str); 6] = [
        (|k| k.force_n = -1.0, ", key 2: force_n is -1: it must be at least zero"),
        (|k| k.force_n = f64::NAN, ", key 2: force_n is NaN: it must be at least zero"),
        (|k| k.radius_m = 0.0, ", key 2: radius_m is 0: it must be above zero"),
        (|k| k.time_s = 0.5, ", key 2: its time 0.5 s is not after the previous key at 0.6 s"),
        (|k| k.position_m = [0.2, 0.0], ", at key 2, 1.2 s: (0.2, 0) m is not on the skin"),
        (|k| k.position_m[1] = f64::INFINITY, ", key 2: position_m[1] is inf: it must be finite"),
    ];
    for (change, wanted) in bad_keys {
        says(&|s| change(&mut s.fingers[0].keys[2]), &format!("finger 7{wanted}"));
    }
    says(
        &|s| s.quiet_frames = 10,
        "finger 7, key 1: time_s is 0.6: it must be after the quiet frames, since the finger presses",
    );
    says(&|s| s.frame_rate_hz = 0.0, "frame_rate_hz is 0: it must be finite and above zero");
    for frames in [0, 1_000_000_000_000] {
        let wanted = "it must be more than quiet_frames, and at most 10 million";
        says(&|s| s.frames = frames, &format!("frames is {frames}: {wanted}"));
    }
}

#[test]
fn bad_settings_are_refused() {
    let mesh = mesh();
    let says = |change: &dyn Fn(&mut FabricSettings), wanted: &str| {
        refused(try_fabric(&mesh, &changed(FabricSettings::default(), change)), wanted);
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
    // found only while the skin is pressed
    let pressed = |change: &dyn Fn(&mut FabricSettings), force_n| {
        let fabric = try_fabric(&mesh, &changed(FabricSettings::default(), change)).unwrap();
        try_simulate(&mesh, &fabric, &press([0.0, 0.0], force_n), 16).unwrap_err().to_string()
    };
    let error = pressed(&|_| {}, 1000.0);
    assert!(error.starts_with("finger 7, 0.5 s: 500"), "{error}");
    let error = pressed(&|s| s.print.roll_m = 0.2, 1.0);
    assert!(error.contains("as its print rolls"), "{error}");
}

/// Built-in scripts fit the disc and start with 20 quiet frames; the paper's have the stated lengths.
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
    let [one, two, paper_one, paper_two] =
        ["one-finger", "two-fingers", "paper-one-finger", "paper-two-fingers"]
            .map(|name| TouchScript::built_in(name, &circle, 1).unwrap());
    let place = |s: &TouchScript, f: usize| s.touches(f)[0].position_m;
    let angle = |s: &TouchScript, f: usize| {
        let [x, y] = place(s, f);
        y.atan2(x)
    };
    for (one, two) in [(&one, &two), (&paper_one, &paper_two)] {
        assert_eq!((one.frames, two.frames), (397, 252));
        assert!(angle(two, 60) < angle(two, 30), "clockwise");
    }
    assert!(angle(&one, 60) > angle(&one, 30), "anticlockwise from the top");
    assert_eq!((paper_one.frame_rate_hz, paper_two.frame_rate_hz), (1.0, 1.0));
    // the paper's: from snapshot 13 of 21 from the rim through the centre to the upper left
    let touched: Vec<usize> = (0..397).filter(|f| !paper_one.touches(*f).is_empty()).collect();
    let snapshot = |k: usize| touched[(k - 1) * (touched.len() - 1) / 20];
    let from_centre = |k: usize| {
        let [x, y] = place(&paper_one, snapshot(k));
        x.hypot(y)
    };
    for k in 2..13 {
        assert!((from_centre(k) - 0.08).abs() < 1e-3, "snapshot {k}");
        let turned = angle(&paper_one, snapshot(k)) - angle(&paper_one, snapshot(k - 1));
        let turned = turned.rem_euclid(std::f64::consts::TAU);
        assert!((0.4..0.7).contains(&turned), "snapshot {k}: {turned}");
    }
    assert!(from_centre(14) < 0.075 && from_centre(17) < 3e-3, "{}", from_centre(17));
    let [x, y] = place(&paper_one, snapshot(20));
    assert!(x < -0.03 && y > 0.03 && (x + y).abs() < 1e-6, "{x} {y}");
    let error = TouchScript::built_in("dance", &circle, 1).unwrap_err().to_string();
    assert!(error.contains("dance") && error.contains("closing-in"), "{error}");
}
