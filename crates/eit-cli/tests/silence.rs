//! Instruments that fall silent, restart, lie about their numbers or send hostile text, as a user of the
//! commands meets them. The instrument is our own emulated device behind TCP, with something between.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

mod common;

use common::{SMALL, eit, text, write_scene};
use eit_hw::codec::eits1::Information;
use eit_hw::emulator::{Device, Eits1Device, Emulator, FaultPlan, Listen};
use eit_hw::{Quadruple, Unit};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Duration;

const HOSTILE: &str = "sk\u{1b}]0;OWNED\u{7}\u{1b}[31min\n\rFAKE LINE\u{9b}2J";

fn device(name: &str) -> Box<dyn Device> {
    let information = Information {
        electrodes: 8,
        max_measurements: 256,
        max_frame_rate_hz: 1000.0,
        full_scale: f32::INFINITY,
        unit: Unit::Volt,
        complex: false,
        name: name.into(),
        serial: "7".into(),
    };
    let source = |sequence: u64, quadruples: &[Quadruple], values: &mut [f64]| {
        for (index, (slot, [a, _, m, _])) in values.iter_mut().zip(quadruples).enumerate() {
            let noise = ((sequence * 40 + index as u64) as f64 * 0.618).sin();
            // reciprocal
            *slot = 0.01 / f64::from(1 + a.abs_diff(*m).min(8 - a.abs_diff(*m))) + 1e-7 * noise;
        }
    };
    Box::new(Eits1Device::new(information, Box::new(source)))
}

/// A device of which something becomes while it runs.
struct Meddled<F> {
    device: Box<dyn Device>,
    meddle: F,
}

impl<F: FnMut(Duration, &mut Box<dyn Device>, &mut Vec<u8>) + Send> Device for Meddled<F> {
    fn receive(&mut self, bytes: &[u8], now: Duration, out: &mut Vec<u8>) {
        self.device.receive(bytes, now, out);
    }

    fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        let mut sent = Vec::new();
        self.device.poll(now, &mut sent);
        (self.meddle)(now, &mut self.device, &mut sent);
        out.extend(sent);
    }

    fn power_cycle(&mut self) {
        self.device.power_cycle();
    }
}

fn start(device: Box<dyn Device>) -> Emulator {
    Emulator::start(device, &Listen::Tcp("127.0.0.1:0".into()), FaultPlan::default()).unwrap()
}

fn scene(folder: &Path) -> PathBuf {
    let rate = "[instrument]\ndriver = \"eits1\"\nport = \"unused\"\nframe_rate_hz = 100.0\n";
    write_scene(folder, &format!("{SMALL}\n{rate}"))
}

fn record(folder: &Path, emulator: &Emulator, seconds: &str) -> (Output, Value, PathBuf) {
    let (scene, out) = (scene(folder), folder.join("out.mcap"));
    let port = emulator.endpoint().to_string();
    let output = eit(&[
        "record",
        text(&scene),
        "--port",
        &port,
        "--out",
        text(&out),
        "--seconds",
        seconds,
        "--json",
    ]);
    let json = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output, json, out)
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// It forgets its set-up and says so to nobody: the host sets it up anew.
#[test]
fn a_restart_that_nobody_heard_of_leads_to_a_new_set_up() {
    let folder = tempfile::tempdir().unwrap();
    let (mut frames, mut is_done) = (0, false);
    let emulator = start(Box::new(Meddled {
        device: device("skin"),
        meddle: move |_, device: &mut Box<dyn Device>, sent: &mut Vec<u8>| {
            frames += usize::from(!sent.is_empty());
            if frames == 60 && !is_done {
                is_done = true;
                device.power_cycle();
                // the announcement is lost on the way
                device.poll(Duration::ZERO, &mut Vec::new());
                sent.clear();
            }
        },
    }));
    let (output, json, out) = record(folder.path(), &emulator, "6");
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(json["reconnections"], 1, "{json}");
    assert_eq!(json["ended_silent"], false);
    // set up, 2 s of silence, set up again: more than two seconds of frames are left
    assert!(json["frames"].as_u64().unwrap() > 200, "{json}");
    assert!(json["silent_s"].as_f64().unwrap() > 1.0, "{json}");
    assert!(stderr(&output).contains("no frame has come for 0.5 s"), "{}", stderr(&output));
    let capture = eit_hw::capture::read(&out).unwrap();
    assert_eq!(capture.frames().last().unwrap().epoch, 1);
}

