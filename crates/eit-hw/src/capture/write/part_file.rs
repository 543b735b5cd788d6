//! New files that have their name only once they are complete.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

use super::storage::lock;
use crate::capture::parts::check_new;
use crate::error::{HwError, Place};

/// A new file `press.mcap` while it is written as `press.mcap.part`.
///
/// Dropped without [`keep`](Self::keep), the file is removed. A killed program leaves the part, which
/// the next one overwrites.
#[derive(Debug)]
pub struct PartFile {
    path: PathBuf,
    part: PathBuf,
    is_kept: bool,
}

impl PartFile {
    /// Creates the part of a new recording and returns it with its open file, which is locked.
    ///
    /// # Errors
    /// [`HwError::Exists`] if the recording exists, [`HwError::Busy`] if another program is writing
    /// it, [`HwError::NotAFile`] if something other than a file has the name of the part, and
    /// [`HwError::Write`] if it cannot be created.
    pub fn create(path: impl AsRef<Path>) -> Result<(Self, File), HwError> {
        let path = path.as_ref();
        check_new(path)?;
        let part = Self::part_of(path);
        let failed = |source| HwError::Write { place: Place::file(path), source };
        // opening a pipe without a reader would block forever
        if std::fs::symlink_metadata(&part).is_ok_and(|data| !data.is_file()) {
            return Err(HwError::NotAFile { place: Place::file(&part) });
        }
        // a part of another program must not be cut before it is known to be free
        let options =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&part);
        let file = options.map_err(failed)?;
        lock(&file, &part)?;
        file.set_len(0).map_err(failed)?;
        Ok((Self { path: path.to_path_buf(), part, is_kept: false }, file))
    }

    /// Returns the path at which the file `path` is written.
    pub fn part_of(path: impl AsRef<Path>) -> PathBuf {
        let mut name = path.as_ref().as_os_str().to_owned();
        name.push(".part");
        PathBuf::from(name)
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// [`HwError::Exists`] if another program created a recording of that name meanwhile; the part is
    /// removed then. [`HwError::Write`] if it cannot be renamed.
    pub fn keep(mut self) -> Result<(), HwError> {
        let failed = |source| HwError::Write { place: Place::file(&self.path), source };
        match std::fs::hard_link(&self.part, &self.path) {
            // the part is removed below
            Ok(()) => return Ok(()),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                return Err(HwError::Exists { place: Place::file(&self.path) });
            }
            // file systems of memory cards and sticks have no links
            Err(_) => check_new(&self.path)?,
        }
        std::fs::rename(&self.part, &self.path).map_err(failed)?;
        self.is_kept = true;
        Ok(())
    }
}

impl Drop for PartFile {
    fn drop(&mut self) {
        if !self.is_kept {
            // a destructor cannot report a failure
            let _ = std::fs::remove_file(&self.part);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a panic is a failed test")]
mod tests {
    use super::*;
    use std::io::Write as _;

    #[test]
    fn a_file_has_its_name_once_it_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let names = || {
            let entries = std::fs::read_dir(folder.path()).unwrap();
            let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
            names.sort();
            names
        };
        // one that is not kept, as after an error
        let (part, mut file) = PartFile::create(&path).unwrap();
        file.write_all(b"lost").unwrap();
        assert_eq!(names(), ["a.mcap.part"]);
        assert!(matches!(PartFile::create(&path), Err(HwError::Busy { .. })));
        drop((part, file));
        assert!(names().is_empty());
        // a part left by a killed program is overwritten
        std::fs::write(folder.path().join("a.mcap.part"), b"a longer leftover").unwrap();
        let (part, mut file) = PartFile::create(&path).unwrap();
        file.write_all(b"whole").unwrap();
        drop(file);
        part.keep().unwrap();
        assert_eq!(names(), ["a.mcap"]);
        assert_eq!(std::fs::read(&path).unwrap(), b"whole");
        assert!(matches!(PartFile::create(&path), Err(HwError::Exists { .. })));
    }

    #[test]
    fn a_file_that_appears_meanwhile_is_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let (part, file) = PartFile::create(&path).unwrap();
        drop(file);
        std::fs::write(&path, b"of another program").unwrap();
        assert!(matches!(part.keep(), Err(HwError::Exists { .. })));
        assert_eq!(std::fs::read(&path).unwrap(), b"of another program");
        assert!(!folder.path().join("a.mcap.part").exists());
        std::fs::create_dir(folder.path().join("b.mcap.part")).unwrap();
        let refused = PartFile::create(folder.path().join("b.mcap")).unwrap_err();
        assert!(matches!(refused, HwError::NotAFile { .. }), "{refused}");
    }
}
