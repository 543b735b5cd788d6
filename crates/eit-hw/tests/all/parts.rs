//! Recordings that are split into parts: read back as one, and as safe as one file.

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::common::instruments::wait_for;
use crate::common::recordings::{self, append, frame, session};
use crate::common::{place, refused, rotated};
use eit_hw::capture::{
    CaptureReader, CaptureSettings, CaptureWriter, Damage, Entry, SessionRecord, TouchesRecord,
    files, read, recover,
};
use eit_hw::driver::{Event, Pace, Replay};
use eit_hw::{HwError, ReadOptions, read_recording};
use fixtures::Random;

/// Frames per part: a part ends with the first chunk.
const PER_PART: u64 = 40;

/// Every chunk is above the least length of a part. Only `flush` ends a chunk.
fn split() -> CaptureSettings {
    CaptureSettings { flush_s: 3600.0, part_bytes: Some(100_000), ..CaptureSettings::default() }
}

/// Writes frames, each followed by touches; now and then a note.
fn write(writer: &mut CaptureWriter, sequences: std::ops::Range<u64>) {
    for sequence in sequences {
        writer.frame(&frame(sequence)).unwrap();
        let touch = r#"{"id":1,"position_m":[0,0,0]}"#;
        let json = format!(r#"{{"sequence":{sequence},"touches":[{touch}]}}"#);
        writer.touches(&TouchesRecord::new(json).unwrap()).unwrap();
        if sequence % 7 == 0 {
            writer.note(&format!("note {sequence}")).unwrap();
        }
        if sequence % PER_PART == PER_PART - 1 {
            writer.flush().unwrap();
        }
    }
}

/// Writes `count` frames in parts, and the same in one file; returns both names.
fn recorded(folder: &Path, count: u64) -> (PathBuf, PathBuf) {
    let [parts, one] = ["press.mcap", "one.mcap"].map(|name| folder.join(name));
    let whole = CaptureSettings { part_bytes: None, ..split() };
    for (path, settings) in [(&parts, split()), (&one, whole)] {
        let mut writer = CaptureWriter::create(path, &session(), settings).unwrap();
        write(&mut writer, 0..count);
        writer.finish().unwrap();
    }
    (parts, one)
}

fn sequences(path: &Path) -> Vec<u64> {
    read(path).unwrap().frames().map(|frame| frame.sequence).collect()
}

/// Replays a recording without its notes.
fn replayed(path: &Path) -> Vec<String> {
    let mut said = recordings::replayed(Replay::open(path, None, Pace::OnDemand).unwrap());
    said.retain(|text| !text.starts_with("notice"));
    said
}

#[test]
fn parts_are_read_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let (parts, one) = recorded(folder.path(), 130);
    let found = files(&parts);
    assert_eq!(found, [1, 2, 3, 4].map(|n| folder.path().join(format!("press.0000{n}.mcap"))));
    assert!(!parts.exists());
    assert_eq!(read(&parts).unwrap(), read(&one).unwrap());
    assert_eq!(read(&parts).unwrap().damage, Damage::default());
    assert_eq!(replayed(&parts), replayed(&one));
    let [mut as_parts, as_one] =
        [&parts, &one].map(|path| read_recording(path, None, &ReadOptions::default()).unwrap());
    as_parts.path.clone_from(&as_one.path);
    assert_eq!(as_parts, as_one);
    let (mut reader, mut last) = (CaptureReader::open(&parts).unwrap(), 0);
    while reader.next_entry().unwrap().is_some() {
        let log_ns = reader.times().unwrap().log_ns;
        assert!(log_ns >= last);
        last = log_ns;
    }
    // each part is a complete recording of its own, whose touches are those of its frames
    let mut next = 0;
    for file in &found {
        let part = read(file).unwrap();
        let wanted = SessionRecord { continues: next > 0, ..session() };
        assert_eq!((&part.damage, part.sessions().next()), (&Damage::default(), Some(&wanted)));
        let of_touches = part.entries.iter().filter_map(|entry| match entry {
            Entry::Touches(touches) => Some(touches.sequence()),
            _ => None,
        });
        let of_frames = sequences(file);
        assert_eq!(of_touches.collect::<Vec<_>>(), of_frames);
        assert_eq!(of_frames[0], next);
        next += of_frames.len() as u64;
        assert_eq!(replayed(file).len(), of_frames.len());
    }
    assert_eq!(next, 130);
    // one whole file of them
    let whole = folder.path().join("whole.mcap");
    let recovered = recover(&parts, &whole).unwrap();
    assert_eq!((recovered.frames, recovered.damage), (130, Damage::default()));
    assert_eq!(replayed(&whole), replayed(&one));
}

