//! Rows 7, 11 to 13 and 16: frames that are complete but not right. One file, because they share
//! the emulated instruments.

use eit_hw::codec::eits1::Information;
use eit_hw::driver::{Decoded, Driver, Eits1, Sciospec, SciospecSettings, Session};
use eit_hw::emulator::{Eits1Device, Emulator, FaultPlan};
use eit_hw::{Frame, Quadruple, Quality, Trouble, Unit, measure_reference_frames};

use crate::common::instruments::{LIMIT, frames, quick, start};
use crate::common::wire::{eits1_frame, sciospec_frame};
use crate::common::{point_electrode_disc, rotated};

/// What a driver decodes; frames as (real parts, qualities).
#[derive(Debug, Default)]
struct Received {
    frames: Vec<(Vec<f64>, Vec<Quality>)>,
    times_s: Vec<f64>,
    counters: Vec<u64>,
    truncated: usize,
    damaged: u64,
}

fn receive(driver: &mut dyn Driver, bytes: &[u8]) -> Received {
    let mut received = Received::default();
    driver.receive(bytes, &mut |decoded| match decoded {
        Decoded::Frame(frame) => {
            received.frames.push((frame.values.to_vec(), frame.quality.to_vec()));
            received.times_s.extend(frame.device_time_s);
            received.counters.extend(frame.counter);
        }
        Decoded::TruncatedFrame => received.truncated += 1,
        Decoded::Damaged { bytes } => received.damaged += bytes,
        _ => {}
    });
    received
}

/// Returns a driver of 32 electrodes with the drives (0, 1), (1, 2), (2, 3): six cells of 16
/// channels.
fn sciospec() -> Sciospec {
    let quadruples = [[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]];
    let settings = SciospecSettings {
        polarity: eit_hw::driver::Polarity::AsListed,
        ..SciospecSettings::for_quadruples(32, &quadruples)
    };
    Sciospec::new(settings).unwrap()
}

/// Returns a frame of these cells: drive, group.
fn cells(list: &[(u8, u8)]) -> Vec<u8> {
    list.iter()
        .flat_map(|&(drive, group)| sciospec_frame(group, [drive, drive + 1], 1, 5))
        .collect()
}

const WHOLE: [(u8, u8); 6] = [(1, 1), (1, 2), (2, 1), (2, 2), (3, 1), (3, 2)];

/// Asserts that every good value is the one sent for its drive and electrode.
fn check_cells(received: &Received) {
    for (values, quality) in &received.frames {
        for (index, (value, quality)) in values.iter().zip(quality).enumerate() {
            let (drive, electrode) = (index / 32, index % 32);
            if quality.is_good() {
                let sent = ((drive + 1) as f64 + 16.0 * (electrode % 16) as f64) / 1024.0;
                assert_eq!(*value, sent, "drive {drive}, electrode {electrode}");
            } else {
                assert!(quality.contains(Quality::MISSING) && value.is_nan());
            }
        }
    }
}

fn missing(received: &Received, frame: usize) -> usize {
    received.frames[frame].1.iter().filter(|quality| !quality.is_good()).count()
}

#[test]
fn row_07_groups_missing_doubled_reordered_and_too_many() {
    let whole = cells(&WHOLE);
    let received = receive(&mut sciospec(), &whole.repeat(3));
    check_cells(&received);
    assert_eq!((received.frames.len(), missing(&received, 1), received.truncated), (3, 0, 0));

    // each cell missing once: 16 values are flagged, and the next frame is complete
    for gone in 0..WHOLE.len() {
        let mut list = WHOLE.to_vec();
        list.remove(gone);
        let received =
            receive(&mut sciospec(), &[whole.clone(), cells(&list), whole.repeat(2)].concat());
        check_cells(&received);
        assert_eq!(received.frames.len(), 4, "{gone}: {:?}", received.truncated);
        assert_eq!(missing(&received, 1), 16, "{gone}");
        assert_eq!((missing(&received, 2), missing(&received, 3)), (0, 0), "{gone}");
    }
    // each cell doubled: it starts a frame of its own, and no value is misplaced
    for (again, &cell) in WHOLE.iter().enumerate() {
        let mut list = WHOLE.to_vec();
        list.insert(again, cell);
        let received = receive(&mut sciospec(), &[cells(&list), whole.repeat(2)].concat());
        check_cells(&received);
        assert!(received.frames.len() + received.truncated >= 3, "{again}");
        assert_eq!(missing(&received, received.frames.len() - 1), 0, "{again}");
    }
    // neighbours swapped
    for first in 0..WHOLE.len() - 1 {
        let mut list = WHOLE.to_vec();
        list.swap(first, first + 1);
        let received = receive(&mut sciospec(), &[cells(&list), whole.repeat(2)].concat());
        check_cells(&received);
        assert_eq!(missing(&received, received.frames.len() - 1), 0, "{first}");
    }
    // more groups than electrodes, drives that were not requested, another frequency row
    let mut more = Vec::new();
    for (drive, group) in WHOLE {
        more.extend(cells(&[(drive, group)]));
        if group == 2 {
            more.extend(cells(&[(drive, 3), (drive, 4)]));
        }
    }
    let received = receive(&mut sciospec(), &more.repeat(2));
    check_cells(&received);
    assert_eq!((received.frames.len(), missing(&received, 1), received.damaged), (2, 0, 0));
    let foreign = [whole.clone(), sciospec_frame(1, [9, 12], 1, 5), whole.clone()].concat();
    let received = receive(&mut sciospec(), &foreign);
    check_cells(&received);
    assert!(received.frames.len() == 2 && received.damaged > 0);
    // one frequency is set: data of another one do not belong to this frame
    let mut row = whole.clone();
    let other = sciospec_frame(2, [2, 3], 2, 5);
    let at = 3 * other.len();
    row.splice(at..at + other.len(), other.iter().copied());
    let received = receive(&mut sciospec(), &[row, whole].concat());
    check_cells(&received);
    assert_eq!((received.frames.len(), missing(&received, 0), missing(&received, 1)), (2, 16, 0));
    assert!(received.damaged > 0);
}

