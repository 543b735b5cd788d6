//! Detection of failed electrodes from voltages alone.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test file: a panic is a failed test"
)]

use crate::voltages::{Bench, DT_S, ELECTRODES, MEASUREMENTS, NOISE_V};
use eit_skin::SkinError;
use eit_skin::eit_fem::PairProtocol;
use eit_skin::eit_fem::fabric::Random;
use eit_skin::faults::{ElectrodeFault, FaultKind, FaultMonitor};

/// Number of frames within which a failed electrode must be named.
const IN_TIME: usize = 5;

/// Frames after its last bad one at which it is used again: a second.
const HEALING: usize = 20;

/// Inputs of an open electrode float: a tenth of the largest voltage.
fn floating(random: &mut Random, _: f64) -> f64 {
    0.025 * random.normal()
}

#[test]
fn touches_are_no_fault() {
    let mut bench = Bench::new(1);
    for _ in 0..200 {
        bench.push_healthy(1);
        assert_eq!(bench.faults(), []);
        bench.check_missing(&[]);
    }
}

#[test]
fn every_open_electrode_is_named_at_once() {
    for electrode in 0..ELECTRODES {
        let mut bench = Bench::new(electrode as u64);
        bench.push_healthy(10);
        let lost = bench.of(electrode);
        bench.push(&lost, floating);
        assert_eq!(bench.faults(), [(electrode, FaultKind::Contradicts)]);
        bench.check_missing(&lost);
        let fault = bench.monitor.faults()[0];
        assert!((fault.since_s - 10.0 * DT_S).abs() < 1e-12);
        let words = fault.description();
        assert!(words.contains(&format!("electrode {} ", electrode + 1)), "{words}");
        assert_eq!(serde_json::json!(fault.json())["electrode"], electrode + 1);
    }
}

/// All in the first frame, because with one overlooked the touches of that frame are noise; by chance
/// floating values fit in one draw of twenty.
#[test]
fn four_open_electrodes_are_named() {
    let broken = [2, 5, 8, 11];
    let mut at_once = 0;
    for seed in 0..20 {
        let mut bench = Bench::new(seed);
        bench.push_healthy(10);
        let lost: Vec<usize> = broken.iter().flat_map(|&e| bench.of(e)).collect();
        let wanted = broken.map(|e| (e, FaultKind::Contradicts));
        bench.push(&lost, floating);
        at_once += usize::from(bench.faults() == wanted);
        bench.push(&lost, floating);
        assert_eq!(bench.faults(), wanted, "{seed}");
    }
    assert!(at_once >= 18, "{at_once}");
}

/// An electrode without any voltage: its measurements and their reciprocals are both zero.
#[test]
fn a_dead_electrode_is_named() {
    let mut bench = Bench::new(22);
    bench.push_healthy(10);
    let lost = bench.of(7);
    bench.push(&lost, |random, _| NOISE_V * random.normal());
    assert_eq!(bench.faults(), [(7, FaultKind::Contradicts)]);
}

/// A fault that lasts as long as the reference is listed with detected ones, and never heals.
#[test]
fn a_lasting_fault_stays() {
    let lost = Bench::new(31).of(9);
    let mut used = [true; MEASUREMENTS];
    lost.iter().for_each(|&i| used[i] = false);
    let mut bench = Bench::with(31, &used, &[NOISE_V; MEASUREMENTS]);
    let fault = ElectrodeFault { electrode: 9, kind: FaultKind::Contradicts, since_s: 0.0 };
    bench.monitor = bench.monitor.with_lasting(&[fault]).unwrap();
    bench.push_healthy(2 * HEALING);
    assert_eq!(bench.faults(), [(9, FaultKind::Contradicts)]);
    bench.check_missing(&[]);
}

