//! Live instruments, end to end: `eit emulate` on a pseudo-terminal, and the other commands.
#![cfg(unix)]

use crate::common::emulated::{emulate, scene_at_port, side_by_side, signal};
use crate::common::*;
use eit_hw::capture::{Capture, Entry};

const EITS1: &str = "driver = \"eits1\"\nframe_rate_hz = 100.0";
const FAST: &str = "driver = \"eits1\"\nframe_rate_hz = 200.0";

/// Notes of a recording with these words.
fn notes(capture: &Capture, words: &str) -> usize {
    let is_note = |entry: &&Entry| matches!(entry, Entry::Note(text) if text.contains(words));
    capture.entries.iter().filter(is_note).count()
}

/// Recorded frames equal those sent, for every instrument.
#[test]
fn record_takes_what_each_instrument_sends() {
    let cases = [
        (EITS1, 1e-6, 100.0),
        // potentials are 32-bit floats, and driven electrodes are far off
        ("driver = \"sciospec\"\nframe_rate_hz = 50.0\nrange_v = 10", 3e-6, 50.0),
        ("driver = \"csv\"", 0.0, 50.0),
    ];
    side_by_side(cases, |(instrument, tolerance, sent_hz)| {
        let (folder, scene, port) = scene_at_port(instrument);
        let (file, sent) = touched_frames(&folder);
        let _emulated = emulate(&scene, &port, &format!("--frames {file} --rate-hz 50"));
        let [out, table] = folder.paths(["press.mcap", "press.csv"]);
        let json = answer(format!("record {scene} --out {out} --frames 60"));
        has(&json, json!({ "frames": 60, "lost": 0 }));
        // frames come late while others use the processor: what is told is the time that they took
        let times = eit_hw::capture::read(&out).unwrap();
        let times_s: Vec<f64> = times.frames().map(|f| f.host_time_s.unwrap()).collect();
        let took_hz = 59.0 / (times_s[59] - times_s[0]);
        let [rate_hz, wait_s] = ["frame_rate_hz", "longest_wait_s"].map(|key| number(&json, key));
        assert!(took_hz < 2.0 * sent_hz, "{took_hz} {json}");
        assert!((0.5..2.0).contains(&(rate_hz / took_hz)), "{took_hz} {json}");
        assert!((0.999..59.1).contains(&(wait_s * rate_hz)), "{json}");
        succeed(format!("convert {out} --out {table} --scene {scene}"));
        let read = recorded(&table, instrument.contains("sciospec"));
        assert_eq!(read.dim(), (60, 40));
        // recording starts at any frame of the file, and continues with the next
        let near = |row: ArrayView1<'_, f64>, at: usize| {
            largest(&(&row - &sent.row(at % 200))) <= tolerance * largest(sent)
        };
        let first = (0..200).find(|&at| near(read.row(0), at)).expect("a frame that was sent");
        for (step, row) in read.rows().into_iter().enumerate() {
            assert!(near(row, first + step), "{instrument}: frame {step}");
        }
    });
}

#[test]
fn check_tells_who_it_is_and_how_it_is() {
    let (folder, scene, port) = scene_at_port(EITS1);
    answer("check")["ports"].as_array().unwrap();
    {
        let _emulated = emulate(&scene, &port, "--serial 0042");
        let json = answer(format!("check {scene} --identify"));
        has(&json, json!({ "instrument": "emulated skin", "serial": "0042", "values": 40 }));
        let json = answer(format!("check {scene} --frames 40"));
        has(&json, json!({ "verdict": "good", "frames": 40, "lost_frames": 0 }));
    }
    // electrode 3 has a bad contact: it drives more weakly than it senses
    let (_, sent) = touched_frames(&folder);
    let weak = Array2::from_shape_fn((60, 40), |(frame, i)| {
        let drive = i / 5;
        sent[[frame, i]] * if drive == 2 || (drive + 1) % 8 == 2 { 0.1 } else { 1.0 }
    });
    let file = folder.write_array("weak.npy", &weak);
    let _emulated = emulate(&scene, &port, &format!("--frames {file}"));
    let output = eit(format!("check {scene} --frames 40"));
    ended(&output, 4);
    let said = stdout(&output);
    assert!(said.starts_with("emulated skin 1: faulty"), "{said}");
    says(&said, "electrode 3: reciprocity error…fasten it");
}

