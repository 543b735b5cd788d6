//! Files of several arrays, MATLAB's and NumPy's.

use crate::common::arrays::{
    COMPLEX, DOUBLE, compressed, doubles, element, mat, matrix, npy, npy_of, npz,
};
use crate::common::{little_memory, parse, refused};
use eit_hw::Format::{Mat, Npz};
use eit_hw::{Format, FrameOrientation, Note, ReadOptions, read_recording};
use ndarray::{Array2, array};

fn plain() -> ReadOptions {
    ReadOptions::default()
}

fn of_protocol(measurements: usize) -> ReadOptions {
    ReadOptions { measurements: Some(measurements), ..plain() }
}

fn named(name: &str) -> ReadOptions {
    ReadOptions { array: Some(name.to_owned()), ..plain() }
}

/// `scipy.mat` is of SciPy 1.17, `numpy.npz` of NumPy 2, both compressed: `v` = [[0.5, -2, 3], [4, 5, 6]],
/// `z` = v (1 + 2i), in the second transposed, a number `rate_hz`, the text `note`, and in the first a
/// struct `setup`.
#[test]
fn files_of_scipy_and_numpy_are_read() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/files");
    let v = array![[0.5, -2.0, 3.0], [4.0, 5.0, 6.0]];
    for (name, format) in [("scipy.mat", Mat), ("numpy.npz", Npz)] {
        let read = |options: &ReadOptions| read_recording(folder.join(name), None, options);
        let recording = read(&named("v")).unwrap();
        assert_eq!((recording.real, recording.format), (v.clone(), format));
        assert!(recording.imaginary.is_none());
        let recording = read(&ReadOptions { measurements: Some(3), ..named("z") }).unwrap();
        assert_eq!((recording.real, recording.imaginary), (v.clone(), Some(2.0 * &v)), "{name}");
        let text = "more than one array has frames of the protocol's 3 measurements";
        refused(read(&of_protocol(3)), &[name, text, "`v` [2, 3]", "`z` [", "`note` ("]);
    }
}

/// Every type of stored numbers in both byte orders, packed or not, beside a class of wider numbers.
#[test]
fn numbers_of_matlab_of_every_type() {
    let wanted = array![[1.0, 2.0, 4.0], [3.0, 5.0, 6.0]];
    let values = [1_u8, 3, 2, 5, 4, 6];
    let whole = |v: u8| u64::from(v).to_le_bytes();
    let floats = |v: u8| f32::from(v).to_le_bytes();
    let doubles = |v: u8| f64::from(v).to_le_bytes();
    // signed and unsigned numbers of 1, 2, 4 and 8 bytes
    let sizes = [(1, 1), (2, 1), (3, 2), (4, 2), (5, 4), (6, 4), (12, 8), (13, 8)];
    let of_size = |size: usize| values.map(|v| whole(v)[..size].to_vec()).concat();
    let floats = [(7, values.map(floats).concat()), (9, values.map(doubles).concat())];
    for (kind, data) in sizes.map(|(kind, size)| (kind, of_size(size))).into_iter().chain(floats) {
        let variable = matrix("v", DOUBLE, &[2, 3], &[element(kind, &data)]);
        for content in [variable.clone(), compressed(&variable)] {
            let recording = parse(Mat, mat(&[content]), &plain()).unwrap();
            assert_eq!(recording.real, wanted, "type {kind}");
        }
    }
    // numbers so short that they stand in the tag, with imaginary parts
    let parts = [element(2, &[1, 2]), element(3, &[3, 0, 0xFF, 0xFF])];
    let variable = matrix("v", DOUBLE | COMPLEX, &[1, 2], &parts);
    let recording = parse(Mat, mat(std::slice::from_ref(&variable)), &plain()).unwrap();
    assert_eq!(recording.real, array![[1.0, 2.0]]);
    assert_eq!(recording.imaginary, Some(array![[3.0, -1.0]]));
    let alternate = ReadOptions { complex: true, ..plain() };
    refused(parse(Mat, mat(&[variable]), &alternate), &["`[recording] complex`", "real numbers"]);
    // big-endian: words and numbers of 8 bytes, but for names
    let swap = |bytes: &[u8]| bytes.chunks(4).flat_map(|word| word.iter().rev().copied()).collect();
    let data = [1.5_f64, -2.0].map(f64::to_be_bytes).concat();
    let little = matrix("", DOUBLE, &[1, 2], &[]);
    let mut content: Vec<u8> = swap(&little[8..little.len() - 8]);
    content.extend([0, 1, 0, 1, b'v', 0, 0, 0, 0, 0, 0, 9, 0, 0, 0, 16]);
    content.extend(data);
    let size = u32::try_from(content.len()).unwrap().to_be_bytes();
    let mut file = mat(&[]);
    file.splice(124.., *b"\x01\0MI");
    let file = [file, vec![0, 0, 0, 14], size.to_vec(), content].concat();
    assert_eq!(parse(Mat, file, &plain()).unwrap().real, array![[1.5, -2.0]]);
}