#[test]
fn parts_end_by_time_too() {
    let (folder, path) = place("press.mcap");
    let settings = CaptureSettings { part_s: Some(1.0), ..CaptureSettings::default() };
    let mut writer = CaptureWriter::create(&path, &session(), settings).unwrap();
    writer.frame(&frame(0)).unwrap();
    writer.frame(&frame(1)).unwrap();
    std::thread::sleep(Duration::from_millis(1010));
    // notes alone begin no part
    writer.note("n").unwrap();
    writer.frame(&frame(2)).unwrap();
    std::thread::sleep(Duration::from_millis(1010));
    writer.note("end").unwrap();
    writer.finish().unwrap();
    let counts: Vec<usize> = files(&path).iter().map(|part| sequences(part).len()).collect();
    assert_eq!(counts, [2, 1]);
    assert_eq!(sequences(&path), [0, 1, 2]);
    for (settings, key) in [
        (CaptureSettings { part_s: Some(0.9), ..settings }, "part_s"),
        (CaptureSettings { part_s: Some(f64::NAN), ..settings }, "part_s"),
        (CaptureSettings { part_bytes: Some(99_999), ..settings }, "part_bytes"),
        (CaptureSettings { flush_s: f64::NAN, ..settings }, "flush_s"),
    ] {
        let refused = CaptureWriter::create(&folder.path().join("b.mcap"), &session(), settings);
        assert!(matches!(refused, Err(HwError::Setting { name, .. }) if name == key));
    }
}

/// A killed recorder loses what came after its last chunk, whichever part it was writing.
#[test]
fn an_unfinished_part_is_appended_to() {
    let (folder, path) = place("press.mcap");
    for flushed in [2 * PER_PART, 2 * PER_PART + 10] {
        let mut writer = CaptureWriter::create(&path, &session(), split()).unwrap();
        write(&mut writer, 0..flushed);
        writer.flush().unwrap();
        write(&mut writer, flushed..flushed + 5);
        // a second recorder is rejected, and told which file is in use
        refused(append(&path), &["press.0000", "another program is recording to it"]);
        for new in [split(), CaptureSettings::default()] {
            let exists = CaptureWriter::create(&path, &session(), new);
            refused(exists, &["press.00001.mcap: exists"]);
        }
        // threads write the indices of the parts before the last one
        let parts = files(&path);
        for part in &parts[..parts.len() - 1] {
            wait_for(|| read(part).unwrap().damage == Damage::default());
        }
        // as a killed program leaves it
        let copies = folder.path().join("killed");
        std::fs::create_dir_all(&copies).unwrap();
        let killed = copies.join("press.mcap");
        for file in files(&path) {
            std::fs::copy(&file, copies.join(file.file_name().unwrap())).unwrap();
        }
        writer.finish().unwrap();
        let capture = read(&killed).unwrap();
        assert!(capture.damage.unfinished && !capture.damage.is_any());
        assert_eq!(sequences(&killed), (0..flushed).collect::<Vec<_>>());
        // a second run, in further parts
        let parts = files(&killed).len();
        let mut writer = CaptureWriter::append(&killed, &session(), split()).unwrap();
        write(&mut writer, 0..2 * PER_PART);
        writer.finish().unwrap();
        assert!(files(&killed).len() > parts && !read(&killed).unwrap().damage.unfinished);
        let run = |epoch: u32, count: u64| (0..count).map(move |n| format!("{epoch}.{n}"));
        let again = format!("{:?}", Event::Reconnected { epoch: 1 });
        assert!(run(0, flushed).chain([again]).chain(run(1, 2 * PER_PART)).eq(replayed(&killed)));
        for file in files(&path).iter().chain(&files(&killed)) {
            std::fs::remove_file(file).unwrap();
        }
    }
}

