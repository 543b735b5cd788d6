//! Memory of every reader, by the allocator: at most 64 MB plus ten times the file, whatever it holds.

use std::fmt::Write;
use std::hint::black_box;

use crate::common::arrays::npy_bytes;
use crate::common::recordings::{
    channel, chunk, container, create, frame, frame_json, lz4_chunk, message, zeros,
};
use crate::common::{Parsed, little_memory, place, table as options};
use eit_hw::capture::{self, CaptureReader};
use eit_hw::{Format, FrameOrientation, HwError, ReadOptions, read_recording};

/// Size of most files: two arrays of `f64` of single digits, with the file, nearly reach the limit.
const FILE_BYTES: usize = 24_000_000;

/// Writes the content to a file of this name and reads it.
fn read(name: &str, content: &[u8], format: Option<Format>, options: &ReadOptions) -> Parsed {
    let (_folder, path) = place(name);
    std::fs::write(&path, content).unwrap();
    little_memory(name, content.len(), || read_recording(&path, format, options))
}

/// A table of these fields in turn, as long as most files.
fn table(fields: &[&str], columns: usize) -> Vec<u8> {
    let mut text = Vec::with_capacity(FILE_BYTES + 100);
    let mut fields = fields.iter().cycle();
    while text.len() < FILE_BYTES {
        // an even number of rows, for those that alternate
        for column in (0..columns).chain(0..if columns < 1000 { columns } else { 0 }) {
            text.extend_from_slice(fields.next().unwrap().as_bytes());
            text.push(if column + 1 == columns { b'\n' } else { b',' });
        }
    }
    text
}

#[test]
fn tables_of_short_numbers() {
    use FrameOrientation::{Columns, Matrix, Rows};
    let plain = ReadOptions::default();
    let (columns, matrix) = (options(Columns, false), options(Matrix, false));
    let complex = options(Rows, true);
    let digits = ["1", "0", "7", "3", "3", "9", "2"];
    for (name, fields, width, options) in [
        ("line.csv", &digits[..], FILE_BYTES / 2, &plain),
        ("column.csv", &digits, 1, &plain),
        ("wide-columns.csv", &digits, 100_000, &columns),
        ("matrix.csv", &digits, 30, &matrix),
        ("complex.csv", &digits, 208, &complex),
        ("missing.csv", &["nan", "1", "inf", "2", "3"], 209, &plain),
    ] {
        let recording = read(name, &table(fields, width), Some(Format::Csv), options).unwrap();
        let first = recording.real[[0, 0]];
        let wanted: f64 = fields[0].parse().unwrap();
        assert!(first == wanted || first.is_nan() && wanted.is_nan(), "{name}: {first}");
    }
}

#[test]
fn arrays_of_every_type_and_order() {
    for (kind, size) in [("|u1", 1), ("<c8", 8)] {
        for (order, frames_are) in [
            ("False", FrameOrientation::Rows),
            ("True", FrameOrientation::Rows),
            ("False", FrameOrientation::Columns),
        ] {
            let rows = FILE_BYTES / size / 208;
            let head =
                format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': ({rows}, 208)}}");
            let bytes = npy_bytes(&head, &vec![7; rows * 208 * size]);
            let options = ReadOptions { frames_are: Some(frames_are), ..ReadOptions::default() };
            let found = read("a.npy", &bytes, None, &options).unwrap();
            assert_eq!(found.real.len(), rows * 208, "{kind}, {order}");
        }
    }
}

#[test]
fn logs_of_boards_and_instruments() {
    let times = |block: &[u8]| block.repeat(FILE_BYTES / block.len());
    let line = |count: usize| format!("{}\n", vec!["1"; count].join(" "));
    let serial = Some(Format::SerialLog);
    // a good frame, then one that does not end, by lines and by values
    let good = format!("s\n{}s\n", line(13).repeat(16));
    let endless = [good.as_bytes(), &times(line(13).as_bytes())].concat();
    let long = [good.as_bytes(), line(FILE_BYTES / 2).as_bytes()].concat();

    let mut block = "1,0,A\n".to_owned();
    (0..16).for_each(|_| writeln!(block, "1,0,1,{}", vec!["7"; 16].join(",")).unwrap());
    let head = b"UTC:,2022\ntime_pc [s],Mass [g],time_mcu[ms],data [mV]:\n";
    let voltages: Vec<u8> =
        (0..256).flat_map(|slot| (slot as f32 * 0.1 + 0.3).to_le_bytes()).collect();

    // a frame longer than any instrument's, and one that is just short enough
    let lct = |rows: usize| {
        let head = format!(
            "#MEAS\n#Length,{rows}\n#Electrodes,16\n#Operating_Frequency,10 , KHz\n#Strategy,x\n"
        );
        [head.as_bytes(), &b"1 3 7\n".repeat(rows)].concat()
    };
    // a Sciospec frame of very many short lines, one of very long lines, and one that is real
    let eit = |lines: String| {
        format!("9\nname\n2025.02.12. 13:19:58\n1000\n1000\n0\n1\n0.001\n10\n{lines}").into_bytes()
    };
    let channels = vec!["1 2"; 64].join(" ");
    for (name, content, format, is_read) in [
        ("digits.log", times(&good.as_bytes()[..good.len() - 2]), serial, true),
        ("endless.log", endless, serial, true),
        ("long.log", long, serial, true),
        ("black.csv", [head, &times(block.as_bytes())[..]].concat(), None, true),
        // bytes that are no text
        ("wrong.csv", [head, block.as_bytes(), &[0xFF; FILE_BYTES][..]].concat(), None, true),
        ("skin.get", times(&voltages), None, true),
        ("long.txt", lct(FILE_BYTES / 6), None, false),
        ("short.txt", lct(1 << 18), None, true),
        ("lines.eit", eit("1 2\n1 2 3 4\n".repeat(FILE_BYTES / 12)), None, false),
        ("long.eit", eit(format!("1 2\n{}", line(FILE_BYTES / 2))), None, false),
        ("real.eit", eit(format!("1 2\n{channels}\n").repeat(4096)), None, true),
    ] {
        let found = read(name, &content, format, &ReadOptions::default());
        assert_eq!(found.is_ok(), is_read, "{name}: {:?}", found.err());
    }
}