/// One channel that violates reciprocity is excluded with its reciprocal; no electrode is blamed.
#[test]
fn a_bad_channel_is_no_bad_electrode() {
    let mut bench = Bench::new(23);
    bench.push_healthy(10);
    bench.push(&[40], |_, v| v + 0.1);
    assert_eq!(bench.faults(), []);
    let mut pair = [40, bench.monitor.reciprocal()[40]];
    pair.sort_unstable();
    bench.check_missing(&pair);
}

#[test]
fn a_stuck_electrode_is_named() {
    let mut bench = Bench::new(24);
    let lost = bench.of(5);
    // without a touch: under one it would violate reciprocity first
    let quiet = |bench: &mut Bench| -> Vec<f64> {
        let Bench { reference, random, .. } = bench;
        reference.iter().map(|v| v + NOISE_V * random.normal()).collect()
    };
    let held = quiet(&mut bench);
    for frame in 1..=IN_TIME {
        assert_eq!(bench.faults(), [], "{frame}");
        let mut values = quiet(&mut bench);
        lost.iter().for_each(|&i| values[i] = held[i]);
        bench.push_frame(&values, |_| true);
    }
    assert_eq!(bench.faults(), [(5, FaultKind::Stuck)]);
    bench.check_missing(&lost);
    // it moves again
    for _ in 0..HEALING {
        let values = quiet(&mut bench);
        bench.push_frame(&values, |_| true);
    }
    assert_eq!(bench.faults(), []);
}

/// A coarse converter repeats every value of a quiet skin: nothing is stuck.
#[test]
fn a_still_skin_is_not_stuck() {
    let mut bench = Bench::new(25);
    let frame = bench.reference.clone();
    (0..20).for_each(|_| bench.push_frame(&frame, |_| true));
    assert_eq!(bench.faults(), []);
}

/// Two consecutive frames must blame the same electrode; a gain that has stopped drifting is used again.
#[test]
fn a_drifting_electrode_is_blamed_and_comes_back() {
    let mut bench = Bench::new(26);
    let of_7 = bench.of(7);
    let push = |bench: &mut Bench, gain: f64, blamed: Option<usize>| {
        let mut frame = bench.reference.clone();
        of_7.iter().for_each(|&i| frame[i] *= gain);
        bench.monitor.push(&frame, &bench.reference, |_| true, bench.time_s).unwrap();
        bench.monitor.blame(blamed, bench.time_s).unwrap();
        bench.time_s += DT_S;
    };
    for blamed in [Some(7), None, Some(7), Some(3), Some(7)] {
        push(&mut bench, 1.0, blamed);
        assert_eq!(bench.faults(), [], "{blamed:?}");
    }
    push(&mut bench, 1.0, Some(7));
    assert_eq!(bench.faults(), [(7, FaultKind::Drifts)]);
    // excluded from the blaming frame too
    bench.check_missing(&bench.of(7));
    // 1 % a second for 3 s
    for k in 0..60 {
        push(&mut bench, 1.0 + 0.01 * DT_S * f64::from(k), None);
        assert_eq!(bench.faults(), [(7, FaultKind::Drifts)], "{k}");
    }
    let mut still = 0;
    while !bench.faults().is_empty() {
        push(&mut bench, 1.03, None);
        still += 1;
    }
    // the second starts when the gain has changed by 0.1 % for the last time: two frames of drift
    assert!((HEALING - 2..=HEALING + 2).contains(&still), "{still}");
    assert_eq!(bench.monitor.healed(), bench.of(7));
}

#[test]
fn a_flagged_electrode_is_named_and_flags_alone_are_none() {
    let mut bench = Bench::new(27);
    let lost = bench.of(3);
    for _ in 0..IN_TIME {
        assert_eq!(bench.faults(), []);
        let frame = bench.frame();
        bench.push_frame(&frame, |i| !lost.contains(&i));
        bench.check_missing(&lost);
    }
    assert_eq!(bench.faults(), [(3, FaultKind::Flagged)]);
    for _ in 0..HEALING {
        assert_eq!(bench.faults(), [(3, FaultKind::Flagged)]);
        bench.push_healthy(1);
    }
    assert_eq!(bench.faults(), []);
    // half of them, and values that are not numbers: excluded, but no electrode is blamed
    let half: Vec<usize> = lost.iter().copied().step_by(2).collect();
    let mut frame = bench.frame();
    half.iter().for_each(|&i| frame[i] = f64::NAN);
    bench.push_frame(&frame, |_| true);
    assert_eq!(bench.faults(), []);
    bench.check_missing(&half);
}

