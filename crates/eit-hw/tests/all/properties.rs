//! Parsers never panic on arbitrary or damaged bytes, and what is written is read back.

use crate::common::arrays::{compressed, doubles, mat, npy, npy_bytes, npy_of, npz};
use crate::common::{parse, table as table_options};
use eit_hw::Format::{Csv, Goe, Lct, Mat, Npy, Npz, Sciospec, SerialLog};
use eit_hw::{
    Component, FrameOrientation, HwError, Note, Quality, ReadOptions, SerialLogOptions,
    read_recording,
};
use ndarray::Array2;
use proptest::prelude::*;
use proptest::sample::Index;
use std::ops::Range;

const ORIENTATIONS: [FrameOrientation; 3] =
    [FrameOrientation::Rows, FrameOrientation::Columns, FrameOrientation::Matrix];

/// Runs every parser on the same bytes: results are consistent, errors are one line.
fn parse_all(bytes: &[u8]) {
    let check = |format, options: &ReadOptions| match parse(format, bytes, options) {
        Ok(recording) => {
            let count = recording.value_count();
            assert!(count > 0 && recording.frame_count() > 0);
            let frames = recording.frames_for(None, count, Component::Phased);
            assert!(matches!(frames, Ok(_) | Err(HwError::NeedsQuadruples { .. })), "{frames:?}");
        }
        Err(error) => assert!(!error.to_string().contains(['\n', '\r']), "{error}"),
    };
    for orientation in ORIENTATIONS {
        for (complex, format) in [(false, Csv), (true, Csv), (false, Npy), (true, Npy)] {
            check(format, &table_options(orientation, complex));
        }
    }
    for format in [Sciospec, Goe, Mat, Npz, Lct] {
        check(format, &ReadOptions::default());
    }
    check(Sciospec, &ReadOptions { frequency_row: 1, ..ReadOptions::default() });
    for (lines_per_frame, values_per_line) in [(16, 13), (2, 2), (1, 1), (0, 3), (3, 0)] {
        check(SerialLog, &log_of(lines_per_frame, values_per_line, Some(1.0)));
    }
}

fn log_of(lines_per_frame: usize, values_per_line: usize, full_scale: Option<f64>) -> ReadOptions {
    let serial_log = SerialLogOptions { lines_per_frame, values_per_line, full_scale };
    ReadOptions { serial_log, ..ReadOptions::default() }
}

const EIT: &[u8] = b"12\n2\nt_1\n2020.07.08. 14:20:28.750\n1\n10\n1\n2\n0.01\n30.0\n0.0\n\
    MeasurementChannels: 1,2\n1 2\n0.5\t-0.25\t-0.5\t0.25\n1 2 3 4\n2 1\n1 2 3 4\n5 6 7 8\n";

const LCT: &[u8] = b"#MEAS  \n#Length, 4\n#Electrodes, 4 \n#Strategy, Adjacent , P\n\
    #Operating_Frequency 10 , KHz\n#Start\n1 2 3\n4 5 6\n7 8 9\n1 2 3\n1 2 3\n";

/// A file, the options that read it, and its frames and values per frame.
type Sample = (eit_hw::Format, Vec<u8>, ReadOptions, (usize, usize));

fn samples() -> [Sample; 8] {
    let floats = (0..512).flat_map(|index: u16| f32::from(index).to_le_bytes()).collect();
    let mut log = b"ref:\n1 2\n3 4\ndata:\ns\n1 2\n3 4\ns\n5 6\n7 8\n".to_vec();
    log.extend(b"s\n".iter().chain("1 ".repeat(13).as_bytes()).chain(b"\n"));
    let header = "{'descr': '<i2', 'fortran_order': True, 'shape': (2, 3), }   ";
    let table = npy_bytes(header, b"\x01\0\x02\0\x03\0\x04\0\x05\0\x06\0");
    let arrays = mat(&[doubles("t", &[1, 1]), compressed(&doubles("v", &[2, 3]))]);
    let archive = npz(&[("t.npy", &npy("(1,)", 1)), ("v.npy", &npy("(2, 3)", 6))], true);
    let plain = ReadOptions::default;
    [
        (Csv, b"a;b;c\n1;2;3\n# c\n4;5e-3;-6;\n".to_vec(), plain(), (2, 3)),
        (Npy, table, plain(), (2, 3)),
        (Sciospec, EIT.to_vec(), ReadOptions { frequency_row: 1, ..plain() }, (1, 4)),
        (Lct, LCT.to_vec(), plain(), (1, 4)),
        (Goe, floats, plain(), (2, 208)),
        (SerialLog, log, log_of(2, 2, None), (3, 4)),
        (Mat, arrays, plain(), (2, 3)),
        (Npz, archive, plain(), (2, 3)),
    ]
}

