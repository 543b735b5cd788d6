//! Detection of failing electrodes without a model: the first frames of a stream are the reference.

use crate::voltages::{Bench, DT_S, ELECTRODES, MEASUREMENTS};
use eit_skin::eit_fem::{DrivenElectrodes, Order, PairProtocol};
use eit_skin::eit_hw::{self, Component};
use eit_skin::faults::{FaultKind, StreamMonitor};

/// First frames.
const REFERENCE: usize = 20;
/// Number of frames within which a failed electrode must be named.
const IN_TIME: usize = 5;

/// A stream of touched frames.
struct Stream {
    bench: Bench,
    monitor: StreamMonitor,
    frame: usize,
}

type Change = fn(&mut Bench, &mut [f64]);

impl Stream {
    fn new(seed: u64) -> Self {
        let bench = Bench::new(seed);
        let monitor = StreamMonitor::new(&bench.quadruples, ELECTRODES, REFERENCE).unwrap();
        Self { bench, monitor, frame: 0 }
    }

    /// Behind the reference this allocates nothing.
    fn push(&mut self, frames: usize, change: Change) {
        for _ in 0..frames {
            let mut values = self.bench.frame();
            change(&mut self.bench, &mut values);
            let time_s = self.frame as f64 * DT_S;
            let push = || self.monitor.push(&values, |_| true, time_s).unwrap();
            let info = allocation_counter::measure(push);
            assert!(self.frame < REFERENCE || info.count_total == 0, "{}: {info:?}", self.frame);
            self.frame += 1;
        }
    }

    fn faults(&self) -> Vec<(usize, FaultKind)> {
        self.monitor.faults().iter().map(|fault| (fault.electrode, fault.kind)).collect()
    }
}

const SOUND: Change = |_, _| ();
const OPEN_5: Change = |bench, values| {
    bench.of(5).iter().for_each(|&i| values[i] = 0.025 * bench.random.normal());
};
/// A bridge from electrode 5 to 6: no voltage between them, whichever drives.
const SHORTED_5: Change = |bench, values| {
    for (value, &[a, _, m, _]) in values.iter_mut().zip(&bench.quadruples) {
        *value *= if a == 5 || m == 5 { 1e-3 } else { 1.0 };
    }
};

#[test]
fn touches_are_no_fault() {
    for seed in 0..5 {
        let mut stream = Stream::new(seed);
        for _ in 0..200 {
            stream.push(1, SOUND);
            assert_eq!(stream.faults(), [], "{seed}");
        }
    }
}

/// While running, and from the start with the last frame of the reference; all heal.
#[test]
fn electrodes_that_fail_are_named_and_come_back() {
    for (change, sound) in
        [(OPEN_5, 2 * REFERENCE), (SHORTED_5, 2 * REFERENCE), (OPEN_5, 0), (SHORTED_5, 0)]
    {
        let mut stream = Stream::new(if sound > 0 { 1 } else { 2 });
        stream.push(sound, SOUND);
        stream.push(if sound > 0 { 1 } else { REFERENCE }, change);
        let faults = stream.faults();
        assert!(faults.len() == 1 && [5, 6].contains(&faults[0].0), "{faults:?}");
        stream.push(100, change);
        assert_eq!(stream.faults(), faults);
        stream.push(25, SOUND);
        assert_eq!(stream.faults(), []);
    }
}

#[test]
fn a_stuck_electrode_is_named() {
    let mut stream = Stream::new(3);
    stream.push(2 * REFERENCE, SOUND);
    stream.push(IN_TIME, |bench, values| {
        // untouched: under a touch it would violate reciprocity first
        values.copy_from_slice(&bench.untouched());
        bench.of(5).iter().for_each(|&i| values[i] = bench.reference[i]);
    });
    assert_eq!(stream.faults(), [(5, FaultKind::Stuck)]);
}

/// Measurements in another order than stated, and frames without a value or all zero, allow no conclusion.
#[test]
fn bad_input_is_refused_or_blames_nobody() {
    let mut stream = Stream::new(4);
    stream.push(REFERENCE, |_, values| values.rotate_left(5));
    assert_eq!(stream.faults(), []);
    let quadruples = Bench::new(0).quadruples;
    assert!(StreamMonitor::new(&quadruples, ELECTRODES, 2).is_err());
    assert!(StreamMonitor::new(&quadruples, ELECTRODES - 1, REFERENCE).is_err());
    assert!(StreamMonitor::new(&[], ELECTRODES, REFERENCE).is_err());
    let mut monitor = StreamMonitor::new(&quadruples, ELECTRODES, REFERENCE).unwrap();
    assert!(monitor.push(&[0.0; MEASUREMENTS - 1], |_| true, 0.0).is_err());
    for value in [f64::NAN, 0.0] {
        monitor.restart();
        for frame in 0..2 * REFERENCE {
            monitor.push(&[value; MEASUREMENTS], |_| true, frame as f64 * DT_S).unwrap();
        }
        assert!(monitor.faults().is_empty());
    }
}

/// Real instruments: a stream without a fault blames no electrode, whatever is in the tank.
#[test]
fn real_recordings_name_nobody() {
    let options = eit_hw::ReadOptions::default();
    let ascending = PairProtocol {
        order: Order::Ascending,
        driven_electrodes: DrivenElectrodes::Keep,
        ..Default::default()
    };
    let rotated = PairProtocol { order: Order::Rotated, ..Default::default() };
    for (file, pairs) in [
        ("goe_mf2_ball/ball_200_frames.get", &rotated),
        ("iirc_rod_2006/iirc_re_101x256.npy", &ascending),
        ("sciospec_tank_adjacent", &rotated),
        ("umitooko_serial16/__3.txt", &rotated),
    ] {
        let Some(path) = fixtures::shared_data(file) else { continue };
        let protocol = pairs.protocol().unwrap();
        let quadruples = protocol.quadruples().unwrap();
        let recording = eit_hw::read_recording(&path, None, &options).unwrap();
        let count = protocol.measurements();
        let frames = recording.frames_for(Some(quadruples), count, Component::Real).unwrap();
        let first = REFERENCE.min(frames.values.nrows() / 2);
        let mut monitor = StreamMonitor::new(quadruples, ELECTRODES, first).unwrap();
        for frame in frames.frames() {
            let time_s = frame.sequence as f64 * DT_S;
            monitor.push(&frame.values, |i| frame.quality[i].is_good(), time_s).unwrap();
            assert_eq!(monitor.faults(), [], "{file}, frame {}", frame.sequence);
        }
    }
}