#[test]
fn silence_at_the_end_is_exit_code_3() {
    let folder = tempfile::tempdir().unwrap();
    let emulator = start(Box::new(Meddled {
        device: device("skin"),
        meddle: |now: Duration, _: &mut Box<dyn Device>, sent: &mut Vec<u8>| {
            if now > Duration::from_millis(1500) {
                sent.clear();
            }
        },
    }));
    let (output, json, _) = record(folder.path(), &emulator, "3");
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert_eq!(json["ended_silent"], true, "{json}");
    assert!(json["frames"].as_u64().unwrap() > 20, "{json}");
    // the same while watching, and where nothing comes at all
    let (scene, port) = (scene(folder.path()), emulator.endpoint().to_string());
    let output = eit(&["live", text(&scene), "--port", &port, "--seconds", "2"]);
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).contains("silent or unplugged at the end"));
    assert!(stderr(&output).contains("no frame has come for"), "{}", stderr(&output));
    let output = eit(&["check", text(&scene), "--port", &port, "--seconds", "1"]);
    assert_eq!(output.status.code(), Some(3));
    assert!(stderr(&output).contains("no frame came within 1 s"), "{}", stderr(&output));
}

/// The count of frames begins anew or has one number that cannot be: hardly a frame is lost.
#[test]
fn a_count_that_begins_anew_or_jumps_loses_few_frames() {
    for (name, epochs) in [("anew", 1), ("jump", 0)] {
        let folder = tempfile::tempdir().unwrap();
        let mut frames = 0_u32;
        let emulator = start(Box::new(Meddled {
            device: device("skin"),
            meddle: move |_, _: &mut Box<dyn Device>, sent: &mut Vec<u8>| {
                let mut out = Vec::new();
                eit_hw::codec::eits1::Decoder::new().push(sent, &mut |event| {
                    let eit_hw::codec::eits1::Event::Message(mut message) = event else { return };
                    if message.kind == eit_hw::codec::eits1::Kind::Frame {
                        frames += 1;
                        match name {
                            "anew" if frames > 100 => message.sequence = frames - 101,
                            "jump" if frames == 100 => message.sequence += 1_000_000_000,
                            _ => {}
                        }
                    }
                    eit_hw::codec::eits1::encode(&message, &mut out).unwrap();
                });
                *sent = out;
            },
        }));
        let (output, json, out) = record(folder.path(), &emulator, "3");
        assert!(output.status.success(), "{}", stderr(&output));
        let (found, lost) = (json["frames"].as_u64().unwrap(), json["lost"].as_u64().unwrap());
        assert!(found > 200 && lost <= 2, "{name}: {json}");
        assert_eq!(json["reconnections"], 0, "{name}: {json}");
        let capture = eit_hw::capture::read(&out).unwrap();
        assert_eq!(capture.frames().last().unwrap().epoch, epochs, "{name}");
    }
}

