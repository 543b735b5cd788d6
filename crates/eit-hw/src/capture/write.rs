//! Writing of recordings.

use std::fs::{File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions, Writer};

use super::{Entry, NO_METADATA, ReferenceRecord, SessionRecord, Topic, TouchesRecord, container};
use crate::error::{HwError, Place};
use crate::frame::Frame;

/// How a recording is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureSettings {
    /// A chunk is written so long after its first message, at the latest with the next message or
    /// [`CaptureWriter::tick`]: what a killed program loses.
    pub flush_s: f64,
    /// Whether each chunk is also forced to the disk: then it survives a power cut too, at the cost
    /// of a wait for the disk.
    pub sync: bool,
}

impl Default for CaptureSettings {
    /// One second, without forcing.
    fn default() -> Self {
        Self { flush_s: 1.0, sync: false }
    }
}

/// A recording that grows.
///
/// [`finish`](Self::finish) writes the index. Without it, as after a crash, the recording is read
/// by going through it.
pub struct CaptureWriter {
    // dropped first, so that the file ends before anything else
    writer: Writer<File>,
    /// The same file, for forcing.
    file: File,
    path: PathBuf,
    settings: CaptureSettings,
    channels: [u16; Topic::ALL.len()],
    counts: [u32; Topic::ALL.len()],
    /// When the open chunk began.
    open_since: Option<Instant>,
    json: Vec<u8>,
    finished: bool,
}

impl CaptureWriter {
    /// Starts a recording in a new file.
    ///
    /// # Errors
    /// [`HwError::Write`] where the file exists already or cannot be made; [`HwError::Setting`] for
    /// a `flush_s` that is not above 0.
    pub fn create(
        path: &Path,
        session: &SessionRecord,
        settings: CaptureSettings,
    ) -> Result<Self, HwError> {
        let file = OpenOptions::new().write(true).create_new(true).open(path);
        let mut capture = Self::on(file, path, settings)?;
        capture.write(&Entry::Session(session.clone()))?;
        capture.flush()?;
        Ok(capture)
    }

    /// Goes on with a recording, also one that was cut by a crash: all that can be read of it is
    /// copied to a new file beside it, which then takes its place. Reads the whole file.
    ///
    /// # Errors
    /// As [`create`](Self::create) and [`read`](super::read).
    pub fn append(
        path: &Path,
        session: &SessionRecord,
        settings: CaptureSettings,
    ) -> Result<Self, HwError> {
        let before = super::read(path)?;
        let mut name = path.as_os_str().to_owned();
        name.push(".partial");
        let partial = PathBuf::from(name);
        let file = OpenOptions::new().write(true).create(true).truncate(true).open(&partial);
        let mut capture = Self::on(file, &partial, settings)?;
        for (entry, log_time) in before.entries.iter().zip(&before.log_times_ns) {
            capture.write_at(entry, *log_time)?;
        }
        capture.write(&Entry::Session(session.clone()))?;
        capture.flush()?;
        let failed = |source| HwError::Write { place: Place::file(path), source };
        capture.file.sync_data().map_err(failed)?;
        std::fs::rename(&partial, path).map_err(failed)?;
        capture.path = path.to_path_buf();
        Ok(capture)
    }

    fn on(file: io::Result<File>, path: &Path, settings: CaptureSettings) -> Result<Self, HwError> {
        if settings.flush_s.is_nan() || settings.flush_s <= 0.0 {
            let value = settings.flush_s.to_string();
            return Err(HwError::Setting { name: "flush_s", value, wanted: "more than 0" });
        }
        let failed = |source| HwError::Write { place: Place::file(path), source };
        let file = file.map_err(failed)?;
        let same = file.try_clone().map_err(failed)?;
        let library = concat!("eit-hw ", env!("CARGO_PKG_VERSION"));
        // a chunk is put together in memory and written in one go: no seeking back
        let options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(1 << 20))
            .disable_seeking(true)
            .library(library);
        let error = |error| write_error(path, error);
        let mut writer = options.create(file).map_err(error)?;
        let mut channels = [0; Topic::ALL.len()];
        for (topic, channel) in Topic::ALL.into_iter().zip(&mut channels) {
            let (name, text) = topic.schema();
            let schema = writer.add_schema(name, "jsonschema", text.as_bytes()).map_err(error)?;
            *channel =
                writer.add_channel(schema, topic.name(), "json", &NO_METADATA).map_err(error)?;
        }
        Ok(Self {
            writer,
            file: same,
            path: path.to_path_buf(),
            settings,
            channels,
            counts: [0; Topic::ALL.len()],
            open_since: None,
            json: Vec::new(),
            finished: false,
        })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn frame(&mut self, frame: &Frame) -> Result<(), HwError> {
        self.write(&Entry::Frame(frame.clone()))
    }

