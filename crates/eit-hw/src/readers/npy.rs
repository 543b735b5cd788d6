//! NumPy `.npy` arrays of numbers.
//!
//! Parsed here and not by `ndarray-npy`: its header parser recurses on nested brackets, and frames
//! need one real or complex matrix whatever the stored type. Format: NumPy enhancement proposal 1.

use std::path::Path;

use ndarray::Array2;

use super::{Format, file_bytes, table};
use crate::error::{HwError, Place, shortened};
use crate::recording::{Layout, Note, Recording, Unit};

/// First bytes of every `.npy` file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

const MEND: &str = "save it anew with numpy.save of a plain numeric array";

/// How an array is laid out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NpyOptions {
    /// The array is one frame as a matrix [measurement, pattern], taken with the measurements of
    /// one pattern after the other. Without this it is [frame, measurement].
    pub matrix: bool,
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
/// axis order. `[measurement]` and a matrix of one column are one frame, `[frame, measurement]`
/// several; see [`NpyOptions::matrix`] for `[measurement, pattern]`. The layout is
/// [`Layout::AsScene`], the unit [`Unit::Arbitrary`].
///
/// # Errors
/// [`HwError`] for an empty file, a damaged header, another type or shape, more or fewer bytes than
/// the header states, and a NaN or infinite value.
pub fn parse(bytes: &[u8], path: &Path, options: &NpyOptions) -> Result<Recording, HwError> {
    let Header { first_byte, kind, fortran, shape } = Header::parse(bytes, path)?;
    let (rows, columns) = match shape[..] {
        [values] | [values, 1] => (1, values),
        [rows, columns] => (rows, columns),
        _ => return Err(HwError::Shape { place: Place::file(path), shape }),
    };
    let data = &bytes[first_byte..];
    let wanted = rows.checked_mul(columns).and_then(|count| count.checked_mul(kind.bytes()));
    if wanted != Some(data.len()) {
        return Err(HwError::Count {
            place: Place::byte(path, first_byte),
            what: "bytes of data",
            found: data.len(),
            wanted: wanted.unwrap_or(usize::MAX),
            mend: "the file is cut or holds more than one array: copy or save it anew",
        });
    }
    let one_frame = options.matrix && rows > 1;
    let matrix = Matrix { data, first_byte, kind, rows, columns, fortran, one_frame };
    let real = matrix.part(0, path)?;
    let imaginary = if kind.complex { Some(matrix.part(1, path)?) } else { None };
    let mut recording =
        Recording::new(real, imaginary, Layout::AsScene, Unit::Arbitrary, Format::Npy, path);
    if matches!(shape[..], [_, 1]) {
        recording.notes.push(Note::OneColumn { rows: columns });
    }
    Ok(recording)
}

/// The stored numbers, exactly `rows * columns` of them.
struct Matrix<'a> {
    data: &'a [u8],
    first_byte: usize,
    kind: Kind,
    rows: usize,
    columns: usize,
    fortran: bool,
    one_frame: bool,
}

impl Matrix<'_> {
    /// Real (0) or imaginary (1) parts, [frame, value].
    fn part(&self, part: usize, path: &Path) -> Result<Array2<f64>, HwError> {
        let count = self.rows * self.columns;
        let values = if self.one_frame { count } else { self.columns };
        let mut list = Vec::with_capacity(count);
        for index in 0..count {
            let at = self.stored(index) * self.kind.bytes() + part * self.kind.size;
            let value = self.kind.value(&self.data[at..at + self.kind.size]);
            if !value.is_finite() {
                let place = Place::byte(path, self.first_byte + at);
                let (frame, measurement) = (index / values, index % values);
                return Err(HwError::NonFinite { place, frame, measurement, value });
            }
            list.push(value);
        }
        table::frames(list, values, path, 0)
    }

    /// Where the value `index` of the frames stands in the file.
    fn stored(&self, index: usize) -> usize {
        match (self.one_frame, self.fortran) {
            // [measurement, pattern] with measurements fastest is the order of a Fortran array
            (false, false) | (true, true) => index,
            (false, true) => index % self.columns * self.rows + index / self.columns,
            (true, false) => index % self.rows * self.columns + index / self.rows,
        }
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
