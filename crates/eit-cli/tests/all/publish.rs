//! Touches for other programs, as read by those programs.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common;
use crate::common::{SMALL, eit, refuse, text, touched_frames, write_scene};
use serde_json::Value;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Maximum time that a test waits.
const LIMIT: Duration = Duration::from_secs(120);

/// An emulated skin that is touched from the hundredth of its 200 frames on, and stops with the test.
struct Skin {
    folder: tempfile::TempDir,
    scene: PathBuf,
    emulator: Child,
}

impl Drop for Skin {
    fn drop(&mut self) {
        // it may have exited already
        let _ = Command::new("kill").arg(self.emulator.id().to_string()).status();
        let _ = self.emulator.wait();
    }
}

impl Skin {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let port = folder.path().join("skin");
        let instrument = "driver = \"eits1\"\nframe_rate_hz = 100.0";
        let content = format!("{SMALL}\n[instrument]\nport = \"{}\"\n{instrument}\n", text(&port));
        let scene = write_scene(folder.path(), &content);
        let (frames, _) = touched_frames(folder.path(), &scene);
        let mut emulator = Command::new(env!("CARGO_BIN_EXE_eit"))
            .args(["emulate", text(&scene), "--port", text(&port), "--frames", text(&frames)])
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let start = Instant::now();
        while !port.exists() {
            assert!(start.elapsed() < LIMIT && emulator.try_wait().unwrap().is_none(), "no port");
            std::thread::sleep(Duration::from_millis(10));
        }
        Self { folder, scene, emulator }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

/// Runs `eit`; returns its lines, each checked against the schema, and its stderr.
fn lines(arguments: &[&str]) -> (Vec<Value>, String) {
    let output = eit(arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "eit {arguments:?}: {said}");
    (checked(&String::from_utf8(output.stdout).unwrap()), said)
}

fn checked(text: &str) -> Vec<Value> {
    let schema = jsonschema::validator_for(&serde_json::from_str(eit_publish::SCHEMA).unwrap());
    let schema = schema.unwrap();
    let read = |line: &str| {
        let line = serde_json::from_str(line).unwrap_or_else(|e| panic!("{e}: {line}"));
        assert!(schema.is_valid(&line), "{line}: {:?}", schema.validate(&line).err());
        line
    };
    text.lines().map(read).collect()
}

fn frames(lines: &[Value]) -> Vec<&Value> {
    lines.iter().filter(|line| line["type"] == "frame").collect()
}

/// Names of the lines that are not frames.
fn others(lines: &[Value]) -> Vec<&str> {
    let names = lines.iter().filter_map(|line| line["event"].as_str().or(line["type"].as_str()));
    names.filter(|&name| name != "frame").collect()
}

/// Live lines contain every frame and the finger at its place; a datagram is a line; a replay of the
/// recording made meanwhile reports the same touches.
#[test]
fn lines_of_a_live_skin_its_datagrams_and_its_replay() {
    let skin = Skin::new();
    let recording = skin.path("press.mcap");
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    receiver.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
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
    let (live, said) = lines(&[
        "live",
        text(&skin.scene),
        "--json-lines",
        "--udp",
        &address,
        "--frames",
        "120",
        "--record",
        text(&recording),
    ]);
    assert!(said.contains("120 frames") && !said.contains("image"), "{said}");
    assert_eq!(checked(&listen.join().unwrap()), live);
    assert_eq!(others(&live), ["start", "reference_started", "reference_taken", "ended"]);
    let shown = frames(&live);
    assert_eq!(shown.len(), 120);
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
    let first = shown.iter().find(|frame| frame["touches"] != Value::Array(vec![])).unwrap();
    let delay = first["sequence"].as_u64().unwrap() as i64 - 101;
    assert!((0..15).contains(&delay), "the touch begins {delay} frames late");
    assert_eq!(first["touches"][0]["state"], "begin");

    let from = ["replay", text(&skin.scene), "--from", text(&recording), "--json-lines"];
    let (again, _) = lines(&[&from[..], &["--frames", "120"]].concat());
    assert_eq!(others(&again), ["start", "reference_started", "reference_taken", "ended"]);
    let without_latency = |frame: &&Value| {
        let mut frame = (*frame).clone();
        frame["latency_s"] = Value::Null;
        frame
    };
    let [one, other] =
        [shown, frames(&again)].map(|f| f.iter().map(without_latency).collect::<Vec<Value>>());
    assert_eq!(one, other);
    assert!(frames(&again).iter().all(|frame| frame["latency_s"].is_null()));
}

/// `| head -1` ends a live view, which would continue for ever, with success.
#[test]
fn a_closed_pipe_ends_the_run() {
    let skin = Skin::new();
    let mut child = Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(["live", text(&skin.scene), "--json-lines"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    let mut out = BufReader::new(child.stdout.take().unwrap());
    out.read_line(&mut line).unwrap();
    assert_eq!(checked(&line)[0]["type"], "start");
    drop(out);
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        assert!(start.elapsed() < LIMIT, "goes on without a reader");
        std::thread::sleep(Duration::from_millis(10));
    };
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert!(status.success(), "{said}");
}

/// Images are made if a file needs them, and touches are the same with and without.
#[test]
fn images_are_made_for_who_asks() {
    let skin = Skin::new();
    let recording = skin.path("press.mcap");
    let record = ["record", text(&skin.scene), "--out", text(&recording), "--frames", "160"];
    common::succeed(&record);
    let replay = |more: &[&str]| {
        lines(
            &[&["replay", text(&skin.scene), "--from", text(&recording), "--json-lines"], more]
                .concat(),
        )
    };
    let (plain, said) = replay(&[]);
    assert!(!said.contains("images"), "{said}");
    let out = skin.path("out");
    let (with, said) = replay(&["--out", text(&out)]);
    assert!(said.contains("with images"), "{said}");
    assert_eq!(plain, with);
    let images: ndarray::Array3<f64> = ndarray_npy::read_npy(out.join("images.npy")).unwrap();
    assert_eq!(images.dim().0, frames(&plain).len());
}

#[test]
fn bad_wishes_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let scene = write_scene(folder.path(), SMALL);
    let nowhere = Path::new("never.mcap");
    let base = ["replay", text(&scene), "--from", text(nowhere)];
    let said = refuse(&[&base[..], &["--json-lines", "--json"]].concat());
    assert!(said.contains("--json-lines and --json"), "{said}");
    for address in ["9000", "127.0.0.1:0"] {
        let said = refuse(&[&base[..], &["--udp", address]].concat());
        assert!(said.contains(&format!("--udp: {address}: ")), "{said}");
        assert!(said.contains("HOST:PORT"), "{said}");
    }
}

/// The page of a replay: its address is printed, and the data sent to it show the finger and an image.
#[test]
fn a_page_shows_touches_and_images() {
    let skin = Skin::new();
    let recording = skin.path("press.mcap");
    let record = ["record", text(&skin.scene), "--out", text(&recording), "--frames", "190"];
    common::succeed(&record);
    let mut child = Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(["replay", text(&skin.scene), "--from", text(&recording), "--speed", "0.5"])
        .arg("--web=127.0.0.1:0")
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = String::new();
    BufReader::new(child.stderr.take().unwrap()).read_line(&mut said).unwrap();
    let address = said.trim().split("http://").nth(1).expect("an address").trim_end_matches('/');
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    write!(stream, "GET /events HTTP/1.1\r\nHost: {address}\r\n\r\n").unwrap();
    let lines = BufReader::new(stream).lines().map_while(Result::ok);
    let events: Vec<Value> = lines
        .filter_map(|line| Some(serde_json::from_str(line.strip_prefix("data: ")?).unwrap()))
        .collect();
    assert!(child.wait().unwrap().success());
    let of = |name: &str| -> Vec<&Value> {
        events.iter().filter(|event| event["type"] == name).collect()
    };
    assert_eq!(of("skin")[0]["electrodes_m"].as_array().unwrap().len(), 8);
    let last = of("frame").pop().unwrap();
    assert_eq!(last["touches"].as_array().unwrap().len(), 1, "{last}");
    let image = of("image").pop().unwrap();
    assert_eq!((&image["rows"], &image["columns"]), (&64.into(), &64.into()));
    assert_eq!(image["pixels"].as_str().unwrap().len(), 64_usize.pow(2).div_ceil(3) * 4);
    assert!(image["range_s"].as_f64().unwrap() > 1e-7, "{}", image["range_s"]);
    assert_eq!(of("event").pop().unwrap()["event"], "ended");
}