/// A program may be killed between creating a part and writing to it.
#[test]
fn an_empty_last_part_is_appended_to_with_the_same_set_up_only() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = recorded(folder.path(), 2 * PER_PART);
    let last = folder.path().join("press.00003.mcap");
    std::fs::write(&last, b"").unwrap();
    assert_eq!(read(&path).unwrap().damage, Damage { missing_parts: 1, ..Damage::default() });
    assert_eq!(sequences(&path).len() as u64, 2 * PER_PART);
    let other = SessionRecord { quadruples: rotated(8), ..session() };
    refused(CaptureWriter::append(&path, &other, split()), &["other measurements"]);
    let mut writer = append(&path).unwrap();
    write(&mut writer, 0..3 * PER_PART);
    writer.finish().unwrap();
    // without limits, no further part
    assert_eq!((files(&path).len(), read(&path).unwrap().damage), (3, Damage::default()));
    assert_eq!(sequences(&last).len() as u64, 3 * PER_PART);
    assert_eq!(replayed(&path).len() as u64, 5 * PER_PART + 1);
}

#[test]
fn one_file_is_not_split_later() {
    let folder = tempfile::tempdir().unwrap();
    let (_, one) = recorded(folder.path(), 3);
    refused(CaptureWriter::append(&one, &session(), split()), &["single file and cannot be split"]);
    refused(CaptureWriter::create(&one, &session(), split()), &["one.mcap: exists"]);
    assert_eq!(sequences(&one), [0, 1, 2]);
}

/// Each part is damaged or deleted: everything intact in the others is read, and the rest reported.
#[test]
fn damage_of_one_part_costs_nothing_of_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let (path, _) = recorded(folder.path(), 4 * PER_PART);
    let (parts, whole) = (files(&path), folder.path().join("whole.mcap"));
    assert_eq!(parts.len(), 4);
    let mut random = Random::new(11);
    for (number, part) in parts.iter().enumerate() {
        let bytes = std::fs::read(part).unwrap();
        let is_other = |sequence: &u64| sequence / PER_PART != number as u64;
        let others: Vec<u64> = (0..4 * PER_PART).filter(is_other).collect();
        std::fs::remove_file(part).unwrap();
        assert_eq!(sequences(&path), others);
        // a missing end cannot be known
        let missing_parts = usize::from(number < 3);
        assert_eq!(read(&path).unwrap().damage, Damage { missing_parts, ..Damage::default() });
        // frames before and after a gap may belong to different runs
        let reported = replayed(&path);
        let is_split = reported.iter().any(|reported| reported.contains("Reconnected"));
        assert_eq!(is_split, number == 1 || number == 2, "{reported:?}");
        for _ in 0..8 {
            let length = random.below(bytes.len());
            std::fs::write(part, &bytes[..length]).unwrap();
            let capture = read(&path).unwrap();
            let found: Vec<u64> = capture.frames().map(|frame| frame.sequence).collect();
            assert!(found.iter().copied().filter(is_other).eq(others.clone()), "{length} bytes");
            let damage = capture.damage;
            assert!(damage.unfinished || damage.missing_parts == 1, "{length} bytes: {damage:?}");
            // what `recover` writes is the same
            let recovered = recover(&path, &whole).unwrap();
            assert_eq!((sequences(&whole), recovered.damage), (found, damage), "{length} bytes");
            std::fs::remove_file(&whole).unwrap();
        }
        std::fs::write(part, &bytes).unwrap();
    }
}

/// If the next part cannot be created, the recording goes on where it is.
#[test]
fn a_part_that_cannot_be_created_costs_no_frame() {
    let (folder, path) = place("press.mcap");
    let mut writer = CaptureWriter::create(&path, &session(), split()).unwrap();
    write(&mut writer, 0..PER_PART);
    // in the way of the second part
    let other = folder.path().join("press.00002.mcap");
    std::fs::write(&other, b"of somebody else").unwrap();
    write(&mut writer, PER_PART..PER_PART + 10);
    std::fs::remove_file(&other).unwrap();
    write(&mut writer, PER_PART + 10..4 * PER_PART);
    writer.finish().unwrap();
    assert_eq!(sequences(&path), (0..4 * PER_PART).collect::<Vec<_>>());
    let parts = files(&path);
    // the first part is longer by one chunk
    let counts: Vec<u64> = parts.iter().map(|part| sequences(part).len() as u64).collect();
    assert_eq!(counts, [2 * PER_PART, PER_PART, PER_PART]);
    let notes = format!("{:?}", read(&parts[0]).unwrap().entries);
    assert!(notes.contains("press.00002.mcap: exists"));
}
