//! Reading of complete recordings into memory.

use std::io::{Cursor, Read, Seek};
use std::path::{Path, PathBuf};

use super::entry::Entry;
use super::record::SessionRecord;
use super::stream::{CaptureReader, Damage};
use crate::error::{HwError, Place};
use crate::frame::{Frame, Quality};
use crate::recording::{Contents, Format, Layout, Recording, Unit};

/// A complete recording in memory.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Capture {
    /// Every message, in the order of the file.
    pub entries: Vec<Entry>,
    /// What is missing or damaged.
    pub damage: Damage,
}

impl Capture {
    /// Iterates over the frames.
    pub fn frames(&self) -> impl Iterator<Item = &Frame> {
        self.entries.iter().filter_map(|entry| match entry {
            Entry::Frame(frame) => Some(frame),
            _ => None,
        })
    }

    /// Iterates over the sessions; each describes the frames that follow it.
    pub fn sessions(&self) -> impl Iterator<Item = &SessionRecord> {
        self.entries.iter().filter_map(|entry| match entry {
            Entry::Session(session) => Some(session),
            _ => None,
        })
    }

    /// Converts the frames to a [`Recording`], as every other format is read. The instrument's
    /// clock is kept only if every frame has it and it never goes back, as it may between epochs.
    ///
    /// # Errors
    /// [`HwError::NoFrames`] if there are none; [`HwError::Container`] if frames differ in size or
    /// sessions differ in their measurements.
    pub fn recording(&self, path: impl AsRef<Path>) -> Result<Recording, HwError> {
        let path = path.as_ref();
        let mut frames = Frames::new(path);
        self.entries.iter().try_for_each(|entry| frames.take(entry))?;
        frames.finish(self.damage)
    }
}

/// Reads the frames of the recording at `path` without keeping its other messages in memory.
///
/// # Errors
/// Those of [`read`] and [`Capture::recording`].
pub(crate) fn read_frames(path: &Path) -> Result<Recording, HwError> {
    let mut reader = CaptureReader::open(path)?;
    let (mut frames, budget) = (Frames::new(path), Budget::of(reader.length(), path));
    while let Some(entry) = reader.next_entry()? {
        frames.take(&entry)?;
        budget.check(frames.bytes())?;
    }
    frames.finish(reader.damage())
}

/// Limit on the memory that the messages of a file may take.
///
/// Compressed, thousands of frames take a few bytes. A file that expands far beyond its size was
/// made to exhaust memory, or should be read message by message.
struct Budget<'a> {
    path: &'a Path,
    file_bytes: u64,
    most: u64,
}

impl<'a> Budget<'a> {
    /// A reader takes 64 MB and ten times the file; up to 40 of it are for a chunk and a message.
    const LEAST_BYTES: u64 = 24_000_000;
    const TIMES_FILE: u64 = 10;

    fn of(file_bytes: u64, path: &'a Path) -> Self {
        let most = Self::LEAST_BYTES.saturating_add(Self::TIMES_FILE.saturating_mul(file_bytes));
        Self { path, file_bytes, most }
    }

    fn check(&self, bytes: u64) -> Result<(), HwError> {
        if bytes <= self.most {
            return Ok(());
        }
        Err(HwError::TooLarge {
            place: Place::file(self.path),
            most_mb: self.most / 1_000_000,
            file_mb: 1e-6 * self.file_bytes as f64,
        })
    }
}

/// Checks that all sessions and frames of a recording have the same measurements.
#[derive(Clone, Debug)]
pub struct SameSetUp {
    path: PathBuf,
    session: Option<SessionRecord>,
    /// Number of values of the first frame, and whether they are complex.
    size: Option<(usize, bool)>,
}

impl SameSetUp {
    /// `path` is used in messages only.
    pub fn new(path: impl AsRef<Path>) -> Self {
        let path = path.as_ref();
        Self { path: path.to_path_buf(), session: None, size: None }
    }

    /// Returns the first session.
    pub fn session(&self) -> Option<&SessionRecord> {
        self.session.as_ref()
    }

    /// Returns the number of values per frame and whether they are complex; `None` before the first
    /// frame.
    pub fn size(&self) -> Option<(usize, bool)> {
        self.size
    }

    fn differ(&self, what: String) -> HwError {
        HwError::Container {
            place: Place::file(&self.path),
            what,
            mend: "record each set-up in its own file",
        }
    }

    /// Takes the next message.
    ///
    /// # Errors
    /// [`HwError::Container`] if it does not match the earlier ones.
    pub fn take(&mut self, entry: &Entry) -> Result<(), HwError> {
        match entry {
            Entry::Frame(frame) => self.take_frame(frame),
            Entry::Session(session) => self.take_session(session),
            _ => Ok(()),
        }
    }

    /// Checks that the recording has frames, and those of its session; call it at the end, with the
    /// damage found.
    ///
    /// # Errors
    /// [`HwError::NoFrames`]; [`HwError::Container`] if that is because of damage, or if frames have
    /// another number of values than the session lists.
    pub fn check(&self, damage: Damage) -> Result<(), HwError> {
        let place = || Place::file(&self.path);
        let Some((count, _)) = self.size else {
            if !damage.is_any() {
                return Err(HwError::NoFrames { place: place(), skipped: 0 });
            }
            let Damage { bad_chunks, bad_messages, missing_parts, .. } = damage;
            let bytes = damage.skipped_bytes + damage.truncated_bytes;
            let what = format!(
                "no complete frame found: {bad_chunks} chunk(s), {bad_messages} message(s), {bytes} \
                 bytes and {missing_parts} part(s) are damaged, too large or missing"
            );
            return Err(HwError::Container { place: place(), what, mend: "record it again" });
        };
        let named = self.session.as_ref().map_or(0, |session| session.quadruples.len());
        if named == 0 || named == count {
            return Ok(());
        }
        Err(self.differ(format!("frames have {count} values, but the session lists {named}")))
    }

