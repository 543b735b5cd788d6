//! Files with one error each: the message says on one line where and what it is, and how to fix it.

use std::fs;

use crate::common::arrays::{npy_bytes, npy_of};
use crate::common::{Parsed, csv, parse, refused, rotated, table};
use eit_hw::{
    Component, Format, FrameOrientation, Layout, Note, Quality, ReadOptions, Recording,
    SerialLogOptions, parse_recording, read_recording,
};
use ndarray::array;

#[test]
fn csv_layouts_that_are_read() {
    let wanted = array![[1.0, -2.5, 3e-6], [4.0, 5.0, 6.0]];
    for text in [
        "  1   -2.5 3e-6\n\n4 5\t6  \n",
        "\u{FEFF}a, b, c\n1, -2.5, 3e-6,\n# comment\n4, 5, 6, # more\n",
    ] {
        assert_eq!(csv(text).unwrap().real, wanted, "{text:?}");
    }
    assert_eq!(csv("1\n2").unwrap().notes, [Note::NoLineEnd { line: 2 }]);
    assert_eq!(csv("\nfirst,second\n1,2\n").unwrap().notes, [Note::HeaderLine { line: 2 }]);
    // column numbers, as tables without names of their own have; not in a table of four columns, such as of quadruples
    let numbered = csv("0,1,2,3,4,5,6,7\n9,8,7,6,5,4,3,2\n").unwrap();
    assert_eq!(numbered.notes, [Note::HeaderLine { line: 1 }]);
    assert_eq!(numbered.real.nrows(), 1);
    for rows in ["0,1,2,3\n1,2,3,4\n", "0,1,2,3,4,5,6,8\n9,8,7,6,5,4,3,2\n"] {
        assert_eq!(csv(rows).unwrap().real.nrows(), 2, "{rows}");
    }
    for text in ["1,0;-2,5;3e-6\n4;5;6\n", "1,0 -2,5 3e-6\n4 5 6\n", "[1, -2.5, 3e-6]\n[4, 5, 6]\n"]
    {
        let read = csv(text).unwrap();
        assert_eq!(read.real, wanted, "{text:?}");
        assert!(matches!(&read.notes[..], [Note::Stripped { .. }]), "{:?}", read.notes);
    }
    // a column of frame numbers beside the measurements; not one of values that grow otherwise
    let of = |first: fn(i32) -> i32, count| {
        let row = |k| format!("{},9,8,7,6,5,4,3\n", first(k));
        let read = csv((0..5).map(row).collect::<String>()).unwrap();
        read.arranged_for(&Layout::ProtocolOrder, None, count)
    };
    let counted = of(|k| 7 + 3 * k, 7);
    assert_eq!((counted.value_count(), &counted.notes[..]), (7, &[Note::Counter][..]));
    assert_eq!((of(|k| 7 + 3 * k, 8).value_count(), of(|k| k * k, 7).value_count()), (8, 8));
}

#[test]
fn csv_faults() {
    let long = format!("1,{}\n", "y".repeat(500));
    for (text, parts) in [
        (&b""[..], &["f.csv", "empty (0 bytes)", "again"][..]),
        (b"# only a comment\n\n", &["f.csv", "no complete frame"]),
        (b"a,b\n", &["no complete frame"]),
        (b"1,2\n3,4,5\n", &["f.csv, line 2", "3 values", "expected 2", "complete"]),
        (b"1,2\n3\n", &["line 2", "1 values", "expected 2"]),
        (b"1,2\n3,x4\n", &["line 2", "value 2", "\"x4\"", "1234.5e-6"]),
        (b"a,b\nc,d\n", &["line 2", "value 1", "\"c\""]),
        (b"1,,2\n", &["line 1", "value 2", "\"\""]),
        (long.as_bytes(), &["yyy..."]),
        (b"1,2\n\x00\x01", &["f.csv, byte 4", "0x00", "not text"]),
        (b"1,2\xE9\n", &["byte 3", "0xE9"]),
    ] {
        refused(csv(text), parts);
    }
    let columns = table(FrameOrientation::Columns, true);
    refused(parse(Format::Csv, "1,2,3\n", &columns), &["3 columns", "complex = false"]);
    let named = parse_recording(b"1,z\n", "a\nb.csv", Format::Csv, &ReadOptions::default());
    refused(named, &["a?b.csv"]);
}

