//! Recordings and arrays as read and written by `eit recover`, `eit convert` and others.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common;
use crate::common::emulated::{device, record, scene, start, stderr};
use crate::common::{eit, succeed, text};
use eit_hw::capture::{CaptureReader, Damage};
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

/// `eit recover` writes the intact parts, and reports the rest.
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
    // chunks contain a second each, or more if the processor was busy for long: at least three quarters of
    // three seconds are outside a single chunk
    assert!(frames < all && frames > all / 4, "{frames} of {all}");
    let capture = eit_hw::capture::read(&whole).unwrap();
    assert!(capture.frames().count() as u64 == frames && !capture.damage.unfinished);
    assert_eq!(eit(&["recover", text(&damaged), text(&whole)]).status.code(), Some(2));
}

/// Messages that are no frames are told, not called damage-free, and so is a recording of two set-ups.
#[test]
fn recover_does_not_call_other_content_undamaged() {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    let frame = |values: &[f64]| eit_hw::Frame {
        values: values.to_vec(),
        imaginary: None,
        quality: vec![eit_hw::Quality::GOOD; values.len()],
        sequence: 0,
        epoch: 0,
        device_time_s: None,
        host_time_s: None,
    };
    let session = eit_hw::capture::SessionRecord::default();
    let mut writer =
        eit_hw::capture::CaptureWriter::create(&from, &session, Default::default()).unwrap();
    writer.frame(&frame(&[1.0, 2.0])).unwrap();
    writer.frame(&frame(&[1.0])).unwrap();
    writer.finish().unwrap();
    let said = succeed(&["recover", text(&from), text(&to)]);
    assert!(
        said.contains("1 frame(s) or session(s) have other measurements")
            && !said.contains("no damage"),
        "{said}"
    );
    // a channel and a message of it, by hand
    let record = |op: u8, parts: &[&[u8]]| {
        let content = parts.concat();
        [&[op][..], &(content.len() as u64).to_le_bytes(), &content].concat()
    };
    let text_of =
        |words: &str| [&(words.len() as u32).to_le_bytes()[..], words.as_bytes()].concat();
    let bytes = [
        eit_hw::capture::MAGIC.to_vec(),
        record(1, &[&text_of(""), &text_of("test")]),
        record(4, &[&[1, 0, 0, 0], &text_of("/eit/frame"), &text_of("json"), &[0; 4]]),
        record(5, &[&[1, 0], &[0; 20], b"{\"no\": 1}"]),
    ]
    .concat();
    let [from, to] = ["c.mcap", "d.mcap"].map(|name| folder.path().join(name));
    std::fs::write(&from, &bytes).unwrap();
    let output = eit(&["recover", text(&from), text(&to), "--json"]);
    let found: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&found["frames"], &found["unreadable"]), (&0.into(), &1.into()), "{found}");
    let said = succeed(&["recover", text(&from), text(&folder.path().join("e.mcap"))]);
    assert!(
        said.contains("1 message(s) are not what their topic holds") && !said.contains("no damage"),
        "{said}"
    );
}

