//! Files that are written whole or not at all.

use crate::DenoiseError;
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Writes a temporary file and renames it. A program that is killed meanwhile leaves the temporary file,
/// which the next one that writes the same file replaces.
///
/// # Errors
/// [`DenoiseError::Io`].
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), DenoiseError> {
    let failed = |e: &std::io::Error| DenoiseError::io(path, e);
    let (mut file, temporary) = temporary_of(path).map_err(|e| failed(&e))?;
    // flushed to the disk before it gets its name
    let written = file
        .write_all(bytes)
        .and_then(|()| file.sync_all())
        .and_then(|()| std::fs::rename(&temporary, path));
    written.map_err(|e| {
        // created above; the first error matters more
        let _ = std::fs::remove_file(&temporary);
        failed(&e)
    })
}

/// Creates the temporary file of a file, `.eit-NAME`, or with a number if another program is writing one.
fn temporary_of(path: &Path) -> std::io::Result<(File, PathBuf)> {
    for number in 0_u32.. {
        let mut name = std::ffi::OsString::from(".eit-");
        name.push(path.file_name().unwrap_or_default());
        if number > 0 {
            name.push(format!(".{number}"));
        }
        let place = path.with_file_name(name);
        let create = || File::options().write(true).create_new(true).open(&place);
        let file = match create() {
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
                // locked: another program is writing it; unlocked: left by one that was killed
                if !File::open(&place).is_ok_and(|file| file.try_lock().is_ok()) {
                    continue;
                }
                std::fs::remove_file(&place)?;
                create()?
            }
            created => created?,
        };
        // where there are no locks, no file counts as left
        let _ = file.try_lock();
        return Ok((file, place));
    }
    Err(std::io::ErrorKind::AlreadyExists.into())
}
