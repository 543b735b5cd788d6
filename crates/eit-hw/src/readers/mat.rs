//! MATLAB files of version 5, which MATLAB's `save` with `-v6` or `-v7` and `scipy.io.savemat` write.
//!
//! Format: "MAT-File Format", MathWorks. Parsed here because the published crates put no bound on
//! what an array unpacks to, or lose arrays (docs/DESIGN.md).

mod stream;
mod variable;

use std::path::Path;

use self::variable::Variable;
use super::ReadOptions;
use super::array::Array;
use super::arrays::choose;
use crate::error::{HwError, Place};
use crate::recording::{Format, Recording};

const HEADER_BYTES: usize = 128;

/// Returns whether the numbers of a file with this header are big-endian; `None` if it is of another
/// kind.
fn is_big_endian(bytes: &[u8]) -> Option<bool> {
    match bytes.get(HEADER_BYTES - 4..HEADER_BYTES)? {
        [0, 1, b'I', b'M'] => Some(false),
        [1, 0, b'M', b'I'] => Some(true),
        _ => None,
    }
}

/// Parses the content of a MATLAB file; `path` is used in messages only.
///
/// Reads arrays of numbers of any class, also complex ones.
///
/// # Errors
/// [`HwError`] for a file of another version, a damaged one, and those of [`choose`] and
/// [`Array::recording`].
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    options: &ReadOptions,
) -> Result<Recording, HwError> {
    let Some(big_endian) = is_big_endian(bytes) else {
        return Err(HwError::Container {
            place: Place::file(path),
            what: "is not a MATLAB file of version 5".to_owned(),
            mend: "load it in MATLAB and write the matrix [frame, measurement] by save('frames.mat', 'v', '-v7')",
        });
    };
    let (mut list, mut variables) = (Vec::new(), Vec::new());
    let mut at = HEADER_BYTES;
    while at < bytes.len() {
        let (variable, end) = Variable::at(at, bytes, big_endian, path)?;
        at = end;
        let listed = variable.listed()?;
        // MATLAB keeps its own data of objects in an array without a name
        if !listed.name.is_empty() {
            list.push(listed);
            variables.push(variable);
        }
    }
    let chosen = choose(&list, options, path)?;
    let [real, imaginary] = variables[chosen.index].parts()?;
    let Some(real) = &real else {
        return Err(HwError::NoFrames { place: Place::file(path), skipped: 0 });
    };
    let array = Array {
        shape: list[chosen.index].shape.clone(),
        fortran: true,
        real: real.numbers(),
        imaginary: imaginary.as_ref().map(|part| part.numbers()),
    };
    chosen.recording(array, Format::Mat, options, path)
}
