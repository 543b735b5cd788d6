//! Parsers never panic on arbitrary or damaged bytes, and what is written is read back. One file,
//! because all formats share the same generators.

use crate::common::arrays::{compressed, doubles, mat, npy, npz};
use crate::common::{parse, table as table_options};
use eit_hw::Format::{Csv, Goe, Lct, Mat, Npy, Npz, Sciospec, SerialLog};
use eit_hw::{
    Component, FrameOrientation, HwError, Note, Quality, ReadOptions, Recording, SerialLogOptions,
    read_recording,
};
use ndarray::Array2;
use proptest::prelude::*;
use proptest::sample::Index;

const ORIENTATIONS: [FrameOrientation; 3] =
    [FrameOrientation::Rows, FrameOrientation::Columns, FrameOrientation::Matrix];

/// Runs every parser on the same bytes: results have values and are consistent, errors are one
/// line.
fn parse_all(bytes: &[u8]) {
    let check = |result: Result<Recording, HwError>| match result {
        Ok(recording) => {
            let count = recording.value_count();
            assert!(count > 0 && recording.frame_count() > 0);
            let frames = recording.frames_for(None, count, Component::Phased);
            assert!(matches!(frames, Ok(_) | Err(HwError::NeedsQuadruples { .. })), "{frames:?}");
        }
        Err(error) => {
            let message = error.to_string();
            assert!(!message.contains(['\n', '\r']), "{message:?}");
        }
    };
    for orientation in ORIENTATIONS {
        for (complex, format) in [(false, Csv), (true, Csv), (false, Npy), (true, Npy)] {
            check(parse(format, bytes, &table_options(orientation, complex)));
        }
    }
    let plain = ReadOptions::default();
    for frequency_row in [0, 1] {
        check(parse(Sciospec, bytes, &ReadOptions { frequency_row, ..plain.clone() }));
    }
    for format in [Goe, Mat, Npz] {
        check(parse(format, bytes, &plain));
    }
    check(parse(Lct, bytes, &plain));
    for (lines_per_frame, values_per_line) in [(16, 13), (2, 2), (1, 1), (0, 3), (3, 0)] {
        check(parse(SerialLog, bytes, &log_options(lines_per_frame, values_per_line, Some(1.0))));
    }
}

fn log_options(
    lines_per_frame: usize,
    values_per_line: usize,
    full_scale: Option<f64>,
) -> ReadOptions {
    let serial_log = SerialLogOptions { lines_per_frame, values_per_line, full_scale };
    ReadOptions { serial_log, ..ReadOptions::default() }
}

const EIT: &[u8] = b"12\n2\nt_1\n2020.07.08. 14:20:28.750\n1\n10\n1\n2\n0.01\n30.0\n0.0\n\
    MeasurementChannels: 1,2\n1 2\n0.5\t-0.25\t-0.5\t0.25\n1 2 3 4\n2 1\n1 2 3 4\n5 6 7 8\n";

const LCT: &[u8] = b"#MEAS  \n#Length, 4\n#Electrodes, 4 \n#Strategy, Adjacent , P\n\
    #Operating_Frequency 10 , KHz\n#Start\n1 2 3\n4 5 6\n7 8 9\n1 2 3\n1 2 3\n";

const NPY: &[u8] =
    b"\x93NUMPY\x01\x00\x3D\x00{'descr': '<i2', 'fortran_order': True, 'shape': (2, 3), }   \
      \x01\x00\x02\x00\x03\x00\x04\x00\x05\x00\x06\x00";

/// Returns a file of each format.
fn samples() -> [(eit_hw::Format, Vec<u8>); 8] {
    let floats = (0..512).flat_map(|index: u16| f32::from(index).to_le_bytes()).collect();
    let mut log = b"ref:\n1 2\n3 4\ndata:\ns\n1 2\n3 4\ns\n5 6\n7 8\n".to_vec();
    log.extend(b"s\n".iter().chain("1 ".repeat(13).as_bytes()).chain(b"\n"));
    let csv = b"a;b;c\n1;2;3\n# c\n4;5e-3;-6;\n".to_vec();
    let fixed = [(Npy, NPY), (Sciospec, EIT), (Lct, LCT)].map(|(f, bytes)| (f, bytes.to_vec()));
    let [npy, eit, lct] = fixed;
    let arrays = mat(&[doubles("t", &[1, 1]), compressed(&doubles("v", &[2, 3]))]);
    let archive =
        npz(&[("t.npy", &self::npy("(1,)", 1)), ("v.npy", &self::npy("(2, 3)", 6))], true);
    [(Csv, csv), npy, eit, lct, (Goe, floats), (SerialLog, log), (Mat, arrays), (Npz, archive)]
}

