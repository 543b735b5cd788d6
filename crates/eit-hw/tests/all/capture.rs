//! Recordings: what is written is read back, whatever happens to the file. One file, because all
//! tests share the same recordings.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::time::{Duration, Instant};

use crate::common::recordings::{container, frame, session};
use crate::common::rotated;
use eit_hw::capture::{
    Capture, CaptureSettings, CaptureWriter, Entry, ReferenceRecord, SessionRecord, TouchesRecord,
    UnitName, parse, read,
};
use eit_hw::driver::{Event, FrameSource as _, Pace, Replay};
use eit_hw::{Component, Format, Frame, HwError, Quality, ReadOptions, Unit, read_recording};

fn entries(count: u64) -> Vec<Entry> {
    let mut entries = vec![Entry::Session(session())];
    for sequence in 0..count {
        entries.push(Entry::Frame(frame(sequence)));
        if sequence % 20 == 3 {
            let touch = r#"{"id":2,"position_m":[0.01,-0.02,0],"valid":true}"#;
            let json = format!(r#"{{"sequence":{sequence},"state":"sound","touches":[{touch}]}}"#);
            entries.push(Entry::Touches(TouchesRecord::new(json).unwrap()));
            entries.push(Entry::Note(format!("frame {sequence}: \"quoted\"\n\u{b5}")));
        }
    }
    let values = vec![Some(0.1 + 0.2), None];
    entries.push(Entry::Reference(ReferenceRecord {
        epoch: 3,
        values,
        sequences: vec![3, 5],
        until: Some(7),
    }));
    entries
}

/// Writes a recording with a chunk after every `per_chunk` entries.
fn recorded(path: &Path, entries: &[Entry], per_chunk: usize, finish: bool) -> Vec<u8> {
    let Entry::Session(session) = &entries[0] else { panic!("a session comes first") };
    let settings = CaptureSettings { flush_s: 3600.0, ..CaptureSettings::default() };
    let mut writer = CaptureWriter::create(path, session, settings).unwrap();
    for chunk in entries[1..].chunks(per_chunk) {
        chunk.iter().for_each(|entry| writer.write(entry).unwrap());
        writer.flush().unwrap();
    }
    if finish {
        writer.finish().unwrap();
        return std::fs::read(path).unwrap();
    }
    // the file as it would be if the program were killed here
    std::fs::read(path).unwrap()
}

/// Returns the ends of the chunks, from the container's layout: opcode, length, body.
fn chunk_ends(bytes: &[u8]) -> Vec<usize> {
    let (mut at, mut ends) = (8, Vec::new());
    while at + 9 <= bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap());
        let end = at + 9 + usize::try_from(length).unwrap();
        if bytes[at] == 0x06 {
            ends.push(end);
        }
        at = end;
    }
    ends
}

#[test]
fn every_entry_is_read_back_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut wanted = entries(100);
    // everything that JSON has no number for, and the limits of the numbers that it has
    let mut odd = frame(100);
    odd.values[..6].copy_from_slice(&[f64::MAX, f64::MIN_POSITIVE, 5e-324, -0.0, 0.1, 1e22]);
    odd.imaginary = Some(odd.values.iter().map(|value| -value).collect());
    odd.quality[7] = Quality::SATURATED | Quality::MISSING;
    odd.host_time_s = None;
    wanted.push(Entry::Frame(odd));
    let bytes = recorded(&path, &wanted, 13, true);
    let capture = parse(&bytes, &path).unwrap();
    assert_eq!(capture.damage, Default::default());
    assert_eq!(capture.entries.len(), wanted.len());
    for (found, wanted) in capture.entries.iter().zip(&wanted) {
        assert_eq!(found, wanted);
    }
    let negative = capture.frames().last().unwrap().values[3];
    assert!(negative == 0.0 && negative.is_sign_negative());

    let mut writer = CaptureWriter::append(&path, &session(), CaptureSettings::default()).unwrap();
    let mut bad = frame(101);
    bad.values[5] = f64::INFINITY;
    bad.quality[5] = Quality::NON_FINITE;
    writer.frame(&bad).unwrap();
    writer.finish().unwrap();
    let after = read(&path).unwrap();
    assert_eq!(after.entries[..wanted.len()], wanted);
    let last = after.frames().last().unwrap();
    assert!(last.values[5].is_nan() && last.quality[5] == Quality::NON_FINITE);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// Foxglove draws the touches of a recording as it is, and that there are none any more; a frame without a touch costs nothing.