/// `record` reports each fault and its end once, on stderr, in its answer and in the recording, and loses nothing.
#[test]
fn record_names_an_electrode_that_opens() {
    let (folder, scene, port) = scene_at_port(EITS1);
    let (_, sent) = touched_frames(&folder);
    let size = largest(sent);
    let frames = Array2::from_shape_fn((400, 40), |(frame, i)| {
        let (drive, sense) = (i / 5, (i / 5 + 2 + i % 5) % 8);
        let is_lost = [drive, sense].iter().any(|&p| p == 2 || p == 1);
        let floating = 0.1 * size * ((frame * 3571 + i * 7907) as f64).sin();
        if is_lost && (100..200).contains(&frame) { floating } else { sent[[frame % 100, i]] }
    });
    let (file, out) = (folder.write_array("opens.npy", &frames), folder.path("opens.mcap"));
    let _emulated = emulate(&scene, &port, &format!("--frames {file}"));
    // wherever recording starts, it contains all of one round and the second after the fault
    let output = eit(format!("record {scene} --out {out} --frames 900 --json"));
    let (said, json) = (ended(&output, 0), parse(&stdout(&output)));
    has(&json, json!({ "frames": 900, "lost": 0 }));
    let faults = json["faulty_electrodes"].as_array().unwrap();
    assert!((1..=3).contains(&faults.len()), "{json}");
    assert!(faults.iter().all(|fault| fault["electrode"] == 3), "{json}");
    let healed: Vec<_> = faults.iter().filter(|fault| fault["until_s"].is_number()).collect();
    // 1 s of the fault and 1 s in which it must be sound, unless the reference started within the fault
    let lasted_s = number(healed[0], "until_s") - number(healed[0], "since_s");
    assert!((1.0..2.5).contains(&lasted_s), "{json}");
    assert_eq!(said.matches("electrode 3 contradicts").count(), faults.len(), "{said}");
    assert_eq!(said.matches("electrode 3 is sound again").count(), healed.len(), "{said}");
    let capture = eit_hw::capture::read(&out).unwrap();
    assert_eq!(capture.frames().count(), 900);
    assert_eq!(notes(&capture, "electrode 3"), faults.len() + healed.len());
}

/// Unplugged twice meanwhile: the recording says so, and continues in new epochs.
#[test]
fn record_goes_on_over_an_unplugged_instrument() {
    let (folder, scene, port) = scene_at_port(EITS1);
    let faults = "--fault unplug_after_bytes=[8000,16000] --fault unplugged_s=0.1";
    let _emulated = emulate(&scene, &port, faults);
    let out = folder.path("press.mcap");
    let output = eit(format!("record {scene} --out {out} --frames 120 --json"));
    let (said, json) = (ended(&output, 0), parse(&stdout(&output)));
    assert_eq!(said.matches("disconnected").count(), 2, "{said}");
    has(&json, json!({ "frames": 120, "reconnections": 2 }));
    let capture = eit_hw::capture::read(&out).unwrap();
    let epochs: Vec<u32> = capture.frames().map(|frame| frame.epoch).collect();
    assert!(epochs.is_sorted() && epochs.last() == Some(&2), "{epochs:?}");
    assert_eq!(notes(&capture, "connect"), 4);
    assert!(!capture.damage.unfinished);
}

/// Starts `eit record` after commands of the shell and waits until some frames are in the file.
fn start_recording(scene: &str, out: &str, before: &str) -> Child {
    let mut record = in_shell(before, format!("record {scene} --out {out} --json"));
    let child = record.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // the first chunk only contains the session
    grows(out, 10_000);
    child
}

/// Waits until a file has this length.
fn grows(path: &str, bytes: u64) {
    wait_until(|| std::fs::metadata(path).is_ok_and(|data| data.len() >= bytes));
}

/// Ends a recording by a signal: it is complete.
fn end_recording(child: Child, name: &str, out: &str) {
    signal(&child, name);
    let output = child.wait_with_output().unwrap();
    ended(&output, 0);
    let capture = eit_hw::capture::read(out).unwrap();
    assert_eq!(capture.damage, Default::default());
    let frames = capture.frames().count();
    has(&parse(&stdout(&output)), json!({ "interrupted": true, "frames": frames }));
}

