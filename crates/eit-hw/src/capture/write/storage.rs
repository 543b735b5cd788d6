//! The file of a recording, and what the writer needs of it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::capture::container::MAGIC;
use crate::capture::records::Damage;
use crate::error::{HwError, Place};
use crate::regular::regular_file;

/// What a recording is written to. A test's disk fails, and forgets what was not forced.
pub(super) trait Storage: Send {
    /// Writes all bytes behind those written before.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;
    /// Forces to the disk what was written.
    fn sync(&mut self) -> io::Result<()>;
    /// Cuts what is behind so many bytes.
    fn cut(&mut self, bytes: u64) -> io::Result<()>;
}

/// A file that stays locked while it is written, so that a second recorder is refused.
impl Storage for File {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }

    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.set_len(bytes)?;
        self.seek(SeekFrom::Start(bytes)).map(|_| ())
    }
}

/// A new file; with `sync` its name survives a power cut, too.
pub(super) fn create(path: &Path, sync: bool) -> Result<File, HwError> {
    let failed = |source| HwError::Write { place: Place::file(path), source };
    let file =
        OpenOptions::new().read(true).write(true).create_new(true).open(path).map_err(failed)?;
    lock(&file, path)?;
    if sync {
        sync_folder(path).map_err(failed)?;
    }
    Ok(file)
}

/// The file of a recording to go on with.
pub(super) fn open(path: &Path) -> Result<File, HwError> {
    regular_file(path)?;
    let failed = |source| HwError::Write { place: Place::file(path), source };
    let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
    lock(&file, path)?;
    Ok(file)
}

fn lock(file: &File, path: &Path) -> Result<(), HwError> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(HwError::Busy { place: Place::file(path) }),
        // a file system without locks: nobody can be refused there
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
    }
}

/// What was cut off the end of a recording to go on with it, and where it is kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CutTail {
    /// How many bytes.
    pub bytes: u64,
    /// The file beside the recording that holds them.
    pub path: PathBuf,
}

/// Cuts what is no whole record off the end of a recording, and its index. What is cut and no index
/// is kept beside it first. The bytes that are left, and what was kept.
pub(super) fn cut_tail(
    file: &mut File,
    path: &Path,
    whole: u64,
    damage: Damage,
) -> Result<(u64, Option<CutTail>), HwError> {
    let failed = |source| HwError::Write { place: Place::file(path), source };
    let cut = if damage.unfinished { keep_tail(file, path, whole)? } else { None };
    // no record is whole: what begins the file is written anew
    let whole = if whole > MAGIC.len() as u64 { whole } else { 0 };
    file.cut(whole).map_err(failed)?;
    Ok((whole, cut))
}

fn keep_tail(file: &mut File, path: &Path, whole: u64) -> Result<Option<CutTail>, HwError> {
    let failed = |source| HwError::Read { place: Place::file(path), source };
    let bytes = file.metadata().map_err(failed)?.len().saturating_sub(whole);
    if bytes == 0 {
        return Ok(None);
    }
    let (mut kept, place) = beside(path)?;
    let unkept = |source| HwError::Write { place: Place::file(&place), source };
    file.seek(SeekFrom::Start(whole)).map_err(failed)?;
    let copied = io::copy(&mut file.take(bytes), &mut kept).and_then(|_| kept.sync_all());
    // its name, too: the recording is cut next
    copied.and_then(|()| sync_folder(&place)).map_err(unkept)?;
    Ok(Some(CutTail { bytes, path: place }))
}

/// A new file `NAME.cut`, or `NAME.cut2` and so on where that exists.
fn beside(path: &Path) -> Result<(File, PathBuf), HwError> {
    let mut number = 1_u32;
    loop {
        let mut name = path.as_os_str().to_owned();
        name.push(".cut");
        if number > 1 {
            name.push(number.to_string());
        }
        let place = PathBuf::from(name);
        match OpenOptions::new().write(true).create_new(true).open(&place) {
            Ok(file) => return Ok((file, place)),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
            Err(source) => return Err(HwError::Write { place: Place::file(&place), source }),
        }
    }
}

/// Forces the name of a new file to the disk.
fn sync_folder(path: &Path) -> io::Result<()> {
    if cfg!(unix) {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        File::open(folder.unwrap_or(Path::new(".")))?.sync_all()?;
    }
    Ok(())
}
