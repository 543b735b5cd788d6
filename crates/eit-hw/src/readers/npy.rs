//! NumPy `.npy` arrays of numbers.
//!
//! Parsed here and not by `ndarray-npy`, whose header parser recurses on nested brackets, and
//! because frames need a real or complex matrix whatever the stored type. Format: NumPy enhancement
//! proposal 1.

mod header;

use std::path::Path;

use ndarray::{Array2, ArrayD, IxDyn, ShapeBuilder};

use self::header::{Header, Kind};
use super::files::file_bytes;
use super::table;
use crate::error::{HwError, Place};
use crate::recording::{Format, FrameOrientation, Layout, Note, Recording, Unit};

/// First bytes of every `.npy` file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

const MEND: &str = "save it again with numpy.save as a plain numeric array";

/// Layout of an array.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct NpyOptions {
    /// What forms one frame in an array of two axes.
    pub orientation: FrameOrientation,
    /// Whether rows (or columns, also those of a matrix) of real numbers alternate: real parts of
    /// frame 0, imaginary parts of frame 0, real parts of frame 1 and so on.
    pub complex: bool,
}

/// Reads an NPY file.
///
/// # Errors
/// Those of [`parse`], and [`HwError::Read`] if the file cannot be read.
pub fn read(path: impl AsRef<Path>, options: &NpyOptions) -> Result<Recording, HwError> {
    let path = path.as_ref();
    parse(&file_bytes(path, Format::Npy.name())?, path, options)
}

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
pub fn parse(
    bytes: &[u8],
    path: impl AsRef<Path>,
    options: &NpyOptions,
) -> Result<Recording, HwError> {
    let path = path.as_ref();
    let Header { first_byte, kind, fortran, shape } = Header::parse(bytes, path)?;
    let orientation = options.orientation;
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
    let stored = Stored { data, kind, rows, columns, fortran };
    let (real, alternating) =
        table::oriented(stored.part(0, path)?, orientation, options.complex, path)?;
    let imaginary = if kind.complex {
        Some(table::oriented(stored.part(1, path)?, orientation, false, path)?.0)
    } else {
        alternating
    };
    let mut recording =
        Recording::new(real, imaginary, Layout::ProtocolOrder, Unit::Arbitrary, Format::Npy, path);
    recording.frames_are = Some(orientation);
    if by_rows && matches!(shape[..], [_, 1]) {
        recording.notes.push(Note::OneColumn { rows: columns });
    }
    Ok(recording.with_missing())
}

/// Parses real numbers of any shape from the content of an NPY file; `path` is used in messages
/// only.
///
/// # Errors
/// Those of [`parse`], and [`HwError::Field`] for complex numbers.
pub fn parse_array(bytes: &[u8], path: impl AsRef<Path>) -> Result<ArrayD<f64>, HwError> {
    let path = path.as_ref();
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
    let rows = count.unwrap_or_default();
    let list = Stored { data, kind, rows, columns: 1, fortran }.list(0);
    let shape = IxDyn(&shape).set_f(fortran);
    let none = |_| HwError::NoFrames { place: Place::file(path), skipped: 0 };
    ArrayD::from_shape_vec(shape, list).map_err(none)
}

/// Reads a file with [`parse_array`].
///
/// # Errors
/// Those of [`parse_array`], and [`HwError::Read`] if the file cannot be read.
pub fn read_array(path: impl AsRef<Path>) -> Result<ArrayD<f64>, HwError> {
    let path = path.as_ref();
    parse_array(&file_bytes(path, Format::Npy.name())?, path)
}

fn wrong_size(path: &Path, first_byte: usize, found: usize, wanted: Option<usize>) -> HwError {
    HwError::Count {
        place: Place::byte(path, first_byte),
        what: "bytes of data",
        found,
        wanted: wanted.unwrap_or(usize::MAX),
        mend: "the file is truncated or contains more than one array: copy or save it again",
    }
}

/// The stored numbers, exactly `rows * columns` of them.
struct Stored<'a> {
    data: &'a [u8],
    kind: Kind,
    rows: usize,
    columns: usize,
    fortran: bool,
}

impl Stored<'_> {
    /// Returns the real (0) or imaginary (1) parts, [row, column].
    fn part(&self, part: usize, path: &Path) -> Result<Array2<f64>, HwError> {
        let Self { rows, columns, fortran, .. } = *self;
        let none = |_| HwError::NoFrames { place: Place::file(path), skipped: 0 };
        Array2::from_shape_vec((rows, columns).set_f(fortran), self.list(part)).map_err(none)
    }

    fn list(&self, part: usize) -> Vec<f64> {
        let Self { data, kind, rows, columns, .. } = *self;
        let mut list = Vec::with_capacity(rows * columns);
        for index in 0..rows * columns {
            let at = index * kind.bytes() + part * kind.size;
            list.push(kind.value(&data[at..at + kind.size]));
        }
        list
    }
}