    fn take_session(&mut self, other: &SessionRecord) -> Result<(), HwError> {
        let session = self.session.get_or_insert_with(|| other.clone());
        if session.quadruples == other.quadruples {
            return Ok(());
        }
        let (one, other) = (session.quadruples.len(), other.quadruples.len());
        Err(self.differ(format!("sessions of {one} and {other} measurements do not match")))
    }

    fn take_frame(&mut self, frame: &Frame) -> Result<(), HwError> {
        let found = (frame.values.len(), frame.imaginary.is_some());
        let size = *self.size.get_or_insert(found);
        if found == size {
            return Ok(());
        }
        let (found, count, number) = (found.0, size.0, frame.sequence);
        let what = format!("frame {number} has {found} values, but earlier frames have {count}");
        Err(self.differ(what))
    }
}

/// Accumulates frames one by one.
struct Frames<'a> {
    path: &'a Path,
    same: SameSetUp,
    real: Vec<f64>,
    imaginary: Vec<f64>,
    /// Empty as long as all values are good.
    quality: Vec<Quality>,
    times: Vec<f64>,
}

impl<'a> Frames<'a> {
    fn new(path: &'a Path) -> Self {
        let [real, imaginary, times] = [(); 3].map(|()| Vec::new());
        Self { path, same: SameSetUp::new(path), real, imaginary, quality: Vec::new(), times }
    }

    fn take(&mut self, entry: &Entry) -> Result<(), HwError> {
        self.same.take(entry)?;
        let Entry::Frame(frame) = entry else { return Ok(()) };
        let is_flagged = frame.quality.iter().any(|quality| !quality.is_good());
        if is_flagged || !self.quality.is_empty() {
            self.quality.resize(self.real.len(), Quality::GOOD);
            append(&mut self.quality, &frame.quality);
        }
        append(&mut self.real, &frame.values);
        append(&mut self.imaginary, frame.imaginary.as_deref().unwrap_or_default());
        append(&mut self.times, frame.device_time_s.as_slice());
        Ok(())
    }

    /// Returns the memory that the lists take when they grow next, in bytes.
    fn bytes(&self) -> u64 {
        let numbers = [&self.real, &self.imaginary, &self.times].map(Vec::capacity);
        // while a list grows, the old one and the new one are in memory together
        let bytes = 8 * numbers.iter().sum::<usize>() + 2 * self.quality.capacity();
        (9 * bytes / 4) as u64
    }

    fn finish(self, damage: Damage) -> Result<Recording, HwError> {
        let path = self.path;
        self.same.check(damage)?;
        let none = || HwError::NoFrames { place: Place::file(path), skipped: 0 };
        let (count, complex) = self.same.size.ok_or_else(none)?;
        let session = self.same.session.unwrap_or_default();
        let layout = match session.quadruples.is_empty() {
            true => Layout::ProtocolOrder,
            false => Layout::Quadruples(session.quadruples),
        };
        let contents = Contents {
            real: self.real,
            imaginary: complex.then_some(self.imaginary),
            quality: Some(self.quality).filter(|flags| !flags.is_empty()),
            value_count: count,
            ..Contents::default()
        };
        let unit = Unit::from(session.unit);
        let mut recording = Recording::new(contents, layout, unit, Format::Mcap, path)?;
        let steady = self.times.len() == recording.frame_count() && self.times.is_sorted();
        recording.device_time_s = steady.then_some(self.times);
        recording.notes.extend(damage.note());
        recording.current_a = session.current_a;
        recording.frequency_hz = session.frequency_hz;
        Ok(recording)
    }
}

/// Appends the values. A full list grows by a quarter, not to twice its size, so that the budget is for values.
fn append<T: Copy>(list: &mut Vec<T>, values: &[T]) {
    if list.capacity() - list.len() < values.len() {
        list.reserve_exact(values.len() + list.len() / 4);
    }
    list.extend_from_slice(values);
}

/// Reads a complete recording, even if its end is missing.
///
/// # Errors
/// [`HwError::Read`] if the file cannot be read, and those of [`parse`].
pub fn read(path: impl AsRef<Path>) -> Result<Capture, HwError> {
    let path = path.as_ref();
    whole(CaptureReader::open(path)?, path)
}

/// Parses a recording held in memory; `path` is used in messages only. Intact chunks are read even
/// if others are damaged.
///
/// # Errors
/// [`HwError::Empty`]; [`HwError::Container`] if the bytes do not start as MCAP;
/// [`HwError::TooLarge`] if the content expands so far that the file was made to exhaust memory.
pub fn parse(bytes: &[u8], path: impl AsRef<Path>) -> Result<Capture, HwError> {
    let path = path.as_ref();
    whole(CaptureReader::new(Cursor::new(bytes), path)?, path)
}

/// Reads every message of a recording.
fn whole<R: Read + Seek>(mut reader: CaptureReader<R>, path: &Path) -> Result<Capture, HwError> {
    let (mut entries, budget) = (Vec::new(), Budget::of(reader.length(), path));
    let mut bytes = 0;
    while let Some(entry) = reader.next_entry()? {
        bytes += entry.memory_bytes();
        entries.push(entry);
        // while the list grows, the old one and the new one are in memory together
        budget.check(bytes + (3 * entries.capacity() * size_of::<Entry>() / 2) as u64)?;
    }
    Ok(Capture { entries, damage: reader.damage() })
}
