//! Touches for other programs, as read by those programs.
#![cfg(unix)]

use crate::common::emulated::{Emulated, emulate, printed, scene_at_port, signal, spawn};
use crate::common::*;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{TcpStream, UdpSocket};

/// An emulated skin that stops with the test.
struct Skin {
    folder: Folder,
    scene: String,
    _emulated: Emulated,
}

impl Skin {
    /// Touched from the hundredth of its 200 frames on.
    fn new() -> Self {
        Self::sending(100.0, 200, |frame| frame)
    }

    /// Sends these of the frames in a loop.
    fn sending(rate_hz: f64, count: usize, number: impl Fn(usize) -> usize) -> Self {
        let keys = format!("driver = \"eits1\"\nframe_rate_hz = {rate_hz:?}");
        let (folder, scene, port) = scene_at_port(&keys);
        let (_, frames) = touched_frames(&folder);
        let sent = Array2::from_shape_fn((count, 40), |(frame, i)| frames[[number(frame), i]]);
        let file = folder.write_array("sent.npy", &sent);
        let _emulated = emulate(&scene, &port, &format!("--frames {file}"));
        Self { folder, scene, _emulated }
    }
}

/// Asks the page, whose address is the first line on stderr: what follows the request.
fn ask(said: &str, method: &str, path: &str) -> impl Iterator<Item = String> + use<> {
    let (address, token) = said.trim().split_once("http://").unwrap().1.split_once('/').unwrap();
    let mut stream = TcpStream::connect(address).unwrap();
    let head = format!("{method} {path}{token} HTTP/1.1\r\nHost: {address}");
    write!(stream, "{head}\r\nContent-Length: 0\r\n\r\n").unwrap();
    BufReader::new(stream).lines().map_while(Result::ok)
}

/// The first line that a child writes to stderr; the rest is read and dropped.
fn first_said(child: &mut Child) -> String {
    let mut err = BufReader::new(child.stderr.take().unwrap());
    let mut said = String::new();
    err.read_line(&mut said).unwrap();
    std::thread::spawn(move || err.read_to_end(&mut Vec::new()));
    said
}

/// Runs `eit`; returns its lines, each checked against the schema, and its stderr.
fn lines(line: impl AsRef<str>) -> (Vec<Value>, String) {
    let output = eit(line);
    let said = ended(&output, 0);
    (checked(&stdout(&output)), said)
}

fn checked(text: &str) -> Vec<Value> {
    let schema = jsonschema::validator_for(&parse(eit_publish::SCHEMA)).unwrap();
    let lines: Vec<Value> = text.lines().map(parse).collect();
    for line in &lines {
        assert!(schema.is_valid(line), "{line}: {:?}", schema.validate(line).err());
    }
    lines
}

fn frames(lines: &[Value]) -> Vec<&Value> {
    // but for the list that ends all touches
    lines.iter().filter(|line| line["type"] == "frame" && line["state"] != "no_data").collect()
}

fn is_touched(line: &Value) -> bool {
    line["touches"].as_array().is_some_and(|touches| !touches.is_empty())
}

/// Names of the lines that are not frames.
fn others(lines: &[Value]) -> Vec<&str> {
    let names = lines.iter().filter_map(|line| line["event"].as_str().or(line["type"].as_str()));
    names.filter(|&name| name != "frame").collect()
}

