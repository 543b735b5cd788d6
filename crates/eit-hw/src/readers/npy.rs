//! NumPy `.npy` arrays of numbers.
//!
//! Parsed here and not by `ndarray-npy`, whose header parser recurses on nested brackets, and
//! because frames need a real or complex matrix whatever the stored type. Format: NumPy enhancement
//! proposal 1.

mod header;

use std::io::{self, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use ndarray::{ArrayD, IxDyn, ShapeBuilder};

use self::header::{Header, Kind};
use super::files::file_bytes;
use super::table::Parts;
use crate::error::{HwError, Place};
use crate::recording::{Format, FrameOrientation, Layout, Note, Recording, Unit};
use crate::regular::regular_file;

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

/// Longest header read; NumPy's have about 100 bytes.
const MOST_HEADER_BYTES: u64 = 1 << 20;
/// Memory in bytes used to collect vectors that are not contiguous in the file.
const COLLECTED_BYTES: usize = 8 << 20;

/// Reads an NPY file, in pieces.
///
/// # Errors
/// Those of [`parse`], and [`HwError::Read`] if the file cannot be read.
pub fn read(path: impl AsRef<Path>, options: &NpyOptions) -> Result<Recording, HwError> {
    let path = path.as_ref();
    if path.is_dir() {
        let format = Format::Npy.name();
        return Err(HwError::Folder { place: Place::file(path), format });
    }
    recording(BufReader::with_capacity(1 << 16, regular_file(path)?), path, options)
}

/// Returns whether a file begins as an array.
pub(super) fn is_npy(path: &Path) -> Result<bool, HwError> {
    let failed = |source| HwError::Read { place: Place::file(path), source };
    let mut start = Vec::new();
    regular_file(path)?.take(MAGIC.len() as u64).read_to_end(&mut start).map_err(failed)?;
    Ok(start == MAGIC)
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
    recording(Cursor::new(bytes), path.as_ref(), options)
}

fn recording<R: Read + Seek>(
    mut source: R,
    path: &Path,
    options: &NpyOptions,
) -> Result<Recording, HwError> {
    let failed = |source| HwError::Read { place: Place::file(path), source };
    let total = source.seek(SeekFrom::End(0)).map_err(failed)?;
    source.rewind().map_err(failed)?;
    let mut head = Vec::new();
    source.by_ref().take(MOST_HEADER_BYTES).read_to_end(&mut head).map_err(failed)?;
    let Header { first_byte, kind, fortran, shape } = Header::parse(&head, path)?;
    drop(head);
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
    let found = usize::try_from(total).unwrap_or(usize::MAX) - first_byte;
    let wanted = rows.checked_mul(columns).and_then(|count| count.checked_mul(kind.bytes()));
    if wanted != Some(found) {
        return Err(wrong_size(path, first_byte, found, wanted));
    }
    let (count, length) = if by_rows { (rows, columns) } else { (columns, rows) };
    let mut parts = Parts::new(count, length, orientation, options.complex, path)?;
    // the rows of a table in C order follow each other, and so do the columns of one in Fortran's
    let vectors = Vectors { first_byte: first_byte as u64, kind, count, length };
    if count.min(length) == 0 {
        return Err(HwError::NoFrames { place: Place::file(path), skipped: 0 });
    }
    if by_rows == fortran && count.min(length) > 1 {
        vectors.collect(&mut source, &mut parts).map_err(failed)?;
    } else {
        source.seek(SeekFrom::Start(first_byte as u64)).map_err(failed)?;
        vectors.stream(&mut source, &mut parts).map_err(failed)?;
    }
    let (layout, unit) = (Layout::ProtocolOrder, Unit::Arbitrary);
    let mut recording = Recording::new(parts.contents(), layout, unit, Format::Npy, path)?;
    recording.frames_are = Some(orientation);
    if by_rows && matches!(shape[..], [_, 1]) {
        recording.notes.push(Note::OneColumn { rows: columns });
    }
    Ok(recording.with_missing())
}

/// The rows or columns of a stored table that form its frames: `count` times `length` numbers.
struct Vectors {
    first_byte: u64,
    kind: Kind,
    count: usize,
    length: usize,
}

impl Vectors {
    fn push(&self, vector: usize, bytes: &[u8], parts: &mut Parts) {
        let (real, imaginary) = bytes.split_at(self.kind.size);
        match self.kind.complex {
            true => parts.push_complex(self.kind.value(real), self.kind.value(imaginary)),
            false => parts.push(vector, self.kind.value(real)),
        }
    }

    /// Reads vectors that follow each other.
    fn stream(&self, source: &mut impl Read, parts: &mut Parts) -> io::Result<()> {
        let mut bytes = vec![0; self.kind.bytes()];
        for vector in 0..self.count {
            for _ in 0..self.length {
                source.read_exact(&mut bytes)?;
                self.push(vector, &bytes, parts);
            }
        }
        Ok(())
    }

    /// Reads vectors whose first values are followed by all second values and so on, some at a time.
    fn collect<R: Read + Seek>(&self, source: &mut R, parts: &mut Parts) -> io::Result<()> {
        let size = self.kind.bytes();
        let group = (COLLECTED_BYTES / size / self.length).clamp(1, self.count);
        let mut bytes = vec![0; group * self.length * size];
        let mut position = source.stream_position()?;
        for first in (0..self.count).step_by(group) {
            let some = group.min(self.count - first);
            for (index, slots) in bytes.chunks_exact_mut(group * size).enumerate() {
                let at = self.first_byte + (index * self.count + first) as u64 * size as u64;
                // relative, so that a buffer is kept
                source.seek_relative(at as i64 - position as i64)?;
                source.read_exact(&mut slots[..some * size])?;
                position = at + (some * size) as u64;
            }
            for vector in 0..some {
                for slots in bytes.chunks_exact(group * size) {
                    self.push(first + vector, &slots[vector * size..(vector + 1) * size], parts);
                }
            }
        }
        Ok(())
    }
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
    let list: Vec<f64> = data.chunks_exact(kind.bytes()).map(|bytes| kind.value(bytes)).collect();
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
