//! Rows 5, 6 and 8 to 10: faults of the connection and of the dialogue.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use eit_hw::codec::eits1::{Information, Kind, Message, encode};
use eit_hw::codec::sciospec as wire;
use eit_hw::codec::text::TextFormat;
use eit_hw::driver::{Board, Driver, Eits1, Event, Overflow, Session, SessionSettings, identify};
use eit_hw::emulator::{BoardDevice, Device, Eits1Device, Emulator, FaultPlan};
use eit_hw::{Endpoint, Frame, HwError, Layout, Link, Quadruple};

use crate::common::instruments::{
    self, LIMIT, eits1_device, eits1_driver, eits1_session, events, falls_silent, information,
    on_line, quick, sciospec_device, sciospec_driver, start, take, wait_for,
};
use crate::common::wire::sciospec_frame;
use crate::common::{refused, rotated};

fn check_eits1(frame: &Frame) {
    instruments::check_eits1(frame, &rotated(8));
}

fn check_sciospec(frame: &Frame) {
    instruments::check_sciospec(frame, &rotated(8));
}

/// A device whose answers are modified before they are sent.
struct Meddled<D, F>(D, F);

impl<D: Device, F: FnMut(Duration, &mut Vec<u8>) + Send> Device for Meddled<D, F> {
    fn receive(&mut self, bytes: &[u8], now: Duration, out: &mut Vec<u8>) {
        let mut answer = Vec::new();
        self.0.receive(bytes, now, &mut answer);
        (self.1)(now, &mut answer);
        out.append(&mut answer);
    }

    fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        let mut sent = Vec::new();
        self.0.poll(now, &mut sent);
        (self.1)(now, &mut sent);
        out.append(&mut sent);
    }

    fn power_cycle(&mut self) {
        self.0.power_cycle();
    }
}

/// Opens a session with a Sciospec instrument whose answers are modified.
fn meddled(meddle: impl FnMut(Duration, &mut Vec<u8>) + Send + 'static) -> (Emulator, Session) {
    let emulator = start(Meddled(sciospec_device(8, false), meddle), FaultPlan::default());
    let session = instruments::sciospec_session(&emulator, 8);
    (emulator, session)
}

/// Place of the first acknowledgement.
fn acknowledged(sent: &[u8]) -> Option<usize> {
    let executed = system(wire::Code::Executed);
    sent.windows(4).position(|window| window == executed)
}

fn system(code: wire::Code) -> Vec<u8> {
    let mut bytes = Vec::new();
    wire::encode(wire::TAG_SYSTEM, &[code.byte()], &mut bytes);
    bytes
}

#[test]
fn row_05_an_old_stream_still_runs_at_opening() {
    // starts the instrument and leaves without stopping it
    let leave_streaming = |mut driver: Box<dyn Driver>, emulator: &Emulator, start: &[u8]| {
        let Endpoint::Tcp { address } = emulator.endpoint() else { panic!("tcp") };
        identify(&mut *driver, emulator.endpoint()).unwrap();
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(start).unwrap();
        stream.set_read_timeout(Some(LIMIT)).unwrap();
        stream.read_exact(&mut [0; 700]).unwrap();
    };
    let emulator = start(sciospec_device(8, false), FaultPlan::default());
    let mut begin = Vec::new();
    wire::encode(wire::TAG_DATA, &[1], &mut begin);
    leave_streaming(sciospec_driver(8), &emulator, &begin);
    let session = instruments::sciospec_session(&emulator, 8);
    take(&session, 10, check_sciospec);
    assert_eq!(session.statistics().lost, 0);

    let emulator = start(eits1_device("7"), FaultPlan::default());
    let mut begin = vec![0];
    let (kind, payload) = (Kind::Start, &[][..]);
    let message = Message { kind, sequence: 1, device_time_us: 0, flags: 0, count: 0, payload };
    encode(&message, &mut begin).unwrap();
    leave_streaming(eits1_driver(8, 200.0), &emulator, &begin);
    let session = eits1_session(&emulator, 8);
    take(&session, 10, check_eits1);
    assert_eq!((session.statistics().lost, session.statistics().damaged_bytes), (0, 0));
}

