//! What real fabric and instruments do beyond the paper's skin: each effect alone, against its closed form.

use crate::common::skins::{changed, disc, finger, key, script, try_simulate};
use crate::common::{CONDUCTIVITY_S, IMPEDANCE_OHM_M, largest, paper_protocol};
use eit_fem::Protocol;
use eit_fem::fabric::{Fabric, FabricSettings, Key, Simulation, Tip, TouchScript, TrueQuality};
use eit_mesh::{Mesh, Raster};
use std::sync::LazyLock;

static MESH: LazyLock<Mesh> = LazyLock::new(|| disc(0.006));
/// For instruments, which do not depend on it.
static COARSE: LazyLock<Mesh> = LazyLock::new(|| disc(0.02));
/// Of 1.6 mm.
const FINE_PIXELS: usize = 128;

fn simulate_script(
    mesh: &Mesh,
    protocol: &Protocol,
    script: &TouchScript,
    pixels: usize,
    change: impl Fn(&mut FabricSettings),
) -> Simulation {
    let settings = changed(FabricSettings::ideal(), change);
    let impedance = [IMPEDANCE_OHM_M; 16];
    let fabric = Fabric::new(mesh, protocol, CONDUCTIVITY_S, &impedance, &settings).unwrap();
    try_simulate(mesh, &fabric, script, pixels).unwrap()
}

fn of_keys(frames: usize, keys: Vec<Key>) -> TouchScript {
    script(frames, 5, vec![finger(1, Tip::Round, keys)])
}

/// A press of 1 N in the middle from 1 s on.
fn press(frames: usize) -> TouchScript {
    let keys = [(0.9, 0.0), (1.0, 1.0), (1e6, 1.0)];
    of_keys(frames, keys.map(|(time_s, force_n)| key(time_s, [0.0; 2], force_n)).to_vec())
}

fn simulate(frames: usize, change: impl Fn(&mut FabricSettings)) -> Simulation {
    simulate_script(&MESH, &paper_protocol(), &press(frames), 8, change)
}

/// Frames of an instrument.
fn measure(frames: usize, change: impl Fn(&mut FabricSettings)) -> Simulation {
    simulate_script(&COARSE, &paper_protocol(), &press(frames), 8, change)
}

/// ln(sigma / sigma_0) of each element in a frame.
fn logarithms(made: &Simulation, frame: usize) -> Vec<f64> {
    let changes = made.truth.element_change_s.as_ref().unwrap();
    changes.row(frame).iter().zip(&made.truth.untouched_s).map(|(c, s)| (c / s).ln_1p()).collect()
}

/// The integral of the change falls by the ring's share, and the change is negative around the finger.
#[test]
fn a_ring_takes_its_share() {
    let integral = |made: &Simulation| -> f64 {
        logarithms(made, 12).iter().zip(MESH.surface().areas_m2()).map(|(c, area)| c * area).sum()
    };
    let plain = integral(&simulate(13, |_| {}));
    for share in [0.35, 0.7] {
        let made = simulate(13, |settings| settings.piezo.ring = share);
        let found = 1.0 - integral(&made) / plain;
        // elements of 6 mm under a finger of 7 mm
        assert!((found - share).abs() < 0.03, "{share}: {found}");
        let mut around = logarithms(&made, 12).into_iter().zip(MESH.surface().centroids());
        let is_around = |c: [f64; 3]| (0.035..0.05).contains(&c[0].hypot(c[1]));
        assert!(around.all(|(change, c)| !is_around(c) || change < 0.0));
    }
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
    let wanted = 0.6 * 6.0 / 10.0 / 60.0;
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
    // an electrode against the sink; the sink itself is at zero
    let singles = pairs.map(|[a, b, m, n]| [m, n].map(|e| (e != b).then_some([a, b, e, b])));
    let all: Vec<[u32; 4]> =
        pairs.into_iter().chain(singles.into_iter().flatten().flatten()).collect();
    let protocol = Protocol::from_quadruples(16, &all, 1e-4).unwrap();
    let voltages = |common_mode_db| {
        let change = |s: &mut FabricSettings| s.instrument.common_mode_db = common_mode_db;
        simulate_script(&COARSE, &protocol, &press(6), 8, change).frames_v.row(0).to_vec()
    };
    let (plain, leaky) = (voltages(None), voltages(Some(40.0)));
    let mut against_sink = plain[pairs.len()..].iter();
    for (k, single) in singles.iter().enumerate() {
        let mean: f64 = single.iter().flatten().map(|_| 0.5 * against_sink.next().unwrap()).sum();
        let leak = leaky[k] - plain[k];
        // rounding of voltages near the largest
        assert!((leak - 0.01 * mean).abs() < 1e-12 * largest(&plain), "{k}: {leak} for {mean}");
    }
}

