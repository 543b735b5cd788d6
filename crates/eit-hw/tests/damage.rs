//! Recordings that were damaged, are written by two programs, or come from others: nothing whole is
//! lost, and what is lost is told.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

mod common;

use std::collections::BTreeMap;
use std::path::Path;

use common::rotated;
use eit_hw::capture::{
    CaptureSettings, CaptureWriter, Entry, SessionRecord, UnitName, parse, read, recover,
};
use eit_hw::{Frame, HwError, Note, Quality, ReadOptions, read_recording};

fn session() -> SessionRecord {
    SessionRecord {
        driver: "eits1".into(),
        instrument: "emulated skin".into(),
        unit: UnitName::Volt,
        quadruples: rotated(16),
        current_a: Some(1e-4),
        ..SessionRecord::default()
    }
}

fn frame(sequence: u64) -> Frame {
    let value = |index: u64| ((sequence * 208 + index) as f64 * 0.618_033_988_749).sin() * 1e-3;
    Frame {
        values: (0..208).map(value).collect(),
        imaginary: None,
        quality: vec![Quality::GOOD; 208],
        sequence,
        epoch: 0,
        device_time_s: Some(sequence as f64 / 25.0),
        host_time_s: Some(1.79e9 + sequence as f64 / 25.0),
    }
}

const PER_CHUNK: u64 = 5;

/// A finished recording with a chunk of 5 frames after the session's.
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

/// Where each chunk's record begins, and its length.
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

/// Every bit of every byte before the content of a chunk: the content tells what the head should say.
#[test]
fn a_damaged_head_costs_at_most_its_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = recording(&folder.path().join("a.mcap"), 6);
    let all: Vec<u64> = (0..6 * PER_CHUNK).collect();
    let heads = chunks(&bytes);
    assert_eq!(heads.len(), 7);
    let (mut most, mut mended) = (0, 0);
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
            most = most.max(lost);
            mended += capture.damage.mended_chunks;
        }
        // a length alone costs nothing
        for byte in 1..9 {
            let mut damaged = bytes.clone();
            damaged[start + byte] ^= 1;
            assert_eq!(sequences(&damaged), all, "length byte {byte}");
        }
    }
    assert!(most <= PER_CHUNK as usize, "{most}");
    assert!(mended > 6 * 8 * 8, "{mended}");
}

/// Any bit of the whole file, and any stretch of up to 5 bytes: at most two chunks are lost, and told.
#[test]
fn any_damage_costs_little_and_is_told() {
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

/// One flipped length once cost all that came after it, and going on with it cut all that off.
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

    // a tail that is no whole record: an unfinished chunk, or garbage of any length
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

#[test]
fn two_recorders_do_not_share_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let settings = CaptureSettings::default;
    let first = CaptureWriter::create(&path, &session(), settings()).unwrap();
    let append = || CaptureWriter::append(&path, &session(), settings());
    let refused = append().err().unwrap();
    assert!(matches!(&refused, HwError::Busy { .. }), "{refused}");
    assert!(refused.to_string().contains("a.mcap: is being recorded to by another program"));
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
    // never over another file
    assert!(matches!(recover(&from, &to), Err(HwError::Write { .. })));
}

/// The chunk that names the topics is bad: messages say themselves what they are.
#[test]
fn messages_of_unnamed_topics_are_read_by_what_they_hold() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut bytes = recording(&path, 4);
    let first = chunks(&bytes)[0];
    bytes[first.0 + first.1 / 2] ^= 4;
    let capture = parse(&bytes, &path).unwrap();
    assert_eq!(capture.frames().count() as u64, 4 * PER_CHUNK);
    assert_eq!((capture.damage.bad_chunks, capture.damage.bad_messages), (1, 0));
    std::fs::write(&path, &bytes).unwrap();
    let found = recover(&path, &folder.path().join("b.mcap")).unwrap();
    assert_eq!(found.frames, 4 * PER_CHUNK);
}

/// The bytes of a chunk with this content, as the container lays it out.
fn chunk(name: &[u8], packed: &[u8], unpacked: u64, crc: u32) -> Vec<u8> {
    let mut body = Vec::new();
    body.extend(0_u64.to_le_bytes());
    body.extend(1_u64.to_le_bytes());
    body.extend(unpacked.to_le_bytes());
    body.extend(crc.to_le_bytes());
    body.extend((name.len() as u32).to_le_bytes());
    body.extend(name);
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    record(6, &body)
}

