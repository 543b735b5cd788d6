//! Drivers against emulated instruments, over a real serial line (a pseudo-terminal) and TCP, with
//! and without faults. No frame may contain a value that the instrument did not measure. One file,
//! because all drivers share the same instruments and checks.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::common::instruments::{LIMIT, events, frames, line, quick, start};
use crate::common::{ascending, own_port, rotated};
use eit_hw::capture::{
    CaptureReader, CaptureSettings, CaptureWriter, Entry, Recorder, SessionRecord, Tape,
    TouchesRecord,
};
use eit_hw::codec::eits1::Information;
use eit_hw::codec::text::TextFormat;
use eit_hw::driver::{
    Board, Driver, Eits1, Event, FrameSource as _, Overflow, Polarity, Sciospec, SciospecSettings,
    Session, SessionSettings, identify,
};
use eit_hw::emulator::{
    BoardDevice, Device, Eits1Device, Emulator, FaultPlan, Listen, SciospecDevice,
};
use eit_hw::{Endpoint, Frame, HwError, Layout, Quadruple, Quality, Unit};

/// Returns a value that encodes frame and measurement; exact in 32 bits.
fn value(sequence: u64, [a, b, m, n]: Quadruple) -> f64 {
    let place = f64::from(((a * 16 + b) * 16 + m) * 16 + n) / 65_536.0;
    // 5 bits for the frame, 16 for the measurement
    place + (sequence % 32) as f64
}

fn information(serial: &str, complex: bool) -> Information {
    Information {
        electrodes: 16,
        max_measurements: 256,
        max_frame_rate_hz: 1000.0,
        full_scale: 100.0,
        unit: Unit::Volt,
        complex,
        name: "emulated skin".into(),
        serial: serial.into(),
    }
}

fn eits1_device(serial: &str) -> Eits1Device {
    let source = |sequence: u64, quadruples: &[Quadruple], values: &mut [f64]| {
        for (slot, &quadruple) in values.iter_mut().zip(quadruples) {
            *slot = value(sequence, quadruple);
        }
    };
    Eits1Device::new(information(serial, false), Box::new(source))
}

fn eits1_driver(rate: f32) -> Box<dyn Driver> {
    Box::new(Eits1::new(&rotated(16), rate, 1e-4, 0.0).unwrap())
}

/// Checks a frame by itself: its values encode its sequence in the stream.
fn check_frame(frame: &Frame, quadruples: &[Quadruple]) {
    let first = (frame.values[0] - value(0, quadruples[0])).round() as u64;
    for (found, &quadruple) in frame.values.iter().zip(quadruples) {
        assert_eq!(*found, value(first, quadruple), "frame {}", frame.sequence);
    }
}

fn on_line(device: impl Device + 'static, folder: &tempfile::TempDir, plan: FaultPlan) -> Emulator {
    Emulator::start(Box::new(device), &line(folder), plan).unwrap()
}

#[test]
fn eits1_over_a_serial_line_end_to_end() {
    let folder = tempfile::tempdir().unwrap();
    let emulator = on_line(eits1_device("7"), &folder, FaultPlan::default());
    // the scene's order differs from the one that the driver measures
    let wanted: Vec<Quadruple> = ascending(16);
    let settings = SessionSettings { quadruples: Some(wanted.clone()), ..quick() };
    let mut session = Session::open(eits1_driver(200.0), emulator.endpoint(), settings).unwrap();
    let identity = &session.setup().identity;
    assert_eq!((identity.name.as_str(), identity.serial.as_str()), ("emulated skin", "7"));
    assert_eq!((session.setup().unit, session.setup().frame_rate_hz), (Unit::Volt, Some(200.0)));
    let frames: Vec<_> = frames(&session).take(100).collect();
    frames.iter().for_each(|frame| check_frame(frame, &wanted));
    for (index, pair) in frames.windows(2).enumerate() {
        assert_eq!(pair[1].sequence, pair[0].sequence + 1, "{index}");
        assert!(pair[1].device_time_s > pair[0].device_time_s);
        assert!(pair[1].host_time_s >= pair[0].host_time_s);
        assert!(pair[0].epoch == 0 && pair[0].quality.iter().all(|quality| quality.is_good()));
    }
    session.stop();
    let statistics = session.statistics();
    assert_eq!((statistics.lost, statistics.damaged_bytes, statistics.dropped), (0, 0, 0));
    // once stopped, it sends nothing more
    while session.next_event(Duration::ZERO).unwrap().is_some() {}
    falls_silent(&emulator);
}