/// Every frame, and the finger at its place; a datagram is a line; a replay reports the same touches.
#[test]
fn lines_of_a_live_skin_its_datagrams_and_its_replay() {
    // the finger comes 60 frames after the reference: three seconds for the set-up, however busy the machine
    let skin = Skin::sending(20.0, 200, |frame| frame);
    let recording = skin.folder.path("press.mcap");
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    receiver.set_read_timeout(Some(LIMIT)).unwrap();
    let address = receiver.local_addr().unwrap().to_string();
    let listen = std::thread::spawn(move || {
        let mut datagram = [0; 65_536];
        let mut text = String::new();
        // the last line says `ended`
        while !text.contains("\"ended\"") {
            let size = receiver.recv(&mut datagram).unwrap();
            text += std::str::from_utf8(&datagram[..size]).unwrap();
            text.push('\n');
        }
        text
    });
    let to = format!("--udp {address} --record {recording}");
    let (live, said) = lines(format!("live {} --json-lines {to} --frames 100", skin.scene));
    assert!(said.contains("100 frames") && !said.contains("image"), "{said}");
    let mut datagrams = checked(&listen.join().unwrap());
    // they repeat the first line every second
    let mut has_begun = false;
    datagrams.retain(|line| line["type"] != "start" || !std::mem::replace(&mut has_begun, true));
    assert_eq!(datagrams, live);
    assert_eq!(others(&live), ["start", "reference_started", "reference_taken", "ended"]);
    let shown = frames(&live);
    assert_eq!(shown.len(), 100);
    for (before, now) in shown.iter().zip(&shown[1..]) {
        let [a, b] = [before, now].map(|frame| frame["sequence"].as_u64().unwrap());
        assert_eq!(b, a + 1);
        assert!(now["time_s"].as_f64() > before["time_s"].as_f64());
    }
    assert!(shown.iter().all(|frame| frame["whole"] == true && frame["latency_s"].is_number()));
    // the finger is at (30, 0) mm, from frame 101 on
    let last = shown.last().unwrap();
    let touches = last["touches"].as_array().unwrap();
    assert_eq!(touches.len(), 1, "{last}");
    let [x, y] = [0, 1].map(|axis| touches[0]["position_m"][axis].as_f64().unwrap());
    assert!((x - 0.03).hypot(y) < 0.01, "({x}, {y}) m");
    let first = shown.iter().find(|frame| is_touched(frame)).unwrap();
    let delay = first["sequence"].as_u64().unwrap() as i64 - 101;
    assert!((0..15).contains(&delay), "the touch begins {delay} frames late");
    assert_eq!(first["touches"][0]["state"], "begin");

    let from = format!("replay {} --from {recording} --json-lines", skin.scene);
    let (again, _) = lines(format!("{from} --frames 100"));
    let events = ["start", "notice", "reference_started", "reference_taken", "ended"];
    assert_eq!(others(&again), events);
    let without_latency = |frames: Vec<&Value>| {
        let mut frames: Vec<Value> = frames.into_iter().cloned().collect();
        // epochs of a live run are not those of another program
        frames.iter_mut().for_each(|f| (f["latency_s"], f["epoch"]) = (Value::Null, Value::Null));
        frames
    };
    assert_eq!(without_latency(shown), without_latency(frames(&again)));
    assert!(frames(&again).iter().all(|frame| frame["latency_s"].is_null()));
}

/// `| head -1` ends a live view with success; a reader that takes nothing, or goes, costs a recording no frame.
#[test]
fn a_recording_waits_for_no_reader() {
    let skin = Skin::new();
    let mut child = spawn(format!("live {} --json-lines", skin.scene));
    assert_eq!(checked(&printed(&mut child).next().unwrap())[0]["type"], "start");
    wait_until(|| child.try_wait().unwrap().is_some());
    ended(&child.wait_with_output().unwrap(), 0);

    for is_gone in [false, true] {
        let recording = skin.folder.path(&format!("{is_gone}.mcap"));
        let line = format!("live {} --json-lines --record {recording} --frames 400", skin.scene);
        let mut child = spawn(line);
        let out = child.stdout.take().filter(|_| !is_gone);
        let said = ended(&child.wait_with_output().unwrap(), 0);
        // a pipe holds 64 kB
        assert_eq!(said.contains("frames were not written"), !is_gone, "{said}");
        drop(out);
        let capture = eit_hw::capture::read(&recording).unwrap();
        let sequences: Vec<u64> = capture.frames().map(|frame| frame.sequence).collect();
        // with those of the reference
        assert!(sequences.len() >= 440, "{is_gone}: {}", sequences.len());
        assert!(sequences.windows(2).all(|pair| pair[1] == pair[0] + 1), "{is_gone}");
    }
}

