//! Live instruments from the command line, end to end: `eit emulate` on a pseudo-terminal, and the
//! other commands as a user runs them.
#![cfg(unix)]
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "tests")]

use crate::common::{SMALL, eit, refuse, succeed, text, touched_frames, write_scene};
use ndarray::{Array2, Array3};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Maximum time that a test waits.
const LIMIT: Duration = Duration::from_secs(120);

/// A running `eit emulate`; stopped when dropped, so that its path does not remain: the system may give the
/// terminal behind it to another test.
struct Emulated(Child);

impl Drop for Emulated {
    fn drop(&mut self) {
        // it may have exited already
        let _ = Command::new("kill").arg(self.0.id().to_string()).status();
        let _ = self.0.wait();
    }
}

/// Starts `eit emulate` and waits until its port exists.
fn emulate(scene: &Path, port: &Path, more: &[&str]) -> Emulated {
    let arguments = [&["emulate", text(scene), "--port", text(port)], more].concat();
    let child = Command::new(env!("CARGO_BIN_EXE_eit"))
        .args(&arguments)
        .stdout(Stdio::null())
        .stderr(Stdio::inherit())
        .spawn()
        .unwrap();
    let (start, mut emulated) = (Instant::now(), Emulated(child));
    while !port.exists() {
        assert!(start.elapsed() < LIMIT, "no port");
        assert!(emulated.0.try_wait().unwrap().is_none(), "eit {arguments:?} has ended");
        std::thread::sleep(Duration::from_millis(10));
    }
    emulated
}

/// A folder, and a scene in it with this instrument.
fn scene(instrument: &str) -> (tempfile::TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("skin");
    let content = format!("{SMALL}\n[instrument]\nport = \"{}\"\n{instrument}\n", text(&port));
    let scene = write_scene(folder.path(), &content);
    (folder, scene, port)
}

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|e| panic!("{e}: {text}"))
}

/// Recorded frames equal those sent, for every instrument.
#[test]
fn record_takes_what_each_instrument_sends() {
    for (instrument, tolerance, sent_hz) in [
        ("driver = \"eits1\"\nframe_rate_hz = 100.0", 1e-6, 100.0),
        // potentials are 32-bit floats, and driven electrodes are far off
        ("driver = \"sciospec\"\nframe_rate_hz = 50.0\nrange_v = 10", 3e-6, 50.0),
        ("driver = \"csv\"", 0.0, 50.0),
    ] {
        let (folder, scene, port) = scene(instrument);
        let (file, sent) = touched_frames(folder.path(), &scene);
        let more = ["--frames", text(&file), "--rate-hz", "50"];
        let _emulated = emulate(&scene, &port, &more);
        let out = folder.path().join("press.mcap");
        let answer =
            succeed(&["record", text(&scene), "--out", text(&out), "--frames", "60", "--json"]);
        let answer = json(&answer);
        assert_eq!((&answer["frames"], &answer["lost"]), (&60.into(), &0.into()), "{answer}");
        // frames come late while others use the processor: what is told is the time that they took
        let times_s: Vec<f64> =
            eit_hw::capture::read(&out).unwrap().frames().map(|f| f.host_time_s.unwrap()).collect();
        let took_hz = 59.0 / (times_s[59] - times_s[0]);
        let rate_hz = answer["frame_rate_hz"].as_f64().unwrap();
        assert!(took_hz < 2.0 * sent_hz, "{took_hz} {answer}");
        assert!((0.5..2.0).contains(&(rate_hz / took_hz)), "{took_hz} {answer}");
        let wait_s = answer["longest_wait_s"].as_f64().unwrap();
        assert!((0.999..59.1).contains(&(wait_s * rate_hz)), "{answer}");
        let table = folder.path().join("press.csv");
        succeed(&["convert", text(&out), "--out", text(&table), "--scene", text(&scene)]);
        let options =
            eit_hw::ReadOptions { complex: instrument.contains("sciospec"), ..Default::default() };
        let read = eit_hw::read_recording(&table, None, &options).unwrap().real;
        assert_eq!(read.dim(), (60, 40));
        let size = sent.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        // recording starts at any frame of the file, and continues with the next
        let near = |row: ndarray::ArrayView1<'_, f64>, at: usize| {
            row.iter().zip(sent.row(at % 200)).all(|(a, b)| (a - b).abs() <= tolerance * size)
        };
        let first = (0..200).find(|&at| near(read.row(0), at));
        let first = first.unwrap_or_else(|| panic!("{instrument}: no frame that was sent"));
        for (step, row) in read.rows().into_iter().enumerate() {
            assert!(near(row, first + step), "{instrument}: frame {step}");
        }
    }
}

