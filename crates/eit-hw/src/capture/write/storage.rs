//! The file of a recording, and the trait through which the writer uses it.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::capture::container::MAGIC;
use crate::capture::records::Damage;
use crate::error::{HwError, Place};
use crate::regular::regular_file;

/// The target of a recording. Tests replace it with a disk that fails and loses unsynced data.
pub(super) trait Storage: Send {
    /// Appends all bytes.
    fn append(&mut self, bytes: &[u8]) -> io::Result<()>;
    /// Forces written data to the disk.
    fn sync(&mut self) -> io::Result<()>;
    /// Truncates the file to this length.
    fn cut(&mut self, bytes: u64) -> io::Result<()>;
    /// Returns whether the file was removed: what is written to it is lost.
    fn is_removed(&self) -> bool {
        false
    }
}

/// A file, locked while it is written so that a second recorder is rejected.
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

    #[cfg(unix)]
    fn is_removed(&self) -> bool {
        use std::os::unix::fs::MetadataExt as _;
        self.metadata().is_ok_and(|data| data.nlink() == 0)
    }
}

/// The folder of a recording, in which its files are created. Tests replace it with one that fails.
pub(super) trait Folder: Send {
    /// Creates a new file that no other recorder can write to.
    fn create(&mut self, path: &Path) -> Result<Box<dyn Storage>, HwError>;
    /// Forces the name of a new file to the disk.
    fn sync(&mut self, path: &Path) -> io::Result<()>;
    /// Removes a file.
    fn remove(&mut self, path: &Path) -> io::Result<()>;
}

/// The folders of this computer.
pub(super) struct Folders;

impl Folder for Folders {
    fn create(&mut self, path: &Path) -> Result<Box<dyn Storage>, HwError> {
        let file = create_new(path)?;
        lock(&file, path)?;
        Ok(Box::new(file))
    }

    fn sync(&mut self, path: &Path) -> io::Result<()> {
        sync_folder(path)
    }

    fn remove(&mut self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }
}

/// Creates a new file; with `sync`, its name also survives a power cut.
pub(super) fn create(
    folder: &mut dyn Folder,
    path: &Path,
    sync: bool,
) -> Result<Box<dyn Storage>, HwError> {
    let file = folder.create(path)?;
    if sync && let Err(source) = folder.sync(path) {
        // nothing has been written to it
        let _ = folder.remove(path);
        return Err(HwError::Write { place: Place::file(path), source });
    }
    Ok(file)
}

/// Creates a file; fails if one of that name exists.
pub(in crate::capture) fn create_new(path: &Path) -> Result<File, HwError> {
    let file = OpenOptions::new().read(true).write(true).create_new(true).open(path);
    file.map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => HwError::Exists { place: Place::file(path) },
        _ => HwError::Write { place: Place::file(path), source },
    })
}

/// Opens an existing recording for appending.
pub(super) fn open(path: &Path) -> Result<File, HwError> {
    regular_file(path)?;
    let failed = |source| HwError::Write { place: Place::file(path), source };
    let file = OpenOptions::new().read(true).write(true).open(path).map_err(failed)?;
    lock(&file, path)?;
    Ok(file)
}

pub(super) fn lock(file: &File, path: &Path) -> Result<(), HwError> {
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => Err(HwError::Busy { place: Place::file(path) }),
        // a file system without locks cannot reject anybody
        Ok(()) | Err(TryLockError::Error(_)) => Ok(()),
    }
}

/// What was cut off the end of a recording before appending to it, and where it was saved.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CutTail {
    /// Number of bytes.
    pub bytes: u64,
    /// File next to the recording to which the bytes were saved.
    pub path: PathBuf,
}

/// Cuts the index and everything after the last complete record off the end of a recording.
/// Whatever is not the index is first saved to a file next to it. Returns the remaining length and
/// what was saved.
pub(super) fn cut_tail(
    file: &mut File,
    path: &Path,
    whole: u64,
    damage: Damage,
) -> Result<(u64, Option<CutTail>), HwError> {
    let failed = |source| HwError::Write { place: Place::file(path), source };
    let cut = if damage.unfinished { keep_tail(file, path, whole)? } else { None };
    // without any complete record the magic and header are written again
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
    // and its name, before the recording is cut
    copied.and_then(|()| sync_folder(&place)).map_err(unkept)?;
    Ok(Some(CutTail { bytes, path: place }))
}

/// Creates a new file `NAME.cut`, or `NAME.cut2` and so on if that exists.
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
