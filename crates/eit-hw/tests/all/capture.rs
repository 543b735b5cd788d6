//! Recordings: what is written is read back, whatever happens to the file.

use std::time::{Duration, Instant};

use crate::common::recordings::{
    append, chunks, container, create, frame, recorded, replayed, session,
};
use crate::common::{place, refused, rotated};
use eit_hw::capture::{
    Capture, CaptureSettings, CaptureWriter, Entry, ReferenceRecord, SessionRecord, TouchesRecord,
    UnitName, parse, read,
};
use eit_hw::driver::{Pace, Replay};
use eit_hw::{Component, Format, HwError, Quality, ReadOptions, Unit, read_recording};

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
    let (values, sequences) = (vec![Some(0.1 + 0.2), None], vec![3, 5]);
    entries.push(Entry::Reference(ReferenceRecord { epoch: 3, values, sequences, until: Some(7) }));
    entries
}

#[test]
fn every_entry_is_read_back_to_the_bit() {
    let (folder, path) = place("a.mcap");
    let mut wanted = entries(100);
    // everything that JSON has no number for, and the limits of the numbers that it has
    let mut odd = frame(100);
    odd.values[..6].copy_from_slice(&[f64::MAX, f64::MIN_POSITIVE, 5e-324, -0.0, 0.1, 1e22]);
    odd.imaginary = Some(odd.values.iter().map(|value| -value).collect());
    odd.quality[7] = Quality::SATURATED | Quality::MISSING;
    odd.host_time_s = None;
    wanted.push(Entry::Frame(odd));
    let capture = parse(&recorded(&path, &wanted, 13), &path).unwrap();
    assert_eq!((&capture.damage, &capture.entries), (&Default::default(), &wanted));
    let negative = capture.frames().last().unwrap().values[3];
    assert!(negative == 0.0 && negative.is_sign_negative());

    let mut writer = append(&path).unwrap();
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
    let (_folder, path) = place("a.mcap");
    let mut writer = create(&path).unwrap();
    let touch =
        r#"{"id":2,"state":"hold","position_m":[0.01,-0.02,0],"valid":false,"force_n":1.25}"#;
    let end = r#"{"id":2,"state":"end","position_m":[0.01,-0.02,0],"valid":false,"force_n":null}"#;
    let of = [("sound", ""), ("sound", touch), ("sound", end), ("frozen", ""), ("sound", "")];
    for (state, touches) in of.iter().chain(&of[4..]) {
        let json = format!(r#"{{"sequence":1,"state":"{state}","touches":[{touches}]}}"#);
        writer.touches(&TouchesRecord::new(json).unwrap()).unwrap();
    }
    writer.finish().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let mut drawn = Vec::new();
    for message in messages.filter(|message| message.channel.topic == "/eit/scene") {
        let schema = message.channel.schema.as_ref().unwrap();
        assert_eq!((&*schema.name, &*schema.encoding), ("foxglove.SceneUpdate", "jsonschema"));
        let scene: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
        let entity = &scene["entities"][0];
        assert_eq!(entity["timestamp"]["sec"], message.log_time / 1_000_000_000);
        let texts: Vec<_> =
            entity["texts"].as_array().unwrap().iter().map(|t| &t["text"]).collect();
        let spheres = entity["spheres"].as_array().unwrap();
        if let [sphere] = &spheres[..] {
            let (y, alpha) = (&sphere["pose"]["position"]["y"], &sphere["color"]["a"]);
            assert_eq!((y.as_f64(), alpha.as_f64()), (Some(-0.02), Some(0.35)));
        }
        drawn.push((spheres.len(), serde_json::json!(texts).to_string()));
    }
    let drawn: Vec<(usize, &str)> = drawn.iter().map(|(count, text)| (*count, &**text)).collect();
    let wanted = [(1, r#"["2 1.2 N"]"#), (0, "[]"), (0, r#"["not known: frozen"]"#), (0, "[]")];
    assert_eq!(drawn, wanted);
    // and our own reader passes over the scenes
    assert_eq!(read(&path).unwrap().entries.len(), 7);
}

#[test]
fn a_frame_of_another_length_is_refused() {
    let (_folder, path) = place("a.mcap");
    let mut writer = create(&path).unwrap();
    writer.frame(&frame(0)).unwrap();
    let [mut short, mut bare, mut half] = [frame(1), frame(1), frame(1)];
    short.values.pop();
    bare.quality.clear();
    half.imaginary = Some(vec![0.0]);
    for (wrong, words) in [
        (short, "`values` has 207 entries, but expected 208"),
        (bare, "`quality` has 0 entries, but expected 208"),
        (half, "`imaginary` has 1 entries, but expected 208"),
    ] {
        refused(writer.frame(&wrong), &[words]);
    }
    writer.frame(&frame(1)).unwrap();
    writer.finish().unwrap();
    assert_eq!(read(&path).unwrap().frames().count(), 2);
}

/// Cut at the end of every chunk and at 1 000 other places: every chunk before the cut is read.
#[test]
fn a_cut_recording_keeps_every_whole_chunk() {
    let (_folder, path) = place("a.mcap");
    let wanted = entries(20);
    let per_chunk = 3;
    let bytes = recorded(&path, &wanted, per_chunk);
    let ends: Vec<usize> = chunks(&bytes).iter().map(|chunk| chunk.end).collect();
    assert_eq!(ends.len(), 1 + (wanted.len() - 1).div_ceil(per_chunk));
    let mut cuts: Vec<usize> = ends.iter().flat_map(|&end| [end - 1, end, end + 1]).collect();
    let mut random = fixtures::Random::new(9);
    cuts.extend((0..1000).map(|_| random.below(bytes.len())));
    cuts.extend([1, 7, 8, 9, bytes.len() - 1]);
    for cut in cuts {
        let capture = parse(&bytes[..cut], &path).unwrap();
        let chunks = ends.iter().filter(|&&end| end <= cut).count();
        // the session is a chunk of its own
        let entries = chunks.min(1) + chunks.saturating_sub(1) * per_chunk;
        let entries = entries.min(wanted.len());
        assert_eq!(capture.entries, wanted[..entries], "cut at {cut}");
        assert!(capture.damage.unfinished && capture.damage.bad_chunks == 0, "cut at {cut}");
    }
    assert!(matches!(parse(&[], &path), Err(HwError::Empty { .. })));
}

/// The file as it is while the recorder runs is what a killed one leaves.
#[test]
fn a_killed_recorder_loses_the_last_moment_only() {
    let folder = tempfile::tempdir().unwrap();
    let [path, killed] = ["a.mcap", "killed.mcap"].map(|name| folder.path().join(name));
    let settings = CaptureSettings { flush_s: 0.2, ..CaptureSettings::default() };
    let mut writer = CaptureWriter::create(&path, &session(), settings).unwrap();
    let (start, mut written) = (Instant::now(), Vec::new());
    while written.len() < 100 || start.elapsed().as_secs_f64() < 0.7 {
        written.push(start.elapsed().as_secs_f64());
        writer.frame(&frame(written.len() as u64 - 1)).unwrap();
        std::thread::sleep(Duration::from_millis(2));
    }
    std::fs::copy(&path, &killed).unwrap();
    let capture = read(&killed).unwrap();
    assert!(capture.damage.unfinished && capture.damage.bad_chunks == 0);
    assert!(capture.frames().zip(0..).all(|(found, sequence)| *found == frame(sequence)));
    let frames = capture.frames().count();
    let lost_s = written.get(frames).map_or(0.0, |first| written[written.len() - 1] - first);
    // the recorder looks at its clock with each frame, which may wait for the processor after we looked at ours
    let longest_s = written.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    assert!(frames > 0 && lost_s < 0.2 + longest_s, "{lost_s} of {frames}, {longest_s}");

    // it can be appended to
    append(&killed).unwrap().finish().unwrap();
    let after = read(&killed).unwrap();
    assert!(!after.damage.unfinished && after.frames().count() == frames);
}

/// Appends to a recording: each run begins at epoch 0 and sequence 0. Replayed, the second run is
/// another epoch, so that no reference of the first is subtracted from it. The reference of each is told before its
/// first frame, and frames that were not recorded after it are not lost.
#[test]
fn a_second_run_is_another_epoch() {
    let (_folder, path) = place("p.mcap");
    for start in [create, append] {
        let mut writer = start(&path).unwrap();
        (0..3).for_each(|sequence| writer.frame(&frame(sequence)).unwrap());
        let (values, sequences) = (Vec::new(), vec![0, 1]);
        writer.reference(&ReferenceRecord { epoch: 0, values, sequences, until: Some(1) }).unwrap();
        [7, 9].iter().for_each(|&sequence| writer.frame(&frame(sequence)).unwrap());
        writer.finish().unwrap();
    }
    let open = || Replay::open(&path, None, Pace::OnDemand).unwrap();
    assert_eq!(open().without_references().reference_frames(), None);
    assert_eq!(open().reference_frames(), Some(2));
    let run = |epoch: u32| {
        let frames = [0, 1, 2, 7].map(|sequence| format!("{epoch}.{sequence}"));
        let told = format!("Reference {{ epoch: {epoch}, sequences: [0, 1], until: Some(1) }}");
        let gap = "Gap { frames: 1 }".to_owned();
        [vec![told], frames.to_vec(), vec![gap, format!("{epoch}.9")]].concat()
    };
    let wanted = [run(0), vec!["Reconnected { epoch: 1 }".to_owned()], run(1)].concat();
    assert_eq!(replayed(open()), wanted);

    // a recording of another set-up is rejected and stays as it is
    let before = std::fs::read(&path).unwrap();
    for (other, what) in [
        (SessionRecord { quadruples: rotated(8), ..session() }, "other measurements"),
        (SessionRecord { unit: UnitName::Ohm, ..session() }, "another unit"),
        (SessionRecord { current_a: Some(1e-3), ..session() }, "another current"),
    ] {
        refused(CaptureWriter::append(&path, &other, CaptureSettings::default()), &[what]);
    }
    assert_eq!(std::fs::read(&path).unwrap(), before);
}

/// What is written to a removed file is lost, although every write succeeds; a renamed one is whole.
#[cfg(unix)]
#[test]
fn a_file_that_is_removed_ends_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let (path, other) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    let mut writer = create(&path).unwrap();
    writer.frame(&frame(0)).unwrap();
    writer.flush().unwrap();
    std::fs::rename(&path, &other).unwrap();
    writer.frame(&frame(1)).unwrap();
    writer.flush().unwrap();
    std::fs::remove_file(&other).unwrap();
    writer.frame(&frame(2)).unwrap();
    refused(writer.flush(), &["removed while it was recorded"]);
    assert!(writer.frame(&frame(3)).is_err() && writer.finish().is_err());
}

#[test]
fn a_recording_is_read_like_any_other_file() {
    let (folder, path) = place("press");
    recorded(&path, &entries(30), 7);
    let open = |path: &std::path::Path| read_recording(path, None, &ReadOptions::default());
    let recording = open(&path).unwrap();
    assert_eq!((recording.format, recording.unit), (Format::Mcap, Unit::Volt));
    assert_eq!(recording.current_a, Some(1e-4));
    let frames = recording.frames_for(Some(&rotated(16)), 208, Component::Real).unwrap();
    assert_eq!(frames.values.row(29).to_vec(), frame(29).values);
    assert_eq!(frames.device_time_s.unwrap()[29], 29.0 / 25.0);

    let mut mixed = entries(3);
    mixed.push(Entry::Session(SessionRecord { quadruples: rotated(8), ..session() }));
    let path = folder.path().join("mixed.mcap");
    recorded(&path, &mixed, 7);
    refused(open(&path), &["sessions of 208 and 40 measurements"]);
    let empty = folder.path().join("empty.mcap");
    recorded(&empty, &[Entry::Session(session())], 1);
    refused(open(&empty), &["no complete frame found"]);
}

#[test]
fn what_cannot_be_written_or_read_is_reported() {
    let (folder, path) = place("a.mcap");
    drop(create(&path).unwrap());
    assert!(matches!(create(&path), Err(HwError::Exists { .. })));
    let not = folder.path().join("not.mcap");
    std::fs::write(&not, b"1,2,3\n").unwrap();
    assert!(matches!(read(&not), Err(HwError::Container { .. })));
    assert!(matches!(read(&folder.path().join("none")), Err(HwError::Read { .. })));
    let garbage = container(&[(0..255).cycle().take(9999).collect()]);
    let capture: Capture = parse(&garbage, &not).unwrap();
    assert!(capture.entries.is_empty() && capture.damage.unfinished);
}