    /// Adds a new session, after a reconnection with another set-up.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn session(&mut self, session: &SessionRecord) -> Result<(), HwError> {
        self.write(&Entry::Session(session.clone()))
    }

    /// Adds a reference frame.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn reference(&mut self, reference: &ReferenceRecord) -> Result<(), HwError> {
        self.write(&Entry::Reference(reference.clone()))
    }

    /// Adds touches.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn touches(&mut self, touches: &TouchesRecord) -> Result<(), HwError> {
        self.write(&Entry::Touches(touches.clone()))
    }

    /// Adds a note, such as that the instrument was unplugged.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn note(&mut self, text: &str) -> Result<(), HwError> {
        self.write(&Entry::Note(text.to_owned()))
    }

    /// Adds any entry.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn write(&mut self, entry: &Entry) -> Result<(), HwError> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let log_time_ns = match entry {
            // when the frame came, not when it was written
            Entry::Frame(Frame { host_time_s: Some(time_s), .. }) if *time_s >= 0.0 => {
                Duration::try_from_secs_f64(*time_s).unwrap_or(now)
            }
            _ => now,
        };
        self.write_at(entry, u64::try_from(log_time_ns.as_nanos()).unwrap_or(u64::MAX))
    }

    fn write_at(&mut self, entry: &Entry, log_time_ns: u64) -> Result<(), HwError> {
        let index = entry.topic() as usize;
        self.json.clear();
        entry
            .to_json(&mut self.json)
            .map_err(|error| container(Place::file(&self.path), &error))?;
        let header = MessageHeader {
            channel_id: self.channels[index],
            sequence: self.counts[index],
            log_time: log_time_ns,
            publish_time: log_time_ns,
        };
        self.counts[index] = self.counts[index].wrapping_add(1);
        self.writer
            .write_to_known_channel(&header, &self.json)
            .map_err(|error| write_error(&self.path, error))?;
        self.open_since.get_or_insert_with(Instant::now);
        self.tick()
    }

    /// Writes the open chunk if it is old enough. Call it while no messages come, a few times a
    /// second.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn tick(&mut self) -> Result<(), HwError> {
        match self.open_since {
            Some(since) if since.elapsed().as_secs_f64() >= self.settings.flush_s => self.flush(),
            _ => Ok(()),
        }
    }

    /// Writes the open chunk.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn flush(&mut self) -> Result<(), HwError> {
        self.open_since = None;
        self.writer.flush().map_err(|error| write_error(&self.path, error))?;
        if self.settings.sync {
            let failed = |source| HwError::Write { place: Place::file(&self.path), source };
            self.file.sync_data().map_err(failed)?;
        }
        Ok(())
    }

    /// Ends the recording with its index, forced to the disk.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn finish(mut self) -> Result<(), HwError> {
        self.finished = true;
        self.writer.finish().map_err(|error| write_error(&self.path, error))?;
        self.file
            .sync_data()
            .map_err(|source| HwError::Write { place: Place::file(&self.path), source })
    }
}

impl Drop for CaptureWriter {
    fn drop(&mut self) {
        if !self.finished {
            // nobody is there to hear of a failure
            let _ = self.writer.finish();
        }
    }
}

fn write_error(path: &Path, error: McapError) -> HwError {
    let place = Place::file(path);
    match error {
        McapError::Io(source) => HwError::Write { place, source },
        other => container(place, &other),
    }
}