/// Files of other programs are named, with a way to convert them.
#[test]
fn foreign_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (bytes, what) in [
        (&b"MATLAB 7.3 MAT-file, Platform: GLNXA64"[..], "version 7.3: load it in MATLAB"),
        (b"\x89HDF\r\n\x1a\n\0\0", "an HDF5 file: write the matrix"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1", "an old Excel file: save the sheet as CSV"),
    ] {
        let path = folder.path().join("f.dat");
        fs::write(&path, bytes).unwrap();
        refused(read_recording(&path, None, &ReadOptions::default()), &["f.dat", what]);
    }
}

fn npy(bytes: impl AsRef<[u8]>) -> Parsed {
    parse(Format::Npy, bytes, &ReadOptions::default())
}

fn npy_with(descr: &str, shape: &str, data: &[u8]) -> Parsed {
    npy(npy_of(descr, shape, data))
}

/// A comma is a separator; where all of them may be decimal ones, a note or the error says so.
#[test]
fn decimal_commas_that_read_as_two_numbers_are_named() {
    let error_of = |recording: &Recording, count| {
        recording.frames_for(None, count, Component::Real).unwrap_err().to_string()
    };
    for (text, is_noted, is_in_error) in [
        ("1,5\n0,25\n-3,0\n", true, true),
        ("volt\n0,5\n2,5\n", true, true),
        ("1,5 # a comment\n+2,07\n", true, true),
        // a table of whole numbers is as likely
        ("1,5\n", true, false),
        ("1,5\n2,3\n", true, false),
        ("0,5,2,5\n", false, true),
        ("1,05,-2,5\n3,0,4,25\n", false, true),
        // two numbers: a sign, a point, an exponent or a space after the comma, names of two columns
        ("0,-5\n", false, false),
        ("0,5\n2,-5\n", false, false),
        ("0.1,5\n", false, false),
        ("0,5\n1,5.0\n", false, false),
        ("0, 5\n", false, false),
        ("0,2e3\n", false, false),
        ("a,b\n0,5\n", false, false),
    ] {
        let recording = csv(text).unwrap();
        let error = error_of(&recording, recording.value_count() / 2);
        let is_told = error.contains("the commas seem to be decimal ones, as in 1,5");
        let found = (recording.notes.contains(&Note::DecimalComma), is_told);
        assert_eq!(found, (is_noted, is_in_error), "{text:?}");
    }
    let note = csv("1,5\n").unwrap().notes[0].to_string();
    assert!(note.contains("write 1.5"), "{note}");
    // as many frames as measurements, in columns: not taken for swapped rows
    let error = error_of(&csv("0,5\n".repeat(208)).unwrap(), 208);
    assert!(error.contains("decimal ones") && !error.contains("swapped"), "{error}");
}

#[test]
fn npy_types_that_are_read() {
    let wanted = array![[1.0, 2.0]];
    let floats = [1_f32, 2.0].map(f32::to_le_bytes).concat();
    for (descr, data) in [
        ("<f4", floats.clone()),
        (">f4", [1_f32, 2.0].map(f32::to_be_bytes).concat()),
        ("|i1", vec![1, 2]),
        ("|u1", vec![1, 2]),
        ("<u2", vec![1, 0, 2, 0]),
        (">i2", vec![0, 1, 0, 2]),
        ("<i4", vec![1, 0, 0, 0, 2, 0, 0, 0]),
        ("<i8", vec![1, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0]),
    ] {
        for shape in ["(2,)", "(1, 2)", "(2, 1)"] {
            assert_eq!(npy_with(descr, shape, &data).unwrap().real, wanted, "{descr} {shape}");
        }
    }
    let complex = npy_with("<c8", "(1, 1)", &floats).unwrap();
    assert_eq!((complex.real[[0, 0]], complex.imaginary.unwrap()[[0, 0]]), (1.0, 2.0));
    let signed = npy_with("<i2", "(2,)", &[0xFF, 0xFF, 0, 0x80]).unwrap();
    assert_eq!(signed.real, array![[-1.0, -32768.0]]);
    let quoted = "{'descr': \"|u1\", 'fortran_order': False, 'shape': (1, 2), }";
    assert_eq!(npy(npy_bytes(quoted, &[1, 2])).unwrap().real, wanted);
}