/// Waits until an emulator has sent nothing for twenty frame periods.
fn falls_silent(emulator: &Emulator) {
    let (start, mut before) = (Instant::now(), None);
    while before != Some(emulator.statistics().sent) {
        assert!(start.elapsed() < LIMIT, "it still sends");
        before = Some(emulator.statistics().sent);
        std::thread::sleep(Duration::from_millis(100));
    }
}

fn wait_for(mut is_so: impl FnMut() -> bool) {
    let start = Instant::now();
    while !is_so() {
        assert!(start.elapsed() < LIMIT);
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Every accepted frame is right, and every lost frame is counted.
#[test]
fn eits1_on_a_bad_line_loses_frames_but_tells_no_wrong_one() {
    let folder = tempfile::tempdir().unwrap();
    let plan = FaultPlan {
        seed: 5,
        spared_bytes: 3000,
        drop_byte: 1e-4,
        flip_bit: 1e-4,
        insert_byte: 1e-4,
        ..FaultPlan::default()
    };
    let emulator = on_line(eits1_device("7"), &folder, plan);
    let session = Session::open(eits1_driver(400.0), emulator.endpoint(), quick()).unwrap();
    let (mut seen, mut gaps, mut last) = (0, 0, None);
    let mut events = events(&session);
    while seen < 500 {
        match events.next() {
            Some(Event::Frame(frame)) => {
                check_frame(&frame, &rotated(16));
                // values distinguish 32 frames
                let number = (frame.values[0] - value(0, rotated(16)[0])).round() as u64;
                let (number_before, sequence_before) = last.unwrap_or((number, frame.sequence));
                let steps = (frame.sequence - sequence_before) % 32;
                assert_eq!((number_before + steps) % 32, number);
                last = Some((number, frame.sequence));
                seen += 1;
            }
            Some(Event::Gap { frames }) => gaps += frames,
            _ => {}
        }
    }
    let last = last.unwrap().1;
    assert_eq!(seen + gaps, last + 1);
    // 866 bytes per frame: one in four is hit; a tenth and a half are 5 deviations away
    assert!((50..600).contains(&gaps), "{gaps}");
    assert!(session.statistics().damaged_bytes > 10_000 && emulator.statistics().faults > 50);
}

/// Waits for the error that ends a session.
fn end(session: &Session) -> HwError {
    let start = Instant::now();
    loop {
        assert!(start.elapsed() < LIMIT);
        if let Err(error) = session.next_event(Duration::from_millis(500)) {
            return error;
        }
    }
}

#[test]
fn another_instrument_on_the_same_port_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let listen = line(&folder);
    let device = |serial| Box::new(eits1_device(serial));
    let mut first = Emulator::start(device("7"), &listen, FaultPlan::default()).unwrap();
    let endpoint = first.endpoint().clone();
    let session = Session::open(eits1_driver(200.0), &endpoint, quick()).unwrap();
    frames(&session).nth(4);
    first.stop();
    let again = match &endpoint {
        Endpoint::Tcp { address } => Listen::Tcp(address.clone()),
        Endpoint::Serial { .. } => listen,
    };
    let _second = Emulator::start(device("8"), &again, FaultPlan::default()).unwrap();
    let error = end(&session);
    let HwError::Identity { wanted, found, .. } = &error else { panic!("{error}") };
    assert_eq!((wanted.as_str(), found.as_str()), ("emulated skin 7", "emulated skin 8"));
    // reported once, then the session is over
    assert_eq!(session.next_event(Duration::from_millis(500)).unwrap(), None);
}

/// An instrument with fewer electrodes, or less room for measurements, than the scene needs.
#[test]
fn an_instrument_that_is_too_small_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (electrodes, max_measurements, wanted) in [
        (8, 256, "the number of electrodes was set to 16, but the instrument reports at most 8"),
        (16, 4, "the number of measurements was set to "),
    ] {
        let small = Information { electrodes, max_measurements, ..information("7", false) };
        let device = Eits1Device::new(small, Box::new(|_, _, values| values.fill(1.0)));
        let emulator = on_line(device, &folder, FaultPlan::default());
        let refused = Session::open(eits1_driver(100.0), emulator.endpoint(), quick()).unwrap_err();
        assert!(matches!(&refused, HwError::ReadBack { .. }), "{refused}");
        assert!(refused.to_string().contains(wanted), "{refused}");
    }
}

