//! Files that can be read to their end.

use std::fs::File;
use std::path::Path;

use crate::error::{HwError, Place};

/// Opens a file; a device, a pipe or a folder is refused, since it may have no end.
///
/// # Errors
/// [`HwError::Read`] and [`HwError::NotAFile`].
pub fn regular_file(path: &Path) -> Result<File, HwError> {
    let failed = |source| HwError::Read { place: Place::file(path), source };
    // before it is opened: a pipe without a writer would wait for ever
    if !std::fs::metadata(path).map_err(failed)?.is_file() {
        return Err(HwError::NotAFile { place: Place::file(path) });
    }
    File::open(path).map_err(failed)
}