#[test]
fn devices_and_check_tell_who_it_is_and_how_it_is() {
    let (folder, scene, port) = scene("driver = \"eits1\"\nframe_rate_hz = 100.0");
    json(&succeed(&["devices", "--json"]))["ports"].as_array().unwrap();
    {
        let _emulated = emulate(&scene, &port, &["--serial", "0042"]);
        let answer = json(&succeed(&["devices", text(&scene), "--json"]));
        assert_eq!(
            (&answer["instrument"], &answer["serial"]),
            (&"emulated skin".into(), &"0042".into())
        );
        assert_eq!(answer["values"], 40);
        let answer = json(&succeed(&["check", text(&scene), "--frames", "40", "--json"]));
        assert_eq!(answer["verdict"], "good", "{answer}");
        assert_eq!((&answer["frames"], &answer["lost_frames"]), (&40.into(), &0.into()));
    }
    // electrode 3 has a bad contact: it drives more weakly than it senses
    let (_, sent) = touched_frames(folder.path(), &scene);
    let weak = Array2::from_shape_fn((60, 40), |(frame, i)| {
        let drive = i / 5;
        let bad = drive == 2 || (drive + 1) % 8 == 2;
        sent[[frame, i]] * if bad { 0.1 } else { 1.0 }
    });
    let file = folder.path().join("weak.npy");
    ndarray_npy::write_npy(&file, &weak).unwrap();
    let _emulated = emulate(&scene, &port, &["--frames", text(&file)]);
    let output = eit(&["check", text(&scene), "--frames", "40"]);
    assert_eq!(output.status.code(), Some(4));
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.starts_with("emulated skin 1: faulty"), "{said}");
    assert!(said.contains("electrode 3: reciprocity error"), "{said}");
    assert!(said.contains("fasten it"), "{said}");
}

/// Faults that neither violate reciprocity nor are flagged: a bridge between electrodes 3 and 4 removes the
/// voltage between them, whichever drives; and a multiplexer that holds the values of one electrode.
#[test]
fn check_names_a_shorted_and_a_stuck_electrode() {
    let pairs: Vec<[usize; 2]> =
        (0..8).flat_map(|d| (2..7).map(move |k| [d, (d + k) % 8])).collect();
    let of = |electrode: usize, pair: &[usize; 2]| {
        pair.iter().any(|&p| p == electrode || (p + 1) % 8 == electrode)
    };
    let check = |change: &dyn Fn(&[usize; 2], usize, f64) -> f64| {
        let (folder, scene, port) = scene("driver = \"eits1\"\nframe_rate_hz = 100.0");
        let (_, sent) = touched_frames(folder.path(), &scene);
        let size = sent.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
        let frames = Array2::from_shape_fn((60, 40), |(frame, i)| {
            let noise = 1e-4 * size * ((frame * 7919 + i * 104_729) as f64).sin();
            change(&pairs[i], frame, noise) + change(&pairs[i], 0, sent[[0, i]])
        });
        let file = folder.path().join("frames.npy");
        ndarray_npy::write_npy(&file, &frames).unwrap();
        let _emulated = emulate(&scene, &port, &["--frames", text(&file)]);
        let output = eit(&["check", text(&scene), "--frames", "50", "--json"]);
        let answer = json(&String::from_utf8(output.stdout).unwrap());
        let findings = answer["findings"].as_array().unwrap().clone();
        let faulty = answer["verdict"] == "faulty";
        assert_eq!(output.status.code(), Some(if faulty { 4 } else { 0 }), "{answer}");
        (answer["verdict"].as_str().unwrap().to_owned(), findings)
    };
    // sound
    let (verdict, findings) = check(&|_, _, value| value);
    assert_eq!((verdict.as_str(), findings.len()), ("good", 0), "{findings:?}");
    // shorted: a thousandth remains
    let (verdict, findings) =
        check(&|pair, _, value| if pair.contains(&2) { 1e-3 * value } else { value });
    assert_eq!(verdict, "faulty");
    let named: Vec<_> = findings.iter().filter_map(|f| f["electrode"].as_u64()).collect();
    assert!(!named.is_empty() && named.iter().all(|e| [3, 4].contains(e)), "{findings:?}");
    assert!(findings[0]["what"].as_str().unwrap().contains("shorted"), "{findings:?}");
    // stuck: no noise where electrode 6 is involved
    let (verdict, findings) =
        check(&|pair, frame, value| if of(5, pair) && frame > 0 { 0.0 } else { value });
    assert_eq!(verdict, "faulty", "{findings:?}");
    let stuck = findings.iter().find(|f| f["electrode"] == 6).unwrap();
    assert!(stuck["what"].as_str().unwrap().contains("stuck"), "{findings:?}");
    assert!(
        findings.iter().all(|f| f["electrode"].is_null() || f["electrode"] == 6),
        "{findings:?}"
    );
}