/// An instrument that is unplugged under a finger ends the touch before anything else is said.
#[test]
fn an_unplugged_instrument_ends_its_touches() {
    let Skin { folder: _folder, scene, _emulated } = Skin::new();
    let mut child = spawn(format!("live {scene} --json-lines"));
    let mut lines = printed(&mut child).map(|line| parse(&line));
    assert!(lines.any(|line| is_touched(&line)));
    drop(_emulated);
    let mut before = lines.next().unwrap();
    let event = loop {
        let line = lines.next().unwrap();
        if line["type"] == "event" {
            break line;
        }
        before = line;
    };
    assert!(["silent", "disconnected"].contains(&event["event"].as_str().unwrap()), "{event}");
    assert_eq!(before["state"], "no_data", "{before}");
    let touches = before["touches"].as_array().unwrap();
    assert_eq!(touches.len(), 1, "{before}");
    has(&touches[0], json!({ "state": "end", "valid": false }));
    signal(&child, "-INT");
    assert!(child.wait().unwrap().code().is_some());
}

/// Touches are the same with and without; the page, whose address is printed, gets the finger and an image.
#[test]
fn images_are_made_for_who_asks() {
    let skin = Skin::new();
    let (scene, recording) = (&skin.scene, skin.folder.path("press.mcap"));
    succeed(format!("record {scene} --out {recording} --frames 190"));
    let replay = format!("replay {scene} --from {recording}");
    let (plain, said) = lines(format!("{replay} --json-lines"));
    assert!(!said.contains("images"), "{said}");
    let out = skin.folder.path("out");
    let (with, said) = lines(format!("{replay} --json-lines --out {out}"));
    assert!(said.contains("with images"), "{said}");
    assert_eq!(plain, with);
    assert_eq!(read_array::<Ix3>(format!("{out}/images.npy")).dim().0, frames(&plain).len());

    let mut child = spawn(format!("{replay} --speed 0.5 --web=127.0.0.1:0"));
    let lines = ask(&first_said(&mut child), "GET", "/events");
    let event = |line: String| Some(parse(line.strip_prefix("data: ")?));
    let events: Vec<Value> = lines.filter_map(event).collect();
    assert!(child.wait().unwrap().success());
    let of = |name: &str| -> Vec<&Value> {
        events.iter().filter(|event| event["type"] == name).collect()
    };
    assert_eq!(of("skin")[0]["electrodes_m"].as_array().unwrap().len(), 8);
    let last = of("frame").pop().unwrap();
    assert_eq!(last["touches"].as_array().unwrap().len(), 1, "{last}");
    let image = of("image").pop().unwrap();
    has(image, json!({ "rows": 64, "columns": 64 }));
    assert_eq!(image["pixels"].as_str().unwrap().len(), 64_usize.pow(2).div_ceil(3) * 4);
    assert!(number(image, "range_s") > 1e-7, "{}", image["range_s"]);
    assert_eq!(of("event").pop().unwrap()["event"], "ended");
}

/// A recording that the page begins has the reference from before.
#[test]
fn a_recording_that_begins_under_a_finger_shows_it() {
    // three seconds each
    let skin = Skin::sending(100.0, 600, |frame| match frame {
        0..300 => frame % 100,
        _ => 101 + frame % 99,
    });
    let Skin { folder, scene, _emulated } = &skin;
    let mut child = spawn(format!("live {scene} --json-lines --web=127.0.0.1:0"));
    let said = first_said(&mut child);
    let press = |button: &str| {
        let status = ask(&said, "POST", &format!("/record/{button}")).next().unwrap();
        assert!(status.starts_with("HTTP/1.1 202 "), "{status}");
    };
    let mut touched = printed(&mut child).filter(|line| is_touched(&parse(line)));
    touched.nth(29).unwrap();
    press("start");
    touched.nth(69).unwrap();
    press("stop");
    drop(touched);
    // the page goes on without the pipe
    signal(&child, "-INT");
    assert!(child.wait().unwrap().success());
    let name = folder.names().into_iter().find(|name| name.starts_with("scene-")).unwrap();
    let (again, _) = lines(format!("replay {scene} --from {} --json-lines", folder.path(&name)));
    assert!(others(&again).contains(&"reference_taken"), "{:?}", others(&again));
    assert!(!others(&again).contains(&"gap"), "{:?}", others(&again));
    let shown = frames(&again);
    let is_shown = |frame: &&&Value| frame["touches"].as_array().unwrap().len() == 1;
    let touched = shown.iter().filter(is_shown).count();
    // a touch takes some frames to begin
    assert!(shown.len() >= 40 && touched + 15 > shown.len(), "{touched} of {}", shown.len());
}