#[test]
fn a_lost_instrument_ends_a_session_that_does_not_reconnect() {
    let mut emulator = start(eits1_device("7"), FaultPlan::default());
    let settings = SessionSettings { reconnect: None, ..quick() };
    let session = Session::open(eits1_driver(200.0), emulator.endpoint(), settings).unwrap();
    emulator.stop();
    let error = end(&session);
    assert!(matches!(error, HwError::Lost { .. }), "{error}");
}

/// Frames taken and those reported as skipped are all frames, in order, for a consumer that stalls twice.
#[test]
fn every_frame_is_taken_or_reported_as_skipped() {
    let emulator = start(eits1_device("7"), FaultPlan::default());
    let robot = SessionSettings { capacity: 3, ..quick() };
    let session = Session::open(eits1_driver(500.0), emulator.endpoint(), robot).unwrap();
    let (mut next, mut stalls) = (0, 0);
    for taken in 0..40 {
        if taken % 20 == 10 {
            let dropped = session.statistics().dropped;
            wait_for(|| session.statistics().dropped > dropped + 30);
        }
        match session.next_event(LIMIT).unwrap() {
            Some(Event::Frame(frame)) => {
                assert_eq!(frame.sequence, next);
                next += 1;
            }
            Some(Event::Skipped { frames }) => {
                stalls += 1;
                next += frames;
            }
            other => panic!("{other:?}"),
        }
    }
    assert!(stalls >= 2, "{stalls}");
    assert!(session.statistics().dropped > 60, "{:?}", session.statistics());
}

/// However slow the consumer is, a recording has every frame from its beginning to the end of the instrument; the consumer gets
/// the latest, and is told how many it skipped.
#[test]
fn a_recording_waits_for_nobody() {
    let source = |sequence: u64, _: &[Quadruple], values: &mut [f64]| values.fill(sequence as f64);
    let device = Eits1Device::new(information("7", false), Box::new(source));
    let emulator = start(device, FaultPlan::default());
    let settings = SessionSettings { capacity: 8192, overflow: Overflow::Fail, ..quick() };
    let session = Session::open(eits1_driver(200.0), emulator.endpoint(), settings).unwrap();
    let record = SessionRecord::default();
    let folder = tempfile::tempdir().unwrap();
    let words =
        |event: &Event| Some(format!("{event:?}")).filter(|_| !matches!(event, Event::Frame(_)));
    let mut recorder = Recorder::new(Box::new(session), 4, words);
    let tape = recorder.tape();
    let ended = |tape: &Tape| {
        let mut ended = None;
        wait_for(|| {
            ended = ended.take().or_else(|| tape.ended());
            ended.is_some()
        });
        ended.unwrap()
    };
    let recorded = |path: &Path| -> (Vec<u64>, usize) {
        let mut reader = CaptureReader::open(path).unwrap();
        let entries: Vec<Entry> = std::iter::from_fn(|| reader.next_entry().unwrap()).collect();
        let frames = entries.iter().filter_map(|entry| match entry {
            Entry::Frame(frame) => Some(frame.sequence),
            _ => None,
        });
        (frames.collect(), entries.iter().filter(|e| matches!(e, Entry::Touches(_))).count())
    };
    let files = ["first.mcap", "second.mcap"].map(|name| folder.path().join(name));
    let create =
        |path: &Path| CaptureWriter::create(path, &record, CaptureSettings::default()).unwrap();
    assert!(matches!(recorder.next_event(LIMIT).unwrap(), Some(Event::Frame(_))));
    // nothing is recorded yet
    wait_for(|| recorder.statistics().frames > 20);
    assert!(!tape.is_on());
    tape.write(|| panic!("made although nothing is recorded"));
    let before = recorder.statistics().frames;
    tape.begin(create(&files[0]));
    wait_for(|| recorder.statistics().frames > before + 60);
    tape.write(|| {
        let json = r#"{"sequence":0,"touches":[]}"#.to_owned();
        Entry::Touches(TouchesRecord::new(json).unwrap())
    });
    tape.end();
    ended(&tape).unwrap();
    tape.begin(create(&files[1]));
    wait_for(|| recorder.statistics().frames > before + 120);
    recorder.stop();
    ended(&tape).unwrap();
    let (first, touches) = recorded(&files[0]);
    let (second, _) = recorded(&files[1]);
    assert!(first.len() >= 60 && second.len() >= 30, "{} {}", first.len(), second.len());
    for frames in [&first, &second] {
        assert!(frames.windows(2).all(|pair| pair[1] == pair[0] + 1), "{frames:?}");
    }
    assert_eq!(touches, 1);
    // the consumer has taken nothing
    let statistics = recorder.statistics();
    let events: Vec<Event> =
        std::iter::from_fn(|| recorder.next_event(Duration::ZERO).unwrap()).collect();
    let Some((Event::Skipped { frames }, taken)) = events.split_first() else {
        panic!("{events:?}")
    };
    assert_eq!((*frames, taken.len()), (statistics.dropped, 4));
    assert_eq!(statistics.frames, 1 + frames + 4);
    let Some(Event::Frame(last)) = taken.last() else { panic!("{taken:?}") };
    assert_eq!(second.last(), Some(&last.sequence));
    assert!(recorder.is_over());
}