#[test]
fn samples_are_read_and_do_no_harm_under_any_name() {
    let folder = tempfile::tempdir().unwrap();
    for (format, bytes, options, wanted) in samples() {
        let read = parse(format, &bytes, &options).unwrap();
        assert_eq!(read.real.dim(), wanted, "{format}");
        assert!(format != Sciospec || read.real.row(0).to_vec() == [1.0, 3.0, 5.0, 7.0]);
        for ending in ["csv", "npy", "mat", "npz", "eit", "get", "txt", "log", "bin", ""] {
            let path = folder.path().join(format!("frame_1.{ending}"));
            std::fs::write(&path, &bytes).unwrap();
            if let Err(error) = read_recording(&path, None, &ReadOptions::default()) {
                assert!(!error.to_string().contains('\n'));
            }
        }
    }
}

/// Bytes, text of characters of text formats, NPY files with headers of any kind, damaged files.
fn hostile() -> impl Strategy<Value = Vec<u8>> {
    let byte = prop::sample::select(b"0123456789.,;-+eE# \t\r\nsnaif:()'{}".to_vec());
    let text = prop::collection::vec(byte, 0..400);
    let shape = ("[(][0-9, ]{0,24}[)]", "[<>|=]?[fiuc][1248]{1,2}");
    let rest = (0..5_u8, any::<Option<u16>>(), prop::collection::vec(any::<u8>(), 0..64));
    let headers = (shape, rest).prop_map(|((shape, descr), (version, length, rest))| {
        let mut bytes = npy_of(&descr, &shape, &rest);
        bytes[6] = version;
        if let Some(length) = length {
            bytes[8..10].copy_from_slice(&length.to_le_bytes());
        }
        bytes
    });
    let files = samples().map(|(_, bytes, ..)| bytes).to_vec();
    let edits = prop::collection::vec((any::<Index>(), any::<u8>(), 0..3_u8), 1..6);
    let damaged = (prop::sample::select(files), edits).prop_map(|(mut bytes, edits)| {
        for (at, byte, kind) in edits {
            let at = at.index(bytes.len() + 1);
            match kind {
                0 => bytes[at..].iter_mut().take(1).for_each(|old| *old = byte),
                1 => bytes.truncate(at),
                _ => bytes.insert(at, byte),
            }
        }
        bytes
    });
    prop_oneof![prop::collection::vec(any::<u8>(), 0..3000), text, headers, damaged]
}

proptest! {
    #![proptest_config(fixtures::cases(1024))]

    #[test]
    fn hostile_bytes_do_no_harm(bytes in hostile()) {
        parse_all(&bytes);
    }
}