/// Names, notes and files of others move no cursor and fake no line.
#[test]
fn nothing_of_others_reaches_the_terminal_as_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let emulator = start(device(HOSTILE));
    let (scene, port) = (scene(folder.path()), emulator.endpoint().to_string());
    let out = folder.path().join("out.mcap");
    let note = "a\u{1b}[2Jb";
    let runs = [
        vec!["devices", text(&scene), "--port", &port],
        vec!["devices", text(&scene), "--port", &port, "--json"],
        vec!["check", text(&scene), "--port", &port, "--frames", "20"],
        vec![
            "record",
            text(&scene),
            "--port",
            &port,
            "--out",
            text(&out),
            "--seconds",
            "1",
            "--note",
            note,
        ],
        vec!["replay", text(&scene), "--from", text(&out)],
        vec!["replay", text(&scene), "--from", text(&out), "--json"],
        vec!["plan", "no\u{1b}[31mscene.toml"],
    ];
    for run in &runs {
        let output = eit(run);
        for bytes in [&output.stdout, &output.stderr] {
            let said = String::from_utf8(bytes.clone()).unwrap();
            assert!(!said.contains(|c: char| c.is_control() && c != '\n'), "eit {run:?}: {said:?}");
            assert!(!said.lines().any(|line| line.starts_with("FAKE")), "{said:?}");
        }
    }
}

/// Two programs cannot record to one file, nor two hosts share one instrument.
#[test]
fn a_second_recorder_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (start(device("one")), start(device("two")));
    let scene = scene(folder.path());
    let out = folder.path().join("out.mcap");
    let arguments = |port: &str, seconds: &str, more: &[&str]| {
        let base = ["record", text(&scene), "--port", port, "--out", text(&out)];
        let all = [&base[..], &["--seconds", seconds], more].concat();
        all.iter().map(|&argument| argument.to_owned()).collect::<Vec<String>>()
    };
    let ports = [first.endpoint().to_string(), second.endpoint().to_string()];
    let mut running = std::process::Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(arguments(&ports[0], "4", &[]))
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    while !out.exists() {
        assert!(running.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(10));
    }
    let run =
        |arguments: &[String]| eit(&arguments.iter().map(String::as_str).collect::<Vec<&str>>());
    let refused = run(&arguments(&ports[1], "1", &["--append"]));
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("out.mcap: is being recorded to by another program"));
    // the instrument has one host
    let other = folder.path().join("other.mcap");
    let refused = eit(&[
        "record",
        text(&scene),
        "--port",
        &ports[0],
        "--out",
        text(&other),
        "--seconds",
        "1",
    ]);
    assert!(!refused.status.success());
    assert!(running.wait().unwrap().success());
    let capture = eit_hw::capture::read(&out).unwrap();
    assert!(!capture.damage.is_any() && capture.frames().count() > 200);
    assert!(capture.frames().all(|frame| frame.epoch == 0));
}

/// `eit recover` writes what is whole, and says what is not.
#[test]
fn recover_reports_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let emulator = start(device("skin"));
    let (_, json, out) = record(folder.path(), &emulator, "3");
    let mut bytes = std::fs::read(&out).unwrap();
    let all = json["frames"].as_u64().unwrap();
    // a byte in the middle of the content of some chunk
    let at = bytes.len() / 2;
    bytes[at] ^= 4;
    let damaged = folder.path().join("damaged.mcap");
    std::fs::write(&damaged, &bytes).unwrap();
    let whole = folder.path().join("whole.mcap");
    let output = eit(&["recover", text(&damaged), text(&whole), "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(found["bad_chunks"], 1, "{found}");
    let frames = found["frames"].as_u64().unwrap();
    assert!(frames < all && frames > all / 4, "{frames} of {all}");
    let capture = eit_hw::capture::read(&whole).unwrap();
    assert!(capture.frames().count() as u64 == frames && !capture.damage.unfinished);
    assert_eq!(eit(&["recover", text(&damaged), text(&whole)]).status.code(), Some(2));
}

/// Nested brackets in the header of images took a minute, and were echoed whole.
#[test]
fn a_hostile_header_of_images_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("nest.npy");
    let out = folder.path().join("out");
    for nested in ["[".repeat(24), "[".repeat(60_000)] {
        let closed = nested.replace('[', "]");
        let header =
            format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {nested}{closed}, }}\n");
        let mut bytes = b"\x93NUMPY\x02\x00".to_vec();
        bytes.extend((header.len() as u32).to_le_bytes());
        bytes.extend(header.as_bytes());
        std::fs::write(&file, &bytes).unwrap();
        refused_shortly(&file, &out);
    }
    std::fs::write(&file, b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}").unwrap();
    refused_shortly(&file, &out);
}

