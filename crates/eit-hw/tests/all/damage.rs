//! Recordings that are damaged or written by two programs: nothing intact is lost, and every loss
//! is reported. One file, because all tests damage files with the same few functions.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use crate::common::recordings::{container, frame, session};
use eit_hw::HwError;
use eit_hw::capture::{CaptureSettings, CaptureWriter, Entry, parse, read, recover};
use eit_hw::driver::{Event, FrameSource, Pace, Replay};

const PER_CHUNK: u64 = 5;

/// Writes a finished recording with one chunk for the session and `chunks` chunks of 5 frames.
fn recording(path: &Path, chunks: u64) -> Vec<u8> {
    let settings = CaptureSettings { flush_s: 3600.0, ..CaptureSettings::default() };
    let mut writer = CaptureWriter::create(path, &session(), settings).unwrap();
    for sequence in 0..chunks * PER_CHUNK {
        writer.frame(&frame(sequence)).unwrap();
        if sequence % PER_CHUNK == PER_CHUNK - 1 {
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

/// Returns the start and length of each chunk's record.
fn chunks(bytes: &[u8]) -> Vec<(usize, usize)> {
    let (mut at, mut found) = (8, Vec::new());
    while bytes[at] != 0x0F {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == 0x06 {
            found.push((at, length));
        }
        at += 9 + length;
    }
    found
}

fn sequences(bytes: &[u8]) -> Vec<u64> {
    parse(bytes, Path::new("damaged.mcap")).unwrap().frames().map(|frame| frame.sequence).collect()
}

/// A replay says at its end, once, what a damaged recording lacks; of an intact one it says nothing.
#[test]
fn a_replay_tells_what_is_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let bytes = recording(&path, 4);
    let third = chunks(&bytes)[3];
    let mut bad = bytes.clone();
    bad[third.0 + third.1 / 2] ^= 4;
    let cut = bytes[..third.0 + third.1 / 2].to_vec();
    for (bytes, frames, reported) in [(bytes, 20, 0), (bad, 15, 1), (cut, 10, 1)] {
        std::fs::write(&path, bytes).unwrap();
        let mut replay = Replay::open(&path, None, Pace::OnDemand).unwrap();
        let (mut found, mut notices) = (0, Vec::new());
        while !replay.is_over() {
            match replay.next_event(Duration::ZERO).unwrap() {
                Some(Event::Frame(_)) => found += 1,
                Some(Event::Notice(text)) => notices.push((found, text)),
                _ => {}
            }
        }
        assert_eq!((found, notices.len()), (frames, reported), "{notices:?}");
        assert!(notices.iter().all(|(at, text)| *at == frames && text.contains("damaged")));
    }
}

/// Flips every bit of every byte before the content of a chunk: the content shows what the header
/// should say.
#[test]
fn a_damaged_head_costs_at_most_its_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = recording(&folder.path().join("a.mcap"), 6);
    let all: Vec<u64> = (0..6 * PER_CHUNK).collect();
    let heads = chunks(&bytes);
    assert_eq!(heads.len(), 7);
    let mut mended = 0;
    for &(start, _) in &heads[1..] {
        for bit in 0..8 * (9 + 28 + 4 + 3 + 8) {
            let mut damaged = bytes.clone();
            damaged[start + bit / 8] ^= 1 << (bit % 8);
            let capture = parse(&damaged, Path::new("a.mcap")).unwrap();
            let found: Vec<u64> = capture.frames().map(|frame| frame.sequence).collect();
            let lost = all.len() - found.len();
            let mut rest = all.iter();
            assert!(found.iter().all(|one| rest.any(|all| all == one)), "bit {bit} at {start}");
            assert!(lost == 0 || capture.damage.is_any(), "bit {bit} at {start}: not told");
            assert!(lost <= PER_CHUNK as usize, "{lost} frames: bit {bit} of the head at {start}");
            mended += capture.damage.mended_chunks;
        }
        // a wrong length alone loses nothing
        for byte in 1..9 {
            let mut damaged = bytes.clone();
            damaged[start + byte] ^= 1;
            assert_eq!(sequences(&damaged), all, "length byte {byte}");
        }
    }
    // six chunks, all bits of the two lengths and of the opcode, except for two bits that turn the
    // opcode into a channel or a message index
    assert_eq!(mended, 6 * (64 + 64 + 8 - 2));
}

/// Damages any bit of the file, or any stretch of up to 5 bytes: at most two chunks are lost, and
/// the loss is reported.
#[test]
fn any_damage_costs_little_and_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = recording(&folder.path().join("a.mcap"), 6);
    let all: Vec<u64> = (0..6 * PER_CHUNK).collect();
    let mut random = fixtures::Random::new(3);
    for round in 0..3000 {
        let mut damaged = bytes.clone();
        let (at, count) = (8 + random.below(bytes.len() - 8), [1, 1, 1, 2, 5][round % 5]);
        for byte in damaged.iter_mut().skip(at).take(count) {
            *byte ^= 1 << random.below(8);
        }
        let capture = parse(&damaged, Path::new("a.mcap")).unwrap();
        let found: Vec<u64> = capture.frames().map(|frame| frame.sequence).collect();
        let mut rest = all.iter();
        assert!(found.iter().all(|one| rest.any(|all| all == one)), "{count} bytes at {at}");
        let lost = all.len() - found.len();
        assert!(lost <= 2 * PER_CHUNK as usize, "{lost} frames lost: {count} bytes at {at}");
        assert!(lost == 0 || capture.damage.is_any(), "{count} bytes at {at}: not told");
    }
}