#[test]
fn eits1_complex_values_and_flags_of_the_values_themselves() {
    let source = |sequence: u64, _: &[Quadruple], values: &mut [f64]| {
        for (index, parts) in values.chunks_exact_mut(2).enumerate() {
            parts.copy_from_slice(&[index as f64 / 4.0, sequence as f64 / 1024.0]);
        }
        values[0] = f64::NAN;
        values[2] = 100.0;
        values[4] = -101.0;
    };
    let device = Eits1Device::new(information("7", true), Box::new(source));
    let emulator = start(device, FaultPlan::default());
    let session = Session::open(eits1_driver(200.0), emulator.endpoint(), quick()).unwrap();
    let frame = frames(&session).next().unwrap();
    assert_eq!(frame.values[4], 1.0);
    assert!(frame.imaginary.as_ref().is_some_and(|imaginary| imaginary.len() == 208));
    let flags = [Quality::NON_FINITE, Quality::SATURATED, Quality::OVER_RANGE, Quality::GOOD];
    assert_eq!(frame.quality[..4], flags);
}

#[test]
fn every_board_over_a_line() {
    for name in Board::PRESETS {
        let board = Board::preset(name).unwrap();
        let quadruples = match &board.layout {
            eit_hw::Layout::Quadruples(quadruples) => quadruples.clone(),
            other => panic!("{other:?}"),
        };
        let complex = board.format.complex;
        let source = move |sequence: u64, quadruples: &[Quadruple], values: &mut [f64]| {
            let step = if complex { 2 } else { 1 };
            for (parts, [a, b, m, n]) in values.chunks_exact_mut(step).zip(quadruples) {
                // whole numbers, since some boards send no others; below their saturation
                let whole = (a * 37 + b * 11 + m * 5 + n) % 500 + (sequence % 32) as u32 * 500;
                parts.fill(f64::from(whole + 1) / if name == "serial-16" { 4096.0 } else { 1.0 });
            }
        };
        let folder = tempfile::tempdir().unwrap();
        let device = BoardDevice::new(board.clone(), 50.0, Box::new(source));
        let emulator = on_line(device, &folder, FaultPlan::default());
        let driver = board.driver().unwrap();
        let session = Session::open(driver, emulator.endpoint(), quick()).unwrap();
        for frame in frames(&session).take(10) {
            let unit = if name == "serial-16" { 4096.0 } else { 1.0 };
            let number = (frame.values[0] * unit) as u32 / 500;
            for (found, [a, b, m, n]) in frame.values.iter().zip(&quadruples) {
                let whole = (a * 37 + b * 11 + m * 5 + n) % 500 + number * 500;
                assert_eq!(*found, f64::from(whole + 1) / unit, "{name}");
            }
            assert_eq!(frame.imaginary.as_ref(), complex.then_some(&frame.values), "{name}");
        }
        assert_eq!(session.statistics().lost, 0, "{name}");
    }
}

