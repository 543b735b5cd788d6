//! Drivers against emulated instruments, over a real serial line (a pseudo-terminal) and TCP, with
//! and without faults. No frame may contain a value that the instrument did not measure.

use std::path::Path;
use std::time::Duration;

use crate::common::instruments::{
    LIMIT, check_eits1, check_sciospec, eits1_device, eits1_driver, eits1_session, falls_silent,
    frames, information, on_line, quick, sciospec_device, sciospec_session, start, take, wait_for,
};
use crate::common::{ascending, place, refused, rotated};
use eit_hw::capture::{CaptureSettings, CaptureWriter, Entry, Recorder, SessionRecord, Tape};
use eit_hw::capture::{TouchesRecord, read};
use eit_hw::codec::eits1::Information;
use eit_hw::codec::text::TextFormat;
use eit_hw::driver::{
    Board, Eits1, Event, FrameSource as _, Overflow, Sciospec, SciospecSettings, Session,
    SessionSettings, identify,
};
use eit_hw::emulator::{BoardDevice, Eits1Device, Emulator, FaultPlan, Listen};
use eit_hw::{Endpoint, HwError, Layout, Quadruple, Quality, Unit};

#[test]
fn eits1_over_a_serial_line_end_to_end() {
    let (_folder, emulator) = on_line(eits1_device("7"), FaultPlan::default());
    // the scene's order differs from the one that the driver measures
    let wanted: Vec<Quadruple> = ascending(16);
    let settings = SessionSettings { quadruples: Some(wanted.clone()), ..quick() };
    let mut session =
        Session::open(eits1_driver(16, 200.0), emulator.endpoint(), settings).unwrap();
    let identity = &session.setup().identity;
    assert_eq!((identity.name.as_str(), identity.serial.as_str()), ("emulated skin", "7"));
    assert_eq!((session.setup().unit, session.setup().frame_rate_hz), (Unit::Volt, Some(200.0)));
    let frames: Vec<_> = frames(&session).take(100).collect();
    for pair in frames.windows(2) {
        check_eits1(&pair[1], &wanted);
        assert_eq!(pair[1].sequence, pair[0].sequence + 1);
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

#[test]
fn eits1_on_a_bad_line_loses_frames_but_tells_no_wrong_one() {
    let plan = FaultPlan {
        seed: 5,
        spared_bytes: 3000,
        drop_byte: 1e-4,
        flip_bit: 1e-4,
        insert_byte: 1e-4,
        ..FaultPlan::default()
    };
    let (_folder, emulator) = on_line(eits1_device("7"), plan);
    let session = Session::open(eits1_driver(16, 400.0), emulator.endpoint(), quick()).unwrap();
    let (frames, others) = take(&session, 500, |_| {});
    for pair in frames.windows(2) {
        let [before, number] = [0, 1].map(|k| check_eits1(&pair[k], &rotated(16)));
        let steps = (pair[1].sequence - pair[0].sequence) % 32;
        assert_eq!((before + steps) % 32, number);
    }
    let lost = |event: &Event| if let Event::Gap { frames } = event { *frames } else { 0 };
    let gaps: u64 = others.iter().map(lost).sum();
    assert_eq!(500 + gaps, frames[499].sequence + 1);
    // 866 bytes per frame: one in four is hit; a tenth and a half are 5 deviations away
    assert!((50..600).contains(&gaps), "{gaps}");
    assert!(session.statistics().damaged_bytes > 10_000 && emulator.statistics().faults > 50);
}

/// Waits for the error that ends a session.
fn end(session: &Session) -> HwError {
    let mut error = None;
    wait_for(|| {
        error = session.next_event(Duration::from_millis(500)).err();
        error.is_some()
    });
    error.unwrap()
}

/// The instrument is found at its path although the system gives it another name; another one there is refused.
#[cfg(unix)]
#[test]
fn another_instrument_on_the_same_port_is_refused() {
    let (_folder, path) = place("skin");
    let plug_in = |serial| {
        let listen = Listen::PseudoTerminal(path.clone());
        Emulator::start(Box::new(eits1_device(serial)), &listen, FaultPlan::default()).unwrap()
    };
    let mut first = plug_in("7");
    let session = eits1_session(&first, 16);
    frames(&session).nth(4);
    // keeps its name in use while the second one starts
    let _keep = std::fs::File::open(std::fs::read_link(&path).unwrap());
    first.stop();
    let mut second = plug_in("7");
    check_eits1(&frames(&session).find(|frame| frame.epoch == 1).unwrap(), &rotated(16));
    second.stop();
    let _third = plug_in("8");
    let error = end(&session);
    let HwError::Identity { wanted, found, .. } = &error else { panic!("{error}") };
    assert_eq!((wanted.as_str(), found.as_str()), ("emulated skin 7", "emulated skin 8"));
    // reported once, then the session is over
    assert_eq!(session.next_event(Duration::from_millis(500)).unwrap(), None);
}

#[test]
fn an_instrument_that_is_too_small_is_refused() {
    for (electrodes, max_measurements, wanted) in [
        (8, 256, "the number of electrodes was set to 16, but the instrument reports at most 8"),
        (16, 4, "the number of measurements was set to "),
    ] {
        let small = Information { electrodes, max_measurements, ..information("7", false) };
        let device = Eits1Device::new(small, Box::new(|_, _, values| values.fill(1.0)));
        let (_folder, emulator) = on_line(device, FaultPlan::default());
        let session = Session::open(eits1_driver(16, 100.0), emulator.endpoint(), quick());
        refused(session, &[wanted, "but the instrument reports", "choose a supported value"]);
    }
}

#[test]
fn a_lost_instrument_ends_a_session_that_does_not_reconnect() {
    let mut emulator = start(eits1_device("7"), FaultPlan::default());
    let settings = SessionSettings { reconnect: None, ..quick() };
    let session = Session::open(eits1_driver(16, 200.0), emulator.endpoint(), settings).unwrap();
    emulator.stop();
    let error = end(&session);
    assert!(matches!(error, HwError::Lost { .. }), "{error}");
}

/// However slow the consumer is, a recording has every frame from its beginning to the end of the instrument; the
/// consumer gets the latest, and is told how many it skipped.
#[test]
fn a_recording_waits_for_nobody() {
    let emulator = start(eits1_device("7"), FaultPlan::default());
    let settings = SessionSettings { capacity: 8192, overflow: Overflow::Fail, ..quick() };
    let session = Session::open(eits1_driver(16, 200.0), emulator.endpoint(), settings).unwrap();
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
        ended.unwrap().unwrap();
    };
    // sequences of the frames, and the number of touches
    let recorded = |path: &Path| {
        let capture = read(path).unwrap();
        let frames: Vec<u64> = capture.frames().map(|frame| frame.sequence).collect();
        assert!(frames.windows(2).all(|pair| pair[1] == pair[0] + 1), "{frames:?}");
        (frames, capture.entries.iter().filter(|entry| matches!(entry, Entry::Touches(_))).count())
    };
    let files = ["first.mcap", "second.mcap"].map(|name| folder.path().join(name));
    let record = SessionRecord::default();
    let create =
        |path: &Path| CaptureWriter::create(path, &record, CaptureSettings::default()).unwrap();
    assert!(matches!(recorder.next_event(LIMIT).unwrap(), Some(Event::Frame(_))));
    wait_for(|| recorder.statistics().frames > 20);
    assert!(!tape.is_on());
    tape.write(|| panic!("made although nothing is recorded"));
    let before = recorder.statistics().frames;
    tape.begin(create(&files[0]));
    wait_for(|| recorder.statistics().frames > before + 60);
    let json = r#"{"sequence":0,"touches":[]}"#;
    tape.write(|| Entry::Touches(TouchesRecord::new(json.to_owned()).unwrap()));
    tape.end();
    ended(&tape);
    tape.begin(create(&files[1]));
    wait_for(|| recorder.statistics().frames > before + 120);
    recorder.stop();
    ended(&tape);
    let ((first, touches), (second, _)) = (recorded(&files[0]), recorded(&files[1]));
    assert!(first.len() >= 60 && second.len() >= 30, "{} {}", first.len(), second.len());
    assert_eq!(touches, 1);
    let statistics = recorder.statistics();
    let events: Vec<Event> =
        std::iter::from_fn(|| recorder.next_event(Duration::ZERO).unwrap()).collect();
    let [Event::Skipped { frames }, taken @ .., Event::Frame(last)] = &events[..] else {
        panic!("{events:?}")
    };
    assert_eq!((*frames, taken.len()), (statistics.dropped, 3));
    assert_eq!(statistics.frames, 1 + frames + 4);
    assert_eq!(second.last(), Some(&last.sequence));
    assert!(recorder.is_over());
}

/// Every preset, and frames of several lines with nothing but pauses between them, as a firmware prints its rows.
#[test]
fn every_board_over_a_line() {
    let format = |lines_per_frame, values_per_line| TextFormat {
        lines_per_frame,
        values_per_line,
        ..TextFormat::default()
    };
    let rows = |name, format| Board::new(name, 115_200, format, Layout::Quadruples(rotated(16)));
    let of = |format| (rows("rows", format), rows("csv", TextFormat::csv(208)), 8.0);
    let preset = |name: &&str| {
        let board = Board::preset(name).unwrap();
        (board.clone(), board, 50.0)
    };
    // what sends, what is expected, and the frame rate
    let presets = Board::PRESETS.iter().map(preset);
    for (sent, expected, rate_hz) in presets.chain([of(format(16, 13)), of(format(208, 1))]) {
        let name = sent.name.clone();
        let Layout::Quadruples(quadruples) = &sent.layout else { panic!("{name}") };
        let step = if sent.format.complex { 2 } else { 1 };
        // some boards send whole numbers only; below their saturation
        let unit = if name == "serial-16" { 4096.0 } else { 1.0 };
        let value = move |sequence: u64, [a, b, m, n]: Quadruple| {
            let whole = (a * 37 + b * 11 + m * 5 + n) % 500 + (sequence % 32) as u32 * 500;
            f64::from(whole + 1) / unit
        };
        let source = move |sequence: u64, quadruples: &[Quadruple], values: &mut [f64]| {
            for (parts, &quadruple) in values.chunks_exact_mut(step).zip(quadruples) {
                parts.fill(value(sequence, quadruple));
            }
        };
        let device = BoardDevice::new(sent.clone(), rate_hz, Box::new(source));
        let (_folder, emulator) = on_line(device, FaultPlan::default());
        let driver = expected.driver().unwrap();
        let session = Session::open(driver, emulator.endpoint(), quick()).unwrap();
        for frame in frames(&session).take(if rate_hz < 10.0 { 6 } else { 10 }) {
            let number = (frame.values[0] * unit) as u64 / 500;
            for (found, &quadruple) in frame.values.iter().zip(quadruples) {
                assert_eq!(*found, value(number, quadruple), "{name}");
            }
            assert_eq!(frame.imaginary.as_ref(), (step == 2).then_some(&frame.values), "{name}");
        }
        // a busy computer may take a pause for one within a frame
        assert!(session.statistics().lost == 0 || rate_hz < 10.0, "{name}");
    }
}

#[test]
fn sciospec_over_a_serial_line_with_either_polarity() {
    for (electrodes, reversed) in [(16, false), (16, true), (32, true)] {
        let device = sciospec_device(electrodes, reversed);
        let (_folder, emulator) = on_line(device, FaultPlan::default());
        let session = sciospec_session(&emulator, electrodes);
        assert_eq!(session.setup().identity.to_string(), "Sciospec 0019 011F (2020-07)");
        let (_, mut polarity) = take(&session, 20, |frame| {
            assert!(frame.quality.iter().all(|q| q.is_good()), "frame {}", frame.sequence);
            check_sciospec(frame, &rotated(electrodes));
        });
        polarity.retain(|event| matches!(event, Event::Notice(_)));
        let [Event::Notice(text)] = &polarity[..] else { panic!("{polarity:?}") };
        assert_eq!(text.contains("second"), reversed, "{text}");
        assert_eq!(session.statistics().damaged_bytes, 0);
    }
}

/// Lost bytes leave gaps, which are flagged; no value is wrong.
#[test]
fn sciospec_on_a_line_that_loses_bytes() {
    let plan = FaultPlan { seed: 3, spared_bytes: 4000, drop_byte: 2e-4, ..FaultPlan::default() };
    let (_folder, emulator) = on_line(sciospec_device(16, false), plan);
    let session = sciospec_session(&emulator, 16);
    let mut holes = 0;
    for frame in frames(&session).take(100) {
        check_sciospec(&frame, &rotated(16));
        let missing = frame.quality.iter().filter(|q| q.contains(Quality::MISSING)).count();
        // whole drives are missing
        assert_eq!(missing % 13, 0);
        holes += missing / 13;
    }
    // 2240 bytes per frame and 2e-4: 45 losses in 100 frames, most of which cost one or two drives
    assert!((10..200).contains(&holes), "{holes}");
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
        (SciospecSettings { frame_rate_hz: 0.0, ..good }, "frame_rate_hz is 0"),
    ] {
        let message = Sciospec::new(bad).unwrap_err().to_string();
        assert!(message.starts_with(wanted), "{message}");
    }
    assert!(Eits1::new(&rotated(16), -1.0, 1e-4, 0.0).is_err());
    assert!(Eits1::new(&rotated(16), 10.0, f32::NAN, 0.0).is_err());
    refused(Board::preset("nothing"), &["cn0565-16"]);
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
fn what_an_instrument_cannot_do_is_refused_by_name() {
    let nowhere = Endpoint::parse("/nowhere/ttyACM0", 9600).unwrap();
    let words = ["/nowhere/ttyACM0: cannot be opened", "plug it in, or name another port"];
    refused(identify(&mut *eits1_driver(16, 10.0), &nowhere), &words);

    // an electrode that the instrument does not have
    let emulator = start(sciospec_device(16, false), FaultPlan::default());
    let settings = SciospecSettings::for_quadruples(32, &rotated(32));
    let told = identify(&mut Sciospec::new(settings).unwrap(), emulator.endpoint());
    refused(told, &["refused to add a drive: ", "not executed (code 81)"]);

    // a measurement that the instrument cannot take, and an unsupported rate
    let emulator = start(eits1_device("7"), FaultPlan::default());
    let settings = SessionSettings { quadruples: Some(vec![[0, 8, 2, 3]]), ..quick() };
    let session = Session::open(eits1_driver(16, 10.0), emulator.endpoint(), settings);
    refused(session, &["has no drive (0, 8)"]);
    let mut fast = eits1_driver(16, 2000.0);
    refused(identify(&mut *fast, emulator.endpoint()), &["value cannot be set"]);
}

/// A host that disconnects leaves a terminal that nobody reads: writing blocks, and the emulator stops all the same.
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
    let (_folder, path) = place("skin");
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
    ended.recv_timeout(Duration::from_secs(20)).unwrap();
    assert!(!path.exists(), "its name stays");
}