#[test]
fn the_array_that_fits_the_protocol_is_read() {
    let text = matrix("t", 4, &[1, 2], &[element(16, b"ab")]);
    let others =
        [doubles("rate", &[1, 1]), doubles("time", &[5, 1]), doubles("place", &[2, 2]), text];
    let with = |shape: &[u32]| mat(&[&others[..], &[compressed(&doubles("v", shape))]].concat());
    let note = |shape, by_columns| Note::Array { name: "v".into(), shape, by_columns };
    let counted = |rows: usize, columns: usize, at: fn((usize, usize)) -> usize| {
        Array2::from_shape_fn((rows, columns), |place| at(place) as f64)
    };
    let rows = parse(Mat, with(&[5, 6]), &of_protocol(6)).unwrap();
    assert_eq!(rows.real, counted(5, 6, |(frame, value)| frame + 5 * value));
    assert_eq!(rows.notes, [note(vec![5, 6], false)]);
    let columns = parse(Mat, with(&[6, 5]), &of_protocol(6)).unwrap();
    assert_eq!(columns.real, counted(5, 6, |(frame, value)| 6 * frame + value));
    assert_eq!(columns.notes, [note(vec![6, 5], true)]);
    assert!(columns.notes[0].to_string().contains("`v` [6, 5], a frame in each column"));
    // [frame, drive, electrode]: a drive after the other
    let drives = parse(Mat, with(&[5, 2, 3]), &of_protocol(6)).unwrap();
    assert_eq!(drives.real, counted(5, 6, |(frame, v)| frame + 5 * (v / 3) + 10 * (v % 3)));
    let drives = parse(Npz, npz(&[("v.npy", &npy("(5, 2, 3)", 30))], true), &plain()).unwrap();
    assert_eq!(drives.real, counted(5, 6, |(frame, value)| 6 * frame + value));
    assert!(drives.notes.is_empty());
    // a row for each drive
    let lines = parse(Mat, with(&[2, 3]), &of_protocol(6)).unwrap();
    let quadruples =
        [[0, 1, 2, 3], [0, 1, 3, 4], [0, 1, 4, 5], [1, 2, 3, 4], [1, 2, 4, 5], [1, 2, 5, 0]];
    let frames = lines.arranged_for(&eit_hw::Layout::ProtocolOrder, Some(&quadruples), 6);
    assert_eq!(frames.real, array![[0.0, 2.0, 4.0, 1.0, 3.0, 5.0]]);
    // the same as the one frame, which is turned
    let one = ReadOptions { frames_are: Some(FrameOrientation::Matrix), ..plain() };
    let turned = parse(Format::Npy, npy("(2, 3)", 6), &one).unwrap();
    let turned = turned.arranged_for(&eit_hw::Layout::ProtocolOrder, Some(&quadruples), 6);
    assert_eq!(turned.real, array![[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]]);
    assert_eq!(turned.notes, [Note::Turned { drives: 2 }]);
    // what is stated holds; a single table needs no protocol, and one that does not fit is read to be compared
    let stated = ReadOptions { frames_are: Some(FrameOrientation::Columns), ..of_protocol(6) };
    refused(parse(Mat, with(&[5, 6]), &stated), &["no array has frames", "6 measurements"]);
    let single = mat(&[others[1].clone(), doubles("v", &[5, 6])]);
    assert_eq!(parse(Mat, &single, &plain()).unwrap().real.dim(), (5, 6));
    let other = parse(Mat, &single, &of_protocol(7)).unwrap();
    refused(other.frames_for(None, 7, eit_hw::Component::Real), &["6 values per frame"]);
}

