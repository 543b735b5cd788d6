//! NumPy `.npy` arrays of numbers.
//!
//! Parsed here and not by `ndarray-npy`, whose header parser recurses on nested brackets, and
//! because frames need a real or complex matrix whatever the stored type. Format: NumPy enhancement
//! proposal 1.

mod header;

use std::path::Path;

use ndarray::{ArrayD, IxDyn, ShapeBuilder};

pub(super) use self::header::Header;
use super::array::Array;
use super::files::file_bytes;
use super::number::Numbers;
use super::wrong_field;
use crate::error::{HwError, Place};
use crate::recording::Format;

/// First bytes of every `.npy` file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

const MEND: &str = "save it again with numpy.save as a plain numeric array";

/// Parses the content of an NPY file; `path` is used in messages only.
///
/// Accepts integers of 1 to 8 bytes, floats of 4 and 8 and complex numbers of 8 and 16, in either
/// byte and axis order.
///
/// # Errors
/// [`HwError`] for an empty file, a damaged header, another type, and more or fewer bytes than the
/// header states.
pub(super) fn parse<'a>(bytes: &'a [u8], path: &Path) -> Result<Array<'a>, HwError> {
    let header = Header::parse(bytes, path)?;
    let data = &bytes[header.first_byte..];
    let wanted = header.data_bytes();
    if wanted != Some(data.len()) {
        return Err(HwError::count(
            Place::byte(path, header.first_byte),
            "bytes of data",
            [data.len(), wanted.unwrap_or(usize::MAX)],
            "the file is truncated or contains more than one array: copy or save it again",
        ));
    }
    let Header { kind, complex, fortran, shape, .. } = header;
    let stride = if complex { 2 * kind.size } else { kind.size };
    let from = |first: usize| {
        let bytes = data.get(first..).unwrap_or_default();
        Numbers { kind, bytes, stride }
    };
    Ok(Array { shape, fortran, real: from(0), imaginary: complex.then(|| from(kind.size)) })
}

/// Reads real numbers of any shape from an NPY file.
///
/// # Errors
/// [`HwError::Read`] if the file cannot be read, [`HwError`] for an empty or damaged file and for
/// complex numbers.
pub fn read_array(path: impl AsRef<Path>) -> Result<ArrayD<f64>, HwError> {
    let path = path.as_ref();
    let bytes = file_bytes(path, Format::Npy.name())?;
    let Array { shape, fortran, real, imaginary } = parse(&bytes, path)?;
    if imaginary.is_some() {
        return Err(wrong_field(Place::file(path), "type", "complex", "real numbers", MEND));
    }
    let shape = IxDyn(&shape).set_f(fortran);
    let none = |_| HwError::NoFrames { place: Place::file(path), skipped: 0 };
    ArrayD::from_shape_vec(shape, real.values().collect()).map_err(none)
}