const NOTHING: [(usize, FaultKind); 0] = [];

/// Frames without a good value: NaN, or flagged.
fn push_dropped(bench: &mut Bench, is_nan: bool) {
    let frame = if is_nan { vec![f64::NAN; MEASUREMENTS] } else { bench.frame() };
    bench.push_frame(&frame, |_| is_nan);
}

/// A random value for each measurement, unrelated to it.
fn push_garbage(bench: &mut Bench) {
    bench.push(&ALL, |random, _| 0.1 * random.normal());
}

const ALL: [usize; MEASUREMENTS] = {
    let mut all = [0; MEASUREMENTS];
    let mut i = 0;
    while i < MEASUREMENTS {
        all[i] = i;
        i += 1;
    }
    all
};

#[test]
fn dropped_frames_blame_nobody() {
    for is_nan in [true, false] {
        let mut bench = Bench::new(33);
        bench.push_healthy(10);
        for _ in 0..50 {
            push_dropped(&mut bench, is_nan);
            assert_eq!(bench.faults(), NOTHING);
            assert!(bench.monitor.is_bad());
            bench.check_missing(&ALL);
        }
        bench.push_healthy(1);
        assert_eq!(bench.faults(), NOTHING);
        assert!(!bench.monitor.is_bad());
        bench.check_missing(&[]);
    }
}

#[test]
fn a_garbage_frame_blames_nobody_but_five_do() {
    for seed in 0..20 {
        let mut bench = Bench::new(seed);
        bench.push_healthy(10);
        for _ in 0..IN_TIME - 1 {
            push_garbage(&mut bench);
            assert_eq!(bench.faults(), NOTHING, "{seed}");
            bench.check_missing(&ALL);
        }
        bench.push_healthy(1);
        bench.check_missing(&[]);
        for _ in 0..IN_TIME {
            assert_eq!(bench.faults(), NOTHING, "{seed}");
            push_garbage(&mut bench);
        }
        assert!(bench.faults().len() >= 6, "{seed}: {:?}", bench.faults());
        // and all of them recover
        bench.push_healthy(HEALING + 1);
        assert_eq!(bench.faults(), NOTHING, "{seed}");
        bench.check_missing(&[]);
    }
}

/// Garbage of any size, and a packet that lost its first value: all others are one place too early.
#[test]
fn damaged_packets_blame_nobody() {
    for seed in 0..20 {
        for size_v in [1e-3, 0.03, 0.3, 10.0] {
            let mut bench = Bench::new(seed);
            bench.push_healthy(10);
            bench.push(&ALL, |random, _| size_v * random.normal());
            assert_eq!(bench.faults(), NOTHING, "{seed}, {size_v} V");
        }
        let mut bench = Bench::new(seed);
        bench.push_healthy(10);
        let mut frame = bench.frame();
        frame.rotate_left(1);
        bench.push_frame(&frame, |_| true);
        assert_eq!(bench.faults(), NOTHING, "{seed}");
        bench.check_missing(&ALL);
        bench.push_healthy(1);
        bench.check_missing(&[]);
    }
}