/// A board that streams from its start with a banner; the host connects in the middle of a frame.
#[test]
fn row_05_boot_text_and_half_a_frame_at_opening() {
    let board = Board { first_frame_s: 20.0, ..Board::preset("black-sensor-16").unwrap() };
    let source = |number: u64, _: &[Quadruple], values: &mut [f64]| {
        let first = 1000 * (number % 8);
        values.iter_mut().zip(first..).for_each(|(value, whole)| *value = whole as f64);
    };
    let device = BoardDevice::new(board.clone(), 40.0, Box::new(source));
    let mut begun = false;
    let meddle = move |_: Duration, sent: &mut Vec<u8>| {
        if !std::mem::replace(&mut begun, true) {
            sent.splice(0..0, *b"12,13,14,\r\nrst:0x1 (POWERON)\xFF\xFE\r\nMODE = ADJACENT\n");
        }
    };
    let emulator = start(Meddled(device, meddle), FaultPlan::default());
    let session = Session::open(board.driver().unwrap(), emulator.endpoint(), quick()).unwrap();
    take(&session, 10, |frame| {
        assert!(frame.values.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "{frame:?}");
    });
}

/// The fourth answer is modified; the driver repeats the set-up, or reports what was refused.
#[test]
fn row_06_acknowledgement_lost_late_or_negative() {
    let change = |to: Vec<u8>| {
        let mut seen = 0;
        move |_: Duration, sent: &mut Vec<u8>| {
            if let Some(place) = acknowledged(sent) {
                if seen == 3 {
                    sent.splice(place..place + 4, to.clone());
                }
                seen += 1;
            }
        }
    };
    // lost or misunderstood once: the whole set-up is sent again
    let codes = [wire::Code::Syntax, wire::Code::Timeout, wire::Code::Unknown].map(system);
    std::thread::scope(|scope| {
        for to in [&[Vec::new()][..], &codes].concat() {
            let meddle = change(to);
            scope.spawn(|| {
                let (_emulator, session) = meddled(meddle);
                take(&session, 3, check_sciospec);
            });
        }
        // always lost: reported after the attempts, without an endless wait
        let device = Meddled(sciospec_device(8, false), |_, sent: &mut Vec<u8>| sent.clear());
        let emulator = start(device, FaultPlan::default());
        let begun = Instant::now();
        let error = identify(&mut *sciospec_driver(8), emulator.endpoint()).unwrap_err();
        assert!(matches!(error, HwError::NoReply { driver: "sciospec", .. }), "{error}");
        assert!(begun.elapsed() < LIMIT);
    });
    // refused: reported at once, with the command
    let device = Meddled(sciospec_device(8, false), change(system(wire::Code::NotExecuted)));
    let emulator = start(device, FaultPlan::default());
    let begun = Instant::now();
    refused(identify(&mut *sciospec_driver(8), emulator.endpoint()), &["instrument refused to"]);
    assert!(begun.elapsed() < Duration::from_secs(5));
    // each answer 100 ms late
    let mut waiting: Vec<(Duration, Vec<u8>)> = Vec::new();
    let (_emulator, session) = meddled(move |now, sent| {
        if !sent.is_empty() {
            waiting.push((now + Duration::from_millis(100), std::mem::take(sent)));
        }
        while waiting.first().is_some_and(|(due, _)| *due <= now) {
            sent.extend(waiting.remove(0).1);
        }
    });
    take(&session, 5, check_sciospec);
}

#[test]
fn row_06_data_before_the_acknowledgement_and_hold_up_in_the_stream() {
    // stray data before each acknowledgement
    let (_emulator, session) = meddled(|_, sent| {
        if let Some(place) = acknowledged(sent) {
            sent.splice(place..place, sciospec_frame(1, [1, 2], 1, 5));
        }
    });
    let (_, others) = take(&session, 1, |_| {});
    assert!(!others.iter().any(|event| matches!(event, Event::Disconnected { .. })));
    take(&session, 5, check_sciospec);

    let mut bursts = 0_u32;
    let (_emulator, session) = meddled(move |_, sent| {
        if sent.len() > 300 {
            bursts += 1;
            if bursts.is_multiple_of(3) {
                // between two data frames
                sent.splice(140..140, system(wire::Code::HoldUp(0x92)));
            }
        }
    });
    // a busy computer sends several frames in a burst
    let mut told = 0;
    while told < 3 && session.statistics().frames < 360 {
        let (frames, others) = take(&session, 12, check_sciospec);
        assert!(frames.iter().all(|frame| frame.epoch == 0));
        let is_told =
            |event: &&Event| matches!(event, Event::Notice(text) if text.contains("held up"));
        told += others.iter().filter(is_told).count();
    }
    assert!(told >= 3, "{told}");
    assert_eq!(session.statistics().lost, 0);
}