/// Frames of several lines with nothing but pauses between them, as a firmware prints its rows: every value is in its place, and what a
/// busy computer takes for one frame too long is counted, not guessed.
#[test]
fn frames_in_lines_between_pauses() {
    let format = |lines_per_frame, values_per_line| TextFormat {
        lines_per_frame,
        values_per_line,
        ..TextFormat::default()
    };
    let board = |name, format| Board::new(name, 115_200, format, Layout::ProtocolOrder);
    let source = |sequence: u64, _: &[Quadruple], values: &mut [f64]| {
        for (index, value) in values.iter_mut().enumerate() {
            *value = (100 * sequence + index as u64) as f64;
        }
    };
    for (lines, values) in [(4, 3), (12, 1)] {
        let folder = tempfile::tempdir().unwrap();
        let device = BoardDevice::new(board("rows", format(lines, values)), 8.0, Box::new(source));
        let emulator = on_line(device, &folder, FaultPlan::default());
        let driver = board("csv", TextFormat::csv(12)).driver().unwrap();
        let session = Session::open(driver, emulator.endpoint(), quick()).unwrap();
        for frame in frames(&session).take(6) {
            let wanted = (0..12).map(|index| frame.values[0] + f64::from(index));
            assert_eq!(frame.values, wanted.collect::<Vec<_>>());
            assert_eq!(frame.values[0] % 100.0, 0.0);
        }
    }
}

/// Returns potentials that encode drive, electrode and frame, with the current entering at `a`.
fn potential(sequence: u64, [a, b]: [u32; 2], electrode: u32) -> [f64; 2] {
    let driven = f64::from(u8::from(electrode == a)) - f64::from(u8::from(electrode == b));
    let place = f64::from((a * 32 + b) * 32 + electrode + 1) / 131_072.0;
    [0.25 * driven + place, (sequence % 16) as f64 / 64.0]
}

fn sciospec_emulator(
    listen: &Listen,
    electrodes: u32,
    reversed: bool,
    plan: FaultPlan,
) -> Emulator {
    let source = |sequence: u64, drive: [u32; 2], potentials: &mut [[f64; 2]]| {
        for (electrode, slot) in (0..).zip(potentials) {
            *slot = potential(sequence, drive, electrode);
        }
    };
    let device = SciospecDevice::new(electrodes, 0x11F, reversed, Box::new(source));
    Emulator::start(Box::new(device), listen, plan).unwrap()
}

fn sciospec_session(emulator: &Emulator, electrodes: u32, wanted: &[Quadruple]) -> Session {
    let settings = SciospecSettings {
        frame_rate_hz: 100.0,
        ..SciospecSettings::for_quadruples(electrodes, wanted)
    };
    let driver = Box::new(Sciospec::new(settings).unwrap());
    let settings = SessionSettings { quadruples: Some(wanted.to_vec()), ..quick() };
    Session::open(driver, emulator.endpoint(), settings).unwrap()
}

fn check_sciospec(frame: &Frame, wanted: &[Quadruple]) {
    for (index, &[a, b, m, n]) in wanted.iter().enumerate() {
        if frame.quality[index].is_good() {
            let difference = potential(0, [a, b], m)[0] - potential(0, [a, b], n)[0];
            assert_eq!(frame.values[index], difference, "{index} of frame {}", frame.sequence);
            assert_eq!(frame.imaginary.as_ref().unwrap()[index], 0.0);
        }
    }
}

#[test]
fn sciospec_over_a_serial_line_with_either_polarity() {
    for (electrodes, reversed) in [(16, false), (16, true), (32, true)] {
        let folder = tempfile::tempdir().unwrap();
        let emulator =
            sciospec_emulator(&line(&folder), electrodes, reversed, FaultPlan::default());
        let wanted = rotated(electrodes);
        let session = sciospec_session(&emulator, electrodes, &wanted);
        assert_eq!(session.setup().identity.to_string(), "Sciospec 0019 011F (2020-07)");
        let (mut seen, mut polarity, mut events) = (0, Vec::new(), events(&session));
        while seen < 20 {
            match events.next() {
                Some(Event::Frame(frame)) => {
                    assert!(frame.quality.iter().all(|q| q.is_good()), "frame {}", frame.sequence);
                    check_sciospec(&frame, &wanted);
                    seen += 1;
                }
                Some(Event::Notice(text)) => polarity.push(text),
                _ => {}
            }
        }
        assert_eq!(polarity.len(), 1, "{polarity:?}");
        assert_eq!(polarity[0].contains("second"), reversed, "{polarity:?}");
        assert_eq!(session.statistics().damaged_bytes, 0);
    }
}