fn record(op: u8, body: &[u8]) -> Vec<u8> {
    [&[op][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

/// Channels of the session and frames, and a session with these many measurements.
fn start(quadruples: usize) -> Vec<u8> {
    let channel = |id: u16, topic: &str| {
        let ids = [id.to_le_bytes(), 0_u16.to_le_bytes()].concat();
        record(4, &[ids, text(topic), text("json"), 0_u32.to_le_bytes().to_vec()].concat())
    };
    let session = SessionRecord { quadruples: rotated(16)[..quadruples].to_vec(), ..session() };
    let json = serde_json::to_vec(&session).unwrap();
    [channel(1, "/eit/session"), channel(2, "/eit/frame"), message(1, &json)].concat()
}

fn message(channel: u16, json: &[u8]) -> Vec<u8> {
    let mut body = channel.to_le_bytes().to_vec();
    body.extend([0; 20]);
    body.extend(json);
    record(5, &body)
}

fn frame_json(values: &str) -> Vec<u8> {
    let head = r#"{"sequence":0,"epoch":0,"device_time_s":null,"host_time_s":null,"values":["#;
    format!("{head}{values}]}}").into_bytes()
}

const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// The default of the mcap package of PyPI is Zstandard.
#[test]
fn zstandard_is_read_and_gone_on_with_only_by_the_same_set_up() {
    let folder = tempfile::tempdir().unwrap();
    let content = [start(4), message(2, &frame_json("1,2,3,4"))].concat();
    let level = ruzstd::encoding::CompressionLevel::Fastest;
    let packed = ruzstd::encoding::compress_to_vec(&content[..], level);
    let bytes = [
        MAGIC,
        &chunk(b"zstd", &packed, content.len() as u64, crc32fast_of(&content)),
        // what does not end where it says is bad
        &chunk(b"zstd", &packed, content.len() as u64 - 1, 0),
    ]
    .concat();
    let path = folder.path().join("z.mcap");
    std::fs::write(&path, &bytes).unwrap();
    let capture = read(&path).unwrap();
    assert_eq!(capture.frames().next().unwrap().values, [1.0, 2.0, 3.0, 4.0]);
    assert_eq!((capture.entries.len(), capture.damage.bad_chunks), (2, 1));
    let recording = read_recording(&path, None, &ReadOptions::default()).unwrap();
    assert_eq!(recording.real.dim(), (1, 4));
    assert!(matches!(recording.notes[..], [Note::Damaged { chunks: 1, .. }]));
    let refused = CaptureWriter::append(&path, &session(), CaptureSettings::default());
    assert!(refused.err().unwrap().to_string().contains("measurements"));
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
}

/// CRC-32 as the container has it, of the crate that the library has for its other codes.
fn crc32fast_of(bytes: &[u8]) -> u32 {
    crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(bytes)
}

/// Lengths that lie ask for no memory, and what unpacks without end is left out.
#[test]
fn hostile_lengths_are_told_at_once() {
    let path = Path::new("hostile.mcap");
    let lz4 = |content: &[u8]| {
        let mut packed = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
        std::io::Write::write_all(&mut packed, content).unwrap();
        packed.finish().0
    };
    // a text of 4 GiB in the first record
    let long = [&0xFFFF_FFF0_u32.to_le_bytes()[..], b"abcd", &[b'x'; 64]].concat();
    let bytes = [MAGIC, &record(1, &long)].concat();
    assert_eq!(parse(&bytes, path).unwrap().entries, []);
    // a record of 64 MiB in 18 bytes
    let bytes = [MAGIC, &[1], &(64_u64 << 20).to_le_bytes(), b"x"].concat();
    assert!(parse(&bytes, path).unwrap().damage.truncated_bytes > 0);
    // 60 MB of values in 0.2 MB
    let many = [start(4), message(2, &frame_json(&vec!["0"; 30_000_000].join(",")))].concat();
    let packed = lz4(&many);
    assert!(packed.len() < 300_000);
    for stated in [many.len() as u64, 1000] {
        let bytes = [MAGIC, &chunk(b"lz4", &packed, stated, 0)].concat();
        let capture = parse(&bytes, path).unwrap();
        assert!(capture.entries.is_empty() && capture.damage.is_any());
    }
    // values beyond what any instrument has, in a chunk that can be
    let many = [start(4), message(2, &frame_json(&vec!["0"; 300_000].join(",")))].concat();
    let bytes = [MAGIC, &chunk(b"lz4", &lz4(&many), many.len() as u64, 0)].concat();
    let capture = parse(&bytes, path).unwrap();
    assert_eq!((capture.entries.len(), capture.damage.bad_messages), (1, 1));
    // nested lists
    let deep =
        message(2, &[&br#"{"sequence":0,"epoch":0,"values":"#[..], &vec![b'['; 1 << 20]].concat());
    let bytes = [MAGIC, &start(4), &deep].concat();
    assert_eq!(parse(&bytes, path).unwrap().damage.bad_messages, 1);
    // frames that fill the memory: 40 times 200 000 zeros, packed 200 times
    let large = frame_json(&vec!["0"; 200_000].join(","));
    let many = [start(0), message(2, &large).repeat(40)].concat();
    let one = chunk(b"lz4", &lz4(&many), many.len() as u64, 0);
    let bytes = [MAGIC, &one.repeat(12)].concat();
    let refused = parse(&bytes, path).unwrap_err();
    assert!(matches!(refused, HwError::TooLarge { .. }), "{refused}");
}

/// Chunk heads one after another, each of which looks like it could be one: time stays bounded.
#[test]
fn a_file_of_heads_takes_no_time() {
    let packed = vec![0; 32];
    let mut bytes = MAGIC.to_vec();
    while bytes.len() < 2 << 20 {
        // a length that fits nothing, so that each place is tried
        let mut one = chunk(b"", &packed, 1 << 20, 1);
        one[1] ^= 1;
        one[9 + 28 + 4..][..8].copy_from_slice(&(1_u64 << 20).to_le_bytes());
        bytes.extend(one);
    }
    let start = std::time::Instant::now();
    let capture = parse(&bytes, Path::new("heads.mcap")).unwrap();
    assert_eq!(capture.entries, []);
    let took_s = start.elapsed().as_secs_f64();
    println!("{} kB of heads: {took_s:.2} s", bytes.len() / 1000);
    assert!(took_s < 10.0, "{took_s}");
}

#[test]
fn only_regular_files_are_read() {
    if !cfg!(unix) {
        return;
    }
    for path in ["/dev/zero", "/dev/null"] {
        let refused = read_recording(Path::new(path), None, &ReadOptions::default()).unwrap_err();
        assert!(matches!(refused, HwError::NotAFile { .. }), "{refused}");
        assert!(matches!(read(Path::new(path)), Err(HwError::NotAFile { .. })));
        let session = session();
        let append = CaptureWriter::append(Path::new(path), &session, CaptureSettings::default());
        assert!(matches!(append.err(), Some(HwError::NotAFile { .. })));
    }
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

/// The host's clock was set back and forth while it was recorded: the instrument's rules, and without one
/// a step of an hour is not waited for.
#[test]
fn a_replay_in_real_time_does_not_follow_a_clock_that_is_set() {
    use eit_hw::driver::{Event, FrameSource as _, Pace, Replay};
    let folder = tempfile::tempdir().unwrap();
    for (step_s, has_device_clock) in
        [(3600.0, true), (-3600.0, true), (3600.0, false), (-3600.0, false)]
    {
        let path = folder.path().join(format!("{step_s}{has_device_clock}.mcap"));
        let settings = CaptureSettings::default();
        let mut writer = CaptureWriter::create(&path, &session(), settings).unwrap();
        for sequence in 0..10 {
            let set_s = if sequence >= 5 { step_s } else { 0.0 };
            let mut frame = frame(sequence);
            frame.host_time_s = frame.host_time_s.map(|time_s| time_s + set_s);
            frame.device_time_s = frame.device_time_s.filter(|_| has_device_clock);
            writer.frame(&frame).unwrap();
        }
        writer.finish().unwrap();
        let mut replay = Replay::open(&path, None, Pace::Speed(1.0)).unwrap();
        let (start, mut told) = (std::time::Instant::now(), 0);
        while !replay.is_over() {
            let wait = std::time::Duration::from_secs(5);
            told += usize::from(matches!(replay.next_event(wait).unwrap(), Some(Event::Frame(_))));
        }
        let took_s = start.elapsed().as_secs_f64();
        assert_eq!(told, 10);
        // nine steps of 0.04 s, one of which is the clock's
        assert!((0.3..5.0).contains(&took_s), "{step_s} s: {took_s:.2} s");
    }
}