#[test]
fn row_06_a_reset_in_the_stream_begins_a_new_epoch() {
    let mut bursts = 0;
    let (_emulator, session) = meddled(move |_, sent| {
        if sent.len() > 300 {
            bursts += 1;
            if bursts == 5 {
                sent.extend(system(wire::Code::Booted));
            }
        }
    });
    let (mut after, mut news) = (0, Vec::new());
    while after < 5 {
        let (frames, others) = take(&session, 1, check_sciospec);
        after += frames[0].epoch;
        news.extend(others);
    }
    news.retain(|event| !matches!(event, Event::Notice(_)));
    let wanted = matches!(news[..], [Event::Disconnected { .. }, Event::Reconnected { epoch: 1 }]);
    assert!(wanted, "{news:?}");
    assert_eq!(session.statistics().reconnections, 1);
}

/// Unplugged at each place of a frame, and again while being set up.
#[test]
fn row_08_unplugged_anywhere() {
    // frames have 192 bytes
    for within in [0, 1, 90, 191] {
        let at = 2000 + within;
        // again while it is identified and set up: 20 and 150 bytes later
        let unplug_after_bytes = vec![at, at + 20, at + 170];
        let plan = FaultPlan { unplug_after_bytes, unplugged_s: 0.03, ..FaultPlan::default() };
        let (_folder, emulator) = on_line(eits1_device("7"), plan);
        let session = eits1_session(&emulator, 8);
        let (mut last, mut after, mut news, mut events) = (None, 0, Vec::new(), events(&session));
        while after < 10 {
            match events.next().unwrap() {
                Event::Frame(frame) => {
                    check_eits1(&frame);
                    assert!(last.is_none_or(|last| frame.sequence > last), "{within}");
                    // the clock restarts with the instrument
                    assert!(frame.device_time_s.unwrap() >= 0.0);
                    last = Some(frame.sequence);
                    after += u32::from(frame.epoch > 0);
                }
                Event::Reconnected { epoch } => news.push(epoch),
                _ => {}
            }
        }
        assert!(emulator.statistics().faults == 3, "{within}");
        // each connection has an epoch of its own
        assert_eq!(news, (1..=news.len() as u32).collect::<Vec<_>>(), "{within}");
        assert_eq!(session.statistics().reconnections as usize, news.len(), "{within}");
    }
}

/// During the first command there is nothing to reconnect to: the error names the port.
#[test]
fn row_08_unplugged_during_the_first_command() {
    let plan = FaultPlan { unplug_after_bytes: vec![5], unplugged_s: 5.0, ..FaultPlan::default() };
    let emulator = start(eits1_device("7"), plan);
    let begun = Instant::now();
    let error = Session::open(eits1_driver(8, 200.0), emulator.endpoint(), quick()).unwrap_err();
    assert!(matches!(error, HwError::Lost { .. } | HwError::NoReply { .. }), "{error}");
    assert!(error.to_string().contains(&emulator.endpoint().to_string()), "{error}");
    assert!(begun.elapsed() < Duration::from_secs(10));
}

#[test]
fn row_08_a_session_stops_at_once_while_it_looks_for_the_instrument() {
    let mut emulator = start(eits1_device("7"), FaultPlan::default());
    let Endpoint::Tcp { address } = emulator.endpoint().clone() else { panic!("tcp") };
    let mut session = eits1_session(&emulator, 8);
    take(&session, 3, check_eits1);
    emulator.stop();
    // another program listens there and never answers: each attempt takes seconds
    let listener = loop {
        if let Ok(listener) = std::net::TcpListener::bind(&address) {
            break listener;
        }
    };
    let _peer = listener.accept().unwrap();
    let begun = Instant::now();
    session.stop();
    // waiting for the answer would take 2 s; a read takes 20 ms, the rest allows for a busy computer
    assert!(begun.elapsed() < Duration::from_millis(1500), "{:?}", begun.elapsed());
}