/// A bad chunk after damage, at the end of an unfinished recording: a failed search finds no
/// record.
#[test]
fn damage_that_no_whole_chunk_follows_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let bytes = recording(&path, 3);
    let [.., before, last] = chunks(&bytes)[..] else { panic!("chunks") };
    let whole = sequences(&bytes[..last.0]);
    assert_eq!(whole.len() as u64, 2 * PER_CHUNK);
    let mut bad = bytes[last.0..last.0 + 9 + last.1].to_vec();
    let at = bad.len() / 2;
    bad[at] ^= 4;
    let tail = [&[0xff; 5][..], &bad].concat();
    let damaged = [&bytes[..last.0], &tail].concat();
    let capture = parse(&damaged, &path).unwrap();
    assert_eq!(capture.frames().count(), whole.len());
    assert_eq!(capture.damage.truncated_bytes, tail.len() as u64, "{:?}", capture.damage);
    // the message index of the previous chunk is intact
    assert!(before.0 + before.1 < last.0);
    // what is cut off before appending is kept
    std::fs::write(&path, &damaged).unwrap();
    let writer = CaptureWriter::append(&path, &session(), CaptureSettings::default()).unwrap();
    let cut = writer.cut_tail().cloned().unwrap();
    writer.finish().unwrap();
    assert_eq!(std::fs::read(&cut.path).unwrap(), tail);
    assert_eq!(sequences(&std::fs::read(&path).unwrap()), whole);
}

/// Regression: one flipped length lost everything after it, and appending cut all of that off.
#[test]
fn going_on_never_cuts_a_whole_chunk_and_keeps_what_it_cuts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let bytes = recording(&path, 8);
    let mut damaged = bytes.clone();
    damaged[chunks(&bytes)[3].0 + 5] ^= 1;
    std::fs::write(&path, &damaged).unwrap();
    let settings = CaptureSettings::default;
    let mut writer = CaptureWriter::append(&path, &session(), settings()).unwrap();
    assert_eq!(writer.cut_tail(), None);
    writer.frame(&frame(1000)).unwrap();
    writer.finish().unwrap();
    let mut wanted: Vec<u64> = (0..8 * PER_CHUNK).collect();
    wanted.push(1000);
    assert_eq!(sequences(&std::fs::read(&path).unwrap()), wanted);

    // an incomplete record at the end: an unfinished chunk, or garbage of any length
    let last = *chunks(&bytes).last().unwrap();
    let whole = sequences(&bytes[..last.0]);
    for tail in [bytes[last.0..last.0 + last.1 / 2].to_vec(), vec![0xff; 17 << 20]] {
        let path = folder.path().join(format!("tail{}.mcap", tail.len()));
        std::fs::write(&path, [&bytes[..last.0], &tail].concat()).unwrap();
        let writer = CaptureWriter::append(&path, &session(), settings()).unwrap();
        let cut = writer.cut_tail().cloned().unwrap();
        writer.finish().unwrap();
        assert_eq!(cut.bytes, tail.len() as u64);
        assert_eq!(std::fs::read(&cut.path).unwrap(), tail);
        assert_eq!(sequences(&std::fs::read(&path).unwrap()), whole);
    }
}