/// A full disk, by the shell's limit of file size, whose signal SIGXFSZ kills a program that does not expect it.
#[test]
fn a_file_size_limit_ends_the_recording_whole_and_names_the_file() {
    let (folder, scene, port) = scene_at_port(FAST);
    let _emulated = emulate(&scene, &port, "");
    // by default, and with the signal ignored, as under some services
    for (name, before) in [("press.mcap", ""), ("ignored.mcap", "trap '' XFSZ;")] {
        let out = folder.path(name);
        // blocks of 512 or 1024 bytes: three to six seconds
        let line = format!("record {scene} --out {out}");
        let mut record = in_shell(&format!("{before} ulimit -f 800;"), line);
        let said = one_line(&record.output().unwrap(), 1);
        says(&said, format!("the recording has stopped…{out}: …disk space"));
        let capture = eit_hw::capture::read(&out).unwrap();
        let frames = capture.frames().count();
        // truncated to its last complete chunk
        assert!(frames > 0 && !capture.damage.is_any(), "{:?}", capture.damage);
        assert!(said.contains(&format!("contains {frames} frames; ")), "{said}");
    }
}

/// Ctrl-C ends a recording, and so does a closed terminal, but not under `nohup`; a kill loses its last second.
#[test]
fn ctrl_c_and_a_hang_up_end_a_recording_and_a_kill_loses_its_last_second() {
    let (folder, scene, port) = scene_at_port(FAST);
    let _emulated = emulate(&scene, &port, "");
    let [out, below, killed] = folder.paths(["press.mcap", "nohup.mcap", "killed.mcap"]);
    // children of tests that run under `nohup` themselves ignore it too, and no shell can undo that
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:")).unwrap_or("0");
    if u64::from_str_radix(ignored.trim(), 16).unwrap() & 1 == 1 {
        println!("skipped: a hang-up, which is ignored here");
    } else {
        end_recording(start_recording(&scene, &out, ""), "-HUP", &out);
    }
    // what nohup does, which would also redirect the output
    let child = start_recording(&scene, &below, "trap '' HUP;");
    signal(&child, "-HUP");
    grows(&below, std::fs::metadata(&below).unwrap().len() + 20_000);
    end_recording(child, "-INT", &below);

    let child = start_recording(&scene, &killed, "");
    signal(&child, "-KILL");
    child.wait_with_output().unwrap();
    let capture = eit_hw::capture::read(&killed).unwrap();
    let before = capture.frames().count();
    assert!(capture.damage.unfinished && before > 0);
    // and it can be appended to where it was truncated
    let again = format!("record {scene} --out {killed} --frames 20");
    refuse_each([(&again, "never overwritten…--append")]);
    succeed(format!("{again} --append"));
    let capture = eit_hw::capture::read(&killed).unwrap();
    assert_eq!((capture.frames().count(), capture.sessions().count()), (before + 20, 2));
    assert!(!capture.damage.unfinished && capture.damage.bad_chunks == 0);
}

/// A replay reproduces the live images bit for bit, at any speed, whatever reference the scene states for recordings.
#[test]
fn a_replay_gives_the_images_of_the_live_view_to_the_bit() {
    let of_scene = "[recording]\nreference = \"0..20\"";
    let (folder, scene, port) = scene_at_port(&format!("{EITS1}\n{of_scene}"));
    let (file, _) = touched_frames(&folder);
    let _emulated = emulate(&scene, &port, &format!("--frames {file}"));
    let [recording, live, picture] = folder.paths(["press.mcap", "live", "now.png"]);
    let files = format!("--record {recording} --out {live} --picture {picture}");
    let json = answer(format!("live {scene} {files} --frames 120"));
    has(&json, json!({ "frames": 120, "references": 1, "lost": 0, "dropped": 0 }));
    let latency_s = number(&json["latency_s"], "median");
    assert!(number(&json, "touches") > 0.0 && latency_s > 0.0, "{json}");
    assert_eq!(read(&picture)[..4], *b"\x89PNG");
    assert_eq!(read_array::<Ix3>(format!("{live}/images.npy")).dim(), (120, 64, 64));
    let replay = format!("replay {scene} --from {recording}");
    for (name, more) in [("fast", ""), ("real", "--speed 4"), ("step", "--step")] {
        let again = folder.path(name);
        let json = answer(format!("{replay} --out {again} --frames 120 {more}"));
        assert_eq!(json["frames"], 120, "{name}: {json}");
        assert_eq!(json["notices"][0], "the reference is that of the recording: 40 frames");
        for file in ["images.npy", "touches.csv"] {
            let [one, other] = [&live, &again].map(|folder| read(format!("{folder}/{file}")));
            assert!(one == other, "{name}: {file} differs");
        }
    }
    let json = answer(format!("{replay} --reference-frames 24"));
    assert!(json["frames"].as_u64() > Some(120) && json["notices"][0].is_null(), "{json}");
    // a recording can serve other programs as an instrument
    let other = folder.path("again");
    let _again = emulate(&scene, &other, &format!("--frames {recording}"));
    assert_eq!(answer(format!("check {scene} --identify --port {other}"))["values"], 40);
}