/// Reads a recording in every way; each takes little memory or is refused with the sizes.
fn check_capture(name: &str, bytes: &[u8], is_read: bool) {
    let (folder, path) = place(name);
    std::fs::write(&path, bytes).unwrap();
    let refused = |error: &HwError| {
        matches!(error, HwError::TooLarge { .. } | HwError::Container { .. }) && !is_read
    };
    let frames =
        little_memory(name, bytes.len(), || read_recording(&path, None, &ReadOptions::default()));
    assert!(frames.as_ref().err().is_none_or(refused), "{name}: {:?}", frames.err());
    let whole = little_memory(name, bytes.len(), || capture::read(&path).map(black_box));
    assert!(whole.as_ref().err().is_none_or(refused), "{name}: {:?}", whole.err());
    little_memory(name, bytes.len(), || {
        let mut reader = CaptureReader::open(&path).unwrap();
        while let Some(entry) = reader.next_entry().unwrap() {
            black_box(&entry);
        }
    });
    let new = folder.path().join("new.mcap");
    little_memory(name, bytes.len(), || capture::recover(&path, &new).unwrap());
}

#[test]
fn recordings_packed_hard_and_loosely() {
    let head = channel(1, "/eit/frame");
    let of = |messages: Vec<u8>| [&head[..], &messages].concat();
    let json = frame_json(&zeros(208));
    let frames = of(message(1, &json).repeat(15_000));
    let level = ruzstd::encoding::CompressionLevel::Fastest;
    let zstd = ruzstd::encoding::compress_to_vec(&frames[..], level);
    let zstd = chunk(b"zstd", &zstd, frames.len() as u64, 0);
    // large messages, and those of 7 MB that hold more values than any reader takes
    let huge = zeros(3_500_000);
    let reference = format!("{{\"epoch\":0,\"values\":[{huge}]}}");
    let reference = [channel(2, "/eit/reference"), message(2, reference.as_bytes()).repeat(2)];
    // frames that differ in every value, yet take nothing in the file
    let ramp = |start: usize| {
        let values: Vec<String> =
            (0..60_000).map(|i| (12_000 + (i + start) % 997).to_string()).collect();
        message(1, &frame_json(&values.join(",")))
    };
    let ramps = (0..20).flat_map(|start| ramp(7 * start)).collect();
    for (name, content, count) in [
        // the same frame again and again, twice what may be taken, in large chunks and in one chunk per frame
        ("frames", frames, 4),
        ("tiny", of(message(1, &json)), 40_000),
        // frames of one value, each with a time and a place in lists
        ("short", of(message(1, &frame_json("7")).repeat(100_000)), 10),
        ("large", of(message(1, &frame_json(&zeros(200_000))).repeat(40)), 2),
        ("huge", of(message(1, &frame_json(&huge)).repeat(2)), 1),
        ("reference", of(reference.concat()), 1),
        ("ramps", of(ramps), 12),
    ] {
        check_capture(name, &container(&[lz4_chunk(&content).repeat(count)]), false);
    }
    check_capture("zstd", &container(&[zstd.repeat(4)]), false);
}

/// What an instrument records: 208 values that differ in all digits.
#[test]
fn recordings_of_instruments_are_read_whole() {
    let (_folder, path) = place("press.mcap");
    let mut writer = create(&path).unwrap();
    (0..8000).for_each(|sequence| writer.frame(&frame(sequence)).unwrap());
    writer.finish().unwrap();
    check_capture("press.mcap", &std::fs::read(&path).unwrap(), true);
    let recording = read_recording(&path, None, &ReadOptions::default()).unwrap();
    assert_eq!(recording.real.row(7999).to_vec(), frame(7999).values);
}
