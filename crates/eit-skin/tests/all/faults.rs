//! Detection of failed electrodes from voltages alone.

use crate::voltages::{Bench, DT_S, ELECTRODES, MEASUREMENTS, NOISE_V};
use eit_skin::SkinError;
use eit_skin::eit_fem::PairProtocol;
use eit_skin::eit_fem::fabric::Random;
use eit_skin::faults::{ElectrodeFault, FaultKind, FaultMonitor};
use eit_skin::ndarray::Array2;
use std::array::from_fn;

/// Number of frames within which a failed electrode must be named.
const IN_TIME: usize = 5;

/// Frames after its last bad one at which it is used again: a second.
const HEALING: usize = 20;

const NOTHING: [(usize, FaultKind); 0] = [];

/// Inputs of an open electrode float: a tenth of the largest voltage.
fn floating(random: &mut Random, _: f64) -> f64 {
    0.025 * random.normal()
}

fn all() -> [usize; MEASUREMENTS] {
    from_fn(|i| i)
}

/// Frames without a good value: NaN, or flagged.
fn push_dropped(bench: &mut Bench, is_nan: bool) {
    let frame = if is_nan { vec![f64::NAN; MEASUREMENTS] } else { bench.frame() };
    bench.push_frame(&frame, |_| is_nan);
}

/// A random value for each measurement, unrelated to it.
fn push_garbage(bench: &mut Bench, size_v: f64) {
    bench.push(&all(), |random, _| size_v * random.normal());
}

/// Touches are no fault; an electrode that opens, or has no voltage any more, is named at once.
#[test]
fn every_open_electrode_is_named_at_once() {
    let none = |random: &mut Random, _| NOISE_V * random.normal();
    let values: [fn(&mut Random, f64) -> f64; 2] = [floating, none];
    for (electrode, value) in (0..ELECTRODES).flat_map(|e| values.map(|value| (e, value))) {
        let mut bench = Bench::new(electrode as u64);
        for _ in 0..10 {
            bench.push_healthy(1);
            bench.check(&[], &[]);
        }
        let lost = bench.of(electrode);
        bench.push(&lost, value);
        bench.check(&[(electrode, FaultKind::Contradicts)], &lost);
        let fault = bench.monitor.faults()[0];
        assert!((fault.since_s - 10.0 * DT_S).abs() < 1e-12);
        let words = fault.description();
        assert!(words.contains(&format!("electrode {} ", electrode + 1)), "{words}");
        assert_eq!(serde_json::json!(fault.json())["electrode"], electrode + 1);
    }
}

/// In the first frame, as one overlooked turns its touches into noise; by chance floating values fit in one of twenty.
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

/// A fault that lasts as long as the reference never heals; measurements that do not count are never missing.
#[test]
fn a_lasting_fault_stays() {
    let lost = Bench::new(31).of(9);
    let used: [bool; MEASUREMENTS] = from_fn(|i| !lost.contains(&i));
    let mut bench = Bench::with(31, &used);
    for _ in 0..10 {
        bench.push(&lost, |_, _| f64::NAN);
        bench.check(&[], &[]);
    }
    let fault = ElectrodeFault { electrode: 9, kind: FaultKind::Contradicts, since_s: 0.0 };
    bench.monitor = bench.monitor.with_lasting(&[fault]).unwrap();
    bench.push_healthy(2 * HEALING);
    bench.check(&[(9, FaultKind::Contradicts)], &[]);
}

/// One channel that violates reciprocity is excluded with its reciprocal; no electrode is blamed.
#[test]
fn a_bad_channel_is_no_bad_electrode() {
    let mut bench = Bench::new(23);
    bench.push_healthy(10);
    bench.push(&[40], |_, v| v + 0.1);
    let mut pair = [40, bench.monitor.reciprocal()[40]];
    pair.sort_unstable();
    bench.check(&[], &pair);
}