/// One line each: what is wrong, where, how to fix it; before any work.
#[test]
fn bad_input_is_reported_in_one_line() {
    let (folder, good, port) = scene_at_port("driver = \"eits1\"");
    let [out, none, jpg, csv] = folder.paths(["out.mcap", "none", "now.jpg", "press.csv"]);
    let with = |instrument: &str| {
        folder.write("other.toml", format!("{SMALL}\n[instrument]\n{instrument}\n"))
    };
    let record = |scene: &str| format!("record {scene} --out {out}");
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
        refuse_each([(record(&with(instrument)), wanted)]);
    }
    // there is nothing at the port; no instrument is opened and no recording read where a number or a name is wrong
    let (live, replay) = (format!("live {good}"), format!("replay {good} --from none.mcap"));
    let (zero, png) = ("--frames 0: it must be above 0", "now.jpg: --picture must end in .png");
    let plain = folder.write("plain.toml", SMALL);
    refuse_each([
        (record(&good), "cannot be opened"),
        (record(&good) + " --port tcp:127.0.0.1:1", "tcp:127.0.0.1:1: cannot be"),
        (record(&good) + " --seconds 0", "--seconds 0: it must be above 0"),
        // a run without any frame would look like a silent instrument, exit code 3
        (record(&good) + " --frames 0", zero),
        (format!("{live} --frames 0"), zero),
        (format!("{replay} --frames 0"), zero),
        (format!("{replay} --speed 0"), "--speed 0: it must be above 0"),
        (format!("{replay} --speed -1"), "--speed -1: it must be above 0"),
        (format!("{replay} --json-lines --json"), "--json-lines and --json"),
        (format!("{replay} --udp 9000"), "--udp: 9000: …HOST:PORT"),
        (format!("{replay} --udp 127.0.0.1:0"), "--udp: 127.0.0.1:0: …HOST:PORT"),
        // a picture is PNG and a recording MCAP, whatever the name
        (format!("{live} --picture {jpg}"), png),
        (format!("{replay} --picture {jpg}"), png),
        (format!("{live} --record {csv}"), "press.csv: --record must end in .mcap"),
        // the noise is unknown from fewer
        (format!("check {good} --frames 0"), "--frames 0: it must be at least 8"),
        (format!("check {good} --frames 7"), "--frames 7: it must be at least 8"),
        (record(&plain), "has no [instrument]"),
    ]);
    assert!(![&jpg, &csv, &out].into_iter().any(exists), "refused before anything is made");

    // another device, and a protocol that it does not measure: both are named
    let csv = with(&format!("driver = \"csv\"\nport = \"{port}\""));
    let emulated = emulate(&csv, &port, "");
    refuse_each([(record(&good), "lines of text with 40 numbers…[instrument] driver")]);
    drop(emulated);
    let board = with(&format!("driver = \"openeit-8\"\nport = \"{port}\""));
    let (file, _) = touched_frames(&folder);
    let of_board = "the protocol of…\"openeit-8\"…it drives (0, 4)";
    refuse_each([(format!("emulate {board} --port {none} --frames {file}"), of_board)]);
    // the board measures with opposite drives, a scene with adjacent ones does not match
    let opposite = read_text(&board).replace("\"adjacent\"", "\"opposite\"");
    let right = folder.write("right.toml", opposite);
    let _emulated = emulate(&right, &port, "");
    refuse_each([(record(&board), "the protocol of…has no drive (0, 1)…openeit-8")]);
    succeed(record(&right) + " --frames 5");
    let emulate = |more: &str| format!("emulate {good} --port {none} {more}");
    refuse_each([
        (format!("emulate {good} --port {port}"), "exists"),
        (emulate("--fault drop_bite=1"), "did you mean \"drop_byte\"?"),
        (emulate("--fault drop_byte=2.0"), "drop_byte is 2"),
        (emulate("--scan-share 2"), "--scan-share: 2: it must be"),
    ]);
}