#[test]
fn touches_are_drawn_by_foxglove() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut writer = CaptureWriter::create(&path, &session(), CaptureSettings::default()).unwrap();
    let touch =
        r#"{"id":2,"state":"hold","position_m":[0.01,-0.02,0],"valid":false,"force_n":1.25}"#;
    let end = r#"{"id":2,"state":"end","position_m":[0.01,-0.02,0],"valid":false,"force_n":null}"#;
    for (state, touches) in [
        ("sound", ""),
        ("sound", touch),
        ("sound", end),
        ("frozen", ""),
        ("sound", ""),
        ("sound", ""),
    ] {
        let json = format!(r#"{{"sequence":1,"state":"{state}","touches":[{touches}]}}"#);
        writer.touches(&TouchesRecord::new(json).unwrap()).unwrap();
    }
    writer.finish().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let mut drawn = Vec::new();
    for message in messages.filter(|message| message.channel.topic == "/eit/scene") {
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!(
            (schema.name.as_str(), schema.encoding.as_str()),
            ("foxglove.SceneUpdate", "jsonschema")
        );
        let scene: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
        let entity = &scene["entities"][0];
        let time = message.log_time;
        assert_eq!(entity["timestamp"]["sec"], time / 1_000_000_000);
        let texts = entity["texts"].as_array().unwrap().iter().map(|text| text["text"].clone());
        drawn.push((entity["spheres"].clone(), texts.collect::<Vec<_>>()));
    }
    let spheres: Vec<usize> = drawn.iter().map(|(s, _)| s.as_array().unwrap().len()).collect();
    assert_eq!(spheres, [1, 0, 0, 0]);
    let sphere = &drawn[0].0[0];
    assert_eq!(
        (&sphere["pose"]["position"]["y"], &sphere["color"]["a"]),
        (&(-0.02).into(), &0.35.into())
    );
    let texts = drawn.iter().map(|(_, texts)| serde_json::Value::from(texts.clone()).to_string());
    let wanted = [r#"["2 1.2 N"]"#, "[]", r#"["not known: frozen"]"#, "[]"];
    assert_eq!(texts.collect::<Vec<_>>(), wanted);
    // and our own reader passes over the scenes
    assert_eq!(read(&path).unwrap().entries.len(), 7);
}

/// All frames of a session have its number of measurements.
#[test]
fn a_frame_of_another_length_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut writer = CaptureWriter::create(&path, &session(), CaptureSettings::default()).unwrap();
    writer.frame(&frame(0)).unwrap();
    let [mut short, mut bare, mut half] = [frame(1), frame(1), frame(1)];
    short.values.pop();
    bare.quality.clear();
    half.imaginary = Some(vec![0.0]);
    let wanted = session().quadruples.len();
    let cases = [(&short, "values", wanted - 1), (&bare, "quality", 0), (&half, "imaginary", 1)];
    for (wrong, name, length) in cases {
        let refused = writer.frame(wrong).unwrap_err();
        let HwError::Inconsistent { field, found, wanted: expected, .. } = refused else {
            panic!("{refused}")
        };
        assert_eq!((field, found, expected), (name, length, wanted));
    }
    writer.frame(&frame(1)).unwrap();
    writer.finish().unwrap();
    assert_eq!(read(&path).unwrap().frames().count(), 2);
}

/// Truncates the file at the end of every chunk and at 1 000 other places: every chunk before the
/// cut is read.
#[test]
fn a_cut_recording_keeps_every_whole_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let wanted = entries(40);
    let per_chunk = 3;
    let bytes = recorded(&path, &wanted, per_chunk, true);
    let ends = chunk_ends(&bytes);
    assert_eq!(ends.len(), 1 + (wanted.len() - 1).div_ceil(per_chunk));
    let mut cuts: Vec<usize> = ends.iter().flat_map(|&end| [end - 1, end, end + 1]).collect();
    let mut random = fixtures::Random::new(9);
    cuts.extend((0..1000).map(|_| random.below(bytes.len())));
    cuts.extend([1, 7, 8, 9, bytes.len() - 1]);
    for cut in cuts {
        let capture = parse(&bytes[..cut], &path).unwrap();
        let chunks = ends.iter().filter(|&&end| end <= cut).count();
        // the session is a chunk of its own
        let entries = match chunks {
            0 => 0,
            chunks => (1 + (chunks - 1) * per_chunk).min(wanted.len()),
        };
        assert_eq!(capture.entries, wanted[..entries], "cut at {cut}");
        assert!(capture.damage.unfinished && capture.damage.bad_chunks == 0, "cut at {cut}");
    }
    assert!(matches!(parse(&[], &path), Err(HwError::Empty { .. })));
}

