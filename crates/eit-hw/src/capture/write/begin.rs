//! Begins recordings: new ones, copies, and what is appended to.

use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use super::part_file::PartFile;
use super::split::Parts;
use super::storage::{Folder, Folders};
use super::{CaptureSettings, CaptureWriter, storage};
use crate::capture::entry::Entry;
use crate::capture::parts::{Part, check_new, parts_of};
use crate::capture::record::SessionRecord;
use crate::capture::stream::{CaptureReader, MessageTimes};
use crate::error::{HwError, Place};

impl CaptureWriter {
    /// Creates a new file and starts a recording in it.
    ///
    /// # Errors
    /// [`HwError::Exists`] if the file or a part of it already exists; [`HwError::Write`] if it
    /// cannot be created; [`HwError::Setting`] if `flush_s` is not above 0 or a limit of the parts is too low.
    pub fn create(
        path: impl AsRef<Path>,
        session: &SessionRecord,
        settings: CaptureSettings,
    ) -> Result<Self, HwError> {
        let path = path.as_ref();
        Self::begin(Self::new(path, session, settings)?, session)
    }

    /// Creates a copy of another recording, with `times` for the session message if it has some: like
    /// [`create`](Self::create), but the file has its name only once [`finish`](Self::finish) returns,
    /// and `.part` behind it until then. Dropped before, as after an error, it leaves no file: half a
    /// copy could be taken for all there is. With a split, parts are written as `create` does.
    ///
    /// # Errors
    /// Those of [`create`](Self::create) and [`PartFile::create`].
    pub fn create_copy(
        path: impl AsRef<Path>,
        session: &SessionRecord,
        settings: CaptureSettings,
        times: Option<MessageTimes>,
    ) -> Result<Self, HwError> {
        let path = path.as_ref();
        let mut capture = if settings.is_split() {
            Self::new(path, session, settings)?
        } else {
            settings.check()?;
            let (part, file) = PartFile::create(path)?;
            let mut capture = Self::on(Box::new(file), path, settings, 0)?;
            capture.part = Some(part);
            capture
        };
        match times {
            None => capture.session(session)?,
            Some(times) => capture.write_at(&Entry::Session(session.clone()), times)?,
        }
        capture.flush()?;
        Ok(capture)
    }

    /// Creates the file, or the first part.
    fn new(
        path: &Path,
        session: &SessionRecord,
        settings: CaptureSettings,
    ) -> Result<Self, HwError> {
        settings.check()?;
        check_new(path)?;
        Self::new_in(Box::new(Folders), path, session, settings)
    }

    /// Creates the file, or the first part, in a folder.
    pub(super) fn new_in(
        mut folder: Box<dyn Folder>,
        path: &Path,
        session: &SessionRecord,
        settings: CaptureSettings,
    ) -> Result<Self, HwError> {
        let is_split = settings.is_split();
        let place = if is_split { Part::of(path, 1).path } else { path.to_path_buf() };
        let file = storage::create(&mut *folder, &place, settings.sync)?;
        let mut capture = Self::on(file, &place, settings, 0)?;
        capture.parts = is_split.then(|| Parts::new(path, folder, 1, session));
        Ok(capture)
    }

    /// Appends to a recording, even one whose end is missing after a crash.
    ///
    /// The old index and an incomplete chunk are cut off the end, but never a complete chunk;
    /// whatever is cut off apart from the index is saved to a file next to the recording
    /// ([`cut_tail`](Self::cut_tail)). The extended recording is complete but has no index, so
    /// tools read it sequentially. Reads the whole file once, with the memory of one chunk.
    ///
    /// Appends to the last part of a split recording, which is split further only if the settings
    /// say so.
    ///
    /// # Errors
    /// Those of [`create`](Self::create) and [`read`](crate::capture::read); [`HwError::Busy`] if another
    /// program is writing to it; [`HwError::Container`] if its measurements, unit or current
    /// differ, and if one file is to be split.
    pub fn append(
        path: impl AsRef<Path>,
        session: &SessionRecord,
        settings: CaptureSettings,
    ) -> Result<Self, HwError> {
        let path = path.as_ref();
        settings.check()?;
        if path.exists() {
            if settings.is_split() {
                return Err(HwError::Container {
                    place: Place::file(path),
                    what: "is a single file and cannot be split".into(),
                    mend: "append to it without splitting, or record to another name",
                });
            }
            return Self::begin(
                Self::after(storage::open(path)?, path, session, settings)?.0,
                session,
            );
        }
        loop {
            let mut parts = parts_of(path);
            // without any part, the error is that of the file
            let Some(last) = parts.pop() else {
                return Err(match storage::open(path) {
                    Err(error) => error,
                    Ok(_) => HwError::Busy { place: Place::file(path) },
                });
            };
            let file = storage::open(&last.path)?;
            if parts_of(path).last() != Some(&last) {
                // another recorder has just begun a new part and holds that one
                continue;
            }
            let (mut capture, is_checked) = Self::after(file, &last.path, session, settings)?;
            if !is_checked {
                // nothing was written to the last part
                parts.iter().rev().try_fold(false, |is_checked, part| match is_checked {
                    true => Ok(true),
                    false => same_set_up_as(&part.path, session),
                })?;
            }
            capture.parts = Some(Parts::new(path, Box::new(Folders), last.number, session));
            return Self::begin(capture, session);
        }
    }

