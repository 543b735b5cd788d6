//! Lines as their readers get them.

use crate::common::{FAULTS, datagrams, received, schema, start, touch, wait_for};
use eit_publish::{PublishError, Publisher, Start, UdpSink};
use eit_skin::eit_hw::driver::Event;
use eit_skin::faults::ElectrodeFault;
use eit_skin::{LearntTouch, Touch, TouchFrame};
use serde_json::{Value, json};
use std::io::{self, Write};
use std::net::UdpSocket;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Memory that a publisher writes to and a test reads; counts flushes, and takes nothing while it is shut.
#[derive(Clone, Default)]
struct Shared {
    written: Arc<Mutex<(Vec<u8>, usize)>>,
    is_shut: Arc<AtomicBool>,
}

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        while self.is_shut.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.written.lock().unwrap().0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.written.lock().unwrap().1 += 1;
        Ok(())
    }
}

impl Shared {
    fn shut() -> Self {
        Self { is_shut: Arc::new(true.into()), ..Self::default() }
    }

    fn open(&self) {
        self.is_shut.store(false, Ordering::Relaxed);
    }

    fn flushes(&self) -> usize {
        self.written.lock().unwrap().1
    }

    fn lines(&self) -> Vec<Value> {
        let text = String::from_utf8(self.written.lock().unwrap().0.clone()).unwrap();
        assert!(text.ends_with('\n'));
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

fn frame<'a>(touches: &'a [Touch], faults: &'a [ElectrodeFault]) -> TouchFrame<'a> {
    TouchFrame { number: 60, ..crate::common::frame(100, touches, faults) }
}

/// The lines of a publisher, which fit the schema.
fn lines(speak: impl FnOnce(&mut Publisher)) -> Vec<Value> {
    let out = Shared::default();
    speak(&mut Publisher::new().with_lines(out.clone()).unwrap());
    assert!(out.written.lock().unwrap().0.is_ascii(), "nothing that moves a cursor");
    let (lines, schema) = (out.lines(), schema());
    for line in &lines {
        assert!(schema.is_valid(line), "{line}: {:?}", schema.validate(line).err());
    }
    assert_eq!(out.flushes(), lines.len(), "a flush for each line");
    lines
}

/// Every kind of line.
fn speak(publisher: &mut Publisher) {
    publisher.start(&start()).unwrap();
    (0..40).rev().for_each(|left| publisher.waiting(left).unwrap());
    publisher.touches(&frame(&[], &[])).unwrap();
    publisher.touches(&frame(&[touch(), touch()], &FAULTS)).unwrap();
    publisher.event(&Event::Gap { frames: 3 }).unwrap();
    publisher.event(&Event::Skipped { frames: 5 }).unwrap();
    publisher.event(&Event::Notice("low battery".into())).unwrap();
    publisher.event(&Event::Silent { for_s: 0.5, bytes: 0 }).unwrap();
    publisher.event(&Event::Disconnected { reason: "unplugged".into() }).unwrap();
    publisher.event(&Event::Reconnected { epoch: 1 }).unwrap();
    publisher.end().unwrap();
}

#[test]
fn every_line_fits_the_schema_and_says_what_happened() {
    let lines = lines(speak);
    let said: Vec<&str> = lines
        .iter()
        .map(|line| line["event"].as_str().or(line["type"].as_str()).unwrap())
        .collect();
    let wanted = "start reference_started reference_taken frame frame gap skipped notice frame silent \
                  disconnected reconnected ended";
    assert_eq!(said.join(" "), wanted);
    assert_eq!(lines[0]["instrument"], "a \"board\"\nof 16");
    assert_eq!(lines[1]["frames"], 39);
    assert_eq!((&lines[5]["frames"], &lines[6]["frames"]), (&json!(3), &json!(5)));
    assert_eq!((&lines[8]["state"], &lines[8]["sequence"]), (&json!("no_data"), &json!(100)));
    let touches = lines[8]["touches"].as_array().unwrap();
    assert_eq!(touches.len(), 2);
    assert!(touches.iter().all(|touch| touch["state"] == "end" && touch["valid"] == false));
    assert_eq!(lines[9]["for_s"], 0.5);
    // epochs of this program are not those of another one
    let first = lines[0]["epoch"].as_u64().unwrap();
    assert!(first > 1_700_000_000, "{first}");
    assert_eq!((&lines[11]["epoch"], &lines[12]["frames"]), (&json!(first + 1), &json!(2)));
    let wanted = json!({
        "id": 7, "state": "hold", "position_m": [0.03, -0.01, 0.0],
        "position_std_m": [2e-3, 1e-3, 0.0], "normal": [0.6, 0.0, 0.8], "velocity_m_s": [0.1, 0.0, -0.0],
        "intensity_s_m2": 2.5e-11, "intensity_std_s_m2": 1e-12, "confidence": 0.97, "valid": true,
        "whole": false, "age_s": 0.12, "force_n": null, "force_std_n": null,
        "unlike": null, "split_from": null, "merged_into": 3,
    });
    let wanted = json!({
        "type": "frame", "sequence": 100, "epoch": first + 1, "time_s": 2.0, "host_time_s": 1_700_000_000.25,
        "latency_s": 2e-3, "state": "sound", "whole": false, "explained": true, "frozen": false,
        "faulty_electrodes": [{ "electrode": 5, "fault": "stuck", "since_s": 1.5 }],
        "touches": [wanted, wanted],
    });
    assert_eq!(lines[4], wanted);
}

/// A skin that has learnt says forces with their deviations, and which touches are unlike. JSON has no infinity: an error
/// that is not known is null.
#[test]
fn learnt_touches_have_their_force_and_its_deviation() {
    let learnt =
        |force_n, is_unlike| Touch { learnt: Some(LearntTouch { force_n, is_unlike }), ..touch() };
    let mut touches = [
        learnt(Some([1.5, 0.1]), false),
        learnt(Some([0.0, f64::INFINITY]), false),
        learnt(None, true),
    ];
    touches[0].position_covariance_m2[0][0] = f64::INFINITY;
    let line = &lines(|publisher| publisher.touches(&frame(&touches, &[])).unwrap())[0];
    let said = |key: &str| -> Value {
        line["touches"].as_array().unwrap().iter().map(|touch| touch[key].clone()).collect()
    };
    assert_eq!(said("force_n"), json!([1.5, 0.0, null]));
    assert_eq!(said("force_std_n"), json!([0.1, null, null]));
    assert_eq!(said("unlike"), json!([false, false, true]));
    assert_eq!(said("position_std_m")[0], json!([null, 1e-3, 0.0]));
}

/// Names and words of others do not reach a terminal as they are: control characters of C1 and those that turn the
/// direction of text are escaped, and read as they were.
#[test]
fn what_moves_a_cursor_is_escaped() {
    let hostile = "sk\u{1b}[31m \u{9b}2J \u{85} \u{202e}x\u{2066}";
    let start = Start { skin: hostile, instrument: hostile, ..start() };
    let line = &lines(|publisher| publisher.start(&start).unwrap())[0];
    assert_eq!([&line["skin"], &line["instrument"]], [hostile; 2]);
}

/// A schema that takes anything proves nothing.
#[test]
fn the_schema_refuses_lines_that_lack_or_twist_a_field() {
    let (lines, schema) = (lines(speak), schema());
    let without = |object: &Value, key: &str| {
        let mut object = object.clone();
        object.as_object_mut().unwrap().remove(key);
        object
    };
    let mut refused = 0;
    for line in &lines {
        for key in line.as_object().unwrap().keys() {
            assert!(!schema.is_valid(&without(line, key)), "without {key}: {line}");
            let mut twisted = line.clone();
            twisted[key] = json!({ "no": "value" });
            assert!(!schema.is_valid(&twisted), "{twisted}");
            refused += 2;
        }
        let mut more = line.clone();
        more["more"] = json!(1);
        assert!(schema.is_valid(&more), "fields may be added: {more}");
    }
    assert!(refused > 90, "{refused}");
    let touch = &lines[4]["touches"][0];
    for key in touch.as_object().unwrap().keys() {
        let mut frame = lines[4].clone();
        frame["touches"][0] = without(touch, key);
        assert!(!schema.is_valid(&frame), "a touch without {key}");
    }
}

/// Without a clock of this computer a replay says the same every time.
#[test]
fn a_replay_stamps_no_event() {
    let lines = lines(|publisher| {
        publisher.start(&Start { is_live: false, ..start() }).unwrap();
        publisher.event(&Event::Gap { frames: 1 }).unwrap();
    });
    assert!(lines.iter().all(|line| line["host_time_s"].is_null()));
}

#[test]
fn a_closed_pipe_is_an_end_and_a_full_disk_an_error() {
    let closed = || Publisher::new().with_lines(io::pipe().unwrap().1).unwrap();
    let mut publisher = closed();
    assert!(!publisher.is_closed());
    wait_for("it is not closed", || {
        publisher.touches(&frame(&[], &[])).unwrap();
        publisher.is_closed()
    });
    // with another sink it is none
    let (_receiver, sink) = datagrams();
    let mut publisher = closed().with_udp(sink);
    (0..50).for_each(|_| {
        publisher.touches(&frame(&[], &[])).unwrap();
        std::thread::sleep(Duration::from_millis(1));
    });
    assert!(!publisher.is_closed());
    let mut publisher = Publisher::new().with_lines(io::Cursor::new([0; 8])).unwrap();
    wait_for("no error", || {
        let said = publisher.touches(&frame(&[], &[]));
        said.is_err_and(|error| matches!(error, PublishError::Write(_)) && !error.is_input())
    });
}

/// A reader that takes nothing costs live frames, which are counted in their place, and nobody time. One of a recording gets
/// every frame; one that wants the latest gets that, and all events.
#[test]
fn a_slow_reader_delays_nobody() {
    // the queue has room for 4096
    const FRAMES: u64 = 4200;
    let numbers = |lines: &[Value], is_told: bool| -> Vec<u64> {
        let told = lines.iter().filter(|line| (line["event"] == "skipped") == is_told);
        let key = if is_told { "frames" } else { "sequence" };
        told.filter_map(|line| line[key].as_u64()).collect()
    };
    for is_latest in [false, true] {
        let gate = Shared::shut();
        let (receiver, sink) = datagrams();
        let publisher = Publisher::new().with_udp(sink);
        let mut publisher = match is_latest {
            true => publisher.with_latest_lines(gate.clone()).unwrap(),
            false => publisher.with_lines(gate.clone()).unwrap(),
        };
        publisher.start(&start()).unwrap();
        received(&receiver);
        let mut sent = Vec::new();
        for sequence in 0..FRAMES {
            sent.push(Instant::now());
            publisher.touches(&TouchFrame { sequence, ..frame(&[], &[]) }).unwrap();
            // each is there before the next one
            assert_eq!(received(&receiver)["sequence"], sequence);
        }
        gate.open();
        publisher.end().unwrap();
        let lines = gate.lines();
        let (written, told) = (numbers(&lines, false), numbers(&lines, true));
        let dropped = publisher.line_statistics().unwrap().dropped_frames;
        assert_eq!(written.len() as u64 + dropped, FRAMES);
        assert_eq!(*written.last().unwrap(), FRAMES - 1);
        assert_eq!(lines[0]["type"], "start");
        assert_eq!(lines[lines.len() - 1]["event"], "ended");
        match is_latest {
            // one may have been taken before the gate
            true => assert!(written.len() <= 2 && told.is_empty(), "{} {told:?}", written.len()),
            false => {
                // all for which there is room, but those that have waited for 4 s
                let young = |at: &&Instant| at.elapsed() < Duration::from_secs(4);
                let kept = sent.iter().rev().take(4000).filter(young).count();
                assert!(written.len() >= kept, "{} of {kept}", written.len());
                assert_eq!(told, [dropped]);
            }
        }
    }
    let gate = Shared::shut();
    let mut publisher = Publisher::new().with_lines(gate.clone()).unwrap();
    publisher.start(&Start { is_live: false, ..start() }).unwrap();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(Duration::from_millis(200));
            gate.open();
        });
        for sequence in 0..FRAMES {
            publisher.touches(&TouchFrame { sequence, ..frame(&[], &[]) }).unwrap();
        }
    });
    publisher.end().unwrap();
    assert!(numbers(&gate.lines(), false).into_iter().eq(0..FRAMES));
}