/// That the instrument repeats an old frame. A new flag has to be in one of these lists.
#[test]
fn every_output_says_that_the_instrument_is_frozen() {
    const HERE: [&str; 5] = ["json-lines", "udp", "web", "out", "record"];
    // tests of eit-publish: `zenoh_sink::a_subscriber_gets_every_frame`, `foxglove_sink::a_recording_holds_scene_image_and_log`
    const THERE: [&str; 3] = ["zenoh", "foxglove", "foxglove-record"];
    // and a picture of the last image, which has no words but its time
    const OTHERS: &str = "color picture port seconds frames reference-frames split-mb split-s latest frame-id \
                          ros-domain zenoh-connect zenoh-listen zenoh-config zenoh-every-frame json quiet threads \
                          verbose help version";
    let known = [&HERE[..], &THERE, &OTHERS.split(' ').collect::<Vec<_>>()].concat();
    let help = succeed("live --help");
    let flags = help.lines().map(str::trim_start).filter(|line| line.starts_with('-'));
    for flag in flags.filter_map(|line| line.split("--").nth(1)) {
        let name = flag.split(|c: char| c != '-' && !c.is_ascii_alphanumeric()).next().unwrap();
        assert!(known.contains(&name), "is --{name} an output? say above where it is tested");
    }

    // two seconds of the untouched skin, then the last frame again and again
    let skin = Skin::sending(100.0, 400, |frame| if frame < 200 { frame % 100 } else { 99 });
    let [out, record] = skin.folder.paths(["out", "frozen.mcap"]);
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    receiver.set_read_timeout(Some(LIMIT)).unwrap();
    let address = receiver.local_addr().unwrap();
    let files = format!("--out {out} --record {record} --frames 500");
    let outputs = format!("--json-lines --udp {address} --web=127.0.0.1:0 {files}");
    let mut child = spawn(format!("live {} {outputs}", skin.scene));
    let mut page = ask(&first_said(&mut child), "GET", "/events");
    let is_told = |line: &str| line.contains(r#""state":"frozen""#);
    let page = std::thread::spawn(move || page.any(|line| is_told(&line)));
    let datagrams = std::thread::spawn(move || {
        let mut datagram = [0; 65_536];
        loop {
            let size = receiver.recv(&mut datagram).unwrap();
            let line = std::str::from_utf8(&datagram[..size]).unwrap();
            if is_told(line) || line.contains(r#""ended""#) {
                return is_told(line);
            }
        }
    });
    let told = printed(&mut child).filter(|line| is_told(line)).count();
    assert!(child.wait().unwrap().success());
    let [datagrams, page] = [datagrams, page].map(|output| output.join().unwrap());
    assert!(told > 0 && datagrams && page, "{told} lines, datagrams {datagrams}, page {page}");
    let csv = read_text(format!("{out}/touches.csv"));
    assert!(csv.lines().any(|row| row.ends_with(",frozen")), "touches.csv: {csv}");
    let capture = eit_hw::capture::read(&record).unwrap();
    let is_frozen = |entry: &eit_hw::capture::Entry| match entry {
        eit_hw::capture::Entry::Touches(touches) => is_told(touches.json()),
        _ => false,
    };
    assert!(capture.entries.iter().any(is_frozen), "the recording");
}
