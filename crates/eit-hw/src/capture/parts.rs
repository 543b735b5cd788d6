//! Recordings split into several files: `press.00001.mcap`, `press.00002.mcap` and so on are the
//! parts of `press.mcap`.

use std::collections::VecDeque;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use super::container::MAGIC;
use super::records::Records;
use crate::error::{HwError, Place};
use crate::regular::regular_file;

/// Least number of digits of a part's number; with them, up to 99 999 parts sort by name.
const DIGITS: usize = 5;

/// One file of a split recording.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Part {
    /// Number in the file name, from 1; 0 for a recording that is not split.
    pub(crate) number: u32,
    pub(crate) path: PathBuf,
}

impl Part {
    /// Returns part `number` of the recording `path`.
    pub(super) fn of(path: &Path, number: u32) -> Self {
        let mut name = path.file_stem().map_or_else(OsString::new, OsString::from);
        name.push(format!(".{number:0DIGITS$}"));
        if let Some(ending) = path.extension() {
            name.push(".");
            name.push(ending);
        }
        Self { number, path: path.with_file_name(name) }
    }
}

/// Returns the existing parts of the recording `path`, in order.
pub(super) fn parts_of(path: &Path) -> Vec<Part> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let Ok(entries) = std::fs::read_dir(folder.unwrap_or(Path::new("."))) else {
        return Vec::new();
    };
    let mut start = path.file_stem().map_or_else(OsString::new, OsString::from);
    start.push(".");
    let mut end = OsString::new();
    if let Some(ending) = path.extension() {
        end.push(".");
        end.push(ending);
    }
    let number = |name: &[u8]| {
        let digits = name
            .strip_prefix(start.as_encoded_bytes())?
            .strip_suffix(end.as_encoded_bytes())
            .filter(|digits| digits.len() >= DIGITS && digits.iter().all(u8::is_ascii_digit))?;
        std::str::from_utf8(digits).ok()?.parse::<u32>().ok().filter(|number| *number > 0)
    };
    let mut parts: Vec<Part> = entries
        .filter_map(|entry| {
            let name = entry.ok()?.file_name();
            let number = number(name.as_encoded_bytes())?;
            Some(Part { number, path: path.with_file_name(name) })
        })
        .collect();
    parts.sort();
    // `1.000001` besides `1.00001` is not ours
    parts.dedup_by_key(|part| part.number);
    parts
}

/// Returns the files of the recording `path`: the file of that name or, if there is none, its parts
/// in order. Without either, the file of that name, which cannot be opened.
pub fn files(path: impl AsRef<Path>) -> Vec<PathBuf> {
    let path = path.as_ref();
    let parts = if path.exists() { Vec::new() } else { parts_of(path) };
    match parts.is_empty() {
        true => vec![path.to_path_buf()],
        false => parts.into_iter().map(|part| part.path).collect(),
    }
}

/// Checks that a new recording may have the name `path`: neither the file nor a part exists.
///
/// # Errors
/// [`HwError::Exists`].
pub fn check_new(path: impl AsRef<Path>) -> Result<(), HwError> {
    let path = path.as_ref();
    match files(path).into_iter().find(|file| file.exists()) {
        None => Ok(()),
        Some(found) => Err(HwError::Exists { place: Place::file(&found) }),
    }
}

/// Returns whether the file `path` begins as a recording, or parts of that name do.
///
/// # Errors
/// [`HwError::Read`] if it cannot be read, and [`HwError::NotAFile`].
pub fn is_recording(path: impl AsRef<Path>) -> Result<bool, HwError> {
    let path = path.as_ref();
    for file in files(path) {
        let failed = |source| HwError::Read { place: Place::file(&file), source };
        let mut start = Vec::new();
        regular_file(&file)?.take(MAGIC.len() as u64).read_to_end(&mut start).map_err(failed)?;
        if start == MAGIC {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Opens the files of a recording one after the other.
#[derive(Debug)]
pub(super) struct Files<R> {
    left: VecDeque<Part>,
    open: fn(&Path) -> Result<R, HwError>,
    /// Number of the part that follows the last one opened.
    next: u32,
    /// Number of parts that do not exist or do not begin as a recording.
    pub(crate) missing: usize,
    /// Total length in bytes.
    pub(crate) bytes: u64,
}

impl Files<BufReader<File>> {
    /// Finds the files of the recording `path`.
    pub(super) fn of(path: &Path) -> Self {
        let parts = if path.exists() { Vec::new() } else { parts_of(path) };
        let left = match parts.is_empty() {
            true => VecDeque::from([Part { number: 0, path: path.to_path_buf() }]),
            false => VecDeque::from(parts),
        };
        let length = |part: &Part| part.path.metadata().map_or(0, |data| data.len());
        let bytes = left.iter().map(length).sum();
        let open = |path: &Path| Ok(BufReader::with_capacity(1 << 16, regular_file(path)?));
        Self { left, open, next: 1, missing: 0, bytes }
    }
}

impl<R: Read + Seek> Files<R> {
    /// Opens the next file; `None` at the end. Of a split recording, parts that are missing, empty
    /// or no recording are counted and skipped.
    pub(super) fn next(&mut self) -> Result<Option<Records<R>>, HwError> {
        while let Some(Part { number, path }) = self.left.pop_front() {
            self.missing += number.saturating_sub(self.next) as usize;
            self.next = number.saturating_add(1);
            let opened = (self.open)(&path).and_then(|source| Records::new(source, &path));
            match opened {
                Ok(records) => return Ok(Some(records)),
                Err(error) if number == 0 || !is_missing(&error) => return Err(error),
                Err(_) => self.missing += 1,
            }
        }
        Ok(None)
    }

    /// Opens the first file.
    pub(super) fn first(&mut self, path: &Path) -> Result<Records<R>, HwError> {
        self.next()?.ok_or_else(|| HwError::Empty { place: Place::file(path) })
    }
}

/// Whether a part was deleted, or created by a program that was killed before it wrote anything.
fn is_missing(error: &HwError) -> bool {
    match error {
        HwError::Empty { .. } | HwError::Container { .. } => true,
        HwError::Read { source, .. } => source.kind() == io::ErrorKind::NotFound,
        _ => false,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn parts_are_named_and_found_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.b.mcap");
        let name = |number| Part::of(&path, number).path.file_name().unwrap().to_owned();
        assert_eq!(name(1), "a.b.00001.mcap");
        assert_eq!(name(123_456), "a.b.123456.mcap");
        assert_eq!(files(&path), std::slice::from_ref(&path));
        let others = ["a.b.1.mcap", "a.b.00000.mcap", "a.b.0001x.mcap", "a.00001.mcap", "b.00001"];
        for other in others {
            std::fs::write(folder.path().join(other), b"").unwrap();
        }
        assert_eq!(parts_of(&path), []);
        let wanted = [3, 12, 99_999, 100_000].map(|number| Part::of(&path, number));
        for part in wanted.iter().rev() {
            std::fs::write(&part.path, b"").unwrap();
        }
        assert_eq!(parts_of(&path), wanted);
        assert_eq!(files(&path), wanted.map(|part| part.path));
        // a file of that name comes first
        std::fs::write(&path, b"").unwrap();
        assert_eq!(files(&path), [path]);
        // without an ending, and in the current folder
        assert_eq!(Part::of(Path::new("press"), 7).path, Path::new("press.00007"));
    }
}