#[test]
fn npy_faults() {
    let order = npy_bytes("{'descr': '<f8', 'fortran_order': 1, 'shape': (1,), }", &[0; 8]);
    for (bytes, parts) in [
        (&b""[..], &["f.npy", "empty"][..]),
        (b"1,2,3\n", &["its start", "1,2,3", "numpy.save"]),
        (b"\x93NUMPY\x09\x00aaaaaaa", &["version", "1, 2 or 3"]),
        (b"\x93NUMPY\x01\x00\x76\x00{'descr'", &["8 bytes of header", "expected 118"]),
        (b"\x93NUMPY\x02\x00\xFF\xFF\xFF\xFF{", &["bytes of header", "4294967295"]),
        (&npy_bytes("{}", &[]), &["type is \"\""]),
        (&order, &["fortran_order", "True or False"]),
    ] {
        refused(npy(bytes), parts);
    }
    for (descr, shape, bytes, parts) in [
        ("|O", "(2,)", 0, &["type", "|O", "'<f8'"][..]),
        ("'[('a', '<f8')]'", "(2,)", 0, &["type", "[('a'"]),
        ("<f8", "(2,)", 15, &["15 bytes of data", "expected 16", "truncated"]),
        ("<f8", "(2,)", 17, &["17 bytes of data", "expected 16"]),
        ("<f8", "()", 8, &["shape []", "[frame, measurement]"]),
        ("<f8", "(1, 1, 1, 1)", 8, &["shape [1, 1, 1, 1]"]),
        ("<f8", "(0, 4)", 0, &["no complete frame"]),
        ("<f8", "(4, 0)", 0, &["no complete frame"]),
        ("<f8", "(9999999999, 9999999999)", 0, &["0 bytes of data"]),
        ("<f8", "(-1,)", 8, &["shape", "(-1,)"]),
    ] {
        refused(npy_with(descr, shape, &vec![0; bytes]), parts);
    }
}

const EIT_HEADER: &str =
    "11\n2\nt_1\n2020.07.08. 14:20:28.750\n100000.0\n100000.0\n0\n1\n0.01\n30.0\n0.0\n";

fn eit_of(text: impl AsRef<[u8]>) -> Parsed {
    parse(Format::Sciospec, text, &ReadOptions::default())
}

#[test]
fn sciospec_headers_that_are_read() {
    let frame = eit_of(format!("{EIT_HEADER}1 2\n0.5\t-0.25\t-0.5\t0.25\n2 1\n1\t2\t3\t4\n\n"));
    let frame = frame.unwrap();
    assert_eq!(frame.real, array![[0.5, -0.5, 1.0, 3.0]]);
    assert_eq!(frame.imaginary, Some(array![[-0.25, 0.25, 2.0, 4.0]]));
    assert_eq!((frame.frequency_hz, frame.current_a), (Some(1e5), Some(0.01)));
    // 9 lines, two frequencies, all channels
    let text = "9\nt\n2020.07.08. 14:20:28\n10\n20\n0\n2\n0.01\n30\n1 2\n1 2 3 4\n5 6 7 8\n";
    let row = |frequency_row| {
        parse(Format::Sciospec, text, &ReadOptions { frequency_row, ..ReadOptions::default() })
    };
    assert_eq!(row(0).unwrap().real, array![[1.0, 3.0]]);
    assert_eq!(row(1).unwrap().real, array![[5.0, 7.0]]);
    assert_eq!(row(1).unwrap().frequency_hz, Some(20.0));
    refused(row(2), &["f.sciospec", "2 frequency rows", "row 2", "frequency_row"]);
    // channels 3 and 2 are electrodes 0 and 1
    let text = EIT_HEADER.replacen("11", "12", 1) + "MeasurementChannels: 3,2\n";
    let chosen = eit_of(format!("{text}2 3\n1 0 2 0 3 0\n")).unwrap();
    assert_eq!(chosen.real, array![[3.0, 2.0]]);
    let frames = chosen.frames_for(Some(&[[1, 0, 0, 1]]), 1, Component::Real).unwrap();
    assert_eq!(frames.values, array![[1.0]]);
    refused(eit_of(format!("{text}1 2\n1 0 2 0 3 0\n")), &["line 13", "drive", "\"1 2\""]);
    refused(eit_of(format!("{text}2 3\n1 0 2 0\n")), &["line 14", "2 channels", "expected 3"]);
    let repeated = eit_of(format!("{EIT_HEADER}1 2\n1 0 2 0\n1 2\n1 0 2 0\n")).unwrap();
    assert_eq!(repeated.notes, [Note::RepeatedDrive { a: 0, b: 1 }]);
}

