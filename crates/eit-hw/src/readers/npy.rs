//! NumPy `.npy` arrays of numbers.
//!
//! Parsed here and not by `ndarray-npy`: its header parser recurses on nested brackets, and frames
//! need one real or complex matrix whatever the stored type. Format: NumPy enhancement proposal 1.

use std::path::Path;

use ndarray::{Array2, ArrayD, IxDyn, ShapeBuilder};

use super::files::file_bytes;
use super::table;
use crate::error::{HwError, Place, shortened};
use crate::recording::{Format, FrameOrientation, Layout, Note, Recording, Unit};

/// First bytes of every `.npy` file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

const MEND: &str = "save it anew with numpy.save of a plain numeric array";

/// How an array is laid out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NpyOptions {
    /// What one frame is in an array of two axes.
    pub orientation: FrameOrientation,
    /// Rows (or columns, also those of a matrix) of real numbers alternate: real parts of frame 0,
    /// imaginary parts of frame 0, real parts of frame 1 and so on.
    pub complex: bool,
}

/// Reads an NPY file.
///
/// # Errors
/// [`HwError`], see [`parse`], and where the file cannot be read.
pub fn read(path: &Path, options: &NpyOptions) -> Result<Recording, HwError> {
    parse(&file_bytes(path, Format::Npy.name())?, path, options)
}