const CHILD: &str = "EIT_HW_TEST_RECORDING";

/// Not a test of its own: the program that the next test kills. It prints the time of each frame that is written.
#[test]
fn killed_writer() {
    let Ok(path) = std::env::var(CHILD) else { return };
    let settings = CaptureSettings { flush_s: 0.2, ..CaptureSettings::default() };
    let mut writer = CaptureWriter::create(Path::new(&path), &session(), settings).unwrap();
    let start = Instant::now();
    for sequence in 0.. {
        let now_s = start.elapsed().as_secs_f64();
        writer.frame(&Frame { host_time_s: Some(now_s), ..frame(sequence) }).unwrap();
        println!("\nwritten {now_s}");
        std::thread::sleep(Duration::from_millis(2));
        assert!(now_s < 60.0, "nobody killed it");
    }
}

#[test]
fn a_killed_recorder_loses_the_last_moment_only() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("killed.mcap");
    let mut child = std::process::Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "--nocapture", "capture::killed_writer"])
        .env(CHILD, &path)
        .stdout(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let mut times = lines.filter_map(|line| line.unwrap().strip_prefix("written ")?.parse().ok());
    let mut written: Vec<f64> = Vec::new();
    while written.last().is_none_or(|time_s| *time_s < 0.7) {
        written.push(times.next().unwrap());
    }
    // SIGKILL on Unix
    child.kill().unwrap();
    written.extend(times);
    child.wait().unwrap();
    let capture = read(&path).unwrap();
    assert!(capture.damage.unfinished && capture.damage.bad_chunks == 0);
    for (sequence, found) in (0..).zip(capture.frames()) {
        assert_eq!((found.sequence, &found.values), (sequence, &frame(sequence).values));
    }
    let frames = capture.frames().count();
    let lost_s = written.get(frames).map_or(0.0, |first| written[written.len() - 1] - first);
    // 0.2 s is set; in the program's own time, however often it waits for the processor
    assert!(frames > 0 && lost_s < 0.5, "{lost_s} of {frames}");
    println!("lost the last {lost_s:.3} s of {frames} frames");

    // it can be appended to
    CaptureWriter::append(&path, &session(), CaptureSettings::default()).unwrap().finish().unwrap();
    let after = read(&path).unwrap();
    assert!(!after.damage.unfinished && after.frames().count() == capture.frames().count());
}

/// Appends to a recording: each run begins at epoch 0 and sequence 0. Replayed, the second run is
/// another epoch, so that no reference of the first is subtracted from it. The reference of each is told before its
/// first frame, and frames that were not recorded after it are not lost.
#[test]
fn a_second_run_is_another_epoch() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.mcap");
    let settings = CaptureSettings::default;
    let runs = [CaptureWriter::create, CaptureWriter::append];
    for start in runs {
        let mut writer = start(&path, &session(), settings()).unwrap();
        (0..3).for_each(|sequence| writer.frame(&frame(sequence)).unwrap());
        let taken =
            ReferenceRecord { epoch: 0, values: Vec::new(), sequences: vec![0, 1], until: Some(1) };
        writer.reference(&taken).unwrap();
        [7, 9].iter().for_each(|&sequence| writer.frame(&frame(sequence)).unwrap());
        writer.finish().unwrap();
    }
    let open = || Replay::open(&path, None, Pace::OnDemand).unwrap();
    assert_eq!(open().without_references().reference_frames(), None);
    let mut replay = open();
    assert_eq!(replay.reference_frames(), Some(2));
    let mut reported = Vec::new();
    while let Some(event) = replay.next_event(Duration::ZERO).unwrap() {
        reported.push(match event {
            Event::Frame(frame) => format!("{}.{}", frame.epoch, frame.sequence),
            Event::Reconnected { epoch } => format!("epoch {epoch}"),
            Event::Reference { epoch, sequences, until } => {
                format!("{epoch}: {sequences:?} {until:?}")
            }
            Event::Gap { frames } => format!("{frames} lost"),
            other => panic!("{other:?}"),
        });
    }
    let run = |epoch: u32| {
        let frame = |sequence: u64| format!("{epoch}.{sequence}");
        let [first, second, third, fourth, last] = [0, 1, 2, 7, 9].map(frame);
        [
            format!("{epoch}: [0, 1] Some(1)"),
            first,
            second,
            third,
            fourth,
            "1 lost".to_owned(),
            last,
        ]
    };
    let wanted = [&run(0)[..], &["epoch 1".to_owned()], &run(1)].concat();
    assert_eq!(reported, wanted);

    // a recording of another set-up is rejected and stays as it is
    let before = std::fs::read(&path).unwrap();
    let others = [
        SessionRecord { quadruples: rotated(8), ..session() },
        SessionRecord { unit: UnitName::Ohm, ..session() },
        SessionRecord { current_a: Some(1e-3), ..session() },
    ];
    for (other, what) in
        others.iter().zip(["other measurements", "another unit", "another current"])
    {
        let refused = CaptureWriter::append(&path, other, settings()).err().unwrap().to_string();
        assert!(refused.contains(what), "{refused}");
    }
    assert_eq!(std::fs::read(&path).unwrap(), before);
}