/// Frames taken and those reported as skipped are all frames, in order, for a consumer that stalls twice.
#[test]
fn row_09_a_consumer_that_is_slow_or_gone() {
    let emulator = start(eits1_device("7"), FaultPlan::default());
    let robot = SessionSettings { capacity: 3, ..quick() };
    let session = Session::open(eits1_driver(8, 500.0), emulator.endpoint(), robot).unwrap();
    let (mut next, mut stalls) = (0, 0);
    for taken in 0..40 {
        if taken % 20 == 10 {
            let dropped = session.statistics().dropped;
            wait_for(|| session.statistics().dropped > dropped + 30);
        }
        match session.next_event(LIMIT).unwrap() {
            Some(Event::Frame(frame)) => {
                check_eits1(&frame);
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
    let statistics = session.statistics();
    assert!(stalls >= 2 && statistics.dropped > 60 && statistics.lost == 0, "{statistics:?}");
    // dropping the consumer stops the instrument
    drop(session);
    falls_silent(&emulator);
    // and the next consumer is served
    let recorder = SessionSettings { capacity: 4, overflow: Overflow::Fail, ..quick() };
    let session = Session::open(eits1_driver(8, 200.0), emulator.endpoint(), recorder).unwrap();
    wait_for(|| session.statistics().frames >= 5);
    let (frames, _) = take(&session, 4, check_eits1);
    assert_eq!(frames.iter().map(|f| f.sequence).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert!(matches!(session.next_event(LIMIT), Err(HwError::Overflow { capacity: 4, .. })));
}

/// Bytes arrive one by one with pauses: the frames are complete all the same, and the stall is reported.
#[test]
fn row_10_a_trickle_and_a_stall() {
    let mut held: std::collections::VecDeque<u8> = Default::default();
    let meddle = move |now: Duration, sent: &mut Vec<u8>| {
        held.extend(sent.drain(..));
        // silence from 2 s to 3 s after the start
        if !(2.0..3.0).contains(&now.as_secs_f64()) {
            sent.extend(held.drain(..held.len().min(7)));
        }
    };
    let emulator = start(Meddled(eits1_device("7"), meddle), FaultPlan::default());
    let settings = SessionSettings { silence_s: 0.4, ..quick() };
    let session = Session::open(eits1_driver(8, 5.0), emulator.endpoint(), settings).unwrap();
    let (mut frames, mut stalls, mut events) = (0, 0, events(&session));
    while frames < 5 || stalls == 0 {
        match events.next() {
            Some(Event::Frame(frame)) => {
                check_eits1(&frame);
                frames += 1;
            }
            Some(Event::Silent { for_s, .. }) => {
                assert!(for_s >= 0.4);
                stalls += 1;
            }
            _ => {}
        }
    }
    assert_eq!(session.statistics().damaged_bytes, 0);
}

/// The emulated instrument abandons a command with a pause of more than 10 ms, as the real one is said to.
#[test]
fn row_10_a_command_with_a_pause_in_it() {
    let emulator = start(sciospec_device(8, false), FaultPlan::default());
    let Endpoint::Tcp { address } = emulator.endpoint() else { panic!("tcp") };
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_nodelay(true).unwrap();
    stream.set_read_timeout(Some(LIMIT)).unwrap();
    stream.write_all(&[wire::TAG_SET_SETUP, 3]).unwrap();
    let mut answer = [0; 4];
    stream.read_exact(&mut answer).unwrap();
    assert_eq!(answer, [0x18, 1, 0x02, 0x18]);
}

#[cfg(unix)]
#[test]
fn a_wrong_baud_rate_or_driver_is_told_by_what_comes() {
    let board = Board::preset("serial-16").unwrap();
    let values = |_: u64, _: &[Quadruple], values: &mut [f64]| values.fill(0.5);
    let device = BoardDevice::new(board.clone(), 40.0, Box::new(values));
    let plan = FaultPlan { line_baud: Some(115_200), ..FaultPlan::default() };
    let (_folder, emulator) = on_line(device, plan);
    let Endpoint::Serial { path, .. } = emulator.endpoint().clone() else { panic!("serial") };
    let at = |baud| Endpoint::Serial { path: path.clone(), baud, dtr: None };
    let driver = || Board { first_frame_s: 0.5, ..board.clone() }.driver().unwrap();
    refused(identify(&mut *driver(), &at(9600)), &["baud rate of 9600 is probably wrong"]);
    assert!(identify(&mut *driver(), &at(115_200)).is_ok());

    // text where EITS-1 or another board was expected
    let error = identify(&mut *eits1_driver(8, 200.0), &at(115_200)).unwrap_err().to_string();
    assert!(error.contains("lines of text with 13 numbers"), "{error}");
    let steps = Vec::new();
    let other = Board { first_frame_s: 0.5, steps, ..Board::preset("openeit-16").unwrap() };
    let error = identify(&mut *other.driver().unwrap(), &at(115_200)).unwrap_err().to_string();
    assert!(error.contains("lines of 13 numbers, which this board does not send"), "{error}");
    // a second program
    let _first = Link::open(&at(115_200)).unwrap();
    refused(Link::open(&at(115_200)), &["another program uses the port"]);
}

/// On a slow line the set-up's 858 or 3 700 bytes there and back take longer than half a second.
#[cfg(unix)]
#[test]
fn a_set_up_takes_the_time_of_its_line() {
    for (electrodes, baud) in [(16, 9600), (32, 57_600)] {
        let plan = FaultPlan { line_baud: Some(baud), ..FaultPlan::default() };
        let quadruples = rotated(electrodes);
        let (electrodes, max_measurements) = (electrodes as u16, quadruples.len() as u16);
        let information = Information { electrodes, max_measurements, ..information("7", false) };
        let source = |_: u64, _: &[Quadruple], values: &mut [f64]| values.fill(0.5);
        let (_folder, emulator) = on_line(Eits1Device::new(information, Box::new(source)), plan);
        let Endpoint::Serial { path, .. } = emulator.endpoint().clone() else { panic!("serial") };
        let mut driver = Eits1::new(&quadruples, 0.5, 1e-4, 0.0).unwrap();
        let begun = Instant::now();
        let setup = identify(&mut driver, &Endpoint::Serial { path, baud, dtr: None });
        let took_s = begun.elapsed().as_secs_f64();
        assert_eq!(setup.unwrap().value_count, quadruples.len());
        // at least the time of the bytes there and back: the line is as slow as its rate
        let line_s = 2.0 * 4.0 * quadruples.len() as f64 * 10.0 / f64::from(baud);
        assert!(took_s > 0.9 * line_s && took_s < 20.0, "{electrodes} at {baud}: {took_s:.2} s");
    }
}

/// If an instrument identifies itself and then falls silent, the error does not name the baud rate.
#[test]
fn an_instrument_that_falls_silent_in_the_set_up_is_reported() {
    // it has no answer to long commands
    let meddle = |_: Duration, sent: &mut Vec<u8>| {
        if sent.len() > 100 {
            sent.clear();
        }
    };
    let emulator = start(Meddled(eits1_device("7"), meddle), FaultPlan::default());
    let error = identify(&mut *eits1_driver(8, 5.0), emulator.endpoint());
    let error = error.unwrap_err().to_string();
    assert!(error.contains("identified itself but did not answer"), "{error}");
    assert!(error.contains("use the configuration") && !error.contains("baud"), "{error}");
}

#[test]
fn a_board_of_other_electrodes_is_told_by_both_counts() {
    let of = |electrodes: u32| {
        let values_per_line = rotated(electrodes).len();
        let format = TextFormat { values_per_line, ..Default::default() };
        let layout = Layout::Quadruples(rotated(electrodes));
        Board { layout, format, first_frame_s: 0.6, ..Board::preset("serial-16").unwrap() }
    };
    let values = |_: u64, _: &[Quadruple], values: &mut [f64]| values.fill(0.5);
    let emulator = start(BoardDevice::new(of(16), 20.0, Box::new(values)), FaultPlan::default());
    let wanted = Board { steps: Vec::new(), request: None, ..of(8) };
    let told = identify(&mut *wanted.driver().unwrap(), emulator.endpoint());
    refused(told, &["complete lines of 208 numbers", "has 40 measurements", "16"]);
}