#[test]
fn sciospec_faults() {
    for (bytes, parts) in [
        (&b""[..], &["f.sciospec", "empty"][..]),
        (b"1,2,3\n", &["line 1", "number of header lines", "\"1,2,3\""]),
        (b"40\n2\n", &["line 1", "number of header lines"]),
        (b"---Draeger EIT-Software V1\r\n", &["Draeger", "CSV or NPY"]),
        (b"\xFF\xFE<\x00", &["Carefusion"]),
        (b"\x00\x00\x00\x03", &["Swisstom"]),
        (EIT_HEADER.replacen("0.01", "much", 1).as_bytes(), &["line 9", "amplitude", "\"much\""]),
    ] {
        refused(eit_of(bytes), parts);
    }
    for (frame, parts) in [
        ("", &["no complete frame"][..]),
        ("1 2\n", &["line 12", "0 lines of potentials", "1"]),
        ("1 2\n1 2 3\n", &["line 13", "3 real and imaginary"]),
        ("1 2\n1 2 3 4\n2 1\n1 2 3", &["line 15", "3 real and imaginary", "expected 4"]),
        // truncated from -2.5E-6
        ("1 2\n1 2 3 -2.5", &["line 13", "no line end", "again"]),
        ("1 3\n1 2 3 4\n", &["drive is \"1 3\""]),
        ("1 1\n1 2 3 4\n", &["drive is \"1 1\"", "different"]),
        ("1 2\n1 2 3 NaN\n", &["line 13", "frame 0, measurement 1", "NaN"]),
    ] {
        refused(eit_of(format!("{EIT_HEADER}{frame}")), parts);
    }
}

#[test]
fn sciospec_folders() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let write = |name: &str, text: &str| fs::write(path.join(name), text).unwrap();
    let read = || read_recording(path, None, &ReadOptions::default());
    let frame = |value: u32| format!("{EIT_HEADER}1 2\n{value} 0 2 0\n");
    // numeric order, with a gap
    write("t_9.eit", &frame(9));
    write("t_10.eit", &frame(10));
    write("t_13.EIT", &frame(13));
    write("notes.md", "not a frame");
    let recording = read().unwrap();
    assert_eq!(recording.real.column(0).to_vec(), [9.0, 10.0, 13.0]);
    assert_eq!(recording.notes, [Note::MissingFrameFiles { count: 2, first: 11 }]);
    write("t_14.eit", &format!("{EIT_HEADER}2 1\n1 0 2 0\n"));
    refused(read(), &["t_14.eit", "0 drives like those", "expected 1"]);
    write("t_14.eit", &format!("{EIT_HEADER}1 2\n1 0 2 0 3 0\n"));
    refused(read(), &["t_14.eit", "3 electrodes", "expected 2"]);
    // a damaged file costs itself
    for damaged in ["", &frame(14)[..frame(14).len() / 2]] {
        write("t_14.eit", damaged);
        let rest = read().unwrap();
        let left_out = rest.notes.iter().any(|note| {
            matches!(note, Note::DamagedFiles { count: 1, first } if first.contains("t_14.eit"))
        });
        assert!(left_out && rest.frame_count() == 3, "{:?}", rest.notes);
    }
    fs::remove_file(path.join("t_14.eit")).unwrap();
    write("u_1.eit", &frame(1));
    refused(read(), &["`t_`", "`u_`", "one recording"]);
    fs::remove_file(path.join("u_1.eit")).unwrap();
    write("last.eit", &frame(1));
    refused(read(), &["last.eit", "frame number", "rename"]);
}