    /// Continues in a file; also returns whether it has a session, which was compared.
    fn after(
        mut file: File,
        path: &Path,
        session: &SessionRecord,
        settings: CaptureSettings,
    ) -> Result<(Self, bool), HwError> {
        let length = file.metadata().map(|data| data.len());
        let length = length.map_err(|source| HwError::Read { place: Place::file(path), source })?;
        if length == 0 {
            // left by a program that was killed before it wrote anything
            return Ok((Self::on(Box::new(file), path, settings, 0)?, false));
        }
        let mut reader = CaptureReader::new(BufReader::with_capacity(1 << 16, &file), path)?;
        let is_checked = same_set_up(&mut reader, path, session)?;
        let (whole, damage) = (reader.whole_bytes(), reader.damage());
        let (whole, cut) = storage::cut_tail(&mut file, path, whole, damage)?;
        let mut capture = Self::on(Box::new(file), path, settings, whole)?;
        capture.cut = cut;
        Ok((capture, is_checked))
    }

    pub(super) fn begin(mut capture: Self, session: &SessionRecord) -> Result<Self, HwError> {
        capture.session(session)?;
        capture.flush()?;
        Ok(capture)
    }
}

/// Rejects a recording of another set-up; reads it up to its first session. Returns whether it has
/// one.
fn same_set_up_as(path: &Path, session: &SessionRecord) -> Result<bool, HwError> {
    let mut reader = match CaptureReader::open(path) {
        // a part like the last one
        Err(HwError::Empty { .. }) => return Ok(false),
        opened => opened?,
    };
    while let Some(entry) = reader.next_entry()? {
        let is_session = matches!(entry, Entry::Session(_));
        same_set_up_in(&entry, path, session)?;
        if is_session {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Reads a whole recording and rejects one of another set-up, since no reader accepts a mix.
/// Returns whether it has a session.
fn same_set_up<R: Read + Seek>(
    reader: &mut CaptureReader<R>,
    path: &Path,
    session: &SessionRecord,
) -> Result<bool, HwError> {
    let mut is_checked = false;
    while let Some(entry) = reader.next_entry()? {
        same_set_up_in(&entry, path, session)?;
        is_checked |= matches!(entry, Entry::Session(_));
    }
    Ok(is_checked)
}

fn same_set_up_in(entry: &Entry, path: &Path, session: &SessionRecord) -> Result<(), HwError> {
    let differs = |what: String| HwError::Container {
        place: Place::file(path),
        what: format!("cannot append: the file has {what}"),
        mend: "record each set-up in its own file",
    };
    match entry {
        Entry::Session(found) if found.quadruples != session.quadruples => {
            Err(differs("other measurements".into()))
        }
        Entry::Session(found) if found.unit != session.unit => Err(differs("another unit".into())),
        Entry::Session(found) if found.current_a != session.current_a => {
            Err(differs("another current".into()))
        }
        Entry::Frame(frame)
            if !session.quadruples.is_empty() && frame.values.len() != session.quadruples.len() =>
        {
            let (found, wanted) = (frame.values.len(), session.quadruples.len());
            Err(differs(format!("{found} values per frame, not {wanted}")))
        }
        _ => Ok(()),
    }
}