/// An open electrode stays excluded while frames are dropped, and other faults are found meanwhile.
#[test]
fn bad_frames_neither_heal_nor_hide_a_fault() {
    let drops: [fn(&mut Bench); 2] = [|bench| push_dropped(bench, true), push_garbage];
    for drop in drops {
        let mut bench = Bench::new(34);
        bench.push_healthy(10);
        let lost = bench.of(5);
        bench.push(&lost, floating);
        for _ in 0..3 {
            // longer than healing takes, with fewer consecutive frames than blame everything
            bench.push_healthy(3);
            (0..4).for_each(|_| drop(&mut bench));
            assert_eq!(bench.faults(), [(5, FaultKind::Contradicts)]);
        }
        (0..HEALING).for_each(|_| push_dropped(&mut bench, true));
        bench.push_healthy(HEALING - 9);
        assert_eq!(bench.faults(), [(5, FaultKind::Contradicts)]);
        bench.push_healthy(2);
        assert_eq!(bench.faults(), NOTHING);
        // flags in every second complete frame
        let flagged = bench.of(3);
        for _ in 0..IN_TIME {
            assert_eq!(bench.faults(), NOTHING);
            drop(&mut bench);
            let frame = bench.frame();
            bench.push_frame(&frame, |i| !flagged.contains(&i));
        }
        assert_eq!(bench.faults(), [(3, FaultKind::Flagged)]);
    }
}

/// A second of good frames without interruption; the measurements that recover are listed once.
#[test]
fn an_open_electrode_heals() {
    let mut bench = Bench::new(28);
    let lost = bench.of(5);
    bench.push(&lost, floating);
    bench.push_healthy(HEALING - 2);
    // a loose contact: opening once more restarts the second
    bench.push(&lost, floating);
    for frame in 1..=HEALING {
        assert_eq!(bench.faults(), [(5, FaultKind::Contradicts)], "{frame}");
        assert!(bench.monitor.healed().is_empty());
        bench.push_healthy(1);
    }
    assert_eq!(bench.faults(), []);
    assert_eq!(bench.monitor.healed(), lost);
    bench.check_missing(&[]);
    bench.push_healthy(1);
    assert!(bench.monitor.healed().is_empty());
}

/// Measurements that do not count blame no electrode and are never missing.
#[test]
fn unused_measurements_do_not_count() {
    let of_5 = Bench::new(29).of(5);
    let mut used = [true; MEASUREMENTS];
    of_5.iter().for_each(|&i| used[i] = false);
    let mut bench = Bench::with(29, &used, &[NOISE_V; MEASUREMENTS]);
    for _ in 0..10 {
        bench.push(&of_5, |_, _| f64::NAN);
        assert_eq!(bench.faults(), []);
        bench.check_missing(&[]);
    }
}

#[test]
fn push_allocates_nothing() {
    let mut bench = Bench::new(30);
    let lost = bench.of(5);
    let mut cycle = |counts: bool| {
        for frame in 0..60 {
            let mut values = bench.frame();
            if frame < 20 {
                lost.iter().for_each(|&i| values[i] = bench.random.normal());
            }
            let info = allocation_counter::measure(|| bench.push_frame(&values, |_| true));
            assert!(!counts || info.count_total == 0, "{frame}: {info:?}");
        }
    };
    cycle(false);
    cycle(true);
}

