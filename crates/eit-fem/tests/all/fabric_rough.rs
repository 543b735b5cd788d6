//! What real fabric and instruments do beyond the paper's skin: each effect alone, against its closed form.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout, reason = "tests")]

use eit_fem::fabric::{
    Fabric, FabricSettings, Finger, Key, PiezoLaw, Piezoresistance, Simulation, SimulationSettings,
    Tip, TouchScript,
};
use eit_fem::{PairProtocol, Protocol};
use eit_mesh::{Mesh, MeshSettings, Raster, RimElectrodes, SkinShape, generate};

const RATE_HZ: f64 = 10.0;
const SIGMA: f64 = 1e-5;

fn mesh() -> Mesh {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    generate(&skin, &electrodes, &MeshSettings::with_edge(0.006)).unwrap()
}

/// A press of 1 N in the middle from 1 s on.
fn simulate(frames: usize, change: impl Fn(&mut FabricSettings)) -> Simulation {
    simulate_with(&PairProtocol::default().protocol().unwrap(), frames, change)
}

fn simulate_with(
    protocol: &Protocol,
    frames: usize,
    change: impl Fn(&mut FabricSettings),
) -> Simulation {
    let mut settings = FabricSettings::ideal();
    change(&mut settings);
    let mesh = mesh();
    let fabric = Fabric::new(&mesh, protocol, SIGMA, &[1e3; 16], &settings).unwrap();
    let key = |time_s, force_n| Key { time_s, position_m: [0.0; 2], force_n, radius_m: 0.01 };
    let keys = vec![key(0.9, 0.0), key(1.0, 1.0), key(1e6, 1.0)];
    let finger = Finger { id: 1, tip: Tip::Round, interpolation: Default::default(), keys };
    let script = TouchScript {
        name: String::new(),
        frame_rate_hz: RATE_HZ,
        frames,
        quiet_frames: 5,
        fingers: vec![finger],
    };
    let raster = Raster::new(mesh.surface(), 8).unwrap();
    let how = SimulationSettings { keep_elements: true, ..Default::default() };
    fabric.simulate(&script, &raster, &how, &mut |_| {}).unwrap()
}

/// ln(sigma / sigma_0) of each element in a frame.
fn logarithms(made: &Simulation, frame: usize) -> Vec<f64> {
    let changes = made.truth.element_change_s.as_ref().unwrap();
    let untouched = &made.truth.untouched_s;
    changes.row(frame).iter().zip(untouched).map(|(c, s)| (c / s).ln_1p()).collect()
}

/// The integral of the change falls by the ring's share, and the change is negative around the finger.
#[test]
fn a_ring_takes_its_share() {
    let areas_m2 = mesh().surface().areas_m2().to_vec();
    let integral = |made: &Simulation| -> f64 {
        logarithms(made, 12).iter().zip(&areas_m2).map(|(c, area)| c * area).sum()
    };
    let plain = integral(&simulate(13, |_| {}));
    for share in [0.35, 0.7] {
        let made = simulate(13, |settings| settings.piezo.ring = share);
        let found = 1.0 - integral(&made) / plain;
        // elements of 6 mm under a finger of 7 mm
        assert!((found - share).abs() < 0.03, "{share}: {found}");
        let centroids = mesh().surface().centroids();
        let around = logarithms(&made, 12).into_iter().zip(centroids).filter(|(_, c)| {
            let r = c[0].hypot(c[1]);
            (0.035..0.05).contains(&r)
        });
        assert!(around.into_iter().all(|(change, _)| change < 0.0));
    }
}

/// A share of -0.2 creeps up to 1.2 of the response at once, and 0.2 of it is left after a lift, fading with its time.
#[test]
fn a_negative_share_creeps_and_stays() {
    let settings = Piezoresistance {
        hysteresis: 0.0,
        relaxing: vec![-0.2],
        relaxation_s: vec![1.0],
        ..Default::default()
    };
    let law = PiezoLaw::new(&settings, 1e-3);
    let mut memory = vec![0.0; law.memory()];
    let mut held = 0.0;
    for _ in 0..20_000 {
        held = law.step(0.5, &mut memory);
    }
    assert!((held - 0.6).abs() < 1e-6, "{held}");
    let left: Vec<f64> = (0..1000).map(|_| law.step(0.0, &mut memory)).collect();
    // the first step is a ramp of a thousandth of the time
    assert!((left[0] - 0.1).abs() < 1e-4 && (left[999] - 0.1 * (-1.0_f64).exp()).abs() < 1e-4);
}

