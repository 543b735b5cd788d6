//! Recordings and containers for tests.

use std::ops::Range;
use std::path::Path;
use std::time::Duration;

use eit_hw::capture::{CaptureSettings, CaptureWriter, Entry, MAGIC, SessionRecord, UnitName};
use eit_hw::driver::{Event, FrameSource as _, Replay};
use eit_hw::{Frame, HwError, Quality};

use super::rotated;

/// Returns a session of adjacent patterns on 16 electrodes.
pub fn session() -> SessionRecord {
    SessionRecord {
        driver: "eits1".into(),
        instrument: "emulated skin".into(),
        serial: "7".into(),
        unit: UnitName::Volt,
        quadruples: rotated(16),
        current_a: Some(1e-4),
        frequency_hz: None,
        frame_rate_hz: Some(25.0),
        scene_toml: "[skin]\nshape = \"disc\"\n".into(),
        recorder: "test".into(),
        continues: false,
    }
}

/// Returns a frame of [`session`], with different values for each sequence number.
pub fn frame(sequence: u64) -> Frame {
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

pub fn create(path: &Path) -> Result<CaptureWriter, HwError> {
    CaptureWriter::create(path, &session(), CaptureSettings::default())
}

pub fn append(path: &Path) -> Result<CaptureWriter, HwError> {
    CaptureWriter::append(path, &session(), CaptureSettings::default())
}

/// Writes a finished recording of these entries, the session first, `per_chunk` of the others in a chunk.
pub fn recorded(path: &Path, entries: &[Entry], per_chunk: usize) -> Vec<u8> {
    let Entry::Session(session) = &entries[0] else { panic!("a session comes first") };
    let settings = CaptureSettings { flush_s: 3600.0, ..CaptureSettings::default() };
    let mut writer = CaptureWriter::create(path, session, settings).unwrap();
    for chunk in entries[1..].chunks(per_chunk) {
        chunk.iter().for_each(|entry| writer.write(entry).unwrap());
        writer.flush().unwrap();
    }
    writer.finish().unwrap();
    std::fs::read(path).unwrap()
}

/// Returns the places of the chunks, from the container's layout: opcode, length, body.
pub fn chunks(bytes: &[u8]) -> Vec<Range<usize>> {
    let (mut at, mut found) = (8, Vec::new());
    while at + 9 <= bytes.len() {
        let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
        if bytes[at] == 0x06 {
            found.push(at..at + 9 + length);
        }
        at += 9 + length;
    }
    found
}

/// Replays a recording: its frames as `EPOCH.SEQUENCE`, then notices and other events.
pub fn replayed(mut replay: Replay) -> Vec<String> {
    let mut reported = Vec::new();
    while let Some(event) = replay.next_event(Duration::ZERO).unwrap() {
        reported.push(match event {
            Event::Frame(frame) => format!("{}.{}", frame.epoch, frame.sequence),
            Event::Notice(text) => format!("notice: {text}"),
            other => format!("{other:?}"),
        });
    }
    assert!(replay.is_over());
    reported
}

/// A container without an index.
pub fn container(records: &[Vec<u8>]) -> Vec<u8> {
    [MAGIC, &records.concat()].concat()
}

pub fn record(op: u8, body: &[u8]) -> Vec<u8> {
    [&[op][..], &(body.len() as u64).to_le_bytes(), body].concat()
}

pub fn chunk(name: &[u8], packed: &[u8], unpacked: u64, crc: u32) -> Vec<u8> {
    let mut body = [0_u64.to_le_bytes(), 1_u64.to_le_bytes()].concat();
    body.extend(unpacked.to_le_bytes());
    body.extend(crc.to_le_bytes());
    body.extend((name.len() as u32).to_le_bytes());
    body.extend(name);
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    record(6, &body)
}

/// A chunk packed with LZ4, without a checksum.
pub fn lz4_chunk(content: &[u8]) -> Vec<u8> {
    chunk(b"lz4", &lz4(content), content.len() as u64, 0)
}

pub fn lz4(content: &[u8]) -> Vec<u8> {
    let mut packed = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
    std::io::Write::write_all(&mut packed, content).unwrap();
    packed.finish().0
}

/// Returns a channel of JSON without a schema.
pub fn channel(id: u16, topic: &str) -> Vec<u8> {
    let ids = [id.to_le_bytes(), 0_u16.to_le_bytes()].concat();
    record(4, &[ids, text(topic), text("json"), 0_u32.to_le_bytes().to_vec()].concat())
}

/// Returns a message with sequence number and times 0.
pub fn message(channel: u16, json: &[u8]) -> Vec<u8> {
    record(5, &[&channel.to_le_bytes()[..], &[0; 20], json].concat())
}

pub fn frame_json(values: &str) -> Vec<u8> {
    let head = r#"{"sequence":0,"epoch":0,"device_time_s":null,"host_time_s":null,"values":["#;
    format!("{head}{values}]}}").into_bytes()
}

pub fn zeros(count: usize) -> String {
    "0,".repeat(count - 1) + "0"
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}