#[test]
fn goe_faults() {
    let goe = |bytes: &[u8]| parse(Format::Goe, bytes, &ReadOptions::default());
    refused(goe(b""), &["f.goe", "empty"]);
    refused(goe(b"1,2,3\n"), &["is text", "`[recording] format`"]);
    refused(goe(b"---Draeger EIT-Software---\r\n"), &["Draeger"]);
    refused(goe(&[0; 1023]), &["no complete frame", "1 incomplete"]);
    let with = |value: f32, slot: usize| {
        let mut frames = [0.25; 512];
        frames[256 + slot] = value;
        goe(&frames.map(f32::to_le_bytes).concat())
    };
    refused(with(f32::INFINITY, 3), &["byte 1036", "frame 1, measurement 3", "inf"]);
    refused(with(-1e30, 3), &["byte 1036", "e30 is not a plausible voltage", "Goe-MF II"]);
    // values after the voltages are ignored
    assert_eq!(with(f32::NAN, 208).unwrap().frame_count(), 2);
}

#[test]
fn goe_fills_the_half_that_was_not_measured() {
    let whole: Vec<_> = rotated(16);
    // one value per unordered pair of drive and measured pair; the second half is 0
    let frame: Vec<f32> = (0..256)
        .map(|slot| match whole.get(slot) {
            Some(&[drive, _, measured, _]) if measured > drive => (16 * drive + measured) as f32,
            Some(_) => 0.0,
            None => 1.0,
        })
        .collect();
    let bytes: Vec<u8> = frame.iter().flat_map(|value| value.to_le_bytes()).collect();
    let recording = parse(Format::Goe, &bytes, &ReadOptions::default()).unwrap();
    assert_eq!(recording.notes, [Note::FilledByReciprocity { values: 104 }]);
    for (&[a, _, m, _], &value) in whole.iter().zip(recording.real.row(0)) {
        assert_eq!(value, f64::from(16 * a.min(m) + a.max(m)));
    }
}

fn lct_text(rows: &[&str]) -> String {
    let header = "#MEAS  \n#Length, 4\n#Electrodes, 4 \n#Strategy, Adjacent , Partial Model\n\
                  #Operating_Frequency 10 , KHz\n#Start\n";
    header.to_owned() + &rows.join("\n") + "\n"
}

#[test]
fn lct_rows_and_header() {
    let lct = |text: &str| parse(Format::Lct, text, &ReadOptions::default());
    let rows = ["1 2 2", "3 4 2", "5 6 2", "7 8 2"];
    let whole = lct_text(&rows);
    let recording = lct(&whole).unwrap();
    assert_eq!(recording.real, array![[0.5, 1.5, 2.5, 3.5]]);
    assert_eq!(recording.imaginary, Some(array![[1.0, 2.0, 3.0, 4.0]]));
    let repeated = lct(&(whole.clone() + "7 8 2\n")).unwrap();
    assert_eq!(repeated.notes, [Note::RepeatedLastRow { line: 11 }]);
    let sixteen = whole.replace("Electrodes, 4", "Electrodes, 16");
    for (text, parts) in [
        (whole.clone() + "7 8 3\n", &["5 rows", "expected 4", "Length"][..]),
        (lct_text(&rows[..3]), &["3 rows", "expected 4"]),
        (whole.replace("3 4 2", "3 4 0"), &["line 8", "current is 0"]),
        (lct_text(&["1 2"]), &["line 7", "2 values", "expected 3"]),
        (whole.replace("3 4 2", "1 2 inf"), &["line 8", "is inf"]),
        (lct_text(&["1 2 x"]), &["line 7", "value 3", "\"x\""]),
        (whole.replace("3 4 2", "nan 2 2"), &["line 8", "frame 0, measurement 1", "NaN"]),
        (String::new(), &["empty"]),
        ("1 2 3\n".into(), &["line 1", "first line", "#MEAS"]),
        ("#MEAS\n1 2 3\n".into(), &["Length", "missing"]),
        (whole.replace("Length, 4", "Length, x"), &["line 2", "Length", "\"x\""]),
        (sixteen, &["line 3", "16 with Length 4", "n (n - 3)"]),
        (whole.replace("KHz", "K"), &["line 5", "Operating_Frequency"]),
        (whole.trim_end().to_owned(), &["line 10", "no line end"]),
        (whole.clone() + "\u{1}", &["byte ", "not text"]),
    ] {
        refused(lct(&text), parts);
    }
}

