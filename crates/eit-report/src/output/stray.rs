//! Temporary files of a program that is about to be ended by a signal: no destructor removes them.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Every temporary file created so far, including those that were renamed.
static TEMPORARIES: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Registers a temporary file; those of this module are registered already.
pub fn remember(path: impl AsRef<Path>) {
    let path = path.as_ref();
    let mut all = TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner);
    // relative paths would follow a change of the current folder
    all.push(std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()));
}

/// Removes the temporary files of all output that is not complete. Call it only before the program ends:
/// whatever is being written can no longer be completed.
pub fn remove_temporaries() {
    for path in TEMPORARIES.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        // most of them have been renamed or removed
        let _ = std::fs::remove_file(path);
    }
}