proptest! {
    #![proptest_config(fixtures::cases(256))]

    #[test]
    fn tables_are_read_back(
        table in table(1..6, 1..6),
        separator in prop::sample::select(vec![",", ";", "\t", " ", ", "]),
        end in prop::sample::select(vec!["\n", "\r\n", "\r"]),
        fortran in any::<bool>(),
        big in any::<bool>(),
        orientation in prop::sample::select(ORIENTATIONS.to_vec()),
    ) {
        let options = table_options(orientation, false);
        let csv = parse(Csv, joined(&table, separator, end), &options).unwrap();
        prop_assert_eq!(&csv.real, &frames_of(&table, orientation));
        prop_assert_eq!(csv.frames_are, Some(orientation));
        let npy = parse(Npy, npy_table(&table, fortran, big), &options).unwrap();
        // a vector is one frame
        if table.nrows() > 1 && table.ncols() > 1 {
            prop_assert_eq!((npy.real, npy.frames_are), (csv.real, csv.frames_are));
        }
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
        let options = table_options(orientation, true);
        let csv = parse(Csv, joined(&written, ",", "\n"), &options).unwrap();
        let npy = parse(Npy, npy_table(&written, false, false), &options).unwrap();
        for recording in [csv, npy] {
            let wanted = frames_of(&table, orientation);
            prop_assert_eq!(recording.imaginary, Some(-&wanted));
            prop_assert_eq!(recording.real, wanted);
        }
    }

    #[test]
    fn both_tables_flag_the_same_missing_value(
        table in table(2..6, 2..6),
        at in any::<Index>(),
        complex in any::<bool>(),
        orientation in prop::sample::select(ORIENTATIONS.to_vec()),
    ) {
        let mut table = ndarray::concatenate![ndarray::Axis(0), table, table];
        table = ndarray::concatenate![ndarray::Axis(1), table, table];
        let at = at.index(table.len());
        *table.iter_mut().nth(at).unwrap() = f64::NAN;
        let options = table_options(orientation, complex);
        let csv = parse(Csv, joined(&table, ",", "\n"), &options);
        let npy = parse(Npy, npy_table(&table, false, false), &options);
        // where the value would be if it were a number
        table.mapv_inplace(|value| f64::from(u8::from(value.is_nan())));
        let found = parse(Csv, joined(&table, ",", "\n"), &options).unwrap();
        let parts = [Some(&found.real), found.imaginary.as_ref()].into_iter().flatten();
        let mut values = parts.flat_map(|part| part.indexed_iter());
        let wanted = values.find(|(_, value)| **value == 1.0).unwrap().0;
        for read in [csv.unwrap(), npy.unwrap()] {
            let quality = read.quality.unwrap();
            let bad: Vec<_> = quality.indexed_iter().filter(|(_, q)| !q.is_good()).collect();
            prop_assert_eq!(bad, vec![(wanted, &Quality::NON_FINITE)]);
            let (frame, value) = wanted;
            let note = Note::MissingValues { values: 1, frame, value };
            prop_assert!(read.notes.contains(&note), "{:?}", read.notes);
        }
    }

    #[test]
    fn serial_log_without_some_lines_keeps_only_whole_frames(
        frames in 1..6_usize,
        start in any::<Index>(),
        length in 1..17_usize,
    ) {
        // frame f, line d, value k is 100 f + d + k / 100: no two lines are equal
        let value = |f: usize, d: usize, k: usize| 100.0 * f as f64 + d as f64 + k as f64 / 100.0;
        let line = |f, d| (0..13).map(|k| format!("{:.2} ", value(f, d, k))).collect::<String>();
        let frame = |f| std::iter::once("s".to_owned()).chain((0..16).map(move |d| line(f, d)));
        let mut lines: Vec<String> = (0..frames).flat_map(frame).collect();
        // fewer lines than a frame with its `s`: more could join two halves
        let start = start.index(lines.len());
        let end = (start + length).min(lines.len());
        lines.drain(start..end);
        match parse(SerialLog, lines.join("\n") + "\n", &log_of(16, 13, None)) {
            Ok(recording) => {
                // without its `s` a frame continues the one before
                let touched = end.div_ceil(17) - start.saturating_sub(1) / 17;
                prop_assert_eq!(recording.frame_count(), frames - touched);
                for row in recording.real.rows() {
                    let frame = (row[0] / 100.0).floor() as usize;
                    // text of two decimals compared with their sum in f64
                    let is_right = |(slot, &found): (usize, &f64)| {
                        (found - value(frame, slot / 13, slot % 13)).abs() < 1e-9
                    };
                    prop_assert!(row.iter().enumerate().all(is_right), "{}", row);
                }
            }
            // every frame lost a line
            Err(error) => prop_assert!(matches!(error, HwError::NoFrames { .. }), "{error}"),
        }
    }
}

/// [frame, measurement]
fn frames_of(table: &Array2<f64>, orientation: FrameOrientation) -> Array2<f64> {
    let columns = table.t().as_standard_layout().into_owned();
    match orientation {
        FrameOrientation::Rows => table.clone(),
        FrameOrientation::Columns => columns,
        FrameOrientation::Matrix => columns.into_shape_with_order((1, table.len())).unwrap(),
    }
}

/// Returns an NPY file of version 3.
fn npy_table(table: &Array2<f64>, fortran: bool, big: bool) -> Vec<u8> {
    let order = if fortran { table.t() } else { table.view() };
    let bytes = |value: &f64| if big { value.to_be_bytes() } else { value.to_le_bytes() };
    let (sign, order_name) = (if big { '>' } else { '<' }, if fortran { "True" } else { "False" });
    let shape = table.dim();
    let header =
        format!("{{'descr': '{sign}f8', 'fortran_order': {order_name}, 'shape': {shape:?}, }}");
    let length = u32::try_from(header.len()).unwrap().to_le_bytes();
    let data: Vec<u8> = order.iter().flat_map(bytes).collect();
    [b"\x93NUMPY\x03\x00", &length[..], header.as_bytes(), &data].concat()
}

/// Generates finite numbers of any size, [row, column].
fn table(rows: Range<usize>, columns: Range<usize>) -> impl Strategy<Value = Array2<f64>> {
    let number = prop::num::f64::NORMAL | prop::num::f64::ZERO | prop::num::f64::SUBNORMAL;
    (rows, columns).prop_flat_map(move |shape| {
        // a quarter, so that no quotient in a test overflows
        prop::collection::vec(number, shape.0 * shape.1)
            .prop_map(move |values| Array2::from_shape_vec(shape, values).unwrap() / 4.0)
    })
}

fn joined(table: &Array2<f64>, separator: &str, end: &str) -> String {
    let row = |row: ndarray::ArrayView1<f64>| {
        row.iter().map(f64::to_string).collect::<Vec<_>>().join(separator) + end
    };
    table.rows().into_iter().map(row).collect()
}