/// Lost bytes leave gaps, which are flagged; no value is wrong. (Changed bits within a value cannot
/// be detected: this protocol has no checksum.)
#[test]
fn sciospec_on_a_line_that_loses_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let plan = FaultPlan { seed: 3, spared_bytes: 4000, drop_byte: 2e-4, ..FaultPlan::default() };
    let emulator = sciospec_emulator(&line(&folder), 16, false, plan);
    let wanted = rotated(16);
    let session = sciospec_session(&emulator, 16, &wanted);
    let mut holes = 0;
    for frame in frames(&session).take(100) {
        check_sciospec(&frame, &wanted);
        let missing =
            frame.quality.iter().filter(|quality| quality.contains(Quality::MISSING)).count();
        // whole drives are missing
        assert_eq!(missing % 13, 0);
        holes += missing / 13;
    }
    // 2240 bytes per frame and 2e-4: 45 losses in 100 frames, most of which cost one or two drives
    assert!((10..200).contains(&holes), "{holes}");
}

#[test]
fn sciospec_refuses_an_electrode_that_it_does_not_have() {
    let emulator = sciospec_emulator(&own_port(), 16, false, FaultPlan::default());
    // an electrode that the instrument does not have
    let settings = SciospecSettings::for_quadruples(32, &rotated(32));
    let mut driver = Sciospec::new(settings).unwrap();
    let error = identify(&mut driver, emulator.endpoint()).unwrap_err();
    assert!(matches!(&error, HwError::Refused { command: "add a drive", .. }), "{error}");
    assert!(error.to_string().contains("not executed (code 81)"), "{error}");
}

#[test]
fn settings_that_cannot_be_are_refused_by_name() {
    let good = SciospecSettings::for_quadruples(16, &rotated(16));
    for (bad, wanted) in [
        (SciospecSettings { electrodes: 129, ..good.clone() }, "electrodes is 129"),
        (SciospecSettings { drives: vec![], ..good.clone() }, "number of drives is 0"),
        (SciospecSettings { drives: vec![[0, 16]], ..good.clone() }, "drive is (0, 16)"),
        (SciospecSettings { drives: vec![[0, 1], [1, 0]], ..good.clone() }, "drive is (1, 0)"),
        (SciospecSettings { current_a: f64::NAN, ..good.clone() }, "current_a is NaN"),
        (SciospecSettings { current_a: 0.02, ..good.clone() }, "current_a is 0.02"),
        (SciospecSettings { frequency_hz: 10.0, ..good.clone() }, "frequency_hz is 10"),
        (
            SciospecSettings { frame_rate_hz: 0.0, polarity: Polarity::AsListed, ..good },
            "frame_rate_hz is 0",
        ),
    ] {
        let message = Sciospec::new(bad).unwrap_err().to_string();
        assert!(message.starts_with(wanted), "{message}");
    }
    assert!(Eits1::new(&rotated(16), -1.0, 1e-4, 0.0).is_err());
    assert!(Eits1::new(&rotated(16), 10.0, f32::NAN, 0.0).is_err());
    assert!(Board::preset("nothing").unwrap_err().to_string().contains("cn0565-16"));
    let mut board = Board::preset("serial-16").unwrap();
    board.format.values_per_line = 12;
    assert!(board.driver().is_err());
    for (settings, name) in [
        (SessionSettings { capacity: 0, ..quick() }, "capacity"),
        (SessionSettings { stall_s: f64::NAN, ..quick() }, "stall_s"),
    ] {
        assert!(settings.validate().unwrap_err().to_string().starts_with(name));
    }
    let negative = FaultPlan { drop_byte: -0.1, ..FaultPlan::default() };
    assert!(negative.validate().unwrap_err().to_string().starts_with("drop_byte"));
    for text in ["", "tcp:", "tcp:host", "tcp::5", "tcp:host:99999"] {
        let message = Endpoint::parse(text, 9600).unwrap_err().to_string();
        assert!(message.starts_with("port is"), "{message}");
    }
    assert!(Endpoint::parse("/dev/ttyACM0", 0).is_err());
}