/// What is written to a removed file is lost, although every write succeeds; a renamed one is whole.
#[cfg(unix)]
#[test]
fn a_file_that_is_removed_ends_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let (path, other) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    let mut writer = CaptureWriter::create(&path, &session(), CaptureSettings::default()).unwrap();
    writer.frame(&frame(0)).unwrap();
    writer.flush().unwrap();
    std::fs::rename(&path, &other).unwrap();
    writer.frame(&frame(1)).unwrap();
    writer.flush().unwrap();
    std::fs::remove_file(&other).unwrap();
    writer.frame(&frame(2)).unwrap();
    let error = writer.flush().unwrap_err();
    assert!(error.to_string().contains("removed while it was recorded"), "{error}");
    assert!(writer.frame(&frame(3)).is_err());
    assert!(writer.finish().is_err());
}

#[test]
fn a_recording_is_read_like_any_other_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("press");
    recorded(&path, &entries(30), 7, true);
    let recording = read_recording(&path, None, &ReadOptions::default()).unwrap();
    assert_eq!((recording.format, recording.unit), (Format::Mcap, Unit::Volt));
    assert_eq!(recording.current_a, Some(1e-4));
    let wanted = rotated(16);
    let frames = recording.frames_for(Some(&wanted), 208, Component::Real).unwrap();
    assert_eq!(frames.values.row(29).to_vec(), frame(29).values);
    assert_eq!(frames.device_time_s.unwrap()[29], 29.0 / 25.0);

    let other = SessionRecord { quadruples: rotated(8), ..session() };
    let mut mixed = entries(3);
    mixed.push(Entry::Session(other));
    let path = folder.path().join("mixed.mcap");
    recorded(&path, &mixed, 7, true);
    let error = read_recording(&path, None, &ReadOptions::default()).unwrap_err();
    assert!(error.to_string().contains("sessions of 208 and 40 measurements"), "{error}");
    let empty = folder.path().join("empty.mcap");
    recorded(&empty, &[Entry::Session(session())], 1, true);
    let error = read_recording(&empty, None, &ReadOptions::default()).unwrap_err();
    assert!(matches!(error, HwError::NoFrames { .. }), "{error}");
}

#[test]
fn what_cannot_be_written_or_read_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let create = |settings| CaptureWriter::create(&path, &session(), settings);
    let never = CaptureSettings { flush_s: f64::NAN, ..CaptureSettings::default() };
    assert!(matches!(create(never), Err(HwError::Setting { name: "flush_s", .. })));
    std::fs::remove_file(&path).ok();
    drop(create(CaptureSettings::default()).unwrap());
    // a recording is never overwritten
    assert!(matches!(create(CaptureSettings::default()), Err(HwError::Exists { .. })));
    let not = folder.path().join("not.mcap");
    std::fs::write(&not, b"1,2,3\n").unwrap();
    assert!(matches!(read(&not), Err(HwError::Container { .. })));
    assert!(matches!(read(&folder.path().join("none")), Err(HwError::Read { .. })));
    let garbage = container(&[(0..255).cycle().take(9999).collect()]);
    let capture: Capture = parse(&garbage, &not).unwrap();
    assert!(capture.entries.is_empty() && capture.damage.unfinished);
}
