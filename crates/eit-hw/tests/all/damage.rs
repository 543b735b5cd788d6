//! Recordings that are damaged or written by two programs: nothing intact is lost; every loss is reported.

use std::collections::BTreeMap;
use std::path::Path;

use crate::common::recordings::{
    append, channel, chunks, container, create, frame, frame_json, lz4_chunk, message, recorded,
    replayed, session,
};
use crate::common::{place, refused};
use eit_hw::HwError;
use eit_hw::capture::{Damage, Entry, parse, read, recover};
use eit_hw::driver::{Pace, Replay};

const PER_CHUNK: u64 = 5;

/// Writes a recording with one chunk for the session and `chunks` chunks of 5 frames.
fn recording(path: &Path, chunks: u64) -> Vec<u8> {
    recording_of(path, chunks, 208)
}

fn recording_of(path: &Path, chunks: u64, measurements: usize) -> Vec<u8> {
    let mut session = session();
    session.quadruples.truncate(measurements);
    let frames = (0..chunks * PER_CHUNK).map(|sequence| {
        let mut frame = frame(sequence);
        frame.values.truncate(measurements);
        frame.quality.truncate(measurements);
        Entry::Frame(frame)
    });
    let entries: Vec<Entry> = [Entry::Session(session)].into_iter().chain(frames).collect();
    recorded(path, &entries, PER_CHUNK as usize)
}

/// Returns how many frames are lost of a recording of `chunks` chunks, and what is reported. The others are in order.
fn lost(bytes: &[u8], chunks: u64, name: &str) -> (usize, Damage) {
    let capture = parse(bytes, Path::new("damaged.mcap")).unwrap();
    let mut all = 0..chunks * PER_CHUNK;
    assert!(capture.frames().all(|found| all.any(|one| found.sequence == one)), "{name}");
    let lost = (chunks * PER_CHUNK) as usize - capture.frames().count();
    assert!(lost == 0 || capture.damage.is_any(), "{name}: not told");
    (lost, capture.damage)
}

fn sequences(bytes: &[u8]) -> Vec<u64> {
    parse(bytes, Path::new("damaged.mcap")).unwrap().frames().map(|frame| frame.sequence).collect()
}

/// A replay says at its end, once, what a damaged recording lacks; of an intact one it says nothing.
#[test]
fn a_replay_tells_what_is_damaged() {
    let (_folder, path) = place("a.mcap");
    let bytes = recording(&path, 4);
    let third = chunks(&bytes)[3].clone();
    let middle = third.start.midpoint(third.end);
    let mut bad = bytes.clone();
    bad[middle] ^= 4;
    let cut = bytes[..middle].to_vec();
    for (bytes, frames, reported) in [(bytes, 20, 0), (bad, 15, 1), (cut, 10, 1)] {
        std::fs::write(&path, bytes).unwrap();
        let said = replayed(Replay::open(&path, None, Pace::OnDemand).unwrap());
        assert_eq!(said.iter().filter(|text| text.starts_with("0.")).count(), frames);
        let last = said.iter().position(|text| text.starts_with("notice"));
        let notices = &said[last.unwrap_or(said.len())..];
        assert_eq!(notices.len(), reported, "{notices:?}");
        assert!(notices.iter().all(|text| text.contains("damaged")), "{notices:?}");
    }
}

/// Flips every bit before the content of a chunk: the content shows what the header should say.
#[test]
fn a_damaged_head_costs_at_most_its_chunk() {
    let (_folder, path) = place("a.mcap");
    let bytes = recording_of(&path, 3, 20);
    let heads = chunks(&bytes);
    assert_eq!(heads.len(), 4);
    let mut mended = 0;
    for start in heads[1..].iter().map(|chunk| chunk.start) {
        for bit in 0..8 * (9 + 28 + 4 + 3 + 8) {
            let mut damaged = bytes.clone();
            damaged[start + bit / 8] ^= 1 << (bit % 8);
            let (lost, damage) = lost(&damaged, 3, &format!("bit {bit} at {start}"));
            // a wrong length alone loses nothing
            let most = if (1..9).contains(&(bit / 8)) { 0 } else { PER_CHUNK as usize };
            assert!(lost <= most, "{lost} frames: bit {bit} of the head at {start}");
            mended += damage.mended_chunks;
        }
    }
    // all bits of the two lengths and of the opcode, but two that turn it into a channel or a message index
    assert_eq!(mended, 3 * (64 + 64 + 8 - 2));
}

/// Damages any bit of the file, or any stretch of up to 5 bytes.
#[test]
fn any_damage_costs_little_and_is_reported() {
    let (_folder, path) = place("a.mcap");
    let bytes = recording_of(&path, 4, 20);
    let mut random = fixtures::Random::new(3);
    for round in 0..3000 {
        let mut damaged = bytes.clone();
        let (at, count) = (8 + random.below(bytes.len() - 8), [1, 1, 1, 2, 5][round % 5]);
        for byte in damaged.iter_mut().skip(at).take(count) {
            *byte ^= 1 << random.below(8);
        }
        let (lost, _) = lost(&damaged, 4, &format!("{count} bytes at {at}"));
        assert!(lost <= 2 * PER_CHUNK as usize, "{lost} frames lost: {count} bytes at {at}");
    }
}