/// No record is intact after the first eight bytes, yet those bytes may be all that somebody has.
#[test]
fn what_follows_the_first_bytes_alone_is_kept_too() {
    let folder = tempfile::tempdir().unwrap();
    for (name, rest) in [("garbage", &[0xa5; 3000][..]), ("a few bytes", b"abc"), ("none", b"")] {
        let path = folder.path().join(format!("{name}.mcap"));
        std::fs::write(&path, container(&[rest.to_vec()])).unwrap();
        let settings = CaptureSettings::default();
        let mut writer = CaptureWriter::append(&path, &session(), settings).unwrap();
        let cut = writer.cut_tail().cloned();
        assert_eq!(cut.is_some(), !rest.is_empty(), "{name}: {cut:?}");
        if let Some(cut) = cut {
            assert_eq!(cut.bytes, rest.len() as u64);
            assert_eq!(std::fs::read(&cut.path).unwrap(), rest);
        }
        writer.frame(&frame(0)).unwrap();
        writer.finish().unwrap();
        let capture = read(&path).unwrap();
        assert!(capture.frames().count() == 1 && capture.damage == Default::default(), "{name}");
    }
}

#[test]
fn two_recorders_do_not_share_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let settings = CaptureSettings::default;
    let first = CaptureWriter::create(&path, &session(), settings()).unwrap();
    let append = || CaptureWriter::append(&path, &session(), settings());
    let refused = append().err().unwrap();
    assert!(matches!(&refused, HwError::Busy { .. }), "{refused}");
    assert!(refused.to_string().contains("a.mcap: another program is recording to it"));
    assert!(CaptureWriter::create(&path, &session(), settings()).is_err());
    drop(first);
    let second = append().unwrap();
    assert!(matches!(append(), Err(HwError::Busy { .. })));
    second.finish().unwrap();
    assert_eq!(read(&path).unwrap().sessions().count(), 2);
}

#[test]
fn a_leftover_of_no_bytes_is_gone_on_with() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    std::fs::write(&path, b"").unwrap();
    let mut writer = CaptureWriter::append(&path, &session(), CaptureSettings::default()).unwrap();
    writer.frame(&frame(0)).unwrap();
    writer.finish().unwrap();
    let capture = read(&path).unwrap();
    assert!(capture.frames().count() == 1 && !capture.damage.unfinished);
}

#[test]
fn recover_writes_all_that_is_whole_with_clocks_notes_and_attachments() {
    let folder = tempfile::tempdir().unwrap();
    let (from, to) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    let mut file = std::io::BufWriter::new(std::fs::File::create(&from).unwrap());
    let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4));
    let mut writer = options.create(&mut file).unwrap();
    let no = BTreeMap::new();
    let own = writer.add_channel(0, "/eit/note", "json", &no).unwrap();
    let other = writer.add_channel(0, "/robot/pose", "raw", &no).unwrap();
    let header = |channel_id, sequence| mcap::records::MessageHeader {
        channel_id,
        sequence,
        log_time: 1000 + u64::from(sequence),
        publish_time: 2000 + u64::from(sequence),
    };
    for sequence in 0..40 {
        let note = format!("{{\"text\": \"note {sequence}\"}}");
        writer.write_to_known_channel(&header(own, sequence), note.as_bytes()).unwrap();
        writer.write_to_known_channel(&header(other, sequence), &[7; 99]).unwrap();
        if sequence % 10 == 9 {
            writer.flush().unwrap();
        }
    }
    let attachment = mcap::Attachment {
        log_time: 5,
        create_time: 6,
        name: "photo.jpg".into(),
        media_type: "image/jpeg".into(),
        data: std::borrow::Cow::Owned(vec![9; 100_000]),
    };
    writer.attach(&attachment).unwrap();
    let pairs: BTreeMap<String, String> = [("who".to_owned(), "me".to_owned())].into();
    let metadata = mcap::records::Metadata { name: "lab".into(), metadata: pairs };
    writer.write_metadata(&metadata).unwrap();
    writer.finish().unwrap();
    drop(writer);
    drop(file);
    let mut bytes = std::fs::read(&from).unwrap();
    let second = chunks(&bytes)[1];
    // in the content: that chunk is bad
    bytes[second.0 + second.1 / 2] ^= 4;
    std::fs::write(&from, &bytes).unwrap();
    let found = recover(&from, &to).unwrap();
    assert_eq!((found.messages, found.attachments, found.bad_attachments), (60, 2, 0));
    assert_eq!(found.damage.bad_chunks, 1);
    let whole = std::fs::read(&to).unwrap();
    let messages: Vec<_> =
        mcap::MessageStream::new(&whole).unwrap().map(|message| message.unwrap()).collect();
    assert_eq!(messages.len(), 60);
    for message in &messages {
        assert_eq!(message.log_time, 1000 + u64::from(message.sequence));
        assert_eq!(message.publish_time, 2000 + u64::from(message.sequence));
        assert!(!(10..20).contains(&message.sequence));
    }
    let summary = mcap::Summary::read(&whole).unwrap().unwrap();
    let index = &summary.attachment_indexes[0];
    assert_eq!(mcap::read::attachment(&whole, index).unwrap(), attachment);
    assert_eq!(mcap::read::metadata(&whole, &summary.metadata_indexes[0]).unwrap(), metadata);
    // never over an existing file
    assert!(matches!(recover(&from, &to), Err(HwError::Exists { .. })));
}