/// Where all repeat, because a coarse converter hides the noise of a quiet skin, nothing is stuck.
#[test]
fn a_stuck_electrode_is_named() {
    let mut bench = Bench::new(25);
    let frame = bench.reference.clone();
    (0..20).for_each(|_| bench.push_frame(&frame, |_| true));
    assert_eq!(bench.faults(), NOTHING);

    let mut bench = Bench::new(24);
    let lost = bench.of(5);
    // without a touch: under one it would violate reciprocity first
    let held = bench.untouched();
    for frame in 1..=IN_TIME {
        assert_eq!(bench.faults(), NOTHING, "{frame}");
        let mut values = bench.untouched();
        lost.iter().for_each(|&i| values[i] = held[i]);
        bench.push_frame(&values, |_| true);
    }
    bench.check(&[(5, FaultKind::Stuck)], &lost);
    // it moves again
    for _ in 0..HEALING {
        let values = bench.untouched();
        bench.push_frame(&values, |_| true);
    }
    assert_eq!(bench.faults(), NOTHING);
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
        assert_eq!(bench.faults(), NOTHING, "{blamed:?}");
    }
    push(&mut bench, 1.0, Some(7));
    // excluded from the blaming frame too
    bench.check(&[(7, FaultKind::Drifts)], &of_7);
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
    assert_eq!(bench.monitor.healed(), of_7);
}

#[test]
fn a_flagged_electrode_is_named_and_flags_alone_are_none() {
    let mut bench = Bench::new(27);
    let lost = bench.of(3);
    for _ in 0..IN_TIME {
        assert_eq!(bench.faults(), NOTHING);
        bench.push_flagged(&lost);
        bench.check_missing(&lost);
    }
    for _ in 0..HEALING {
        assert_eq!(bench.faults(), [(3, FaultKind::Flagged)]);
        bench.push_healthy(1);
    }
    assert_eq!(bench.faults(), NOTHING);
    // half of them, and values that are not numbers: excluded, but no electrode is blamed
    let half: Vec<usize> = lost.iter().copied().step_by(2).collect();
    bench.push(&half, |_, _| f64::NAN);
    bench.check(&[], &half);
}

#[test]
fn dropped_frames_blame_nobody() {
    for is_nan in [true, false] {
        let mut bench = Bench::new(33);
        bench.push_healthy(10);
        for _ in 0..50 {
            push_dropped(&mut bench, is_nan);
            bench.check(&[], &all());
            assert!(bench.monitor.is_bad());
        }
        bench.push_healthy(1);
        bench.check(&[], &[]);
        assert!(!bench.monitor.is_bad());
    }
}

/// Garbage of any size, and a packet that lost its first value, blame nobody in four frames; five do, and all recover.
#[test]
fn damaged_packets_blame_nobody_but_five_do() {
    for seed in 0..20 {
        for size_v in [1e-3, 0.03, 0.3, 10.0] {
            let mut bench = Bench::new(seed);
            bench.push_healthy(10);
            push_garbage(&mut bench, size_v);
            assert_eq!(bench.faults(), NOTHING, "{seed}, {size_v} V");
        }
        let mut bench = Bench::new(seed);
        bench.push_healthy(10);
        let mut frame = bench.frame();
        frame.rotate_left(1);
        bench.push_frame(&frame, |_| true);
        bench.check(&[], &all());
        for _ in 0..IN_TIME - 2 {
            push_garbage(&mut bench, 0.1);
            bench.check(&[], &all());
        }
        bench.push_healthy(1);
        bench.check_missing(&[]);
        for _ in 0..IN_TIME {
            assert_eq!(bench.faults(), NOTHING, "{seed}");
            push_garbage(&mut bench, 0.1);
        }
        assert!(bench.faults().len() >= 6, "{seed}: {:?}", bench.faults());
        bench.push_healthy(HEALING + 1);
        bench.check(&[], &[]);
    }
}

/// An open electrode stays excluded while frames are dropped, and other faults are found meanwhile.
#[test]
fn bad_frames_neither_heal_nor_hide_a_fault() {
    let drops: [fn(&mut Bench); 2] =
        [|bench| push_dropped(bench, true), |bench| push_garbage(bench, 0.1)];
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
            bench.push_flagged(&flagged);
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
    bench.check(&[], &[]);
    assert_eq!(bench.monitor.healed(), lost);
    bench.push_healthy(1);
    assert!(bench.monitor.healed().is_empty());
}

