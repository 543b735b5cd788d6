//! Recordings of other programs, and files that only resemble recordings.

use std::path::Path;

use crate::common::recordings::{
    append, channel, chunk, container, frame_json, lz4, lz4_chunk, message, record, session, zeros,
};
use crate::common::{refused, rotated};
use eit_hw::capture::{SessionRecord, parse, read};
use eit_hw::{Note, ReadOptions, read_recording};

/// Returns the channels of session and frames, and a session with this many measurements.
fn start(quadruples: usize) -> Vec<u8> {
    let session = SessionRecord { quadruples: rotated(16)[..quadruples].to_vec(), ..session() };
    let json = serde_json::to_vec(&session).unwrap();
    [channel(1, "/eit/session"), channel(2, "/eit/frame"), message(1, &json)].concat()
}

/// Zstandard is the default of the mcap package of PyPI.
#[test]
fn zstandard_is_read_and_gone_on_with_only_by_the_same_set_up() {
    let folder = tempfile::tempdir().unwrap();
    let content = [start(4), message(2, &frame_json("1,2,3,4"))].concat();
    let level = ruzstd::encoding::CompressionLevel::Fastest;
    let packed = ruzstd::encoding::compress_to_vec(&content[..], level);
    let bytes = container(&[
        chunk(b"zstd", &packed, content.len() as u64, crc32fast::hash(&content)),
        // content that does not end where stated is bad
        chunk(b"zstd", &packed, content.len() as u64 - 1, 0),
    ]);
    let path = folder.path().join("z.mcap");
    std::fs::write(&path, &bytes).unwrap();
    let capture = read(&path).unwrap();
    assert_eq!(capture.frames().next().unwrap().values, [1.0, 2.0, 3.0, 4.0]);
    assert_eq!((capture.entries.len(), capture.damage.bad_chunks), (2, 1));
    let recording = read_recording(&path, None, &ReadOptions::default()).unwrap();
    assert_eq!(recording.real.dim(), (1, 4));
    assert!(matches!(recording.notes[..], [Note::Damaged { chunks: 1, .. }]));
    refused(append(&path), &["measurements"]);
    assert_eq!(std::fs::read(&path).unwrap(), bytes);
}

/// Wrong lengths allocate no memory, and content that unpacks endlessly is skipped.
#[test]
fn hostile_lengths_are_reported_at_once() {
    let path = Path::new("hostile.mcap");
    let read = |records: &[Vec<u8>]| parse(&container(records), path).unwrap();
    // a text of 4 GiB in the first record
    let long = [&0xFFFF_FFF0_u32.to_le_bytes()[..], b"abcd", &[b'x'; 64]].concat();
    assert_eq!(read(&[record(1, &long)]).entries, []);
    // a record of 64 MiB in 18 bytes
    let short = [&[1][..], &(64_u64 << 20).to_le_bytes(), b"x"].concat();
    assert!(read(&[short]).damage.truncated_bytes > 0);
    // 60 MB of values in 0.2 MB
    let of = |count| [start(4), message(2, &frame_json(&zeros(count)))].concat();
    let many = of(30_000_000);
    let packed = lz4(&many);
    assert!(packed.len() < 300_000);
    for stated in [many.len() as u64, 1000] {
        let capture = read(&[chunk(b"lz4", &packed, stated, 0)]);
        assert!(capture.entries.is_empty() && capture.damage.is_any());
    }
    // more values than any instrument has, in a valid chunk
    let capture = read(&[lz4_chunk(&of(300_000))]);
    assert_eq!((capture.entries.len(), capture.damage.bad_messages), (1, 1));
    // nested lists
    let deep = [&br#"{"sequence":0,"epoch":0,"values":"#[..], &[b'['; 1 << 20]].concat();
    assert_eq!(read(&[start(4), message(2, &deep)]).damage.bad_messages, 1);
    // frames that exhaust memory
    let large = [start(0), message(2, &frame_json(&zeros(200_000))).repeat(40)].concat();
    refused(parse(&container(&[lz4_chunk(&large).repeat(12)]), path), &["unpacks to more than"]);
}

/// A file of chunk headers, each of which looks possible: time stays bounded.
#[test]
fn a_file_of_heads_takes_no_time() {
    let mut bytes = container(&[]);
    while bytes.len() < 2 << 20 {
        // a length that fits nothing, so that each position is tried
        let mut one = chunk(b"", &[0; 32], 1 << 20, 1);
        one[1] ^= 1;
        one[9 + 28 + 4..][..8].copy_from_slice(&(1_u64 << 20).to_le_bytes());
        bytes.extend(one);
    }
    let start = std::time::Instant::now();
    assert_eq!(parse(&bytes, Path::new("heads.mcap")).unwrap().entries, []);
    assert!(start.elapsed().as_secs_f64() < 10.0, "{:?}", start.elapsed());
}

#[cfg(unix)]
#[test]
fn only_regular_files_are_read() {
    for path in ["/dev/zero", "/dev/null"].map(Path::new) {
        let words = ["is not a regular file"];
        refused(read_recording(path, None, &ReadOptions::default()), &words);
        refused(read(path), &words);
        refused(append(path), &words);
    }
}
