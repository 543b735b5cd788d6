//! Rows 7, 11 to 13 and 16: frames that are whole, but not right.

use std::time::Instant;

use eit_hw::codec::eits1::Information;
use eit_hw::codec::text;
use eit_hw::driver::{Driver, Eits1, Event, Found, Sciospec, SciospecSettings, Session};
use eit_hw::emulator::{Eits1Device, Emulator, FaultPlan, Listen};
use eit_hw::{Frame, Quadruple, Quality, Trouble, Unit, measure_quiet};

use super::common::{point_electrode_disc, rotated};
use super::{LIMIT, WAIT, eits1_frame, quick, sciospec_frame};

/// What a driver finds, frames as (real parts, qualities).
#[derive(Debug, Default)]
struct Heard {
    frames: Vec<(Vec<f64>, Vec<Quality>)>,
    times_s: Vec<f64>,
    counters: Vec<u64>,
    cut: usize,
    damaged: u64,
}

fn hear(driver: &mut dyn Driver, bytes: &[u8]) -> Heard {
    let mut heard = Heard::default();
    driver.receive(bytes, &mut |found| match found {
        Found::Frame(frame) => {
            heard.frames.push((frame.values.to_vec(), frame.quality.to_vec()));
            heard.times_s.extend(frame.device_time_s);
            heard.counters.extend(frame.counter);
        }
        Found::Cut => heard.cut += 1,
        Found::Damaged { bytes } => heard.damaged += bytes,
        _ => {}
    });
    heard
}

/// A driver of 32 electrodes with the drives (0, 1), (1, 2), (2, 3): six cells of 16 channels.
fn sciospec() -> Sciospec {
    let quadruples = [[0, 1, 2, 3], [1, 2, 3, 4], [2, 3, 4, 5]];
    let settings = SciospecSettings {
        polarity: eit_hw::driver::Polarity::AsListed,
        ..SciospecSettings::for_quadruples(32, &quadruples)
    };
    Sciospec::new(settings).unwrap()
}

/// A frame: drive, group.
fn cells(list: &[(u8, u8)]) -> Vec<u8> {
    list.iter()
        .flat_map(|&(drive, group)| sciospec_frame(group, [drive, drive + 1], 1, 5))
        .collect()
}

const WHOLE: [(u8, u8); 6] = [(1, 1), (1, 2), (2, 1), (2, 2), (3, 1), (3, 2)];