/// Even warming multiplies the conductivity by `exp(rate t)`; uneven warming has its mean and spread.
#[test]
fn a_sheet_warms() {
    let warmed = |unevenness: f64| {
        let made = simulate(7, |settings| {
            settings.drift.warming_per_min = 0.6;
            settings.drift.warming_unevenness = unevenness;
        });
        logarithms(&made, 6)
    };
    let wanted = 0.6 * 6.0 / RATE_HZ / 60.0;
    assert!(warmed(0.0).iter().all(|w| (w - wanted).abs() < 1e-12));
    let uneven = warmed(0.5);
    let [least, most] =
        [f64::min, f64::max].map(|of| uneven.iter().copied().reduce(of).unwrap() / wanted);
    // a field that is correlated over half of the skin varies by some of its standard deviations
    assert!(most - least > 0.3 && least > -2.0 && most < 4.0, "{least} {most}");
}

/// The leak is `10^(-dB / 20)` times the mean potential of the measured electrodes above the sink: half the sum of two
/// measurements against the sink, whatever the sign of the pair's own.
#[test]
fn common_mode_leaks() {
    let pairs = [[0, 4, 1, 2], [0, 4, 2, 1], [4, 0, 2, 3], [3, 9, 3, 9]];
    let against_sink = |a, b, e| if e == b { None } else { Some([a, b, e, b]) };
    let singles: Vec<_> =
        pairs.iter().map(|[a, b, m, n]| [*m, *n].map(|e| against_sink(*a, *b, e))).collect();
    let all: Vec<[u32; 4]> =
        pairs.into_iter().chain(singles.iter().flatten().flatten().copied()).collect();
    let protocol = Protocol::from_quadruples(16, &all, 1e-4).unwrap();
    let voltages = |change: &dyn Fn(&mut FabricSettings)| {
        simulate_with(&protocol, 6, change).frames_v.row(0).to_vec()
    };
    let plain = voltages(&|_| {});
    let leaky = voltages(&|s| s.instrument.common_mode_db = Some(40.0));
    let largest = plain.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let mut next = pairs.len();
    for (k, single) in singles.iter().enumerate() {
        let mut mean = 0.0;
        for _ in single.iter().flatten() {
            mean += 0.5 * plain[next];
            next += 1;
        }
        let leak = leaky[k] - plain[k];
        // rounding of voltages near the largest
        assert!((leak - 0.01 * mean).abs() < 1e-12 * largest, "{k}: {leak} for {}", 0.01 * mean);
    }
}

/// Slow noise has its standard deviation, mains its amplitude and period, the same for all values of a channel.
#[test]
fn slow_noise_and_mains() {
    let quiet = |change: &dyn Fn(&mut FabricSettings)| {
        let made = simulate(400, change);
        &made.frames_v - &made.exact_v
    };
    let flicker = quiet(&|s| s.instrument.flicker_v = 1e-4);
    let std = (flicker.iter().map(|v| v * v).sum::<f64>() / flicker.len() as f64).sqrt();
    // 16 channels of 400 frames with periods of up to 512
    assert!((std / 1e-4 - 1.0).abs() < 0.2, "{std}");
    let mains = quiet(&|s| (s.instrument.mains_v, s.instrument.mains_hz) = (1e-4, 0.25));
    for frame in 0..300 {
        let change = &mains.row(frame + 40) - &mains.row(frame);
        // a period of 40 frames; rounding of voltages near 1 V
        assert!(change.iter().all(|d| d.abs() < 1e-12), "{frame}");
    }
    let most = mains.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    assert!((most / 1e-4 - 1.0).abs() < 0.01, "{most}");
}