#[test]
fn serial_log_cuts() {
    let log_of = |text: &str, lines_per_frame| {
        let serial_log =
            SerialLogOptions { lines_per_frame, values_per_line: 2, full_scale: Some(6.55) };
        parse(Format::SerialLog, text, &ReadOptions { serial_log, ..ReadOptions::default() })
    };
    let log = |text: &str| log_of(text, 2);
    let rows = |text: &str| {
        let recording = log(text).unwrap();
        (recording.real.outer_iter().map(|row| row[0]).collect::<Vec<_>>(), recording.skipped)
    };
    // complete frames, with all marks
    let (values, skipped) = rows("ref:\n1 1\n1 1\ndata:\ns\n2 2 \r\n2 6.55\ns\n3 3 3 3\n");
    assert_eq!(values, [1.0, 2.0, 3.0]);
    // the `s` before the frame in one line has no lines of its own
    assert_eq!(skipped.frames, 1);
    let recording = log("s\n2 2\n2 6.55\n").unwrap();
    assert_eq!(recording.quality.as_ref().unwrap()[[0, 3]], Quality::SATURATED);
    assert!(recording.quality.as_ref().unwrap()[[0, 2]].is_good());
    for (text, reason) in [
        ("1 1\n1 1\ns\n2 2\n2 2\n", "line 1: its start is missing"),
        ("s\n1 1\ns\n2 2\n2 2\n", "line 1: 1 lines instead of 2"),
        ("s\n1 1\n1 1\n1 1\ns\n2 2\n2 2\n", "line 1: 3 lines instead of 2"),
        ("s\n1 1\n1\ns\n2 2\n2 2\n", "line 3: 1 values in a line instead of 2"),
        ("s\n1 1 1\n1 1\ns\n2 2\n2 2\n", "line 2: 3 values in a line instead of 2"),
        ("s\n1 1\n1 1.2.3\ns\n2 2\n2 2\n", "line 3: a value is not a finite number"),
        ("s\n1 1\n1 nan\ns\n2 2\n2 2\n", "line 3: a value is not a finite number"),
        ("s\n2 2\n2 2\ns\n1 1\n1 1", "line 6: the file ends within a number"),
        ("s\n2 2\n2 2\ns\n", "line 4: 0 lines instead of 2"),
    ] {
        let (values, skipped) = rows(text);
        assert_eq!(values, [2.0], "{text:?}");
        assert_eq!(skipped.first[0].to_string(), reason, "{text:?}");
    }
    // a lost `s` merges two frames, and neither is read
    assert_eq!(rows("s\n1 1\n1 1\n1 1\n1 1\ns\n2 2\n2 2\n").1.frames, 2);
    refused(log(""), &["f.serial-log", "empty"]);
    refused(log("s\n1 1\n"), &["no complete frame", "1 incomplete"]);
    refused(log("\u{0}\u{1}\n"), &["no complete frame"]);
    refused(log_of("s\ns\n1 1\n", 0), &["no complete frame"]);
}

