//! NumPy `.npy` arrays of numbers.
//!
//! Parsed here and not by `ndarray-npy`, whose header parser recurses on nested brackets, and
//! because frames need a real or complex matrix whatever the stored type. Format: NumPy enhancement
//! proposal 1.

mod header;

use std::path::Path;

use ndarray::{ArrayD, IxDyn, ShapeBuilder};

use self::header::Header;
use super::ReadOptions;
use super::files::file_bytes;
use super::table::Table;
use crate::error::{HwError, Place};
use crate::recording::{Format, FrameOrientation, Layout, Note, Recording, Unit};

/// First bytes of every `.npy` file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

const MEND: &str = "save it again with numpy.save as a plain numeric array";

/// Parses the content of an NPY file; `path` is used in messages only.
///
/// Accepts integers of 1 to 8 bytes, floats of 4 and 8 and complex numbers of 8 and 16, in either
/// byte and axis order. `[measurement]` is one frame, and so is, with [`FrameOrientation::Rows`], a
/// matrix of one column (with a note); for other matrices see [`FrameOrientation`]. The layout is
/// [`Layout::ProtocolOrder`], the unit [`Unit::Arbitrary`]. A value that is NaN or infinite counts
/// as missing and is flagged [`Quality::NON_FINITE`](crate::Quality::NON_FINITE).
///
/// # Errors
/// [`HwError`] for an empty file, a damaged header, another type or shape, more or fewer bytes than
/// the header states, an odd number of rows or columns where they alternate, and complex numbers
/// where real ones should alternate.
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    options: &ReadOptions,
) -> Result<Recording, HwError> {
    let Header { first_byte, kind, fortran, shape } = Header::parse(bytes, path)?;
    let orientation = options.frames_are.unwrap_or_default();
    let by_rows = orientation == FrameOrientation::Rows;
    let (rows, columns) = match shape[..] {
        [values] | [values, 1] if by_rows => (1, values),
        [values] => (values, 1),
        [rows, columns] => (rows, columns),
        _ => return Err(HwError::Shape { place: Place::file(path), shape }),
    };
    if kind.complex && options.complex {
        return Err(HwError::UnusedKey {
            place: Place::file(path),
            key: "complex",
            format: "complex npy",
            meant: "tables of real numbers",
        });
    }
    let data = &bytes[first_byte..];
    let wanted = rows.checked_mul(columns).and_then(|count| count.checked_mul(kind.bytes()));
    if wanted != Some(data.len()) {
        return Err(wrong_size(path, first_byte, data.len(), wanted));
    }
    let vectors = if by_rows { [rows, columns] } else { [columns, rows] };
    let mut table = Table::new(vectors, orientation, options.complex, kind.complex, path)?;
    if rows.min(columns) == 0 {
        return Err(HwError::NoFrames { place: Place::file(path), skipped: 0 });
    }
    // the values of a vector follow each other in C order for rows, and in Fortran's for columns
    let inner = if fortran { rows } else { columns };
    for (at, value) in data.chunks_exact(kind.bytes()).enumerate() {
        let (real, imaginary) = value.split_at(kind.size);
        let imaginary = if kind.complex { kind.value(imaginary) } else { 0.0 };
        let [first, second] = [at / inner, at % inner];
        let (vector, index) = if by_rows == fortran { (second, first) } else { (first, second) };
        table.put(vector, index, kind.value(real), imaginary);
    }
    let (layout, unit) = (Layout::ProtocolOrder, Unit::Arbitrary);
    let mut recording = Recording::new(table.contents(), layout, unit, Format::Npy, path)?;
    recording.frames_are = Some(orientation);
    if by_rows && matches!(shape[..], [_, 1]) {
        recording.notes.push(Note::OneColumn { rows: columns });
    }
    Ok(recording.with_missing())
}

fn parse_array(bytes: &[u8], path: &Path) -> Result<ArrayD<f64>, HwError> {
    let Header { first_byte, kind, fortran, shape } = Header::parse(bytes, path)?;
    if kind.complex {
        return Err(HwError::Field {
            place: Place::file(path),
            field: "type",
            text: "complex".into(),
            wanted: "real numbers",
            mend: MEND,
        });
    }
    let data = &bytes[first_byte..];
    let count = shape.iter().try_fold(1_usize, |count, &size| count.checked_mul(size));
    let wanted = count.and_then(|count| count.checked_mul(kind.bytes()));
    if wanted != Some(data.len()) {
        return Err(wrong_size(path, first_byte, data.len(), wanted));
    }
    let list: Vec<f64> = data.chunks_exact(kind.bytes()).map(|bytes| kind.value(bytes)).collect();
    let shape = IxDyn(&shape).set_f(fortran);
    let none = |_| HwError::NoFrames { place: Place::file(path), skipped: 0 };
    ArrayD::from_shape_vec(shape, list).map_err(none)
}

/// Reads real numbers of any shape from an NPY file.
///
/// # Errors
/// [`HwError::Read`] if the file cannot be read, [`HwError`] for an empty or damaged file and for
/// complex numbers.
pub fn read_array(path: impl AsRef<Path>) -> Result<ArrayD<f64>, HwError> {
    let path = path.as_ref();
    parse_array(&file_bytes(path, Format::Npy.name())?, path)
}

fn wrong_size(path: &Path, first_byte: usize, found: usize, wanted: Option<usize>) -> HwError {
    HwError::count(
        Place::byte(path, first_byte),
        "bytes of data",
        [found, wanted.unwrap_or(usize::MAX)],
        "the file is truncated or contains more than one array: copy or save it again",
    )
}