fn refused_shortly(file: &Path, out: &Path) {
    let start = std::time::Instant::now();
    let (images, out) = (text(file), text(out));
    let arguments =
        ["denoise", "paper-disc", "--weights", "default", "--images", images, "--out", out];
    let said = common::refuse(&arguments);
    assert!(start.elapsed() < Duration::from_secs(10), "{:?}", start.elapsed());
    assert!(said.len() < 400, "{} bytes", said.len());
}

#[test]
fn devices_without_an_end_are_no_files() {
    for arguments in [
        vec!["plan", "/dev/zero"],
        vec!["convert", "/dev/zero", "--out", "never.csv"],
        vec!["reconstruct", "paper-disc", "--frames", "/dev/zero", "--out", "never"],
        vec!["recover", "/dev/zero", "never.mcap"],
    ] {
        common::refuse(&arguments);
    }
}

/// Frames of 16 electrodes through the emulator: the verdict, the findings, and the answer of `check`.
fn checked(folder: &Path, change: impl Fn(usize, [u32; 4], f64) -> f64) -> (Option<i32>, Value) {
    let quadruples: Vec<[u32; 4]> = (0..16)
        .flat_map(|d| (2..15).map(move |k| [d, d + 1, d + k, d + k + 1].map(|e| e % 16)))
        .collect();
    let scene = write_scene(
        folder,
        &SMALL.replace("count = 8", "count = 16").replace("edge_m = 0.012", "nodes = 800").replace(
            "[mesh]",
            "[instrument]\ndriver = \"eits1\"\nport = \"unused\"\nframe_rate_hz = 200.0\n[mesh]",
        ),
    );
    let voltages = folder.join("v.csv");
    common::succeed(&["forward", text(&scene), "--out", text(&voltages)]);
    let read = eit_hw::read_recording(&voltages, None, &Default::default()).unwrap().real;
    let table: Vec<f64> = read.row(0).to_vec();
    assert_eq!(table.len(), 208);
    let values: Vec<Vec<f64>> = (0..120)
        .map(|frame| {
            let value = |(i, &quadruple): (usize, &[u32; 4])| {
                let noise = ((frame * 7919 + i * 104_729) as f64).sin();
                change(frame, quadruple, table[i] * (1.0 + 1e-5 * noise))
            };
            quadruples.iter().enumerate().map(value).collect()
        })
        .collect();
    let information = Information {
        electrodes: 16,
        max_measurements: 256,
        max_frame_rate_hz: 1000.0,
        full_scale: f32::INFINITY,
        unit: Unit::Volt,
        complex: false,
        name: "skin".into(),
        serial: "7".into(),
    };
    let source = move |sequence: u64, _: &[Quadruple], slots: &mut [f64]| {
        slots.copy_from_slice(&values[sequence as usize % values.len()]);
    };
    let emulator = start(Box::new(Eits1Device::new(information, Box::new(source))));
    let port = emulator.endpoint().to_string();
    let output = eit(&["check", text(&scene), "--port", &port, "--frames", "100", "--json"]);
    let answer = serde_json::from_slice(&output.stdout).unwrap_or(Value::Null);
    (output.status.code(), answer)
}

fn electrodes(answer: &Value) -> Vec<u64> {
    let findings = answer["findings"].as_array().unwrap();
    findings.iter().filter_map(|finding| finding["electrode"].as_u64()).collect()
}

