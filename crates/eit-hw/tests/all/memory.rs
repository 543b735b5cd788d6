//! Memory of every reader: at most 64 MB plus ten times the file, whatever it holds. Numbers as short as
//! they can be, lines and rows of any length, arrays of every order, recordings packed a hundred
//! times. Counted by the allocator, up to the peak while reading.

use std::fmt::Write;
use std::hint::black_box;
use std::path::Path;

use crate::common::recordings::{
    channel, chunk, container, frame, frame_json, lz4_chunk, message, session, zeros,
};
use crate::common::table as options;
use allocation_counter::measure;
use eit_hw::capture::{self, CaptureReader, CaptureSettings, CaptureWriter};
use eit_hw::{Format, FrameOrientation, HwError, ReadOptions, Recording, read_recording};

const MOST_BYTES: u64 = 64_000_000;

/// Size of most files: two arrays of `f64` of single digits, with the file, nearly reach the limit.
const FILE_BYTES: usize = 24_000_000;

/// Reads a file or folder of this many bytes and checks the peak of memory.
fn check(
    name: &str,
    path: &Path,
    bytes: u64,
    format: Option<Format>,
    options: &ReadOptions,
) -> Result<Recording, HwError> {
    let mut read = None;
    let info = measure(|| read = Some(read_recording(path, format, options)));
    let peak = info.bytes_max;
    let ratio = peak as f64 / bytes as f64;
    println!("{name}: {:.1} MB, peak {:.1} MB, {ratio:.2} times", mb(bytes), mb(peak));
    let most = MOST_BYTES + 10 * bytes;
    assert!(peak <= most, "{name}: {peak} of {most} bytes");
    read.unwrap()
}

fn mb(bytes: u64) -> f64 {
    bytes as f64 * 1e-6
}

/// Writes the content to a file of this name and reads it.
fn read(name: &str, content: &[u8], format: Option<Format>, options: &ReadOptions) -> Recording {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, content).unwrap();
    check(name, &path, content.len() as u64, format, options)
        .unwrap_or_else(|error| panic!("{name}: {error}"))
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
        ("digits.csv", &digits[..], 208, &plain),
        ("line.csv", &digits, FILE_BYTES / 2, &plain),
        ("column.csv", &digits, 1, &plain),
        ("columns.csv", &digits, 208, &columns),
        ("wide-columns.csv", &digits, 100_000, &columns),
        ("matrix.csv", &digits, 30, &matrix),
        ("complex.csv", &digits, 208, &complex),
        ("missing.csv", &["nan", "1", "inf", "2", "3"], 209, &plain),
    ] {
        let recording = read(name, &table(fields, width), Some(Format::Csv), options);
        let first = recording.real[[0, 0]];
        let wanted: f64 = fields[0].parse().unwrap();
        assert!(first == wanted || first.is_nan() == wanted.is_nan(), "{name}: {first}");
    }
}

#[test]
fn arrays_of_every_type_and_order() {
    for (kind, size) in [("|u1", 1), ("<f4", 4), ("<c8", 8)] {
        for (order, frames_are) in [
            ("False", FrameOrientation::Rows),
            ("True", FrameOrientation::Rows),
            ("False", FrameOrientation::Columns),
        ] {
            let rows = FILE_BYTES / size / 208;
            let head = format!(
                "{{'descr': '{kind}', 'fortran_order': {order}, 'shape': ({rows}, 208)}}\n"
            );
            let start = [b"\x93NUMPY\x01\x00", &(head.len() as u16).to_le_bytes()[..]].concat();
            let bytes = [start, head.into_bytes(), vec![7; rows * 208 * size]].concat();
            let options = ReadOptions { frames_are: Some(frames_are), ..ReadOptions::default() };
            let name = format!("{}-{order}.npy", &kind[1..]);
            assert_eq!(read(&name, &bytes, None, &options).real.len(), rows * 208, "{name}");
        }
    }
}

#[test]
fn logs_of_boards_and_instruments() {
    let plain = ReadOptions::default();
    let times = |block: &[u8]| block.repeat(FILE_BYTES / block.len());
    let line = |count: usize| format!("{}\n", vec!["1"; count].join(" "));
    let serial = Some(Format::SerialLog);
    read("digits.log", &times(format!("s\n{}", line(13).repeat(16)).as_bytes()), serial, &plain);
    // a good frame, then one that does not end, by lines and by values
    let good = format!("s\n{}s\n", line(13).repeat(16));
    let endless = [good.as_bytes(), &times(line(13).as_bytes())].concat();
    read("endless.log", &endless, serial, &plain);
    let long = [good.as_bytes(), line(FILE_BYTES / 2).as_bytes()].concat();
    read("long.log", &long, serial, &plain);

    let mut block = "1,0,A\n".to_owned();
    (0..16).for_each(|_| writeln!(block, "1,0,1,{}", vec!["7"; 16].join(",")).unwrap());
    let head = b"UTC:,2022\ntime_pc [s],Mass [g],time_mcu[ms],data [mV]:\n";
    read("black.csv", &[head, &times(block.as_bytes())[..]].concat(), None, &plain);
    // bytes that are no text
    let wrong = [head, block.as_bytes(), &[0xFF; FILE_BYTES][..]].concat();
    read("wrong.csv", &wrong, None, &plain);

    let voltages: Vec<u8> =
        (0..256).flat_map(|slot| (slot as f32 * 0.1 + 0.3).to_le_bytes()).collect();
    read("skin.get", &times(&voltages), None, &plain);
}