#[test]
fn push_allocates_nothing() {
    let mut bench = Bench::new(30);
    let lost = bench.of(5);
    // in the first 60, and never again
    for frame in 0..120 {
        let mut values = bench.frame();
        if frame % 60 < 20 {
            lost.iter().for_each(|&i| values[i] = bench.random.normal());
        }
        let info = allocation_counter::measure(|| bench.push_frame(&values, |_| true));
        assert!(frame < 60 || info.count_total == 0, "{frame}: {info:?}");
    }
}

/// Checks that a number of measurements is refused as wrong.
fn check_count<T>(refused: Result<T, SkinError>, wrong: usize) {
    let error = refused.err().unwrap();
    let SkinError::MeasurementCount { found, measurements, .. } = error else { panic!("{error}") };
    assert_eq!((found, measurements), (wrong, MEASUREMENTS));
}

/// Checks that a setting is refused as out of range.
fn check_range<T>(refused: Result<T, SkinError>, wrong: &str) {
    let refused = refused.err().unwrap();
    assert!(matches!(refused, SkinError::OutOfRange { key, .. } if key == wrong), "{refused}");
}

/// After a rejected call the monitor continues as if it had not been made.
#[test]
fn wrong_lengths_and_electrodes_are_refused() {
    const ALL: usize = MEASUREMENTS;
    let protocol = PairProtocol::default().protocol().unwrap();
    let new = |used: usize, std_v: usize, step_v: f64| {
        FaultMonitor::new(&protocol, &vec![true; used], &vec![NOISE_V; std_v], step_v)
    };
    for (used, std_v) in [(ALL - 1, ALL), (ALL + 1, ALL), (ALL, 0), (ALL, ALL + 1)] {
        check_count(new(used, std_v, 0.0), if used == ALL { std_v } else { used });
    }
    for width in [0, ALL - 1, ALL + 1] {
        let quiet_v = Array2::zeros((10, width));
        check_count(new(ALL, ALL, 0.0).unwrap().with_quiet_frames(quiet_v.view()), width);
    }
    for step_v in [-1.0, f64::NAN, f64::INFINITY] {
        check_range(new(ALL, ALL, step_v), "step_v");
    }

    let mut bench = Bench::new(32);
    bench.push_healthy(10);
    let lost = bench.of(5);
    bench.push(&lost, floating);
    let frame = bench.frame();
    let (monitor, reference) = (&mut bench.monitor, &bench.reference[..]);
    for (frame, reference, wrong) in
        [(&frame[1..], reference, ALL - 1), (&[], reference, 0), (&frame, &reference[1..], ALL - 1)]
    {
        check_count(monitor.push(frame, reference, |_| true, 1.0), wrong);
    }
    check_range(monitor.push(&frame, reference, |_| true, f64::NAN), "time_s");
    check_range(monitor.blame(Some(3), f64::INFINITY), "time_s");
    let refused = monitor.blame(Some(ELECTRODES), 1.0).unwrap_err();
    assert_eq!(refused.to_string(), "electrode 16, counted from 0, of a skin with 16 electrodes");
    bench.check(&[(5, FaultKind::Contradicts)], &lost);
    assert!(bench.monitor.is_missing(ALL));
    let fault = ElectrodeFault { electrode: 99, kind: FaultKind::Stuck, since_s: 0.0 };
    let refused = bench.monitor.with_lasting(&[fault]);
    assert!(matches!(refused, Err(SkinError::NoSuchElectrode { electrode: 99, electrodes: 16 })));
}

/// Equal frames are frozen unless quiet ones repeat too, by a coarse converter; after one of those in twice the time.
#[test]
fn repeated_frames_are_frozen_unless_quiet_ones_repeat() {
    let protocol = PairProtocol::default().protocol().unwrap();
    let (used, std_v) = ([true; MEASUREMENTS], [NOISE_V; MEASUREMENTS]);
    let monitor = FaultMonitor::new(&protocol, &used, &std_v, 0.0).unwrap();
    for (repeated, rows, wanted) in
        [(0, 20, Some(9)), (1, 20, Some(18)), (2, 20, None), (0, 15, None)]
    {
        let value = |(f, i): (usize, usize)| 1.0 + (f.max(repeated) * 7 + i) as f64 * NOISE_V;
        let quiet_v = Array2::from_shape_fn((rows, MEASUREMENTS), value);
        let mut monitor = monitor.clone().with_quiet_frames(quiet_v.view()).unwrap();
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