/// Frames of an NPY file with this content; `path` is for messages.
///
/// Integers of 1 to 8 bytes, floats of 4 and 8 and complex numbers of 8 and 16, in either byte and
/// axis order. `[measurement]` is one frame, and so is, by [`FrameOrientation::Rows`], a matrix of
/// one column (with a note); for other matrices see [`FrameOrientation`]. The layout is
/// [`Layout::ProtocolOrder`], the unit [`Unit::Arbitrary`]. A value that is NaN or infinite is missing:
/// flagged [`Quality::NON_FINITE`](crate::Quality::NON_FINITE).
///
/// # Errors
/// [`HwError`] for an empty file, a damaged header, another type or shape, more or fewer bytes than
/// the header states, an odd number of rows or columns where they
/// alternate, and complex numbers where real ones should alternate.
pub fn parse(bytes: &[u8], path: &Path, options: &NpyOptions) -> Result<Recording, HwError> {
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

/// Real numbers of an NPY file of any shape; `path` is for messages.
///
/// # Errors
/// [`HwError`] as [`parse`], and for complex numbers.
pub fn parse_array(bytes: &[u8], path: &Path) -> Result<ArrayD<f64>, HwError> {
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

/// [`parse_array`] of a file.
///
/// # Errors
/// As [`parse_array`], and where the file cannot be read.
pub fn read_array(path: &Path) -> Result<ArrayD<f64>, HwError> {
    parse_array(&file_bytes(path, Format::Npy.name())?, path)
}

fn wrong_size(path: &Path, first_byte: usize, found: usize, wanted: Option<usize>) -> HwError {
    HwError::Count {
        place: Place::byte(path, first_byte),
        what: "bytes of data",
        found,
        wanted: wanted.unwrap_or(usize::MAX),
        mend: "the file is cut or holds more than one array: copy or save it anew",
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
    /// Real (0) or imaginary (1) parts, [row, column].
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

/// What the header states.
struct Header {
    first_byte: usize,
    kind: Kind,
    fortran: bool,
    shape: Vec<usize>,
}

impl Header {
    fn parse(bytes: &[u8], path: &Path) -> Result<Self, HwError> {
        let place = || Place::file(path);
        if bytes.is_empty() {
            return Err(HwError::Empty { place: place() });
        }
        let wrong = |field, text: &str, wanted| HwError::Field {
            place: place(),
            field,
            text: shortened(text),
            wanted,
            mend: MEND,
        };
        let Some(rest) = bytes.strip_prefix(MAGIC) else {
            let start = String::from_utf8_lossy(&bytes[..bytes.len().min(MAGIC.len())]);
            return Err(wrong("its start", &start, "the NPY mark \\x93NUMPY"));
        };
        let (length, start) = match *rest {
            [1, _, low, high, ..] => (usize::from(u16::from_le_bytes([low, high])), 10),
            [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([a, b, c, d]) as usize, 12),
            _ => return Err(wrong("version", "", "1, 2 or 3")),
        };
        let first_byte = start + length.min(bytes.len());
        let Some(header) = bytes.get(start..first_byte).filter(|header| header.len() == length)
        else {
            return Err(HwError::Count {
                place: Place::byte(path, start),
                what: "bytes of header",
                found: bytes.len().saturating_sub(start),
                wanted: length,
                mend: "the file is cut: copy it anew",
            });
        };
        let header = String::from_utf8_lossy(header);
        let descr = entry(&header, "descr");
        let kind = quoted(descr)
            .and_then(Kind::parse)
            .ok_or_else(|| wrong("type", descr, "a number such as '<f8' or '<c16'"))?;
        let order = entry(&header, "fortran_order");
        let fortran = match (order.starts_with("True"), order.starts_with("False")) {
            (true, _) => true,
            (_, true) => false,
            _ => return Err(wrong("fortran_order", order, "True or False")),
        };
        let list = entry(&header, "shape");
        let shape = shape(list).ok_or_else(|| wrong("shape", list, "a list such as (4, 208)"))?;
        Ok(Self { first_byte, kind, fortran, shape })
    }
}

/// What follows `'key':` in the header, empty where the key is missing.
fn entry<'a>(header: &'a str, key: &str) -> &'a str {
    let after = |quote: char| {
        let quoted = format!("{quote}{key}{quote}");
        header.split_once(quoted.as_str()).map(|(_, rest)| rest)
    };
    after('\'')
        .or_else(|| after('"'))
        .and_then(|rest| rest.trim_start().strip_prefix(':'))
        .map_or("", str::trim_start)
}

/// The quoted text at the start.
fn quoted(text: &str) -> Option<&str> {
    let quote = text.chars().next().filter(|quote| matches!(quote, '\'' | '"'))?;
    text[1..].split_once(quote).map(|(inside, _)| inside)
}

/// The tuple of sizes at the start.
fn shape(text: &str) -> Option<Vec<usize>> {
    let (inside, _) = text.strip_prefix('(')?.split_once(')')?;
    let sizes = inside.trim().trim_end_matches(',').trim();
    if sizes.is_empty() {
        return Some(Vec::new());
    }
    sizes.split(',').map(|size| size.trim().trim_end_matches('L').parse().ok()).collect()
}

/// Type of one stored number, or of each of the two parts of a complex one.
#[derive(Clone, Copy)]
struct Kind {
    number: Number,
    complex: bool,
    big_endian: bool,
    /// Bytes of one part: 1, 2, 4 or 8.
    size: usize,
}

#[derive(Clone, Copy)]
enum Number {
    Float,
    Signed,
    Unsigned,
}

impl Kind {
    /// `<f8` and its like.
    fn parse(descr: &str) -> Option<Self> {
        let (order, rest) = match descr.as_bytes().first()? {
            b'<' | b'|' | b'=' => (false, &descr[1..]),
            b'>' => (true, &descr[1..]),
            _ => (false, descr),
        };
        let (number, complex, size) = match rest {
            "f4" => (Number::Float, false, 4),
            "f8" => (Number::Float, false, 8),
            "c8" => (Number::Float, true, 4),
            "c16" => (Number::Float, true, 8),
            "i1" => (Number::Signed, false, 1),
            "i2" => (Number::Signed, false, 2),
            "i4" => (Number::Signed, false, 4),
            "i8" => (Number::Signed, false, 8),
            "u1" => (Number::Unsigned, false, 1),
            "u2" => (Number::Unsigned, false, 2),
            "u4" => (Number::Unsigned, false, 4),
            "u8" => (Number::Unsigned, false, 8),
            _ => return None,
        };
        Some(Self { number, complex, big_endian: order, size })
    }

    const fn parts(self) -> usize {
        if self.complex { 2 } else { 1 }
    }

    const fn bytes(self) -> usize {
        self.parts() * self.size
    }

    /// One part out of its `size` bytes. Integers beyond 2^53 are rounded.
    fn value(self, bytes: &[u8]) -> f64 {
        // the number as the low bytes of 8, least significant first
        let mut wide = [0; 8];
        for (slot, index) in wide.iter_mut().zip(0..bytes.len()) {
            *slot = bytes[if self.big_endian { bytes.len() - 1 - index } else { index }];
        }
        let raw = u64::from_le_bytes(wide);
        match self.number {
            // the low 4 bytes are all that were filled
            Number::Float if self.size == 4 => f64::from(f32::from_bits(raw as u32)),
            Number::Float => f64::from_bits(raw),
            Number::Unsigned => raw as f64,
            Number::Signed => {
                let unused = 64 - 8 * self.size as u32;
                ((raw << unused) as i64 >> unused) as f64
            }
        }
    }
}