#[test]
fn ports_that_cannot_be_opened_and_instruments_that_do_not_answer() {
    let nowhere = Endpoint::parse("/nowhere/ttyACM0", 9600).unwrap();
    let error = identify(&mut *eits1_driver(10.0), &nowhere).unwrap_err();
    let message = error.to_string();
    assert!(message.contains("/nowhere/ttyACM0: cannot be opened"), "{message}");
    assert!(message.contains("plug it in, or name another port"), "{message}");

    // a measurement that the instrument cannot take
    let emulator = start(eits1_device("7"), FaultPlan::default());
    let settings = SessionSettings { quadruples: Some(vec![[0, 8, 2, 3]]), ..quick() };
    let error = Session::open(eits1_driver(10.0), emulator.endpoint(), settings).unwrap_err();
    assert!(matches!(error, HwError::MissingDrive { a: 0, b: 8, .. }), "{error}");
    // an unsupported rate
    let error = identify(&mut *eits1_driver(2000.0), emulator.endpoint()).unwrap_err();
    assert!(error.to_string().contains("value cannot be set"), "{error}");
}

/// Instrument, serial line, driver, recording, reader; unplugged in between.
#[test]
fn a_live_instrument_is_recorded_and_read_like_a_file() {
    use eit_hw::capture::{CaptureSettings, CaptureWriter, SessionRecord};
    let folder = tempfile::tempdir().unwrap();
    let plan =
        FaultPlan { unplug_after_bytes: vec![40_000], unplugged_s: 0.05, ..FaultPlan::default() };
    let emulator = sciospec_emulator(&line(&folder), 16, true, plan);
    let wanted = rotated(16);
    let session = sciospec_session(&emulator, 16, &wanted);
    let path = folder.path().join("press.mcap");
    let record = SessionRecord::of(session.setup(), &wanted);
    let mut writer = CaptureWriter::create(&path, &record, CaptureSettings::default()).unwrap();
    let (mut recorded, mut events) = (Vec::new(), events(&session));
    while recorded.last().is_none_or(|frame: &Frame| frame.epoch == 0) {
        match events.next() {
            Some(Event::Frame(frame)) => {
                writer.frame(&frame).unwrap();
                recorded.push(frame);
            }
            event => writer.note(&format!("{event:?}")).unwrap(),
        }
    }
    writer.finish().unwrap();
    let recording = eit_hw::read_recording(&path, None, &eit_hw::ReadOptions::default()).unwrap();
    let frames = recording.frames_for(Some(&wanted), 208, eit_hw::Component::Real).unwrap();
    assert_eq!(frames.values.nrows(), recorded.len());
    for (found, frame) in frames.values.rows().into_iter().zip(&recorded) {
        let same = |(a, b): (&f64, &f64)| a == b || a.is_nan() && b.is_nan();
        assert!(found.iter().zip(&frame.values).all(same));
    }
    assert_eq!(frames.unit, Unit::Volt);
}

/// A host that disconnects in the middle of a frame leaves a terminal that nobody reads: writing to
/// it blocks, and the emulator stops all the same.
#[cfg(unix)]
#[test]
fn an_emulator_ends_although_nobody_reads_its_terminal() {
    use std::io::{Read, Write};
    struct Chatter;
    impl eit_hw::emulator::Device for Chatter {
        fn receive(&mut self, _: &[u8], _: Duration, _: &mut Vec<u8>) {}
        fn poll(&mut self, _: Duration, out: &mut Vec<u8>) {
            out.extend([0x55; 65_536]);
        }
        fn power_cycle(&mut self) {}
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("skin");
    let listen = Listen::PseudoTerminal(path.clone());
    let mut emulator = Emulator::start(Box::new(Chatter), &listen, FaultPlan::default()).unwrap();
    let mut host = serialport::new(path.display().to_string(), 115_200)
        .timeout(Duration::from_secs(5))
        .open_native()
        .unwrap();
    host.write_all(b"hello").unwrap();
    // it keeps sending, so its next write finds no room
    host.read_exact(&mut [0; 100]).unwrap();
    std::thread::sleep(Duration::from_millis(100));
    drop(host);
    let (done, ended) = std::sync::mpsc::channel();
    std::thread::spawn(move || {
        emulator.stop();
        done.send(()).unwrap();
    });
    ended.recv_timeout(Duration::from_secs(20)).expect("blocked for ever");
    assert!(!path.exists(), "its name stays");
}
