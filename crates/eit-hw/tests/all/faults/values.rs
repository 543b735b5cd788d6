//! Rows 7, 11 to 13 and 16: frames that are complete but not right.

use eit_hw::driver::{Decoded, Driver, Polarity, Sciospec, SciospecSettings, Session};
use eit_hw::emulator::{Eits1Device, Emulator, FaultPlan};
use eit_hw::{Quadruple, Quality, Trouble, measure_reference_frames};

use crate::common::instruments::{LIMIT, eits1_driver, frames, information, quick, start};
use crate::common::wire::sciospec_frame;
use crate::common::{point_electrode_disc, rotated};

/// What a driver decodes: values of frames, how many of each are missing, and times.
#[derive(Debug, Default)]
struct Received {
    frames: Vec<Vec<f64>>,
    holes: Vec<usize>,
    times_s: Vec<f64>,
    truncated: usize,
    damaged: u64,
}

/// Decodes with a driver of 32 electrodes and the drives (0, 1), (1, 2), (2, 3): six cells of 16 channels.
fn receive(bytes: &[u8]) -> Received {
    let quadruples = [[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]];
    let settings = SciospecSettings::for_quadruples(32, &quadruples);
    let settings = SciospecSettings { polarity: Polarity::AsListed, ..settings };
    let mut received = Received::default();
    Sciospec::new(settings).unwrap().receive(bytes, &mut |decoded| match decoded {
        Decoded::Frame(frame) => {
            for (value, quality) in frame.values.iter().zip(frame.quality) {
                let is_missing = value.is_nan() && quality.contains(Quality::MISSING);
                assert!(is_missing || quality.is_good(), "{value} {quality}");
            }
            received.frames.push(frame.values.to_vec());
            received.holes.push(frame.values.iter().filter(|value| value.is_nan()).count());
            received.times_s.extend(frame.device_time_s);
        }
        Decoded::TruncatedFrame => received.truncated += 1,
        Decoded::Damaged { bytes } => received.damaged += bytes,
        _ => {}
    });
    received
}

/// Returns a frame of these cells: drive, group.
fn cells(list: &[(u8, u8)]) -> Vec<u8> {
    let cell = |&(drive, group): &(u8, u8)| sciospec_frame(group, [drive, drive + 1], 1, 5);
    list.iter().flat_map(cell).collect()
}

const WHOLE: [(u8, u8); 6] = [(1, 1), (1, 2), (2, 1), (2, 2), (3, 1), (3, 2)];

#[test]
fn row_07_groups_missing_doubled_reordered_and_too_many() {
    let whole = cells(&WHOLE);
    // every value is the one sent for its drive and electrode
    let read = |parts: &[Vec<u8>]| {
        let received = receive(&parts.concat());
        for frame in &received.frames {
            for (index, value) in frame.iter().enumerate().filter(|(_, value)| !value.is_nan()) {
                let (drive, electrode) = (index / 32, index % 32);
                let sent = ((drive + 1) as f64 + 16.0 * (electrode % 16) as f64) / 1024.0;
                assert_eq!(*value, sent, "drive {drive}, electrode {electrode}");
            }
        }
        received
    };
    let received = read(&[whole.repeat(3)]);
    assert_eq!((&received.holes[..], received.truncated), (&[0; 3][..], 0));

    for (index, &cell) in WHOLE.iter().enumerate() {
        // missing once: 16 values are flagged, and the next frame is complete
        let mut list = WHOLE.to_vec();
        list.remove(index);
        let received = read(&[whole.clone(), cells(&list), whole.repeat(2)]);
        assert_eq!(received.holes, [0, 16, 0, 0], "{index}");
        // doubled: it starts a frame of its own, and no value is misplaced
        list = WHOLE.to_vec();
        list.insert(index, cell);
        let received = read(&[cells(&list), whole.repeat(2)]);
        assert!(received.frames.len() + received.truncated >= 3, "{index}");
        assert_eq!(received.holes.last(), Some(&0), "{index}");
    }
    // neighbours swapped
    for first in 0..WHOLE.len() - 1 {
        let mut list = WHOLE.to_vec();
        list.swap(first, first + 1);
        assert_eq!(read(&[cells(&list), whole.repeat(2)]).holes.last(), Some(&0), "{first}");
    }
    // more groups than electrodes
    let more: Vec<_> = (1..4).flat_map(|drive| (1..5).map(move |group| (drive, group))).collect();
    let received = read(&[cells(&more).repeat(2)]);
    assert_eq!((&received.holes[..], received.damaged), (&[0; 2][..], 0));
    // a drive that was not requested
    let received = read(&[whole.clone(), sciospec_frame(1, [9, 12], 1, 5), whole.clone()]);
    assert!(received.frames.len() == 2 && received.damaged > 0);
    // one frequency is set: data of another one do not belong to this frame
    let mut row = whole.clone();
    let other = sciospec_frame(2, [2, 3], 2, 5);
    let at = 3 * other.len();
    row.splice(at..at + other.len(), other.iter().copied());
    let received = read(&[row, whole]);
    assert!(received.holes == [16, 0] && received.damaged > 0, "{received:?}");
}

/// Opens a session with an instrument that measures what `values` computes, and its emulator.
fn session(
    complex: bool,
    mut values: impl FnMut(u64, &mut [f64]) + Send + 'static,
) -> (Emulator, Session) {
    let source = move |number: u64, _: &[Quadruple], slots: &mut [f64]| values(number, slots);
    let device = Eits1Device::new(information("7", complex), Box::new(source));
    let emulator = start(device, FaultPlan::default());
    let session = Session::open(eits1_driver(16, 500.0), emulator.endpoint(), quick()).unwrap();
    (emulator, session)
}