#[test]
fn khu_folders() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let write = |name: &str, text: &str| fs::write(path.join(name), text).unwrap();
    let read = || read_recording(path, None, &ReadOptions::default());
    let scan = |count: i32| -> String {
        (0..8).map(|row| format!("{} {} {count}.0 -3\r\n", row % 4, u32::from(row == 2))).collect()
    };
    write("2Scan.txt", &scan(2));
    refused(read(), &["ProjectionTableSendLog.txt", "khu", "whole folder"]);
    // 4 channels and 2 projections
    let mut table = "ProjIndex\tCh\tChIndex\tChInfo\tInj.Freq\tAmp1High\r\n".to_owned();
    for (row, role) in [2, 3, 0, 0, 0, 2, 0, 3].into_iter().enumerate() {
        let gain = if role == 0 { 10 } else { 1 };
        let (projection, channel) = (row / 4, row % 4);
        table += &format!("{projection}\t{channel}\t0\t{role}\t3\t1\t128\t1\t128\t{gain}\t1\r\n");
    }
    write("ProjectionTableSendLog.txt", &table);
    write("10 Scan.txt", &scan(10));
    let recording = read().unwrap();
    // counts divided by 2^15 and by the gain of 0.2
    assert_eq!(recording.real.column(0).to_vec(), [2.0, 10.0].map(|c| c / (32768.0 * 0.2)));
    assert_eq!(recording.notes, [Note::MissingFrameFiles { count: 7, first: 3 }]);
    assert_eq!(recording.quality.as_ref().unwrap()[[0, 2]], Quality::SATURATED);
    assert!(recording.quality.as_ref().unwrap()[[0, 3]].is_good());
    write("11Scan.txt", &(scan(1) + "0 0 1 1\r\n"));
    refused(read(), &["11Scan.txt", "9 records", "expected 8"]);
    write("11Scan.txt", &scan(1).replacen("1 0", "2 0", 1));
    refused(read(), &["11Scan.txt, line 2", "2 instead of 1"]);
    write("11Scan.txt", scan(1).trim_end());
    refused(read(), &["11Scan.txt, line 8", "no line end"]);
    write("11Scan.txt", "0 0 1\r\n");
    refused(read(), &["line 1", "3 values", "expected 4"]);
    write("11Scan.txt", &scan(1).replacen("1.0", "nan", 1));
    assert_eq!(read().unwrap().quality.unwrap()[[2, 0]], Quality::NON_FINITE);
    let scan = read_recording(&path.join("2Scan.txt"), Some(Format::Khu), &ReadOptions::default());
    refused(scan, &["2Scan.txt", "is a single file", "folder", "name the folder"]);
    let scan = read_recording(&path.join("2Scan.txt"), None, &ReadOptions::default());
    refused(scan, &["name the folder"]);
    write("t_1.eit", "");
    refused(read(), &["sciospec or khu", "[recording] format = \"sciospec\"", "or \"khu\""]);
}

#[test]
fn keys_of_tables_are_for_tables() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let frames_are = ReadOptions { frames_are: Some(FrameOrientation::Rows), ..Default::default() };
    let complex = ReadOptions { complex: true, ..ReadOptions::default() };
    let write = |name: &str, bytes: &[u8]| fs::write(path.join(name), bytes).unwrap();
    for (name, content, format) in [
        ("t_1.eit", format!("{EIT_HEADER}1 2\n1 0 2 0\n"), "sciospec"),
        ("f.get", "\0".repeat(1024), "goe"),
        ("f.lct", lct_text(&["1 1 1"; 4]), "lct"),
        ("f.log", format!("s\n{}", ("1 ".repeat(13) + "\n").repeat(16)), "serial-log"),
    ] {
        write(name, content.as_bytes());
        let read = |options: &ReadOptions| read_recording(&path.join(name), None, options);
        assert!(read(&ReadOptions::default()).is_ok(), "{name}");
        let of = [name, "tables (csv, npy", format, "remove"];
        refused(read(&frames_are), &[&of[..], &["`[recording] frames_are`"]].concat());
        refused(read(&complex), &[&of[..], &["`[recording] complex`"]].concat());
    }
    refused(read_recording(path, None, &frames_are), &["`[recording] frames_are`", "sciospec"]);
    let khu = tempfile::tempdir().unwrap();
    fs::write(khu.path().join("1Scan.txt"), "").unwrap();
    refused(read_recording(khu.path(), None, &complex), &["`[recording] complex`", "khu"]);

    let floats = [1_f32, 2.0].map(f32::to_le_bytes).concat();
    write("f.npy", &npy_of("<c8", "(1, 1)", &floats));
    let npy = |options: &ReadOptions| read_recording(&path.join("f.npy"), None, options);
    assert!(npy(&frames_are).is_ok());
    let parts = ["f.npy", "`[recording] complex`", "complex recording", "real numbers"];
    refused(npy(&complex), &parts);
    write("f.npy", &npy_of("<f4", "(1, 2)", &floats));
    refused(npy(&complex), &["1 rows", "expected 2", "`[recording] complex = false`"]);
    let both = ReadOptions { frames_are: Some(FrameOrientation::Columns), ..complex.clone() };
    let recording = npy(&both).unwrap();
    assert_eq!((recording.real[[0, 0]], recording.imaginary.unwrap()[[0, 0]]), (1.0, 2.0));
}