fn information() -> Information {
    Information {
        electrodes: 16,
        max_measurements: 256,
        max_frame_rate_hz: 1000.0,
        full_scale: 10.0,
        unit: Unit::Volt,
        complex: false,
        name: "emulated skin".into(),
        serial: "7".into(),
    }
}

/// Opens a session with an instrument that measures what `values` computes.
fn session(values: impl FnMut(u64, &mut [f64]) + Send + 'static) -> (Emulator, Session) {
    let mut values = values;
    let source = move |number: u64, _: &[Quadruple], slots: &mut [f64]| values(number, slots);
    let device = Eits1Device::new(information(), Box::new(source));
    let emulator = start(device, FaultPlan::default());
    let driver = Eits1::new(&rotated(16), 500.0, 1e-4, 0.0).unwrap();
    let session = Session::open(Box::new(driver), emulator.endpoint(), quick()).unwrap();
    (emulator, session)
}

fn frame_at(session: &Session, sequence: u64) -> Frame {
    frames(session).find(|frame| frame.sequence >= sequence).unwrap()
}

#[test]
fn row_11_values_that_cannot_be_are_flagged() {
    let (_emulator, session) = session(|number, values| {
        // a changing value everywhere but below
        values.iter_mut().enumerate().for_each(|(i, v)| *v = (i as f64 + number as f64).sin());
        values[0] = f64::NAN;
        values[1] = f64::INFINITY;
        values[2] = f64::from(f32::MIN_POSITIVE) / 8.0;
        values[3] = -10.5;
        values[4] = 10.0;
        values[5] = 0.25;
    });
    let early = frame_at(&session, 0);
    let flags = |frame: &Frame| frame.quality[..6].to_vec();
    assert_eq!(
        flags(&early),
        [
            Quality::NON_FINITE,
            Quality::NON_FINITE,
            Quality::GOOD,
            Quality::OVER_RANGE,
            Quality::SATURATED,
            Quality::GOOD
        ]
    );
    assert!(early.values[2] > 0.0);
    assert!(early.quality[6..].iter().all(|quality| quality.is_good()));
    // a value that stays constant while others change is stuck after 64 frames, also at the rail
    let late = frame_at(&session, 80);
    for index in [2, 4, 5] {
        assert!(late.quality[index].contains(Quality::STUCK), "{index}: {:?}", late.quality[index]);
    }
    assert!(late.quality[6..].iter().all(|quality| quality.is_good()));
}

#[test]
fn row_11_all_zero_is_reported() {
    let (_emulator, mut session) = session(|_, values| values.fill(0.0));
    let quiet = measure_reference_frames(&mut session, 20, LIMIT).unwrap();
    let report = quiet.check(&rotated(16)).unwrap();
    assert!(report.findings.iter().any(|finding| finding.trouble == Trouble::Silent));
}

/// The health check names the electrode, over a live connection.
#[test]
fn row_12_an_electrode_that_is_off_is_named() {
    let quadruples = rotated(16);
    let disc = point_electrode_disc(&quadruples, 16);
    // an unconnected input is at the rail wherever it senses; where it should drive, no current
    // flows
    let open = |bad: u32| {
        let (quadruples, disc) = (quadruples.clone(), disc.clone());
        move |number: u64, values: &mut [f64]| {
            for (index, slot) in values.iter_mut().enumerate() {
                let wobble = 1e-4 * ((index as f64 * 7.0 + number as f64) * 1.3).sin();
                let [a, b, m, n] = quadruples[index];
                *slot = match () {
                    () if m == bad || n == bad => 10.0,
                    () if a == bad || b == bad => f64::NAN,
                    () => disc[index] + wobble,
                };
            }
        }
    };
    let (_emulator, mut session) = session(open(5));
    let report =
        measure_reference_frames(&mut session, 40, LIMIT).unwrap().check(&quadruples).unwrap();
    let electrodes: Vec<_> = report.findings.iter().filter_map(|f| f.electrode).collect();
    assert_eq!(electrodes, [5], "{:?}", report.findings);
    assert!(report.findings[0].to_string().contains("electrode 6"), "people count from 1");
}

