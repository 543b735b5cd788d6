//! Files of a recording: their content, names, and the numbers in the names.

use std::fs;
use std::io::Read;
use std::path::Path;

use crate::error::{HwError, Place};
use crate::recording::Note;
use crate::regular::regular_file;

/// Reads a file; a folder is an error of its own.
pub(super) fn file_bytes(path: &Path, format: &'static str) -> Result<Vec<u8>, HwError> {
    if path.is_dir() {
        return Err(HwError::Folder { place: Place::file(path), format });
    }
    let failed = |source| HwError::Read { place: Place::file(path), source };
    let mut bytes = Vec::new();
    regular_file(path)?.read_to_end(&mut bytes).map_err(failed)?;
    Ok(bytes)
}

/// Returns the names of the files in a folder, sorted. Names that are not valid text belong to no
/// format and are omitted.
pub(super) fn file_names(folder: &Path) -> Result<Vec<String>, HwError> {
    let unreadable = |source| HwError::Read { place: Place::file(folder), source };
    let mut names = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        names.extend(entry.map_err(unreadable)?.file_name().into_string());
    }
    names.sort();
    Ok(names)
}

/// Returns a note if sorted numbers have gaps.
pub(super) fn missing_numbers(numbers: impl Iterator<Item = u64>) -> Option<Note> {
    let (mut count, mut first, mut before) = (0, None, None);
    for number in numbers {
        if let Some(before) = before {
            let gap = number.saturating_sub(before).saturating_sub(1);
            if gap > 0 {
                first = first.or(Some(before + 1));
                count += gap;
            }
        }
        before = Some(number);
    }
    first.map(|first| Note::MissingFrameFiles { count, first })
}