/// A bad chunk after damage, at the end of an unfinished recording.
#[test]
fn damage_that_no_whole_chunk_follows_is_reported() {
    let (_folder, path) = place("a.mcap");
    let bytes = recording(&path, 3);
    let last = chunks(&bytes).pop().unwrap();
    let whole = sequences(&bytes[..last.start]);
    assert_eq!(whole.len() as u64, 2 * PER_CHUNK);
    let mut bad = bytes[last.clone()].to_vec();
    let at = bad.len() / 2;
    bad[at] ^= 4;
    let tail = [&[0xff; 5][..], &bad].concat();
    let capture = parse(&[&bytes[..last.start], &tail].concat(), &path).unwrap();
    assert_eq!(capture.frames().count(), whole.len());
    assert_eq!(capture.damage.truncated_bytes, tail.len() as u64, "{:?}", capture.damage);
    appending_keeps(&path, &bytes[..last.start], &tail);
}

/// Appends to a recording of whole chunks and a tail: the chunks stay, and what is cut off is kept.
fn appending_keeps(path: &Path, chunks: &[u8], tail: &[u8]) {
    std::fs::write(path, [chunks, tail].concat()).unwrap();
    let writer = append(path).unwrap();
    let cut = writer.cut_tail().cloned().unwrap();
    writer.finish().unwrap();
    assert_eq!(cut.bytes, tail.len() as u64);
    assert!(std::fs::read(&cut.path).unwrap() == tail);
    assert_eq!(sequences(&std::fs::read(path).unwrap()), sequences(chunks));
}

/// One flipped length; then an incomplete record at the end.
#[test]
fn going_on_never_cuts_a_whole_chunk_and_keeps_what_it_cuts() {
    let (folder, path) = place("a.mcap");
    let bytes = recording(&path, 8);
    let mut damaged = bytes.clone();
    damaged[chunks(&bytes)[3].start + 5] ^= 1;
    std::fs::write(&path, &damaged).unwrap();
    let mut writer = append(&path).unwrap();
    assert_eq!(writer.cut_tail(), None);
    writer.frame(&frame(1000)).unwrap();
    writer.finish().unwrap();
    let mut wanted: Vec<u64> = (0..8 * PER_CHUNK).collect();
    wanted.push(1000);
    assert_eq!(sequences(&std::fs::read(&path).unwrap()), wanted);

    // an unfinished chunk, or garbage of any length
    let last = chunks(&bytes).pop().unwrap();
    for tail in [bytes[last.start..last.start.midpoint(last.end)].to_vec(), vec![0xff; 17 << 20]] {
        let path = folder.path().join(format!("tail{}.mcap", tail.len()));
        appending_keeps(&path, &bytes[..last.start], &tail);
    }
}

/// No record is intact, yet the bytes after the first eight may be all that somebody has.
#[test]
fn what_follows_the_first_bytes_alone_is_kept_too() {
    let folder = tempfile::tempdir().unwrap();
    for (name, start, rest) in [
        ("garbage", container(&[]), &[0xa5; 3000][..]),
        ("a few bytes", container(&[]), b"abc"),
        ("none", container(&[]), b""),
        ("an empty file", Vec::new(), b""),
    ] {
        let path = folder.path().join(format!("{name}.mcap"));
        std::fs::write(&path, [&start, rest].concat()).unwrap();
        let mut writer = append(&path).unwrap();
        let cut = writer.cut_tail().map(|cut| (cut.bytes, std::fs::read(&cut.path).unwrap()));
        let wanted = Some((rest.len() as u64, rest.to_vec())).filter(|_| !rest.is_empty());
        assert_eq!(cut, wanted, "{name}");
        writer.frame(&frame(0)).unwrap();
        writer.finish().unwrap();
        let capture = read(&path).unwrap();
        assert!(capture.frames().count() == 1 && capture.damage == Damage::default(), "{name}");
    }
}

#[test]
fn two_recorders_do_not_share_a_file() {
    let (_folder, path) = place("a.mcap");
    let first = create(&path).unwrap();
    refused(append(&path), &["a.mcap: another program is recording to it"]);
    assert!(create(&path).is_err());
    drop(first);
    let second = append(&path).unwrap();
    assert!(matches!(append(&path), Err(HwError::Busy { .. })));
    second.finish().unwrap();
    assert_eq!(read(&path).unwrap().sessions().count(), 2);
}