/// Generates characters that occur in text formats.
fn texty() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop::sample::select(b"0123456789.,;-+eE# \t\r\nsnaif:()'{}".to_vec());
    prop::collection::vec(byte, 0..400)
}

#[test]
fn samples_are_read() {
    let log = log_options(2, 2, None);
    let eit = ReadOptions { frequency_row: 1, ..ReadOptions::default() };
    let plain = ReadOptions::default();
    let wanted = [(2, 3), (2, 3), (1, 4), (1, 4), (2, 208), (3, 4), (2, 3), (2, 3)];
    let options = [&plain, &plain, &eit, &plain, &plain, &log, &plain, &plain];
    for (((format, bytes), options), wanted) in samples().into_iter().zip(options).zip(wanted) {
        let read = parse(format, bytes, options).unwrap();
        assert_eq!(read.real.dim(), wanted, "{format}");
        assert!(format != Sciospec || read.real.row(0).to_vec() == [1.0, 3.0, 5.0, 7.0]);
    }
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    #[test]
    fn arbitrary_bytes_do_no_harm(bytes in prop::collection::vec(any::<u8>(), 0..3000)) {
        parse_all(&bytes);
    }

    #[test]
    fn arbitrary_text_does_no_harm(text in texty()) {
        parse_all(&text);
    }

    #[test]
    fn arbitrary_npy_headers_do_no_harm(
        version in 0..5_u8,
        length in any::<u16>(),
        shape in "[(][0-9, ]{0,24}[)]",
        descr in "[<>|=]?[fiuc][1248]{1,2}",
        rest in prop::collection::vec(any::<u8>(), 0..64),
        honest in any::<bool>(),
    ) {
        let header = format!("{{'descr': '{descr}', 'fortran_order': True, 'shape': {shape}}}");
        let length = if honest { u16::try_from(header.len()).unwrap() } else { length };
        let mut bytes = b"\x93NUMPY".to_vec();
        bytes.extend([version, 0]);
        bytes.extend(length.to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(rest);
        parse_all(&bytes);
    }

    #[test]
    fn damaged_files_do_no_harm(
        sample in any::<Index>(),
        edits in prop::collection::vec((any::<Index>(), any::<u8>(), 0..3_u8), 1..6),
    ) {
        let (_, mut bytes) = samples()[sample.index(8)].clone();
        for (at, byte, kind) in edits {
            if bytes.is_empty() {
                break;
            }
            let at = at.index(bytes.len());
            match kind {
                0 => bytes[at] = byte,
                1 => bytes.truncate(at),
                _ => bytes.insert(at, byte),
            }
        }
        parse_all(&bytes);
    }

    #[test]
    fn csv_is_read_back(
        table in table(1..6, 1..6),
        separator in prop::sample::select(vec![",", ";", "\t", " ", ", "]),
        end in prop::sample::select(vec!["\n", "\r\n", "\r"]),
        orientation in prop::sample::select(ORIENTATIONS.to_vec()),
    ) {
        let text = joined(&table, separator, end);
        let recording = parse(Csv, text, &table_options(orientation, false)).unwrap();
        prop_assert_eq!(recording.real, frames_of(&table, orientation));
        prop_assert_eq!(recording.frames_are, Some(orientation));
    }

    #[test]
    fn complex_tables_are_read_back(
        table in table(2..5, 2..6),
        orientation in prop::sample::select(ORIENTATIONS.to_vec()),
    ) {
        // the rows or columns of `table` are real parts: insert the imaginary part after each
        let axis = ndarray::Axis(usize::from(orientation != FrameOrientation::Rows));
        let doubled = ndarray::concatenate(axis, &[table.view(), (-&table).view()]).unwrap();
        let count = table.len_of(axis);
        let order: Vec<_> = (0..count).flat_map(|index| [index, index + count]).collect();
        let written = doubled.select(axis, &order);
        let text = joined(&written, ",", "\n");
        let options = table_options(orientation, true);
        let csv = parse(Csv, text, &options).unwrap();
        let npy = parse(Npy, npy_bytes(&written, false, false), &options).unwrap();
        for recording in [csv, npy] {
            let wanted = frames_of(&table, orientation);
            prop_assert_eq!(recording.imaginary, Some(-&wanted));
            prop_assert_eq!(recording.real, wanted);
        }
    }

    #[test]
    fn npy_is_read_back(
        table in table(2..6, 2..6),
        fortran in any::<bool>(),
        big in any::<bool>(),
        orientation in prop::sample::select(ORIENTATIONS.to_vec()),
    ) {
        let bytes = npy_bytes(&table, fortran, big);
        let recording = parse(Npy, bytes, &table_options(orientation, false)).unwrap();
        prop_assert_eq!(recording.real, frames_of(&table, orientation));
        prop_assert_eq!(recording.frames_are, Some(orientation));
    }

    #[test]
    fn both_tables_flag_the_same_missing_value(
        table in table(2..6, 2..6),
        at in any::<Index>(),
        complex in any::<bool>(),
        orientation in prop::sample::select(ORIENTATIONS.to_vec()),
    ) {
        let (rows, columns) = (2 * table.nrows(), 2 * table.ncols());
        let mut table = ndarray::concatenate![ndarray::Axis(0), table, table];
        table = ndarray::concatenate![ndarray::Axis(1), table, table];
        let at = at.index(rows * columns);
        table[[at / columns, at % columns]] = f64::NAN;
        let text = joined(&table, ",", "\n");
        let options = table_options(orientation, complex);
        let csv = parse(Csv, text, &options);
        let npy = parse(Npy, npy_bytes(&table, false, false), &options);
        // where the value would be if it were a number
        table.mapv_inplace(|value| f64::from(u8::from(value.is_nan())));
        let recording = parse(Csv, joined(&table, ",", "\n"), &options).unwrap();
        let place_in = |part: &Array2<f64>| {
            part.indexed_iter().find(|(_, value)| **value == 1.0).map(|(place, _)| place)
        };
        let wanted =
            place_in(&recording.real).or_else(|| place_in(recording.imaginary.as_ref()?)).unwrap();
        for read in [csv.unwrap(), npy.unwrap()] {
            let quality = read.quality.unwrap();
            let bad: Vec<_> =
                quality.indexed_iter().filter(|(_, quality)| !quality.is_good()).collect();
            prop_assert_eq!(bad, vec![(wanted, &Quality::NON_FINITE)]);
            let (frame, value) = wanted;
            let note = Note::MissingValues { values: 1, frame, value };
            prop_assert!(read.notes.contains(&note), "{:?}", read.notes);
        }
    }

    #[test]
    fn sciospec_is_read_back(table in table(1..5, 4..5), frequency_row in 0..2_usize) {
        // each row: two frequencies of one drive, [re, im, re, im] of two channels
        let mut text =
            "9\nt\n2020.07.08. 14:20:28\n10\n20\n0\n2\n0.01\n30\n".to_owned();
        for row in table.rows() {
            let line = |sign: f64| {
                row.iter().map(|value| (sign * value).to_string()).collect::<Vec<_>>().join("\t")
            };
            text += &format!("1 2\n{}\n{}\n", line(1.0), line(-1.0));
        }
        let options = ReadOptions { frequency_row, ..ReadOptions::default() };
        let recording = parse(Sciospec, text, &options).unwrap();
        let sign = if frequency_row == 0 { 1.0 } else { -1.0 };
        let part = |first: usize| -> Vec<f64> {
            let rows = table.rows().into_iter();
            rows.flat_map(|row| [sign * row[first], sign * row[first + 2]]).collect()
        };
        prop_assert_eq!(recording.real.iter().copied().collect::<Vec<_>>(), part(0));
        prop_assert_eq!(recording.imaginary.unwrap().iter().copied().collect::<Vec<_>>(), part(1));
    }

    #[test]
    fn lct_is_read_back(table in table(4..5, 2..3), current in 0.5..2.0_f64) {
        let mut text = "#MEAS\n#Length, 4\n#Electrodes, 4\n".to_owned();
        text += "#Operating_Frequency 1 , Hz\n";
        for row in table.rows() {
            text += &format!("{} {} {current}\n", row[0], row[1]);
        }
        let recording = parse(Lct, text, &ReadOptions::default()).unwrap();
        prop_assert_eq!(recording.real.row(0).to_owned(), table.column(0).mapv(|v| v / current));
        prop_assert_eq!(
            recording.imaginary.unwrap().row(0).to_owned(),
            table.column(1).mapv(|v| v / current)
        );
    }

    #[test]
    fn serial_log_without_some_lines_keeps_only_whole_frames(
        frames in 1..6_usize,
        start in any::<Index>(),
        length in 1..17_usize,
    ) {
        // frame f, line d, value k is 100 f + d + k / 100: no two lines are equal
        let value = |f: usize, d: usize, k: usize| 100.0 * f as f64 + d as f64 + k as f64 / 100.0;
        let mut lines = Vec::new();
        for frame in 0..frames {
            lines.push("s".to_owned());
            lines.extend((0..16).map(|d| {
                (0..13).map(|k| format!("{:.2} ", value(frame, d, k))).collect::<String>()
            }));
        }
        // fewer lines than a frame with its `s`: more could join two halves
        let start = start.index(lines.len());
        lines.drain(start..(start + length).min(17 * frames));
        let text = lines.join("\n") + "\n";
        match parse(SerialLog, text, &log_options(16, 13, None)) {
            Ok(recording) => {
                // without its `s` a frame continues the one before
                let first = start.saturating_sub(1) / 17;
                let touched = (start + length).min(17 * frames).div_ceil(17) - first;
                prop_assert_eq!(recording.frame_count(), frames - touched);
                for row in recording.real.rows() {
                    let frame = (row[0] / 100.0).floor() as usize;
                    for (slot, &found) in row.iter().enumerate() {
                        // text of two decimals compared with their sum in f64
                        prop_assert!((found - value(frame, slot / 13, slot % 13)).abs() < 1e-9);
                    }
                }
            }
            // every frame lost a line
            Err(error) => prop_assert!(matches!(error, HwError::NoFrames { .. }), "{error}"),
        }
    }
}

/// Returns the frames of a table, [frame, measurement].
fn frames_of(table: &Array2<f64>, orientation: FrameOrientation) -> Array2<f64> {
    let columns = table.t().as_standard_layout().into_owned();
    match orientation {
        FrameOrientation::Rows => table.clone(),
        FrameOrientation::Columns => columns,
        FrameOrientation::Matrix => columns.into_shape_with_order((1, table.len())).unwrap(),
    }
}

/// Returns an NPY file of version 3.
fn npy_bytes(table: &Array2<f64>, fortran: bool, big: bool) -> Vec<u8> {
    let data: Vec<u8> = if fortran { table.t().to_owned() } else { table.clone() }
        .as_standard_layout()
        .iter()
        .flat_map(|value| if big { value.to_be_bytes() } else { value.to_le_bytes() })
        .collect();
    let (rows, columns) = table.dim();
    let header = format!(
        "{{'descr': '{}f8', 'fortran_order': {}, 'shape': ({rows}, {columns}), }}",
        if big { '>' } else { '<' },
        if fortran { "True" } else { "False" },
    );
    let mut bytes = b"\x93NUMPY\x03\x00".to_vec();
    bytes.extend(u32::try_from(header.len()).unwrap().to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

/// Generates finite numbers of any size, [row, column].
fn table(
    rows: std::ops::Range<usize>,
    columns: std::ops::Range<usize>,
) -> impl Strategy<Value = Array2<f64>> {
    let number = prop::num::f64::NORMAL | prop::num::f64::ZERO | prop::num::f64::SUBNORMAL;
    // half of the largest, so that no quotient in a test overflows
    let number = number.prop_map(|value| value / 4.0);
    (rows, columns).prop_flat_map(move |(rows, columns)| {
        prop::collection::vec(number.clone(), rows * columns)
            .prop_map(move |values| Array2::from_shape_vec((rows, columns), values).unwrap())
    })
}

fn joined(table: &Array2<f64>, separator: &str, end: &str) -> String {
    let row = |row: ndarray::ArrayView1<f64>| {
        row.iter().map(f64::to_string).collect::<Vec<_>>().join(separator) + end
    };
    table.rows().into_iter().map(row).collect()
}

#[test]
fn any_bytes_in_a_file_of_any_name_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    for (_, bytes) in samples() {
        for ending in ["csv", "npy", "mat", "npz", "eit", "get", "txt", "log", "bin", ""] {
            let path = folder.path().join(format!("frame_1.{ending}"));
            std::fs::write(&path, &bytes).unwrap();
            if let Err(error) = read_recording(&path, None, &eit_hw::ReadOptions::default()) {
                assert!(!error.to_string().contains('\n'));
            }
        }
    }
}