#[test]
fn each_line_is_a_datagram_and_nobody_needs_to_listen() {
    let (receiver, sink) = datagrams();
    let out = Shared::default();
    let mut publisher = Publisher::new().with_lines(out.clone()).unwrap().with_udp(sink);
    speak(&mut publisher);
    out.lines().iter().for_each(|line| assert_eq!(received(&receiver), *line));
    assert_eq!((publisher.udp()[0].sent(), publisher.udp()[0].unsent()), (13, 0));
    // the receiver goes: lines are lost, and the publisher goes on
    let address = receiver.local_addr().unwrap();
    drop(receiver);
    (0..20).for_each(|_| publisher.touches(&frame(&[], &[])).unwrap());
    // and another comes: it hears of everything from then on
    let Ok(receiver) = UdpSocket::bind(address) else {
        // another program has got the port meanwhile
        return each_line_is_a_datagram_and_nobody_needs_to_listen();
    };
    receiver.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    for sequence in 0..20 {
        publisher.touches(&TouchFrame { sequence, ..frame(&[], &[]) }).unwrap();
        assert_eq!(received(&receiver)["sequence"], sequence);
    }
}

#[test]
fn addresses_that_are_none_are_named() {
    for address in ["", "9000", "127.0.0.1", "127.0.0.1:0", "127.0.0.1:99999", "a b:1"] {
        let error = UdpSink::new(address).unwrap_err();
        assert!(error.is_input(), "{error}");
        assert!(error.to_string().starts_with(&format!("{address}: ")), "{error}");
    }
}

/// From the longest line on, a frame costs no allocation.
#[test]
fn nothing_is_allocated_for_a_frame() {
    let (_receiver, sink) = datagrams();
    let gate = Shared::shut();
    let mut publisher = Publisher::new().with_lines(gate.clone()).unwrap().with_udp(sink);
    let touches = [touch(); 5];
    // as many lines as may wait below
    (0..110).for_each(|_| publisher.touches(&frame(&touches, &FAULTS)).unwrap());
    gate.open();
    wait_for("nothing is written", || gate.flushes() == 110);
    let counted = allocation_counter::measure(|| {
        for count in [0, 1, 5, 3].into_iter().cycle().take(100) {
            publisher.touches(&frame(&touches[..count], &FAULTS)).unwrap();
        }
    });
    assert_eq!(counted.count_total, 0);
}
