//! Opening of files that have an end.

use std::fs::File;
use std::path::Path;

use crate::error::{HwError, Place};

/// Opens a regular file. Rejects a device, pipe or folder, which may have no end.
///
/// # Errors
/// [`HwError::Read`] if it cannot be opened, and [`HwError::NotAFile`].
pub fn regular_file(path: impl AsRef<Path>) -> Result<File, HwError> {
    let path = path.as_ref();
    let failed = |source| HwError::Read { place: Place::file(path), source };
    // checked before opening: opening a pipe without a writer would block forever
    if !std::fs::metadata(path).map_err(failed)?.is_file() {
        return Err(HwError::NotAFile { place: Place::file(path) });
    }
    File::open(path).map_err(failed)
}