/// Whoever ends a command that writes a file finds no half of it that could be taken for the whole, and no
/// stray files; after SIGKILL the half has `.part` or a dot in its name.
#[test]
fn a_command_that_is_ended_leaves_no_half_files() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("a.csv");
    let mut random = fixtures::Random::new(2);
    let row = |_| (0..208).map(|_| random.uniform().to_string()).collect::<Vec<_>>().join(",");
    let rows: Vec<String> = (0..6000).map(row).collect();
    std::fs::write(&table, rows.join("\n") + "\n").unwrap();
    let whole = folder.path().join("whole.mcap");
    succeed(&["convert", text(&table), "--out", text(&whole)]);
    let names = || {
        let entries = std::fs::read_dir(folder.path()).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.retain(|name| name != "a.csv" && name != "whole.mcap");
        names
    };
    let (mut ended, mut seen) = (0, 0);
    for (signal, name) in [
        ("INT", "b.npy"),
        ("TERM", "b.mcap"),
        ("HUP", "b.mcap"),
        ("KILL", "b.mcap"),
        ("KILL", "r.mcap"),
        ("INT", "r.mcap"),
    ] {
        let out = folder.path().join(name);
        let arguments = match name {
            "r.mcap" => vec!["recover", text(&whole), text(&out)],
            _ => vec!["convert", text(&whole), "--out", text(&out)],
        };
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_eit"))
            .args(arguments)
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        // until it writes
        while names().is_empty() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_millis(1));
        }
        let kill = ["-s", signal, &child.id().to_string()];
        assert!(std::process::Command::new("kill").args(kill).status().unwrap().success());
        if child.wait().unwrap().success() {
            // it was faster; then everything is there
            assert_eq!(names(), [name], "{signal}");
            std::fs::remove_file(&out).unwrap();
            continue;
        }
        ended += 1;
        let left = names();
        seen += left.len();
        assert!(!left.contains(&name.to_owned()), "{signal}: {left:?}");
        assert!(signal == "KILL" || left.is_empty(), "{signal}: {left:?}");
        assert!(left.iter().all(|name| name.ends_with(".part")), "{left:?}");
        // the next run is not in the way of what was left
        let again = match name {
            "r.mcap" => succeed(&["recover", text(&whole), text(&out)]),
            _ => succeed(&["convert", text(&whole), "--out", text(&out)]),
        };
        assert!(again.starts_with("6000 frames"), "{again}");
        assert_eq!(names(), [name]);
        std::fs::remove_file(&out).unwrap();
    }
    assert!(ended >= 3, "{ended} of 6 were ended while they wrote, {seen} files left");
}

/// A pipe or device is not replaced by a file, and a link stays one.
#[test]
fn an_output_that_is_no_file_is_refused() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let table = path("a.csv");
    std::fs::write(&table, "1,2,3\n4,5,6\n").unwrap();
    assert!(std::process::Command::new("mkfifo").arg(path("pipe.csv")).status().unwrap().success());
    symlink("/dev/null", path("null.csv")).unwrap();
    symlink(path("nothing.csv"), path("dangling.csv")).unwrap();
    std::fs::write(path("target.csv"), "old").unwrap();
    symlink("target.csv", path("link.csv")).unwrap();
    let convert = |out: &Path| -> Vec<String> {
        ["convert", text(&table), "--out", text(out)].map(str::to_owned).to_vec()
    };
    for (name, wanted) in [
        ("pipe.csv", "is a device, pipe or socket"),
        ("null.csv", "is a device, pipe or socket"),
        ("dangling.csv", "is a link to nothing"),
    ] {
        let arguments = convert(&path(name));
        let said = common::refuse(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(said.contains(name) && said.contains(wanted), "{said}");
    }
    let arguments = convert(&path("link.csv"));
    succeed(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    assert!(path("link.csv").is_symlink());
    assert_eq!(std::fs::read_to_string(path("target.csv")).unwrap().lines().count(), 2);
}

/// Nothing intact is an error, and no empty recording is left that would look complete.
#[test]
fn nothing_whole_is_refused_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let [damaged, new] = ["damaged.mcap", "new.mcap"].map(|name| folder.path().join(name));
    std::fs::write(&damaged, [eit_hw::capture::MAGIC, &[0xa5; 5000]].concat()).unwrap();
    let said = common::refuse(&["recover", text(&damaged), text(&new)]);
    assert!(said.contains("damaged.mcap: its 5008 bytes hold no intact message"), "{said}");
    assert!(!new.exists());
    std::fs::write(&damaged, b"").unwrap();
    let said = common::refuse(&["recover", text(&damaged), text(&new)]);
    assert!(said.contains("damaged.mcap") && !new.exists(), "{said}");
    // a folder that does not exist
    std::fs::write(&damaged, [eit_hw::capture::MAGIC, &[0xa5; 5000]].concat()).unwrap();
    let nowhere = folder.path().join("none").join("new.mcap");
    let said = common::refuse(&["recover", text(&damaged), text(&nowhere)]);
    assert!(said.contains("new.mcap: cannot be written"), "{said}");
}