#[test]
fn instrument_formats_of_text() {
    let plain = ReadOptions::default();
    // a frame longer than any instrument's, and one that is just short enough
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.txt");
    for rows in [FILE_BYTES / 6, 1 << 18] {
        let head = format!(
            "#MEAS\n#Length,{rows}\n#Electrodes,16\n#Operating_Frequency,10 , KHz\n#Strategy,x\n"
        );
        let content = [head.as_bytes(), &b"1 3 7\n".repeat(rows)].concat();
        std::fs::write(&path, &content).unwrap();
        let found = check("long.txt", &path, content.len() as u64, None, &plain);
        assert_eq!(found.is_ok(), rows == 1 << 18, "{:?}", found.err());
    }

    // a Sciospec frame of very many short lines, one of very long lines, and one that is real
    let head = "9\nname\n2025.02.12. 13:19:58\n1000\n1000\n0\n1\n0.001\n10\n";
    let lines = "1 2\n1 2 3 4\n".repeat(FILE_BYTES / 12);
    let long = format!("1 2\n{}\n", vec!["1"; FILE_BYTES / 2].join(" "));
    let channels = vec!["1 2"; 64].join(" ");
    let real = format!("1 2\n{channels}\n").repeat(4096);
    for (name, body, is_read) in
        [("lines.eit", lines, false), ("long.eit", long, false), ("real.eit", real, true)]
    {
        let path = folder.path().join(name);
        let content = format!("{head}{body}");
        std::fs::write(&path, &content).unwrap();
        let found = check(name, &path, content.len() as u64, None, &plain);
        assert_eq!(found.is_ok(), is_read, "{name}: {:?}", found.err());
    }
}

/// Reads a recording in every way; each takes little memory or is refused with the sizes.
fn check_capture(name: &str, bytes: &[u8], is_read: bool) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    let size = bytes.len() as u64;
    let most = MOST_BYTES + 10 * size;
    let refused = |error: HwError| {
        let is_refused = matches!(error, HwError::TooLarge { .. } | HwError::Container { .. });
        assert!(is_refused, "{error}");
    };
    match check(name, &path, size, None, &ReadOptions::default()) {
        Ok(_) => {}
        Err(error) => {
            assert!(!is_read, "{name}: {error}");
            refused(error);
        }
    }
    let mut failed = None;
    let whole = measure(|| failed = capture::read(&path).map(black_box).err());
    failed.into_iter().for_each(refused);
    let streamed = measure(|| {
        let mut reader = CaptureReader::open(&path).unwrap();
        while let Some(entry) = reader.next_entry().unwrap() {
            black_box(&entry);
        }
    });
    let recovered = measure(|| {
        capture::recover(&path, &folder.path().join("new.mcap")).unwrap();
    });
    for (way, info) in [("whole", whole), ("by message", streamed), ("recovered", recovered)] {
        println!("  {way}: peak {:.1} MB", mb(info.bytes_max));
        assert!(info.bytes_max <= most, "{name}, {way}: {} of {most}", info.bytes_max);
    }
}

#[test]
fn recordings_packed_hard_and_loosely() {
    let head = channel(1, "/eit/frame");
    let json = frame_json(&zeros(208));
    let frames = [head.clone(), message(1, &json).repeat(15_000)].concat();
    let zstd = |content: &[u8]| {
        let level = ruzstd::encoding::CompressionLevel::Fastest;
        let packed = ruzstd::encoding::compress_to_vec(content, level);
        chunk(b"zstd", &packed, content.len() as u64, 0)
    };
    // the same frame again and again, three times what may be taken, in large chunks and in one chunk per frame
    check_capture("lz4.mcap", &container(&[lz4_chunk(&frames).repeat(8)]), false);
    check_capture("zstd.mcap", &container(&[zstd(&frames).repeat(8)]), false);
    let tiny = lz4_chunk(&[head.clone(), message(1, &json)].concat());
    check_capture("tiny.mcap", &container(&[tiny.repeat(40_000)]), false);
    // frames of one value, each with a time and a place in lists
    let one = [head.clone(), message(1, &frame_json("7")).repeat(100_000)].concat();
    check_capture("short.mcap", &container(&[lz4_chunk(&one).repeat(10)]), false);
    // large messages, and those of 7 MB that hold more values than any reader takes
    let reference = format!("{{\"epoch\":0,\"values\":[{}]}}", zeros(3_500_000));
    for content in [
        message(1, &frame_json(&zeros(200_000))).repeat(40),
        message(1, &frame_json(&zeros(3_500_000))).repeat(2),
        message(2, reference.as_bytes()).repeat(2),
    ] {
        let channels = [head.clone(), channel(2, "/eit/reference")].concat();
        let chunk = lz4_chunk(&[channels, content].concat());
        check_capture("large.mcap", &container(&[chunk.repeat(4)]), false);
    }
    // frames that differ in every value, yet take nothing in the file: refused
    let ramp = |start: usize| {
        let values: Vec<String> =
            (0..60_000).map(|i| (12_000 + (i + start) % 997).to_string()).collect();
        message(1, &frame_json(&values.join(",")))
    };
    let ramps: Vec<u8> = [head, (0..20).flat_map(|start| ramp(7 * start)).collect()].concat();
    check_capture("ramps.mcap", &container(&[lz4_chunk(&ramps).repeat(60)]), false);
}

/// What an instrument records: 208 values that differ in all digits.
#[test]
fn recordings_of_instruments_are_read_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("press.mcap");
    let mut writer = CaptureWriter::create(&path, &session(), CaptureSettings::default()).unwrap();
    (0..8000).for_each(|sequence| writer.frame(&frame(sequence)).unwrap());
    writer.finish().unwrap();
    check_capture("press.mcap", &std::fs::read(&path).unwrap(), true);
    let recording = read_recording(&path, None, &ReadOptions::default()).unwrap();
    assert_eq!(recording.real.row(7999).to_vec(), frame(7999).values);
}