#[test]
fn vectors_are_one_frame() {
    let with = |shape: &str, orientation| {
        parse(Format::Npy, npy_of("|u1", shape, &[1, 2, 3]), &table(orientation, false)).unwrap()
    };
    for shape in ["(3,)", "(3, 1)"] {
        for orientation in
            [FrameOrientation::Rows, FrameOrientation::Columns, FrameOrientation::Matrix]
        {
            let recording = with(shape, orientation);
            assert_eq!(recording.real, array![[1.0, 2.0, 3.0]], "{shape}");
            // with rows, this is not what the key says
            let noted = shape == "(3, 1)" && orientation == FrameOrientation::Rows;
            assert_eq!(recording.notes.contains(&Note::OneColumn { rows: 3 }), noted);
        }
    }
    assert_eq!(with("(1, 3)", FrameOrientation::Columns).real.dim(), (3, 1));
}

#[test]
fn recognition() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let read = |name: &str, bytes: &[u8]| {
        fs::write(path.join(name), bytes).unwrap();
        read_recording(&path.join(name), None, &ReadOptions::default())
    };
    let frame = ("1 ".repeat(13) + "\n").repeat(16);
    for (name, content, format) in [
        ("a.txt", &b"1 2 3\n4 5 6\n"[..], Format::Csv),
        ("a.dat", b"# comment\nx y\n1 2\n", Format::Csv),
        ("a.csv", lct_text(&["1 1 1"; 4]).as_bytes(), Format::Lct),
        ("a.txt", &npy_of("|u1", "(1,)", &[1]), Format::Npy),
        ("a.log", format!("s\n{frame}").as_bytes(), Format::SerialLog),
    ] {
        assert_eq!(read(name, content).unwrap().format, format);
    }
    let either = read("a.txt", frame.as_bytes());
    refused(either, &["csv or serial-log", "[recording] format = \"csv\""]);
    refused(read("a.bin", &[1, 2, 3]), &["a.bin", "not recognised", "\"csv\"", "\"serial-log\""]);
    refused(read("a.txt", b"some words\nand more\n"), &["not recognised"]);
    refused(read("a.txt", b""), &["empty"]);
    refused(read("a.npy", b"1,2\n"), &["NPY magic"]);
    refused(read_recording(path, None, &ReadOptions::default()), &["not recognised"]);
    let missing = path.join("there is none.csv");
    refused(read_recording(&missing, None, &ReadOptions::default()), &["cannot be read", "path"]);
    let folder = |format| read_recording(path, Some(format), &ReadOptions::default());
    for format in [Format::Csv, Format::Npy, Format::Lct, Format::Goe, Format::SerialLog] {
        refused(folder(format), &["is a folder", format.name(), "name the file"]);
    }
    refused(folder(Format::Sciospec), &["NAME_00001.eit"]);
    refused(folder(Format::Khu), &["ProjectionTableSendLog.txt"]);
    refused("elektro".parse::<Format>(), &["\"elektro\"", "[recording] format", "\"sciospec\""]);
    for format in Format::ALL {
        assert_eq!(format.name().parse::<Format>().unwrap(), format);
    }
}