/// Messages that are stored intact but are not what their topic holds, and frames of another instrument: all are
/// copied, counted and never called frames.
#[test]
fn recover_tells_what_is_whole_but_no_frame() {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    let mut file = std::io::BufWriter::new(std::fs::File::create(&from).unwrap());
    let mut writer = mcap::WriteOptions::new().create(&mut file).unwrap();
    let channel = writer.add_channel(0, "/eit/frame", "json", &BTreeMap::new()).unwrap();
    let content = |k: u32| -> Vec<u8> {
        let frame = |values: &str| {
            format!(
                r#"{{"sequence":{k},"epoch":0,"device_time_s":null,"host_time_s":null,"values":[{values}]}}"#
            )
        };
        match k {
            3 => b"{\"hello\":1}".to_vec(),
            5 => (0..=255).collect(),
            7 => Vec::new(),
            // longer than any reader takes
            9 => [b"\"", &[b'x'; 9 << 20][..], b"\""].concat(),
            20.. => frame("1,2").into_bytes(),
            _ => frame("1,2,3").into_bytes(),
        }
    };
    for sequence in 0..25 {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence,
            log_time: 1,
            publish_time: 1,
        };
        writer.write_to_known_channel(&header, &content(sequence)).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    drop(file);
    let found = recover(&from, &to).unwrap();
    assert_eq!(
        (found.frames, found.unreadable, found.other_set_ups, found.messages),
        (21, 4, 5, 0)
    );
    assert!(!found.damage.is_any(), "{:?}", found.damage);
    // as many frames as a reader finds in both, and every message bit for bit
    let frames = |path: &Path| read(path).unwrap().frames().count() as u64;
    assert_eq!((frames(&from), frames(&to)), (21, 21));
    let whole = std::fs::read(&to).unwrap();
    for (k, message) in mcap::MessageStream::new(&whole).unwrap().enumerate() {
        assert!(*message.unwrap().data == content(k as u32)[..], "message {k}");
    }
    // nothing is left but both files
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

/// The chunk that defines the topics is bad: messages are recognised by their content.
#[test]
fn messages_of_unnamed_topics_are_read_by_what_they_hold() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut bytes = recording(&path, 4);
    let first = chunks(&bytes)[0];
    // one flipped bit of compressed data may stand for the same text
    let middle = first.0 + first.1 / 2;
    bytes[middle..middle + 8].iter_mut().for_each(|byte| *byte = !*byte);
    let capture = parse(&bytes, &path).unwrap();
    assert_eq!(capture.frames().count() as u64, 4 * PER_CHUNK);
    assert_eq!((capture.damage.bad_chunks, capture.damage.bad_messages), (1, 0));
    std::fs::write(&path, &bytes).unwrap();
    let found = recover(&path, &folder.path().join("b.mcap")).unwrap();
    assert_eq!(found.frames, 4 * PER_CHUNK);
}

#[test]
fn two_recordings_behind_each_other_are_read_both() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = recording(&folder.path().join("a.mcap"), 3);
    let both = [bytes.clone(), bytes].concat();
    let entries = parse(&both, Path::new("both.mcap")).unwrap().entries;
    let sessions = entries.iter().filter(|entry| matches!(entry, Entry::Session(_))).count();
    assert_eq!((sessions, entries.len() as u64), (2, 2 * (1 + 3 * PER_CHUNK)));
}