/// A contact that changes what is driven but not what is sensed breaks reciprocity.
#[test]
fn row_12_a_bad_contact_is_named_by_reciprocity() {
    let quadruples = rotated(16);
    let disc = point_electrode_disc(&quadruples, 16);
    let sent = quadruples.clone();
    let (_emulator, mut session) = session(move |number, values| {
        for (index, slot) in values.iter_mut().enumerate() {
            let wobble = 1e-4 * ((index as f64 * 7.0 + number as f64) * 1.3).sin();
            let [a, b, ..] = sent[index];
            let weak = if a == 9 || b == 9 { 0.1 } else { 1.0 };
            *slot = weak * disc[index] + wobble;
        }
    });
    let report =
        measure_reference_frames(&mut session, 40, LIMIT).unwrap().check(&quadruples).unwrap();
    let named: Vec<_> = report.findings.iter().filter_map(|finding| finding.electrode).collect();
    assert_eq!(named, [9], "{:?}", report.findings);
    assert!(matches!(report.findings[0].trouble, Trouble::Contact { .. }));
}

#[test]
fn row_13_sequences_and_clocks_wrap_and_go_back() {
    let quadruples = [[0, 1, 2, 3]];
    let mut driver = Eits1::new(&quadruples, 10.0, 1e-4, 0.0).unwrap();
    let sequences = [u32::MAX - 1, u32::MAX, 0, 1, 5, 5, 4, 6];
    let wire: Vec<u8> =
        sequences.iter().flat_map(|&s| eits1_frame(s, u64::from(s), &[0.5])).collect();
    let received = receive(&mut driver, &wire);
    // 5 again, and 4 after 5, are not new frames
    let first = received.counters[0];
    let steps: Vec<_> = received.counters.iter().map(|counter| counter - first).collect();
    assert_eq!(steps, [0, 1, 2, 3, 7, 8]);
    assert!(received.damaged > 0);
    // a device clock that goes back is left as it is; frames continue in order
    let wire: Vec<u8> = [(7, 900), (8, 100), (9, 200)]
        .iter()
        .flat_map(|&(s, time_us)| eits1_frame(s, time_us, &[0.5]))
        .collect();
    let received = receive(&mut driver, &wire);
    assert_eq!(received.counters.iter().map(|c| c - first).collect::<Vec<_>>(), [9, 10, 11]);
    assert!(received.times_s[1] < received.times_s[0]);

    // 32 bits of milliseconds wrap after 49.7 days
    let mut driver = sciospec();
    let mut wire = Vec::new();
    for time_ms in [u32::MAX - 20, u32::MAX - 10, 5, 15] {
        for (drive, group) in WHOLE {
            wire.extend(sciospec_frame(group, [drive, drive + 1], 1, time_ms));
        }
    }
    let received = receive(&mut driver, &wire);
    let steps: Vec<_> =
        received.times_s.windows(2).map(|pair| (1e3 * (pair[1] - pair[0])).round()).collect();
    assert_eq!(steps, [10.0, 16.0, 10.0]);
}

/// Sciospec's frames have no checksum: a flipped bit of a float is reported as a value unless the
/// value becomes implausible, as the docs of `codec::sciospec` say.
#[test]
fn row_16_a_changed_float_cannot_be_seen_unless_it_makes_no_sense() {
    let whole = cells(&WHOLE);
    let (mut unseen, mut refused) = (0, 0);
    // the first float of the second data frame
    let first = whole.len() / 6 + 11;
    for bit in 0..32 {
        let mut wire = whole.clone();
        wire[first + bit / 8] ^= 0x80 >> (bit % 8);
        let received = receive(&mut sciospec(), &[wire, whole.clone()].concat());
        assert_eq!(missing(&received, received.frames.len() - 1), 0, "bit {bit}");
        let damaged = &received.frames[0];
        let holes = damaged.1.iter().filter(|quality| !quality.is_good()).count();
        match holes {
            0 => {
                unseen += 1;
                assert!(damaged.0[16].abs() <= 20.0, "bit {bit}");
            }
            // the whole data frame is skipped
            16 => refused += 1,
            _ => panic!("bit {bit}: {holes}"),
        }
    }
    assert!(unseen > 20 && refused > 0 && unseen + refused == 32, "{unseen} {refused}");
}