/// Whoever is at fault is named, and nobody else.
#[test]
fn check_names_the_electrode_at_fault_and_exits_4() {
    let folder = tempfile::tempdir().unwrap();
    let (code, answer) = checked(folder.path(), |_, _, value| value);
    assert_eq!((code, &answer["verdict"]), (Some(0), &"good".into()), "{answer}");
    // dead; floating at the largest value; noisy. Electrode 13 by people's count
    let noise = |frame: usize, q: [u32; 4]| {
        let seed = q.iter().fold(frame as u64, |seed, &e| seed * 31 + u64::from(e));
        ((seed * 7907) as f64).sin()
    };
    let faults: [&dyn Fn(usize, [u32; 4], f64) -> f64; 3] = [
        &|_, q, value| if q.contains(&12) { 0.0 } else { value },
        &|_, q, value| if q.contains(&12) { 10.0 } else { value },
        &|frame, q, value| if q.contains(&12) { value * (1.0 + noise(frame, q)) } else { value },
    ];
    for (index, fault) in faults.iter().enumerate() {
        let (code, answer) = checked(folder.path(), fault);
        assert_eq!((code, &answer["verdict"]), (Some(4), &"faulty".into()), "{index}: {answer}");
        assert_eq!(electrodes(&answer), [13], "{index}: {answer}");
    }
}

/// Two channels that hold are told as two, and a converter too coarse for touches is a fault.
#[test]
fn check_counts_stuck_channels_and_the_steps_of_the_converter() {
    let folder = tempfile::tempdir().unwrap();
    let stuck = [[0, 1, 12, 13], [4, 5, 11, 12]];
    let (code, answer) =
        checked(folder.path(), |_, q, value| if stuck.contains(&q) { 0.02 } else { value });
    assert_eq!(code, Some(0), "{answer}");
    let what = answer["findings"].to_string();
    assert!(what.contains("2 measurements do not change"), "{what}");
    // 10 bits of the largest voltage: hardly a value moves, and a touch is less than a step
    let (_, answer) = checked(folder.path(), |_, _, value| value);
    let fine = answer["resolution"]["steps_per_touch"].as_f64().unwrap();
    assert!(fine > 100.0, "{answer}");
    let step = 0.05 / 1023.0 * 40.0;
    let (code, answer) = checked(folder.path(), |frame, q, value| {
        // noise of a twentieth of a step, as of an amplifier
        step * (value / step + 0.05 * noise_of(frame, q)).round()
    });
    assert_eq!(code, Some(4), "{answer}");
    let resolution = &answer["resolution"];
    assert!(resolution["still_measurements"].as_u64().unwrap() > 104, "{answer}");
    assert!(resolution["steps_per_touch"].as_f64().unwrap() < 1.0, "{answer}");
    assert!(answer["findings"].to_string().contains("measurements never change"), "{answer}");
}

fn noise_of(frame: usize, q: [u32; 4]) -> f64 {
    let seed = q.iter().fold(frame as u64, |seed, &e| seed * 31 + u64::from(e));
    ((seed * 104_729) as f64).sin()
}

/// Converted message by message: epochs, clocks and notes go along, and so does the order of a scene.
#[test]
fn convert_keeps_what_a_recording_holds() {
    let folder = tempfile::tempdir().unwrap();
    let emulator = start(device("skin"));
    let (_, json, out) = record(folder.path(), &emulator, "1");
    let frames = json["frames"].as_u64().unwrap() as usize;
    let [other, table, array] = ["b.mcap", "b.csv", "b.npy"].map(|name| folder.path().join(name));
    let scene = folder.path().join("scene.toml");
    for (to, more) in [(&other, &["--scene", text(&scene)][..]), (&table, &[]), (&array, &[])] {
        let arguments = [&["convert", text(&out), "--out", text(to)], more].concat();
        let said = common::succeed(&arguments);
        assert!(said.starts_with(&format!("{frames} frames of 40 values")), "{said}");
    }
    let [one, same] = [&out, &other].map(|path| eit_hw::capture::read(path).unwrap());
    assert_eq!(one.entries, same.entries);
    let wanted = eit_hw::read_recording(&out, None, &Default::default()).unwrap().real;
    for path in [&table, &array] {
        let read = eit_hw::read_recording(path, None, &Default::default()).unwrap().real;
        assert_eq!(read, wanted);
    }
}