/// A recording of ours without a frame is no success, and leaves no file that looks like one.
#[test]
fn recovering_no_frame_fails() {
    let folder = tempfile::tempdir().unwrap();
    let [table, whole, cut, new] =
        ["a.csv", "whole.mcap", "cut.mcap", "new.mcap"].map(|name| folder.path().join(name));
    std::fs::write(&table, "1,2,3\n4,5,6\n").unwrap();
    succeed(&["convert", text(&table), "--out", text(&whole)]);
    // the first chunk holds the session alone
    let bytes = std::fs::read(&whole).unwrap();
    let mut said = String::new();
    for length in (0..bytes.len()).step_by(50) {
        std::fs::write(&cut, &bytes[..length]).unwrap();
        let output = eit(&["recover", text(&cut), text(&new)]);
        if output.status.code() == Some(1) {
            said = stderr(&output);
            break;
        }
        assert_eq!((output.status.code(), new.exists()), (Some(2), false));
    }
    assert!(said.contains("cut.mcap: no frame is intact; "), "{said}");
    assert!(said.contains("new.mcap is not written") && !new.exists(), "{said}");
}

/// A frame that the file's end cuts off is counted, and told in the singular.
#[test]
fn convert_tells_of_a_cut_frame() {
    let folder = tempfile::tempdir().unwrap();
    let [cut, table] = ["cut.get", "table.csv"].map(|name| folder.path().join(name));
    // two frames of 256 values and a part of one
    let bytes: Vec<u8> = (0..600).flat_map(|k| (0.1 + 0.001 * k as f32).to_le_bytes()).collect();
    std::fs::write(&cut, bytes).unwrap();
    let answer = succeed(&["convert", text(&cut), "--out", text(&table), "--json"]);
    let answer: serde_json::Value = serde_json::from_str(&answer).unwrap();
    assert_eq!((&answer["frames"], &answer["skipped_frames"]), (&2.into(), &1.into()), "{answer}");
    let note = "1 cut frame skipped (byte 2048: 352 bytes instead of 1024)";
    assert_eq!(answer["notes"], serde_json::json!([note]));
}

/// A skin that never rests: what to do, also for programs.
#[test]
fn a_replay_without_a_reference_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let plain = common::write_scene(folder.path(), common::SMALL);
    let (array, _) = common::touched_frames(folder.path(), &plain);
    let frames: ndarray::Array2<f64> = ndarray_npy::read_npy(&array).unwrap();
    // each measurement swings by 5 %
    let swings = ndarray::Array2::from_shape_fn((72, frames.ncols()), |(f, i)| {
        frames[[0, i]] * (1.0 + 0.05 * (f as f64 / 3.0).sin() * (i as f64 / 20.0 - 1.0))
    });
    let [array, recording] = ["swings.npy", "swings.mcap"].map(path);
    ndarray_npy::write_npy(&array, &swings).unwrap();
    succeed(&["convert", text(&array), "--out", text(&recording), "--scene", text(&plain)]);
    let replay = ["replay", text(&plain), "--from", text(&recording)];
    let said = eit(&replay);
    let said = String::from_utf8(said.stdout).unwrap();
    assert!(said.contains("72 frames came, and none was searched for touches: begin"), "{said}");
    assert!(said.contains("--reference-frames; in a replay also [recording] reference"), "{said}");
    let answer = eit(&[&replay[..], &["--json"]].concat());
    let answer: serde_json::Value = serde_json::from_slice(&answer.stdout).unwrap();
    assert_eq!(answer["unsearched"]["frames"], 72, "{answer}");
    assert!(answer["unrest"].as_f64().unwrap() > 0.01, "{answer}");
}

/// Values of a table are not replaced by those in another order.
#[test]
fn convert_does_not_write_over_what_it_reads() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("a.csv");
    std::fs::write(&table, "1,2,3\n4,5,6\n").unwrap();
    let other = folder.path().join("./a.csv");
    let said = common::refuse(&["convert", text(&table), "--out", text(&other)]);
    assert!(said.contains("is the file to convert"), "{said}");
    assert_eq!(std::fs::read(&table).unwrap(), b"1,2,3\n4,5,6\n");
}