#[test]
fn an_array_that_cannot_be_told_is_asked_for() {
    let two = mat(&[doubles("a", &[5, 6]), compressed(&doubles("b", &[6, 4]))]);
    let both = ["`a` [5, 6], `b` [6, 4]", "set `[recording] array` to the name"];
    let several = "more than one array has frames of the protocol's 6 measurements";
    refused(parse(Mat, &two, &of_protocol(6)), &[&both[..], &[several]].concat());
    let none = "no array has frames of the protocol's 7 measurements";
    refused(parse(Mat, &two, &of_protocol(7)), &[&both[..], &[none]].concat());
    refused(parse(Mat, &two, &plain()), &[&both[..], &["holds several arrays"]].concat());
    let none = "no array of numbers named \"c\"";
    refused(parse(Mat, &two, &named("c")), &[&both[..], &[none]].concat());
    assert_eq!(parse(Mat, &two, &named("b")).unwrap().real.dim(), (6, 4));
    let structs = mat(&[matrix("s", 2, &[1, 1], &[]), matrix("c", 1, &[1, 1], &[])]);
    let words = ["no array of numbers", "`s` (a struct), `c` (a cell array)", "v = full(s.FIELD)"];
    refused(parse(Mat, &structs, &plain()), &words);
    refused(parse(Mat, mat(&[]), &plain()), &["no array of numbers"]);
    let objects = npz(&[("o.npy", &npy_of("|O", "(2,)", &[]))], false);
    refused(parse(Npz, objects, &plain()), &["no array of numbers", "`o` (not of plain numbers)"]);
    let table = [("xl/workbook.xml", &b"<a/>"[..])];
    refused(parse(Npz, npz(&table, true), &plain()), &["an Excel file (.xlsx)", "as CSV"]);
    let key = ["`[recording] array` is for mat and npz files", "csv"];
    refused(parse(Format::Csv, "1,2\n", &named("a")), &key);
    refused(parse(Mat, mat(&[doubles("v", &[2, 2, 2, 2])]), &plain()), &["shape [2, 2, 2, 2]"]);
    refused(parse(Mat, mat(&[doubles("v", &[0, 3])]), &plain()), &["no complete frame"]);
    refused(parse(Mat, vec![0; 200], &plain()), &["not a MATLAB file of version 5", "'-v7'"]);
}

/// A file that is cut is refused, and so is a changed byte in what a checksum protects; no damage panics.
#[test]
fn damaged_files_are_refused() {
    let array = doubles("v", &[3, 4]);
    let options = of_protocol(4);
    let files = [
        (Mat, mat(&[compressed(&array)]), 128 + 8),
        (Mat, mat(std::slice::from_ref(&array)), usize::MAX),
        (Npz, npz(&[("v.npy", &npy("(3, 4)", 12))], true), 50),
        (Npz, npz(&[("v.npy", &npy("(3, 4)", 12))], false), 50),
    ];
    for (format, bytes, protected) in files {
        let wanted = parse(format, &bytes, &options).unwrap();
        for length in 0..bytes.len() {
            assert!(parse(format, &bytes[..length], &options).is_err(), "{format}: {length} bytes");
        }
        for at in 0..bytes.len() {
            for change in [1, 0x80, 0xFF] {
                let mut bytes = bytes.clone();
                bytes[at] ^= change;
                if let Ok(read) = parse(format, &bytes, &options) {
                    assert!(read.real == wanted.real || at < protected, "{format}: byte {at}");
                }
            }
        }
    }
}

/// Sizes that nothing stands behind, and zeros packed a thousand times, are refused at once.
#[test]
fn sizes_without_numbers_are_refused() {
    let read = |format, bytes: &[u8]| {
        little_memory("bomb", bytes.len(), || parse(format, bytes, &plain()))
    };
    let huge = |shape: &[u32]| matrix("v", DOUBLE, shape, &[element(9, &[0; 64])]);
    for shape in [&[u32::MAX, u32::MAX][..], &[u32::MAX; 4], &[1 << 20, 1 << 20], &[3, 3]] {
        refused(read(Mat, &mat(&[huge(shape)])), &["64 bytes of numbers", "damaged"]);
    }
    let stated = matrix("v", DOUBLE, &[1 << 20, 1 << 7], &[vec![9, 0, 0, 0, 0, 0, 0, 0x40]]);
    refused(read(Mat, &mat(&[compressed(&stated)])), &["unpacks to more than 60 MB"]);
    let cut = matrix("v", DOUBLE, &[1 << 10, 1], &[vec![9, 0, 0, 0, 0, 0x20, 0, 0]]);
    refused(read(Mat, &mat(&[compressed(&cut)])), &["0 bytes of numbers", "expected 8192"]);
    let zeros = vec![0; 40 << 20];
    let bomb = matrix("v", DOUBLE, &[1 << 20, 5], &[element(9, &zeros)]);
    refused(read(Mat, &mat(&[compressed(&bomb)])), &["unpacks to more than"]);
    let bomb = npy_of("<f8", "(1048576, 5)", &zeros);
    refused(read(Npz, &npz(&[("v.npy", &bomb)], true)), &["unpacks to more than"]);
    let claimed = npy_of("|u1", "(18446744073709551615, 9)", &zeros);
    refused(read(Npz, &npz(&[("v.npy", &claimed)], true)), &["unpacks to more than"]);
    let short = npy_of("<f8", "(100, 9)", &[0; 64]);
    refused(read(Npz, &npz(&[("v.npy", &short)], true)), &["64 bytes of data", "expected 7200"]);
    // a name of 2 MB
    let long = matrix(&"v".repeat(1 << 21), DOUBLE, &[1, 1], &[element(9, &[0; 8])]);
    refused(read(Mat, &mat(&[compressed(&long)])), &["damaged", "2097152 bytes"]);
}