#[test]
fn recover_writes_all_that_is_whole_with_clocks_notes_and_attachments() {
    let folder = tempfile::tempdir().unwrap();
    let (from, to) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    let mut bytes = std::io::Cursor::new(Vec::new());
    let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4));
    let mut writer = options.create(&mut bytes).unwrap();
    let no = BTreeMap::new();
    let own = writer.add_channel(0, "/eit/note", "json", &no).unwrap();
    let other = writer.add_channel(0, "/robot/pose", "raw", &no).unwrap();
    for sequence in 0..40 {
        let note = format!("{{\"text\": \"note {sequence}\"}}");
        for (channel_id, content) in [(own, note.as_bytes()), (other, &[7; 99])] {
            let (log_time, publish_time) = (1000 + u64::from(sequence), 2000 + u64::from(sequence));
            let header =
                mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
            writer.write_to_known_channel(&header, content).unwrap();
        }
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
    let metadata = [("who".to_owned(), "me".to_owned())].into();
    let metadata = mcap::records::Metadata { name: "lab".into(), metadata };
    writer.write_metadata(&metadata).unwrap();
    writer.finish().unwrap();
    drop(writer);
    let mut bytes = bytes.into_inner();
    let second = chunks(&bytes)[1].clone();
    // in the content: that chunk is bad
    bytes[second.start.midpoint(second.end)] ^= 4;
    std::fs::write(&from, &bytes).unwrap();
    let found = recover(&from, &to).unwrap();
    assert_eq!((found.messages, found.attachments, found.bad_attachments), (60, 2, 0));
    assert_eq!(found.damage.bad_chunks, 1);
    let whole = std::fs::read(&to).unwrap();
    let mut count = 0;
    for message in mcap::MessageStream::new(&whole).unwrap().map(Result::unwrap) {
        assert_eq!(message.log_time, 1000 + u64::from(message.sequence));
        assert_eq!(message.publish_time, 2000 + u64::from(message.sequence));
        assert!(!(10..20).contains(&message.sequence));
        count += 1;
    }
    assert_eq!(count, 60);
    let summary = mcap::Summary::read(&whole).unwrap().unwrap();
    let index = &summary.attachment_indexes[0];
    assert_eq!(mcap::read::attachment(&whole, index).unwrap(), attachment);
    assert_eq!(mcap::read::metadata(&whole, &summary.metadata_indexes[0]).unwrap(), metadata);
    assert!(matches!(recover(&from, &to), Err(HwError::Exists { .. })));
}

/// Messages that are stored intact but are not what their topic holds, and frames of another instrument: all are
/// copied, in a chunk or not, counted and never called frames.
#[test]
fn recover_tells_what_is_whole_but_no_frame() {
    let folder = tempfile::tempdir().unwrap();
    let [from, to] = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    let content = |k: usize| -> Vec<u8> {
        match k {
            3 => b"{\"hello\":1}".to_vec(),
            5 => (0..=255).collect(),
            7 => Vec::new(),
            // longer than any reader takes
            9 => [b"\"", &[b'x'; 9 << 20][..], b"\""].concat(),
            20.. => frame_json("1,2"),
            _ => frame_json("1,2,3"),
        }
    };
    let messages: Vec<u8> = (0..25).flat_map(|k| message(1, &content(k))).collect();
    let records = [channel(1, "/eit/frame"), messages].concat();
    for records in [lz4_chunk(&records), records] {
        std::fs::write(&from, container(&[records])).unwrap();
        let found = recover(&from, &to).unwrap();
        let counts = (found.frames, found.unreadable, found.other_set_ups, found.messages);
        assert_eq!(counts, (21, 4, 5, 0));
        assert!(!found.damage.is_any(), "{:?}", found.damage);
        // as many frames as a reader finds in both, and every message bit for bit
        let frames = |path: &Path| read(path).unwrap().frames().count() as u64;
        assert_eq!((frames(&from), frames(&to)), (21, 21));
        let whole = std::fs::read(&to).unwrap();
        let messages = mcap::MessageStream::new(&whole).unwrap().map(Result::unwrap);
        let whole: Vec<bool> =
            messages.enumerate().map(|(k, message)| *message.data == content(k)[..]).collect();
        assert_eq!(whole, [true; 25]);
        std::fs::remove_file(&to).unwrap();
    }
    // nothing is left but the damaged one
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// The chunk that defines the topics is bad: messages are recognised by their content.
#[test]
fn messages_of_unnamed_topics_are_read_by_what_they_hold() {
    let (folder, path) = place("a.mcap");
    let mut bytes = recording(&path, 4);
    let first = chunks(&bytes)[0].clone();
    // one flipped bit of compressed data may stand for the same text
    let middle = first.start.midpoint(first.end);
    bytes[middle..middle + 8].iter_mut().for_each(|byte| *byte = !*byte);
    let capture = parse(&bytes, &path).unwrap();
    assert_eq!(capture.frames().count() as u64, 4 * PER_CHUNK);
    assert_eq!((capture.damage.bad_chunks, capture.damage.bad_messages), (1, 0));
    std::fs::write(&path, &bytes).unwrap();
    assert_eq!(recover(&path, &folder.path().join("b.mcap")).unwrap().frames, 4 * PER_CHUNK);
}

#[test]
fn two_recordings_behind_each_other_are_read_both() {
    let (_folder, path) = place("a.mcap");
    let entries = parse(&recording(&path, 3).repeat(2), Path::new("both.mcap")).unwrap().entries;
    let sessions = entries.iter().filter(|entry| matches!(entry, Entry::Session(_))).count();
    assert_eq!((sessions, entries.len() as u64), (2, 2 * (1 + 3 * PER_CHUNK)));
}