/// Every value that is good is the one that was sent for its drive and electrode.
fn check_cells(heard: &Heard) {
    for (values, quality) in &heard.frames {
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

fn missing(heard: &Heard, frame: usize) -> usize {
    heard.frames[frame].1.iter().filter(|quality| !quality.is_good()).count()
}

#[test]
fn row_07_groups_missing_doubled_reordered_and_too_many() {
    let whole = cells(&WHOLE);
    let heard = hear(&mut sciospec(), &whole.repeat(3));
    check_cells(&heard);
    assert_eq!((heard.frames.len(), missing(&heard, 1), heard.cut), (3, 0, 0));

    // each cell missing once: 16 values are flagged, and the next frame is whole
    for gone in 0..WHOLE.len() {
        let mut list = WHOLE.to_vec();
        list.remove(gone);
        let heard = hear(&mut sciospec(), &[whole.clone(), cells(&list), whole.repeat(2)].concat());
        check_cells(&heard);
        assert_eq!(heard.frames.len(), 4, "{gone}: {:?}", heard.cut);
        assert_eq!(missing(&heard, 1), 16, "{gone}");
        assert_eq!((missing(&heard, 2), missing(&heard, 3)), (0, 0), "{gone}");
    }
    // each cell doubled: it starts a frame of its own, and nothing gets a wrong place
    for (again, &cell) in WHOLE.iter().enumerate() {
        let mut list = WHOLE.to_vec();
        list.insert(again, cell);
        let heard = hear(&mut sciospec(), &[cells(&list), whole.repeat(2)].concat());
        check_cells(&heard);
        assert!(heard.frames.len() + heard.cut >= 3, "{again}");
        assert_eq!(missing(&heard, heard.frames.len() - 1), 0, "{again}");
    }
    // neighbours exchanged
    for first in 0..WHOLE.len() - 1 {
        let mut list = WHOLE.to_vec();
        list.swap(first, first + 1);
        let heard = hear(&mut sciospec(), &[cells(&list), whole.repeat(2)].concat());
        check_cells(&heard);
        assert_eq!(missing(&heard, heard.frames.len() - 1), 0, "{first}");
    }
    // more groups than there are electrodes, drives that nobody asked for, another frequency row
    let mut more = Vec::new();
    for (drive, group) in WHOLE {
        more.extend(cells(&[(drive, group)]));
        if group == 2 {
            more.extend(cells(&[(drive, 3), (drive, 4)]));
        }
    }
    let heard = hear(&mut sciospec(), &more.repeat(2));
    check_cells(&heard);
    assert_eq!((heard.frames.len(), missing(&heard, 1), heard.damaged), (2, 0, 0));
    let foreign = [whole.clone(), sciospec_frame(1, [9, 12], 1, 5), whole.clone()].concat();
    let heard = hear(&mut sciospec(), &foreign);
    check_cells(&heard);
    assert!(heard.frames.len() == 2 && heard.damaged > 0);
    // one frequency is set up: data of another one is not of this frame
    let mut row = whole.clone();
    let other = sciospec_frame(2, [2, 3], 2, 5);
    let at = 3 * other.len();
    row.splice(at..at + other.len(), other.iter().copied());
    let heard = hear(&mut sciospec(), &[row, whole].concat());
    check_cells(&heard);
    assert_eq!((heard.frames.len(), missing(&heard, 0), missing(&heard, 1)), (2, 16, 0));
    assert!(heard.damaged > 0);
}

fn information() -> Information {
    Information {
        electrodes: 16,
        most_measurements: 256,
        max_frame_rate_hz: 1000.0,
        full_scale: 10.0,
        unit: Unit::Volt,
        complex: false,
        name: "emulated skin".into(),
        serial: "7".into(),
    }
}

/// A session with an instrument that measures what `values` says.
fn session(values: impl FnMut(u64, &mut [f64]) + Send + 'static) -> (Emulator, Session) {
    let mut values = values;
    let source = move |number: u64, _: &[Quadruple], slots: &mut [f64]| values(number, slots);
    let device = Eits1Device::new(information(), Box::new(source));
    let listen = Listen::Tcp("127.0.0.1:0".into());
    let emulator = Emulator::start(Box::new(device), &listen, FaultPlan::default()).unwrap();
    let driver = Eits1::new(&rotated(16), 500.0, 1e-4, 0.0).unwrap();
    let session = Session::open(Box::new(driver), emulator.endpoint(), quick()).unwrap();
    (emulator, session)
}

fn frame_at(session: &Session, sequence: u64) -> Frame {
    let start = Instant::now();
    loop {
        assert!(start.elapsed() < LIMIT);
        if let Some(Event::Frame(frame)) = session.next_event(WAIT).unwrap()
            && frame.sequence >= sequence
        {
            return frame;
        }
    }
}

#[test]
fn row_11_values_that_cannot_be_are_flagged() {
    let (_emulator, session) = session(|number, values| {
        // a live value in every place but those below
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
    // what does not change while the others do is stuck after 64 frames, also at the rail
    let late = frame_at(&session, 80);
    for index in [2, 4, 5] {
        assert!(late.quality[index].contains(Quality::STUCK), "{index}: {:?}", late.quality[index]);
    }
    assert!(late.quality[6..].iter().all(|quality| quality.is_good()));
}

#[test]
fn row_11_all_zero_is_told_and_codes_of_openeit_never_reach_an_image() {
    let (_emulator, mut session) = session(|_, values| values.fill(0.0));
    let quiet = measure_quiet(&mut session, 20, LIMIT).unwrap();
    let report = quiet.check(&rotated(16)).unwrap();
    assert!(report.findings.iter().any(|finding| finding.trouble == Trouble::Silent));

    let format = text::TextFormat { values_per_line: 3, ..text::TextFormat::open_eit(16).unwrap() };
    let mut flags = Vec::new();
    let line = b"magnitudes:     1234.5625,       0.0000,134217727.9375,\r\n";
    text::Decoder::new(format).unwrap().push(&[&b"\n"[..], line].concat(), &mut |event| {
        if let text::Event::Frame { quality, .. } = event {
            flags = quality.to_vec();
        }
    });
    assert_eq!(flags, [Quality::GOOD, Quality::OPEN, Quality::SATURATED]);
}

/// The check of health names the electrode, over a live connection.
#[test]
fn row_12_an_electrode_that_is_off_is_named() {
    let quadruples = rotated(16);
    let disc = point_electrode_disc(&quadruples, 16);
    // an input with nothing connected is at the rail wherever it is sensed; where it should drive,
    // no current flows
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
    let report = measure_quiet(&mut session, 40, LIMIT).unwrap().check(&quadruples).unwrap();
    let electrodes: Vec<_> = report.findings.iter().filter_map(|f| f.electrode).collect();
    assert_eq!(electrodes, [5], "{:?}", report.findings);
    assert!(report.findings[0].to_string().contains("electrode 6"), "people count from 1");
}

/// A contact that changes what is driven and not what is sensed breaks reciprocity.
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
    let report = measure_quiet(&mut session, 40, LIMIT).unwrap().check(&quadruples).unwrap();
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
    let heard = hear(&mut driver, &wire);
    // 5 again and 4 after 5 are no new frames
    let first = heard.counters[0];
    let steps: Vec<_> = heard.counters.iter().map(|counter| counter - first).collect();
    assert_eq!(steps, [0, 1, 2, 3, 7, 8]);
    assert!(heard.damaged > 0);
    // a clock that goes back is the instrument's own; frames go on in their order
    let wire: Vec<u8> = [(7, 900), (8, 100), (9, 200)]
        .iter()
        .flat_map(|&(s, time_us)| eits1_frame(s, time_us, &[0.5]))
        .collect();
    let heard = hear(&mut driver, &wire);
    assert_eq!(heard.counters.iter().map(|c| c - first).collect::<Vec<_>>(), [9, 10, 11]);
    assert!(heard.times_s[1] < heard.times_s[0]);

    // 32 bits of milliseconds wrap after 49.7 days
    let mut driver = sciospec();
    let mut wire = Vec::new();
    for time_ms in [u32::MAX - 20, u32::MAX - 10, 5, 15] {
        for (drive, group) in WHOLE {
            wire.extend(sciospec_frame(group, [drive, drive + 1], 1, time_ms));
        }
    }
    let heard = hear(&mut driver, &wire);
    let steps: Vec<_> =
        heard.times_s.windows(2).map(|pair| (1e3 * (pair[1] - pair[0])).round()).collect();
    assert_eq!(steps, [10.0, 16.0, 10.0]);
}

/// Sciospec's frames have no checksum: a flipped bit of a float is told as a value, unless it makes
/// it one that no voltage has. docs of `codec::sciospec` say so.
#[test]
fn row_16_a_changed_float_cannot_be_seen_unless_it_makes_no_sense() {
    let whole = cells(&WHOLE);
    let (mut unseen, mut refused) = (0, 0);
    // the first float of the second data frame
    let first = whole.len() / 6 + 11;
    for bit in 0..32 {
        let mut wire = whole.clone();
        wire[first + bit / 8] ^= 0x80 >> (bit % 8);
        let heard = hear(&mut sciospec(), &[wire, whole.clone()].concat());
        assert_eq!(missing(&heard, heard.frames.len() - 1), 0, "bit {bit}");
        let damaged = &heard.frames[0];
        let holes = damaged.1.iter().filter(|quality| !quality.is_good()).count();
        match holes {
            0 => {
                unseen += 1;
                assert!(damaged.0[16].abs() <= 20.0, "bit {bit}");
            }
            // the whole data frame is left out
            16 => refused += 1,
            _ => panic!("bit {bit}: {holes}"),
        }
    }
    assert!(unseen > 20 && refused > 0 && unseen + refused == 32, "{unseen} {refused}");
}