/// Electrode 3 opens in frame 100 of 200 that are sent in a loop, and is sound again with the first: `record`
/// reports each once, on stderr, in its answer and in the recording, and loses nothing.
#[test]
fn record_names_an_electrode_that_opens() {
    let (folder, scene, port) = scene("driver = \"eits1\"\nframe_rate_hz = 100.0");
    let (_, sent) = touched_frames(folder.path(), &scene);
    let size = sent.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let frames = Array2::from_shape_fn((400, 40), |(frame, i)| {
        let (drive, sense) = (i / 5, (i / 5 + 2 + i % 5) % 8);
        let is_lost = [drive, sense].iter().any(|&p| p == 2 || p == 1);
        let floating = 0.1 * size * ((frame * 3571 + i * 7907) as f64).sin();
        if is_lost && (100..200).contains(&frame) { floating } else { sent[[frame % 100, i]] }
    });
    let file = folder.path().join("opens.npy");
    ndarray_npy::write_npy(&file, &frames).unwrap();
    let _emulated = emulate(&scene, &port, &["--frames", text(&file)]);
    let out = folder.path().join("opens.mcap");
    // wherever recording starts, it contains all of one round and the second after the fault
    let output = eit(&["record", text(&scene), "--out", text(&out), "--frames", "900", "--json"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let answer = json(&String::from_utf8(output.stdout).unwrap());
    assert_eq!((&answer["frames"], &answer["lost"]), (&900.into(), &0.into()), "{answer}");
    let faults = answer["faulty_electrodes"].as_array().unwrap();
    assert!((1..=3).contains(&faults.len()), "{answer}");
    for fault in faults {
        assert_eq!(fault["electrode"], 3, "{answer}");
    }
    let whole = faults.iter().find(|fault| fault["until_s"].is_number()).unwrap();
    let time_s = |key: &str| whole[key].as_f64().unwrap();
    // 1 s of the fault and 1 s in which it must be sound, unless the reference started within the fault
    let lasted_s = time_s("until_s") - time_s("since_s");
    assert!((1.0..2.5).contains(&lasted_s), "{answer}");
    let heals = faults.iter().filter(|fault| fault["until_s"].is_number()).count();
    assert_eq!(said.matches("electrode 3 contradicts").count(), faults.len(), "{said}");
    assert_eq!(said.matches("electrode 3 is sound again").count(), heals, "{said}");
    let capture = eit_hw::capture::read(&out).unwrap();
    assert_eq!(capture.frames().count(), 900);
    let notes = capture.entries.iter().filter(
        |entry| matches!(entry, eit_hw::capture::Entry::Note(text) if text.contains("electrode 3")),
    );
    assert_eq!(notes.count(), faults.len() + heals);
}

/// Unplugged twice meanwhile: the recording says so, and continues in new epochs.
#[test]
fn record_goes_on_over_an_unplugged_instrument() {
    let (folder, scene, port) = scene("driver = \"eits1\"\nframe_rate_hz = 100.0");
    let more = ["--fault", "unplug_after_bytes=[8000, 16000]", "--fault", "unplugged_s=0.1"];
    let _emulated = emulate(&scene, &port, &more);
    let out = folder.path().join("press.mcap");
    let output = eit(&["record", text(&scene), "--out", text(&out), "--frames", "120", "--json"]);
    assert!(output.status.success());
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(said.matches("disconnected").count(), 2, "{said}");
    let answer = json(&String::from_utf8(output.stdout).unwrap());
    assert_eq!((&answer["frames"], &answer["reconnections"]), (&120.into(), &2.into()), "{answer}");
    let capture = eit_hw::capture::read(&out).unwrap();
    let epochs: Vec<u32> = capture.frames().map(|frame| frame.epoch).collect();
    assert!(epochs.is_sorted() && epochs.last() == Some(&2), "{epochs:?}");
    let notes = capture.entries.iter().filter(
        |entry| matches!(entry, eit_hw::capture::Entry::Note(text) if text.contains("connect")),
    );
    assert_eq!(notes.count(), 4);
    assert!(!capture.damage.unfinished);
}

/// Sends a signal to a child.
fn signal(child: &Child, name: &str) {
    let status = Command::new("kill").args([name, &child.id().to_string()]).status().unwrap();
    assert!(status.success());
}

/// Starts `eit record` and waits until some frames are in the file.
fn start_recording(scene: &Path, out: &Path) -> Child {
    recording(Command::new(env!("CARGO_BIN_EXE_eit")), scene, out)
}

/// The same with a command that gets its arguments.
fn recording(mut program: Command, scene: &Path, out: &Path) -> Child {
    let child = program
        .args(["record", text(scene), "--out", text(out), "--json"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let start = Instant::now();
    // the first chunk only contains the session
    while std::fs::metadata(out).map_or(0, |data| data.len()) < 10_000 {
        assert!(start.elapsed() < LIMIT, "nothing is recorded");
        std::thread::sleep(Duration::from_millis(20));
    }
    child
}

#[test]
fn ctrl_c_ends_a_recording_and_a_kill_loses_its_last_second() {
    let (folder, scene, port) = scene("driver = \"eits1\"\nframe_rate_hz = 200.0");
    let _emulated = emulate(&scene, &port, &[]);
    let out = folder.path().join("press.mcap");
    let child = start_recording(&scene, &out);
    signal(&child, "-INT");
    let Output { status, stdout, stderr } = child.wait_with_output().unwrap();
    assert!(status.success(), "{}", String::from_utf8_lossy(&stderr));
    let answer = json(&String::from_utf8(stdout).unwrap());
    assert_eq!(answer["interrupted"], true);
    let capture = eit_hw::capture::read(&out).unwrap();
    assert_eq!(capture.damage, Default::default());
    assert_eq!(answer["frames"], capture.frames().count());

    let killed = folder.path().join("killed.mcap");
    let child = start_recording(&scene, &killed);
    signal(&child, "-KILL");
    child.wait_with_output().unwrap();
    let capture = eit_hw::capture::read(&killed).unwrap();
    let before = capture.frames().count();
    assert!(capture.damage.unfinished && before > 0);
    // and it can be appended to where it was truncated
    let said = refuse(&["record", text(&scene), "--out", text(&killed), "--frames", "20"]);
    assert!(said.contains("never overwritten") && said.contains("--append"), "{said}");
    succeed(&["record", text(&scene), "--out", text(&killed), "--frames", "20", "--append"]);
    let capture = eit_hw::capture::read(&killed).unwrap();
    assert_eq!(capture.frames().count(), before + 20);
    assert!(!capture.damage.unfinished && capture.damage.bad_chunks == 0);
    assert_eq!(capture.sessions().count(), 2);
}

/// A full disk, simulated by the shell's limit of file size. The system signals the limit by SIGXFSZ, which
/// kills a program that does not expect it, and its recording with it.
#[test]
fn a_file_size_limit_ends_the_recording_whole_and_names_the_file() {
    let (folder, scene, port) = scene("driver = \"eits1\"\nframe_rate_hz = 200.0");
    let _emulated = emulate(&scene, &port, &[]);
    // by default, and with the signal ignored, as under some services
    for (name, before) in [("press.mcap", ""), ("ignored.mcap", "trap '' XFSZ; ")] {
        let out = folder.path().join(name);
        let (eit, out_text) = (env!("CARGO_BIN_EXE_eit"), text(&out));
        // blocks of 512 or 1024 bytes: three to six seconds
        let line =
            format!("{before}ulimit -f 800; exec {eit} record {} --out {out_text}", text(&scene));
        let Output { status, stderr, .. } =
            Command::new("sh").args(["-c", &line]).output().unwrap();
        let said = String::from_utf8_lossy(&stderr);
        assert_eq!(status.code(), Some(1), "{status}: {said}");
        assert_eq!(said.trim_end().lines().count(), 1, "{said}");
        assert!(said.contains("the recording has stopped"), "{said}");
        assert!(said.contains(&format!("{out_text}: ")) && said.contains("disk space"), "{said}");
        let capture = eit_hw::capture::read(&out).unwrap();
        let frames = capture.frames().count();
        // truncated to its last complete chunk
        assert!(frames > 0 && !capture.damage.is_any(), "{:?}", capture.damage);
        assert!(said.contains(&format!("contains {frames} frames; ")), "{said}");
    }
}

/// A closed terminal ends a recording like Ctrl-C; under `nohup` it continues.
#[test]
fn a_hang_up_ends_a_recording_but_not_below_nohup() {
    let (folder, scene, port) = scene("driver = \"eits1\"\nframe_rate_hz = 200.0");
    let _emulated = emulate(&scene, &port, &[]);
    let out = folder.path().join("press.mcap");
    // children of tests that run under `nohup` themselves ignore it too, and no shell can undo that
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap_or("0");
    if u64::from_str_radix(ignored.trim(), 16).unwrap() & 1 == 1 {
        println!("skipped: a hang-up, which is ignored here");
    } else {
        let child = start_recording(&scene, &out);
        signal(&child, "-HUP");
        let Output { status, stdout, stderr } = child.wait_with_output().unwrap();
        assert!(status.success(), "{status}: {}", String::from_utf8_lossy(&stderr));
        assert_eq!(json(&String::from_utf8(stdout).unwrap())["interrupted"], true);
        assert_eq!(eit_hw::capture::read(&out).unwrap().damage, Default::default());
    }

    let out = folder.path().join("nohup.mcap");
    let mut shell = Command::new("sh");
    // what nohup does, which would also redirect the output
    shell.args(["-c", "trap '' HUP; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_eit")]);
    let mut child = recording(shell, &scene, &out);
    signal(&child, "-HUP");
    let length = || std::fs::metadata(&out).map_or(0, |data| data.len());
    let (start, before) = (Instant::now(), length());
    while length() < before + 20_000 {
        assert!(child.try_wait().unwrap().is_none(), "it has ended");
        assert!(start.elapsed() < LIMIT, "it does not go on");
        std::thread::sleep(Duration::from_millis(20));
    }
    signal(&child, "-INT");
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

/// A replay reproduces the live images bit for bit, at any speed.
#[test]
fn a_replay_gives_the_images_of_the_live_view_to_the_bit() {
    let (folder, scene, port) = scene("driver = \"eits1\"\nframe_rate_hz = 100.0");
    let (file, _) = touched_frames(folder.path(), &scene);
    let _emulated = emulate(&scene, &port, &["--frames", text(&file)]);
    let path = |name: &str| folder.path().join(name);
    let (recording, live, picture) = (path("press.mcap"), path("live"), path("now.png"));
    let answer = succeed(&[
        "live",
        text(&scene),
        "--record",
        text(&recording),
        "--out",
        text(&live),
        "--picture",
        text(&picture),
        "--reference-frames",
        "20",
        "--frames",
        "120",
        "--json",
    ]);
    let answer = json(&answer);
    assert_eq!((&answer["frames"], &answer["references"]), (&120.into(), &1.into()), "{answer}");
    assert_eq!((&answer["lost"], &answer["dropped"]), (&0.into(), &0.into()), "{answer}");
    assert!(answer["touches"].as_u64().unwrap() > 0, "{answer}");
    assert!(answer["latency_s"]["median"].as_f64().unwrap() > 0.0, "{answer}");
    assert_eq!(std::fs::read(&picture).unwrap()[..4], *b"\x89PNG");
    let images: Array3<f64> = ndarray_npy::read_npy(live.join("images.npy")).unwrap();
    assert_eq!(images.dim(), (120, 64, 64));
    for (name, more) in [("fast", &[][..]), ("real", &["--speed", "4"]), ("step", &["--step"])] {
        let again = path(name);
        let arguments = [
            &["replay", text(&scene), "--from", text(&recording), "--out", text(&again)][..],
            &["--reference-frames", "20", "--json"],
            more,
        ]
        .concat();
        let answer = json(&succeed(&arguments));
        assert_eq!(answer["frames"], 120, "{name}: {answer}");
        for file in ["images.npy", "touches.csv"] {
            let [one, other] = [&live, &again].map(|f| std::fs::read(f.join(file)).unwrap());
            assert!(one == other, "{name}: {file} differs");
        }
    }
    let said = refuse(&["replay", text(&scene), "--from", text(&recording), "--speed", "0"]);
    assert!(said.contains("speed is 0"), "{said}");
    // a recording can serve other programs as an instrument
    let _again = emulate(&scene, &path("again"), &["--frames", text(&recording)]);
    let answer =
        json(&succeed(&["devices", text(&scene), "--port", text(&path("again")), "--json"]));
    assert_eq!(answer["values"], 40);
}

/// Tables become recordings and tables again, with identical numbers.
#[test]
fn convert_keeps_every_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let frames = Array2::from_shape_fn((5, 40), |(i, j)| (0.1 + i as f64).powf(j as f64 - 20.0));
    ndarray_npy::write_npy(path("a.npy"), &frames).unwrap();
    for (from, to) in
        [("a.npy", "b.mcap"), ("b.mcap", "c.csv"), ("c.csv", "d.mcap"), ("d.mcap", "e.npy")]
    {
        succeed(&["convert", text(&path(from)), "--out", text(&path(to))]);
    }
    assert_eq!(std::fs::read(path("a.npy")).unwrap(), std::fs::read(path("e.npy")).unwrap());
    let said = refuse(&["convert", text(&path("a.npy")), "--out", text(&path("b.mcap"))]);
    assert!(said.contains("never overwritten"), "{said}");
    let said = refuse(&["convert", text(&path("a.npy")), "--out", text(&path("b.txt"))]);
    assert!(said.contains("--out must end in"), "{said}");
}

/// One line each: what is wrong, where, how to fix it; before any work.
#[test]
fn bad_input_is_told_in_one_line() {
    let (folder, good, port) = scene("driver = \"eits1\"");
    let out = folder.path().join("out.mcap");
    let record = |scene: &Path, more: &[&str]| {
        refuse(&[&["record", text(scene), "--out", text(&out)], more].concat())
    };
    let with = |instrument: &str| {
        let path = folder.path().join("other.toml");
        std::fs::write(&path, format!("{SMALL}\n[instrument]\n{instrument}\n")).unwrap();
        path
    };
    for (instrument, wanted) in [
        ("driver = \"eits2\"", "none of \"eits1\", \"sciospec\", \"csv\", \"openeit-8\""),
        ("driver = \"eits1\"\nboud = 9600", "unknown key \"boud\": did you mean \"baud\"?"),
        ("driver = \"eits1\"\ngain = 10", "instrument.gain has no effect with driver = \"eits1\""),
        ("driver = \"sciospec\"\ngain = 3", "instrument.gain is 3: it must be 1, 10, 100 or 1000"),
        ("driver = \"sciospec\"\nrange_v = 2", "instrument.range_v is 2"),
        ("driver = \"sciospec\"\nframe_rate_hz = 500.0", "frame_rate_hz is 500"),
        ("driver = \"serial-16\"\nframe_rate_hz = 50.0", "instrument.frame_rate_hz has no effect"),
        ("driver = \"eits1\"", "instrument.port is missing"),
        ("driver = \"eits1\"\nport = \"tcp:nowhere\"", "`tcp:host:port`"),
        ("driver = \"eits1\"\nport = \"/x\"\nbaud = 0", "baud is 0"),
    ] {
        let said = record(&with(instrument), &[]);
        assert!(said.contains(wanted), "{instrument}: {said}");
    }
    // there is nothing at the port
    let said = record(&good, &[]);
    assert!(said.contains("cannot be opened") && said.contains("plug it in"), "{said}");
    let said = record(&good, &["--port", "tcp:127.0.0.1:1"]);
    assert!(said.contains("tcp:127.0.0.1:1: cannot be opened"), "{said}");
    let said = record(&good, &["--seconds", "0"]);
    assert!(said.contains("--seconds 0: it must be above 0"), "{said}");
    // a run without any frame would look like a silent instrument, exit code 3
    let said = record(&good, &["--frames", "0"]);
    assert!(said.contains("--frames 0: it must be above 0"), "{said}");
    for more in [&["live", text(&good)][..], &["replay", text(&good), "--from", "none.mcap"]] {
        let said = refuse(&[more, &["--frames", "0"]].concat());
        assert!(said.contains("--frames 0: it must be above 0"), "{more:?}: {said}");
    }
    // a picture is PNG and a recording MCAP, whatever the name: no instrument is opened and no recording read
    let (jpg, csv) = (folder.path().join("now.jpg"), folder.path().join("press.csv"));
    for command in [&["live", text(&good)][..], &["replay", text(&good), "--from", "none.mcap"]] {
        let said = refuse(&[command, &["--picture", text(&jpg)]].concat());
        assert!(said.contains("now.jpg: --picture must end in .png"), "{command:?}: {said}");
    }
    let said = refuse(&["live", text(&good), "--record", text(&csv)]);
    assert!(said.contains("press.csv: --record must end in .mcap"), "{said}");
    assert!(!jpg.exists() && !csv.exists(), "refused before anything is made");
    // the noise is unknown from fewer
    for few in ["0", "2", "7"] {
        let said = refuse(&["check", text(&good), "--frames", few]);
        assert!(said.contains(&format!("--frames {few}: it must be at least 8")), "{said}");
    }
    let plain = folder.path().join("plain.toml");
    std::fs::write(&plain, SMALL).unwrap();
    let said = record(&plain, &[]);
    assert!(said.contains("has no [instrument]"), "{said}");
    assert!(!out.exists(), "refused before anything is made");

    // another device, and a protocol that it does not measure: both are named
    let csv = with(&format!("driver = \"csv\"\nport = \"{}\"", text(&port)));
    let emulated = emulate(&csv, &port, &[]);
    let said = record(&good, &[]);
    assert!(said.contains("lines of text with 40 numbers"), "{said}");
    assert!(said.contains("instrument.driver") || said.contains("`[instrument] driver`"), "{said}");
    drop(emulated);
    let board = with(&format!("driver = \"openeit-8\"\nport = \"{}\"", text(&port)));
    let (file, _) = touched_frames(folder.path(), &good);
    let none = folder.path().join("none");
    let arguments = ["--port", text(&none), "--frames", text(&file)];
    let said = refuse(&[&["emulate", text(&board)], &arguments[..]].concat());
    assert!(said.contains("the protocol of") && said.contains("\"openeit-8\""), "{said}");
    assert!(said.contains("it drives (0, 4)"), "{said}");
    // the board measures with opposite drives, a scene with adjacent ones does not match
    let opposite = std::fs::read_to_string(&board).unwrap().replace("\"adjacent\"", "\"opposite\"");
    let right = folder.path().join("right.toml");
    std::fs::write(&right, opposite).unwrap();
    let _emulated = emulate(&right, &port, &[]);
    let said = record(&board, &[]);
    assert!(said.contains("the protocol of") && said.contains("has no drive (0, 1)"), "{said}");
    assert!(said.contains("openeit-8"), "{said}");
    succeed(&["record", text(&right), "--out", text(&out), "--frames", "5"]);

    let said = refuse(&["emulate", text(&good), "--port", text(&port)]);
    assert!(said.contains("exists"), "{said}");
    let free = folder.path().join("free");
    let said = refuse(&["emulate", text(&good), "--port", text(&free), "--fault", "drop_bite=1"]);
    assert!(said.contains("did you mean \"drop_byte\"?"), "{said}");
    let said = refuse(&["emulate", text(&good), "--port", text(&free), "--fault", "drop_byte=2.0"]);
    assert!(said.contains("drop_byte is 2"), "{said}");
    assert!(eit(&["live", "--help"]).status.success());
}