#[test]
fn row_11_values_that_cannot_be_are_flagged() {
    let (_emulator, session) = session(true, |number, values| {
        for (index, parts) in values.chunks_exact_mut(2).enumerate() {
            // a changing value everywhere but below
            parts.copy_from_slice(&[(index as f64 + number as f64).sin(), 0.125]);
        }
        values[0] = f64::NAN;
        values[2] = f64::INFINITY;
        values[4] = f64::from(f32::MIN_POSITIVE) / 8.0;
        values[6] = -105.0;
        values[8] = 100.0;
        values[10] = 0.25;
    });
    let frame_at = |least: u64| frames(&session).find(|frame| frame.sequence >= least).unwrap();
    let early = frame_at(0);
    let [bad, good] = [Quality::NON_FINITE, Quality::GOOD];
    assert_eq!(early.quality[..6], [bad, bad, good, Quality::OVER_RANGE, Quality::SATURATED, good]);
    assert!(early.values[2] > 0.0 && early.values[5] == 0.25);
    assert_eq!(early.imaginary.as_ref().unwrap()[1..], [0.125; 207]);
    assert!(early.quality[6..].iter().all(|quality| quality.is_good()));
    // a value that stays constant while others change is stuck after 64 frames, also at the rail
    let late = frame_at(80);
    for index in [2, 4, 5] {
        assert!(late.quality[index].contains(Quality::STUCK), "{index}: {:?}", late.quality[index]);
    }
    assert!(late.quality[6..].iter().all(|quality| quality.is_good()));
}

/// The health check names the electrode, over a live connection.
#[test]
fn row_12_faults_of_electrodes_are_named() {
    let quadruples = rotated(16);
    let disc = point_electrode_disc(&quadruples, 16);
    // an unconnected input is at the rail wherever it senses; where it should drive, no current flows
    let open = |[a, b, m, n]: Quadruple, value: f64| match () {
        () if m == 5 || n == 5 => 100.0,
        () if a == 5 || b == 5 => f64::NAN,
        () => value,
    };
    // a contact that changes what is driven but not what is sensed breaks reciprocity
    let weak = |[a, b, ..]: Quadruple, value: f64| value * if a == 9 || b == 9 { 0.1 } else { 1.0 };
    let silent = |_: Quadruple, _: f64| 0.0;
    type Fault = (fn(Quadruple, f64) -> f64, Option<u32>, fn(&Trouble) -> bool);
    let faults: [Fault; 3] = [
        (open, Some(5), |_| true),
        (weak, Some(9), |trouble| matches!(trouble, Trouble::Contact { .. })),
        (silent, None, |trouble| *trouble == Trouble::Silent),
    ];
    for (fault, electrode, is_named) in faults {
        let (sent, disc) = (quadruples.clone(), disc.clone());
        let (_emulator, mut session) = session(false, move |number, values| {
            for (index, slot) in values.iter_mut().enumerate() {
                let wobble = 1e-4 * ((index as f64 * 7.0 + number as f64) * 1.3).sin();
                *slot = fault(sent[index], disc[index] + wobble);
            }
        });
        let report = measure_reference_frames(&mut session, 40, LIMIT).unwrap();
        let findings = report.check(&quadruples).unwrap().findings;
        let named: Vec<_> = findings.iter().filter_map(|finding| finding.electrode).collect();
        assert_eq!(named, electrode.as_slice(), "{findings:?}");
        assert!(findings.iter().any(|finding| is_named(&finding.trouble)), "{findings:?}");
    }
}

/// Sequences and clocks of EITS-1: `driver::eits1::meaning`.
#[test]
fn row_13_clocks_wrap() {
    // 32 bits of milliseconds wrap after 49.7 days
    let frame = |time_ms| {
        WHOLE.map(|(drive, group)| sciospec_frame(group, [drive, drive + 1], 1, time_ms)).concat()
    };
    let times_s = receive(&[u32::MAX - 20, u32::MAX - 10, 5, 15].map(frame).concat()).times_s;
    let steps = times_s.windows(2).map(|pair| (1e3 * (pair[1] - pair[0])).round());
    assert!(steps.eq([10.0, 16.0, 10.0]), "{times_s:?}");
}

/// Sciospec's frames have no checksum: a flipped bit of a float is a value unless it becomes implausible.
#[test]
fn row_16_a_changed_float_cannot_be_seen_unless_it_makes_no_sense() {
    let whole = cells(&WHOLE);
    let (mut unseen, mut refused) = (0, 0);
    // the first float of the second data frame
    let first = whole.len() / 6 + 11;
    for bit in 0..32 {
        let mut wire = whole.clone();
        wire[first + bit / 8] ^= 0x80 >> (bit % 8);
        let received = receive(&[wire, whole.clone()].concat());
        assert_eq!(received.holes.last(), Some(&0), "bit {bit}");
        match received.holes[0] {
            0 => {
                unseen += 1;
                assert!(received.frames[0][16].abs() <= 20.0, "bit {bit}");
            }
            // the whole data frame is skipped
            16 => refused += 1,
            holes => panic!("bit {bit}: {holes}"),
        }
    }
    assert!(unseen > 20 && refused > 0 && unseen + refused == 32, "{unseen} {refused}");
}