/// Slow noise has its standard deviation, mains its amplitude and period, the same for all values of a channel.
#[test]
fn slow_noise_and_mains() {
    let quiet = |change: &dyn Fn(&mut FabricSettings)| {
        let made = measure(400, change);
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
    assert!((largest(&mains) / 1e-4 - 1.0).abs() < 0.01, "{}", largest(&mains));
}

/// Sum, centre, ratio of the axes and angle of the long axis, radians, of weights at places.
fn moments(weights: impl Iterator<Item = ([f64; 2], f64)>) -> (f64, [f64; 2], f64, f64) {
    let all: Vec<_> = weights.filter(|(_, w)| w.is_finite()).collect();
    let mean = |of: &dyn Fn([f64; 2]) -> f64| all.iter().map(|(p, w)| of(*p) * w).sum::<f64>();
    let sum = mean(&|_| 1.0);
    let centre = [0, 1].map(|k| mean(&|p| p[k]) / sum);
    let second = |i: usize, j: usize| mean(&|p| (p[i] - centre[i]) * (p[j] - centre[j])) / sum;
    let (a, b, c) = (second(0, 0), second(1, 1), second(0, 1));
    let (half, root) = (0.5 * (a + b), (0.25 * (a - b).powi(2) + c * c).sqrt());
    let angle = 0.5 * (2.0 * c).atan2(a - b);
    (sum, centre, ((half + root) / (half - root)).sqrt(), angle)
}

/// A press with its pressures in pixels of 1.6 mm, and the moments of those of a frame.
fn pressed(frames: usize, change: impl Fn(&mut FabricSettings)) -> Simulation {
    simulate_script(&MESH, &paper_protocol(), &press(frames), FINE_PIXELS, change)
}

fn pressure(made: &Simulation, frame: usize) -> (f64, [f64; 2], f64, f64) {
    let raster = Raster::new(MESH.surface(), FINE_PIXELS).unwrap();
    let pixels = made.truth.pressure_pa.index_axis(ndarray::Axis(0), frame);
    let area_m2 = raster.pixel_m().powi(2);
    let at = |((i, j), p): ((usize, usize), &f64)| (raster.centre_m(i, j), p * area_m2);
    moments(pixels.indexed_iter().map(at))
}

/// The print is an ellipse of the set ratio, less with little force, whose pressure and response have the integral of the
/// round one.
#[test]
fn a_print_is_an_ellipse() {
    let response = |made: &Simulation| {
        let (centroids, areas_m2) = (MESH.surface().centroids(), MESH.surface().areas_m2());
        let changes = logarithms(made, 12).into_iter().zip(areas_m2).map(|(c, area)| c * area);
        moments(centroids.into_iter().map(|c| [c[0], c[1]]).zip(changes))
    };
    // strains reach the rim, which cuts ellipses and circles differently
    let round = pressed(13, |s| s.piezo.strain_gain = 0.0);
    for (squash_n, wanted) in [(0.0, 1.6), (1.0, 1.6 - 0.6 * (-1.0_f64).exp())] {
        let made = pressed(13, |s| {
            s.piezo.strain_gain = 0.0;
            (s.print.ratio, s.print.squash_n) = (1.6, squash_n);
        });
        let (force_n, _, ratio, angle) = pressure(&made, 12);
        // pixels of 1.6 mm, contact of 11 mm
        assert!((force_n - 1.0).abs() < 0.01 && (ratio - wanted).abs() < 0.03, "{force_n} {ratio}");
        let ((whole, ..), (sum, _, wide, turned)) = (response(&round), response(&made));
        // elements of 6 mm
        assert!((sum / whole - 1.0).abs() < 0.05 && (wide - wanted).abs() < 0.15, "{sum} {wide}");
        assert!((angle - turned).sin().abs() < 0.2, "{angle} {turned}");
    }
}

/// A print rolls to and fro across its long axis, and turns, each by its amplitude with its period; the truth is where it is.
#[test]
fn a_print_rolls_and_turns() {
    let (roll_m, turn) = (2e-3, 15.0_f64.to_radians());
    let made = pressed(40, |s| {
        (s.print.ratio, s.print.roll_m, s.print.roll_deg) = (1.6, roll_m, 15.0);
        s.print.roll_s = 2.0;
    });
    let place = |f: usize| made.truth.touches.iter().find(|t| t.frame == f).unwrap().position_m;
    let squares = |f: usize| place(f).iter().map(|x| x * x).sum::<f64>();
    for f in 12..25 {
        let (_, centre, _, angle) = pressure(&made, f);
        let [x, y] = place(f);
        // a quarter of a period is five frames
        assert!(((squares(f) + squares(f + 5)).sqrt() / roll_m - 1.0).abs() < 1e-9, "{f}");
        assert!((centre[0] - x).hypot(centre[1] - y) < 1e-4, "{f}: {centre:?} {x} {y}");
        assert!((x * angle.cos() + y * angle.sin()).abs() < 0.03 * roll_m, "{f}: along the axis");
        // the mean of two angles half a period apart is that of all
        let angles = [f, f + 5, f + 10, f + 15].map(|f| pressure(&made, f).3);
        let apart = |a: f64, b: f64| (a - b).sin().asin();
        let off = [apart(angles[0], angles[2]), apart(angles[1], angles[3])];
        assert!((0.5 * off[0].hypot(off[1]) / turn - 1.0).abs() < 0.06, "{f}: {angles:?}");
    }
}

/// The whole change, with its ring, is limited.
#[test]
fn a_response_saturates() {
    let change = |saturation: Option<f64>| {
        logarithms(&simulate(13, |s| (s.piezo.ring, s.piezo.saturation) = (0.5, saturation)), 12)
    };
    let plain = change(None);
    for most in [0.02, 0.2] {
        let limited = change(Some(most));
        let wanted = plain.iter().map(|c| c / (1.0 + c.abs() / most));
        let exact = limited.iter().zip(wanted).filter(|(c, wanted)| (*c - wanted).abs() < 1e-12);
        // those that the contact's edge cuts are means of limited values
        assert!(limited.len() - exact.count() < 30 && limited.iter().all(|c| c.abs() < most));
        assert!(limited.iter().any(|c| *c > 0.3 * most) && limited.iter().any(|c| *c < 0.0));
    }
}

/// Frames are torn, and values spiked, as often as set; all else is as without.
#[test]
fn frames_tear_and_spike() {
    let with = |torn, spiked| {
        measure(400, |s| {
            s.instrument.noise_v = [1e-6; 2];
            (s.instrument.torn, s.instrument.spiked) = (torn, spiked);
        })
    };
    let (plain, torn, spiked) = (with(0.0, 0.0), with(0.25, 0.0), with(0.0, 0.25));
    let largest_v = largest(&plain.reference_v);
    let mut counts = [0; 2];
    for f in 0..400 {
        let of = |made: &Simulation, quality| {
            let is = |k: &usize| made.truth.quality[[f, *k]] == quality;
            (0..208).filter(is).collect::<Vec<_>>()
        };
        let (rest, spikes) = (of(&torn, TrueQuality::Torn), of(&spiked, TrueQuality::Spiked));
        let from = 208 - rest.len();
        assert!(from > 0 && rest.iter().all(|k| *k >= from), "{f}: {rest:?}");
        assert!((0..from).all(|k| torn.frames_v[[f, k]] == plain.frames_v[[f, k]]));
        assert!((from..208).all(|k| torn.frames_v[[f, k]] == torn.frames_v[[f - 1, k]]));
        assert!(spikes.len() <= 1, "{f}: {spikes:?}");
        for k in 0..208 {
            let off_v = (spiked.frames_v[[f, k]] - plain.frames_v[[f, k]]).abs();
            assert!(off_v <= largest_v && (off_v > 0.0) == spikes.contains(&k), "{f} {k}: {off_v}");
        }
        counts[0] += usize::from(from < 208);
        counts[1] += spikes.len();
    }
    // four standard deviations of 400 draws of a quarter
    assert!(counts.iter().all(|count| (65..=135).contains(count)), "{counts:?}");
}

/// The values of each drive are those of a faster recording at the drive's own time.
#[test]
fn each_drive_has_its_own_time() {
    /// Frames of the faster recording per frame.
    const FINE: usize = 32;
    let protocol = paper_protocol();
    // 50 mm/s, 5 mm from frame to frame
    let keys = [(0.5, -0.04, 0.0), (0.6, -0.04, 1.0), (1.6, 0.01, 1.0)];
    let keys = keys.map(|(time_s, x, force_n)| key(time_s, [x, 0.02], force_n)).to_vec();
    let slow = of_keys(12, keys);
    let frame_rate_hz = FINE as f64 * slow.frame_rate_hz;
    let fast = TouchScript { frame_rate_hz, frames: 12 * FINE, ..slow.clone() };
    let linear = FabricSettings::linear(0.3).linear;
    // linear between instants 1.25 mm apart; on the fabric, elements of 6 mm under a print of 7 mm let the voltages jump
    for (linear, allowed) in [(linear, 0.003), (None, 0.03)] {
        let scanned = |script: &TouchScript, scan_share: f64| {
            simulate_script(&MESH, &protocol, script, 8, |s| {
                (s.instrument.scan_share, s.linear) = (scan_share, linear);
            })
        };
        let (fine, made) = (scanned(&fast, 0.0), scanned(&slow, 1.0));
        assert_eq!(made.frames_v.row(3), fine.frames_v.row(3), "nothing moves");
        for f in 8..11 {
            let touch = made.truth.touches.iter().find(|t| t.frame == f).unwrap();
            assert!((touch.position_m[0] - (0.005 * f as f64 - 0.07)).abs() < 1e-12);
            // squares: off the drive's own instant, off the frame's, and the signal
            let mut sums = [0.0; 3];
            for (k, [drive, _]) in protocol.data().iter().enumerate() {
                let (v, place) = (made.exact_v[[f, k]], FINE * f);
                let own = fine.exact_v[[place + 2 * *drive as usize - 15, k]];
                let wanted = [own, fine.exact_v[[place, k]], made.reference_v[k]];
                sums.iter_mut().zip(wanted).for_each(|(sum, wanted)| *sum += (v - wanted).powi(2));
            }
            let [off, late] = [sums[0], sums[1]].map(|sum| (sum / sums[2]).sqrt());
            println!("frame {f}: off by {off:.4} of the signal, by {late:.3} all at once");
            assert!(off < allowed && late > 0.03, "{f}: {off} {late}");
        }
    }
}