/// After a rejected call the monitor continues as if it had not been made.
#[test]
fn wrong_lengths_and_electrodes_are_refused() {
    let protocol = PairProtocol::default().protocol().unwrap();
    let (used, std_v) = ([true; MEASUREMENTS + 1], [NOISE_V; MEASUREMENTS + 1]);
    let all = MEASUREMENTS;
    for (u, s) in [(all - 1, all), (all + 1, all), (all, 0), (all, all + 1)] {
        let refused = FaultMonitor::new(&protocol, &used[..u], &std_v[..s], 0.0).unwrap_err();
        let wrong = if u == all { s } else { u };
        assert!(
            matches!(refused, SkinError::MeasurementCount { found, measurements: MEASUREMENTS, .. }
                if found == wrong),
            "{refused}"
        );
    }
    let monitor = FaultMonitor::new(&protocol, &used[..all], &std_v[..all], 0.0).unwrap();
    for width in [0, all - 1, all + 1] {
        let quiet_v = eit_skin::ndarray::Array2::zeros((10, width));
        let refused = monitor.clone().with_quiet_frames(quiet_v.view());
        assert!(
            matches!(refused, Err(SkinError::MeasurementCount { found, .. }) if found == width)
        );
    }
    for step_v in [-1.0, f64::NAN, f64::INFINITY] {
        let refused = FaultMonitor::new(&protocol, &used[..all], &std_v[..all], step_v);
        assert!(matches!(refused, Err(SkinError::OutOfRange { key: "step_v", .. })));
    }

    let mut bench = Bench::new(32);
    bench.push_healthy(10);
    let lost = bench.of(5);
    bench.push(&lost, floating);
    let (before, missing) = (bench.faults(), (0..all).map(|i| bench.monitor.is_missing(i)));
    let missing: Vec<bool> = missing.collect();
    let frame = bench.frame();
    let (monitor, reference) = (&mut bench.monitor, &bench.reference);
    let is_count = |answer: Result<(), SkinError>| {
        assert!(matches!(answer, Err(SkinError::MeasurementCount { .. })), "{answer:?}");
    };
    is_count(monitor.push(&frame[1..], reference, |_| true, 1.0));
    is_count(monitor.push(&[], reference, |_| true, 1.0));
    is_count(monitor.push(&frame, &reference[1..], |_| true, 1.0));
    for answer in
        [monitor.push(&frame, reference, |_| true, f64::NAN), monitor.blame(Some(3), f64::INFINITY)]
    {
        assert!(matches!(answer, Err(SkinError::OutOfRange { key: "time_s", .. })), "{answer:?}");
    }
    let refused = monitor.blame(Some(ELECTRODES), 1.0).unwrap_err();
    assert_eq!(refused.to_string(), "electrode 16, counted from 0, of a skin with 16 electrodes");
    assert_eq!(bench.faults(), before);
    assert!((0..all).all(|i| bench.monitor.is_missing(i) == missing[i]));
    assert!(bench.monitor.is_missing(all));
    let fault = ElectrodeFault { electrode: 99, kind: FaultKind::Stuck, since_s: 0.0 };
    let refused = bench.monitor.with_lasting(&[fault]);
    assert!(matches!(
        refused,
        Err(SkinError::NoSuchElectrode { electrode: 99, electrodes: ELECTRODES })
    ));
}

/// Equal frames are an old one sent again only where those of the untouched skin are hardly ever equal: a coarse converter
/// repeats them by itself.
#[test]
fn repeated_frames_are_frozen_unless_quiet_ones_repeat() {
    let protocol = PairProtocol::default().protocol().unwrap();
    let (used, std_v) = ([true; MEASUREMENTS], [NOISE_V; MEASUREMENTS]);
    let quiet_v = |repeated: usize| {
        let value = |(f, i): (usize, usize)| 1.0 + (f.max(repeated) * 7 + i) as f64 * NOISE_V;
        eit_skin::ndarray::Array2::from_shape_fn((20, MEASUREMENTS), value)
    };
    for (repeated, rows, wanted) in
        [(0, 20, Some(9)), (1, 20, Some(18)), (2, 20, None), (0, 15, None)]
    {
        let quiet_v = quiet_v(repeated);
        let quiet_v = quiet_v.slice_axis(eit_skin::ndarray::Axis(0), (..rows).into());
        let monitor = FaultMonitor::new(&protocol, &used, &std_v, 0.0).unwrap();
        let mut monitor = monitor.with_quiet_frames(quiet_v).unwrap();
        let reference = quiet_v.row(0).to_vec();
        let frozen = (0..40).find(|k| {
            monitor.push(&reference, &reference, |_| true, 0.05 * f64::from(*k)).unwrap();
            monitor.is_frozen()
        });
        assert_eq!(frozen, wanted, "{repeated} {rows}");
        // another frame says something again
        let other: Vec<f64> = reference.iter().map(|v| v + NOISE_V).collect();
        monitor.push(&other, &reference, |_| true, 3.0).unwrap();
        assert!(!monitor.is_frozen() && !monitor.is_bad());
    }
}