/// A table is no recording: the command that makes one of it is named, and works. Where its frames have no times, the
/// assumed rate is told once, by whatever command reads it, and not where it is stated.
#[test]
fn a_table_is_replayed_after_the_command_that_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let plain = common::write_scene(folder.path(), common::SMALL);
    let stated = path("stated.toml");
    let rate = "[recording]\nframe_rate_hz = 50.0\n[mesh]";
    std::fs::write(&stated, common::SMALL.replace("[mesh]", rate)).unwrap();
    let (array, _) = common::touched_frames(folder.path(), &plain);
    let [table, recording] = ["press.csv", "press.mcap"].map(path);
    succeed(&["convert", text(&array), "--out", text(&table)]);

    let said = common::refuse(&["replay", text(&plain), "--from", text(&table)]);
    let command =
        format!("eit convert {} --scene {} --out {}", text(&table), text(&plain), text(&recording));
    assert!(said.contains(&format!("`{command}`")), "{said}");
    assert!(said.contains("[recording] frame_rate_hz"), "{said}");
    succeed(&command.split(' ').skip(1).collect::<Vec<_>>());

    // the column of times is named, whatever reads the table
    let timed = path("timed.csv");
    let rows = std::fs::read_to_string(&table).unwrap();
    let rows = rows.lines().enumerate().map(|(k, row)| format!("{},{row}\n", 0.02 * k as f64));
    std::fs::write(&timed, rows.collect::<String>()).unwrap();
    let [out, other] = ["out", "other.mcap"].map(path);
    let reconstruct = |scene: &Path, table: &Path| {
        let (scene, table, out) =
            (text(scene).to_owned(), text(table).to_owned(), text(&out).to_owned());
        ["reconstruct", &scene, "--frames", &table, "--reference", "0..40", "--out", &out]
            .map(str::to_owned)
    };
    let words = |arguments: &[String]| -> Vec<String> { arguments.to_vec() };
    let convert = ["convert", text(&timed), "--scene", text(&plain), "--out", text(&other)];
    for arguments in [words(&reconstruct(&plain, &timed)), words(&convert.map(str::to_owned))] {
        let said = common::refuse(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(said.contains("remove that column"), "{said}");
    }

    // the arrangement that the scene states is that of the table
    let [turned, scene, back] = ["turned.csv", "turned.toml", "back.csv"].map(path);
    let content = std::fs::read_to_string(&table).unwrap();
    let rows: Vec<Vec<&str>> = content.lines().map(|row| row.split(',').collect()).collect();
    let column = |k: usize| rows.iter().map(|row| row[k]).collect::<Vec<_>>().join(",") + "\n";
    std::fs::write(&turned, (0..rows[0].len()).map(column).collect::<String>()).unwrap();
    let columns = "[recording]\nframes_are = \"columns\"\n[mesh]";
    std::fs::write(&scene, common::SMALL.replace("[mesh]", columns)).unwrap();
    succeed(&["convert", text(&turned), "--scene", text(&scene), "--out", text(&back)]);
    assert_eq!(std::fs::read_to_string(&back).unwrap(), content);

    for (scene, told) in [(&plain, 1), (&stated, 0)] {
        let replay = ["replay", text(scene), "--from", text(&recording)].map(str::to_owned);
        for arguments in [words(&reconstruct(scene, &table)), words(&replay)] {
            let output = eit(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
            let said = String::from_utf8(output.stdout.clone()).unwrap() + &stderr(&output);
            assert!(output.status.success(), "{arguments:?}: {said}");
            let notes = said.matches("20 frames a second; if it is another one").count();
            assert_eq!(notes, told, "{arguments:?}: {said}");
        }
    }
}

/// A disk that fills up during conversion leaves no recording that looks complete.
#[test]
fn a_conversion_that_fails_leaves_no_recording() {
    let folder = tempfile::tempdir().unwrap();
    let [table, out] = ["a.csv", "a.mcap"].map(|name| folder.path().join(name));
    let mut random = fixtures::Random::new(1);
    let row = |_| (0..208).map(|_| random.uniform().to_string()).collect::<Vec<_>>().join(",");
    let rows: Vec<String> = (0..500).map(row).collect();
    std::fs::write(&table, rows.join("\n") + "\n").unwrap();
    let eit = env!("CARGO_BIN_EXE_eit");
    let line = format!(
        "trap '' XFSZ; ulimit -f 400; exec {eit} convert {} --out {}",
        text(&table),
        text(&out)
    );
    let output = std::process::Command::new("sh").args(["-c", &line]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(stderr(&output).contains("a.mcap: cannot be written"), "{}", stderr(&output));
    assert!(!out.exists());
    // a table is named, not its temporary file, and nothing of it is left
    let out = folder.path().join("b.npy");
    let line = line.replace("a.mcap", "b.npy");
    let output = std::process::Command::new("sh").args(["-c", &line]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(
        stderr(&output).contains(text(&out)) && !stderr(&output).contains(".eit-"),
        "{}",
        stderr(&output)
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Nested brackets in the header of images once took a minute, and were echoed in full.
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
    let folder = tempfile::tempdir().unwrap();
    let [endless, pipe] = ["zero.toml", "pipe.toml"].map(|name| folder.path().join(name));
    std::os::unix::fs::symlink("/dev/zero", &endless).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    for script in [&endless, &pipe] {
        let arguments = ["simulate", "paper-disc", "--script", text(script), "--out", "never"];
        let said = common::refuse(&arguments);
        assert!(said.contains(text(script)) && said.contains("not a file of at most"), "{said}");
    }
    for arguments in [
        vec!["plan", "/dev/zero"],
        vec!["convert", "/dev/zero", "--out", "never.csv"],
        vec!["reconstruct", "paper-disc", "--frames", "/dev/zero", "--out", "never"],
        vec!["recover", "/dev/zero", "never.mcap"],
    ] {
        let said = common::refuse(&arguments);
        assert!(said.contains("/dev/zero") && !said.contains("never"), "{said}");
    }
}

/// Converted message by message: epochs, clocks and notes are kept, and a scene's order applies.
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
    // log times of the messages, which players use
    let times = |path: &Path| {
        let (mut reader, mut times) = (CaptureReader::open(path).unwrap(), Vec::new());
        while reader.next_entry().unwrap().is_some() {
            times.push(reader.times().unwrap());
        }
        times
    };
    let wanted = times(&out);
    let lasted_ns = wanted.last().unwrap().log_ns - wanted[0].log_ns;
    assert!(lasted_ns > 500_000_000, "frames of one second: {lasted_ns} ns");
    assert_eq!(times(&other), wanted);
    let wanted = eit_hw::read_recording(&out, None, &Default::default()).unwrap().real;
    for path in [&table, &array] {
        let read = eit_hw::read_recording(path, None, &Default::default()).unwrap().real;
        assert_eq!(read, wanted);
    }
}

/// Every command reads the parts of a split recording as one.
#[test]
fn a_split_recording_is_one_recording_for_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let emulator = start(device("skin"));
    let (scene, port) = (scene(folder.path()), emulator.endpoint().to_string());
    let path = |name: &str| folder.path().join(name);
    let out = path("press.mcap");
    let common = ["record", text(&scene), "--port", &port, "--out", text(&out), "--json"];
    let record = |more: &[&str]| -> Value {
        serde_json::from_str(&succeed(&[&common[..], more].concat())).unwrap()
    };
    let json = record(&["--seconds", "3.5", "--split-s", "1"]);
    let frames = json["frames"].as_u64().unwrap() as usize;
    let files = eit_hw::capture::files(&out);
    let names: Vec<&str> = files.iter().map(|file| text(file)).collect();
    assert_eq!(json["files"], serde_json::json!(names));
    assert!((3..=4).contains(&files.len()) && !out.exists(), "{names:?}");
    let bytes: u64 = files.iter().map(|file| file.metadata().unwrap().len()).sum();
    assert_eq!(json["bytes"], bytes);
    // a name that is taken by parts
    let exists = common::refuse(&[&common[..], &["--seconds", "1"]].concat());
    assert!(exists.contains("press.00001.mcap: exists") && exists.contains("--append"), "{exists}");
    let exists = common::refuse(&["convert", text(&files[0]), "--out", text(&out)]);
    assert!(exists.contains("press.00001.mcap: exists"), "{exists}");
    // a second run in the last part
    let json = record(&["--seconds", "1", "--append"]);
    let all = frames + json["frames"].as_u64().unwrap() as usize;
    assert_eq!(eit_hw::capture::files(&out), files);
    let capture = eit_hw::capture::read(&out).unwrap();
    assert_eq!((capture.frames().count(), capture.damage), (all, Damage::default()));
    for name in ["all.csv", "all.npy", "all.mcap"] {
        let said = succeed(&["convert", text(&out), "--out", text(&path(name))]);
        assert!(said.starts_with(&format!("{all} frames of 40 values")), "{said}");
    }
    let copy = eit_hw::capture::read(&path("all.mcap")).unwrap();
    assert_eq!(copy.entries, capture.entries);
    let said = succeed(&["recover", text(&out), text(&path("whole.mcap"))]);
    assert!(said.starts_with(&format!("{all} frames")) && said.contains("no damage"), "{said}");
    // images and touches are those of the converted recording
    let images = |from: &Path, to: &str| {
        let to = path(to);
        let frames = ["--frames", text(from), "--reference", "0..20", "--out", text(&to)];
        succeed(&[&["reconstruct", text(&scene)][..], &frames].concat());
        let replayed = path(&format!("replay-{}", text(to.file_name().unwrap().as_ref())));
        // the second run is another epoch, which stderr says
        let arguments = ["replay", text(&scene), "--from", text(from), "--out", text(&replayed)];
        assert!(eit(&arguments).status.success());
        [to, replayed].map(|folder| std::fs::read(folder.join("images.npy")).unwrap())
    };
    assert_eq!(images(&out, "parts"), images(&path("all.mcap"), "one"));
    // a missing part is reported, and `recover` writes the rest
    std::fs::remove_file(&files[1]).unwrap();
    let said = succeed(&["recover", text(&out), text(&path("rest.mcap"))]);
    assert!(said.contains("1 part(s) of the recording are missing"), "{said}");
    let said = succeed(&["convert", text(&out), "--out", text(&path("rest.csv"))]);
    assert!(said.contains("1 part(s) of the recording are missing"), "{said}");
    for (key, value) in [("--split-mb", "0"), ("--split-mb", "nan"), ("--split-s", "0.5")] {
        let said = common::refuse(&[&common[..], &[key, value]].concat());
        assert!(said.contains(&format!("{key} ")), "{said}");
    }
    let said = common::refuse(&["live", text(&scene), "--port", &port, "--split-s", "1"]);
    assert!(said.contains("need --record"), "{said}");
}

/// Total variation of live frames with more pixels than it can keep up with is rejected before work.
#[test]
fn live_total_variation_of_too_many_pixels_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let emulator = start(device("skin"));
    let (_, _, out) = record(folder.path(), &emulator, "1");
    let content = std::fs::read_to_string(scene(folder.path())).unwrap();
    let many = folder.path().join("many.toml");
    for (pixels, wanted) in [
        (
            648,
            "40 measurements on 648 x 648 pixels are too many for total variation of live frames: use at \
               most 647",
        ),
        (4096, "40 measurements on 4096 x 4096 pixels"),
    ] {
        let keys = format!("[reconstruction]\nmethod = \"st-tv\"\npixels = {pixels}\n");
        std::fs::write(&many, format!("{content}\n{keys}")).unwrap();
        let port = emulator.endpoint().to_string();
        let start = std::time::Instant::now();
        for arguments in [
            ["live", text(&many), "--port", &port, "--seconds", "9"],
            ["replay", text(&many), "--from", text(&out), "--speed", "1"],
        ] {
            let said = common::refuse(&arguments);
            assert!(said.contains(wanted), "{said}");
        }
        assert!(start.elapsed() < Duration::from_secs(60), "{:?}", start.elapsed());
    }
}
