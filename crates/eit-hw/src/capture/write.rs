//! Writing of recordings.
//!
//! Long because new recordings, those that are gone on with, and every kind of message keep one file
//! and its counts in step.

mod sink;

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions, Writer};

use self::sink::Sink;
use super::container::{MAGIC, container_error};
use super::entry::{Entry, Topic};
use super::json::FrameJson;
use super::record::{NoteJson, ReferenceRecord, SessionRecord, TouchesRecord};
use super::stream::CaptureReader;
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
    writer: Writer<Sink>,
    /// The same file, for forcing.
    file: File,
    /// Its length when it last ended with a whole chunk.
    whole_bytes: u64,
    path: PathBuf,
    settings: CaptureSettings,
    channels: [u16; Topic::ALL.len()],
    counts: [u32; Topic::ALL.len()],
    /// When the open chunk began.
    open_since: Option<Instant>,
    json: Vec<u8>,
    /// Nothing is written any more: it is finished, or could not be written.
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
        check(settings)?;
        let file = OpenOptions::new().write(true).create_new(true).open(path);
        let file = file.map_err(|source| HwError::Write { place: Place::file(path), source })?;
        let mut capture = Self::on(file, path, settings, false)?;
        capture.session(session)?;
        capture.flush()?;
        Ok(capture)
    }

    /// Goes on with a recording, also one that was cut by a crash: its index and what is no whole
    /// chunk are cut off its end. A recording that was gone on with is whole, but has no index:
    /// tools read it from its beginning. Reads the whole file once, in little memory.
    ///
    /// # Errors
    /// As [`create`](Self::create) and [`read`](super::read); [`HwError::Container`] where what it
    /// holds was measured otherwise (measurements, unit, current), or where more would be cut off
    /// than an unfinished chunk and an index can be.
    pub fn append(
        path: &Path,
        session: &SessionRecord,
        settings: CaptureSettings,
    ) -> Result<Self, HwError> {
        check(settings)?;
        same_set_up(path, session)?;
        let whole = CaptureReader::open(path)?.whole_bytes()?;
        let failed = |source| HwError::Write { place: Place::file(path), source };
        let mut file = OpenOptions::new().write(true).open(path).map_err(failed)?;
        let cut = file.metadata().map_err(failed)?.len().saturating_sub(whole);
        if cut > MOST_CUT_BYTES {
            return Err(HwError::Container {
                place: Place::file(path),
                what: format!("{cut} bytes after a damaged record would be lost"),
                mend: "record into another file",
            });
        }
        // not even its head was whole
        let goes_on = whole > MAGIC.len() as u64;
        let end = if goes_on { whole } else { 0 };
        file.set_len(end).and_then(|()| file.seek(SeekFrom::Start(end))).map_err(failed)?;
        let mut capture = Self::on(file, path, settings, goes_on)?;
        capture.session(session)?;
        capture.flush()?;
        Ok(capture)
    }

    fn on(
        mut file: File,
        path: &Path,
        settings: CaptureSettings,
        goes_on: bool,
    ) -> Result<Self, HwError> {
        let failed = |source| HwError::Write { place: Place::file(path), source };
        let whole_bytes = file.stream_position().map_err(failed)?;
        let same = file.try_clone().map_err(failed)?;
        let library = concat!("eit-hw ", env!("CARGO_PKG_VERSION"));
        // a chunk is put together in memory and written in one go: no seeking back
        let mut options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(1 << 20))
            .disable_seeking(true)
            .library(library);
        if goes_on {
            // an index and a checksum of a part would be taken for those of the whole
            options = options
                .emit_summary_records(false)
                .emit_summary_offsets(false)
                .calculate_data_section_crc(false);
        }
        let error = |error| write_error(path, error);
        let is_silent = Arc::new(AtomicBool::new(goes_on));
        let sink = Sink { file, is_silent: Arc::clone(&is_silent) };
        let mut writer = options.create(sink).map_err(error)?;
        is_silent.store(false, Ordering::Relaxed);
        let mut channels = [0; Topic::ALL.len()];
        let no_metadata = BTreeMap::new();
        for (topic, channel) in Topic::ALL.into_iter().zip(&mut channels) {
            let (name, text) = topic.schema();
            let schema = writer.add_schema(name, "jsonschema", text.as_bytes()).map_err(error)?;
            *channel =
                writer.add_channel(schema, topic.name(), "json", &no_metadata).map_err(error)?;
        }
        Ok(Self {
            writer,
            file: same,
            whole_bytes,
            path: path.to_path_buf(),
            settings,
            channels,
            counts: [0; Topic::ALL.len()],
            open_since: None,
            json: Vec::new(),
            finished: false,
        })
    }

    /// Adds a frame. Once the buffers have grown, nothing is allocated but what the container needs
    /// for a chunk.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn frame(&mut self, frame: &Frame) -> Result<(), HwError> {
        let log_time = match frame.host_time_s {
            // when the frame came, not when it was written
            Some(time_s) => Duration::try_from_secs_f64(time_s).unwrap_or_else(|_| now()),
            None => now(),
        };
        self.add(Topic::Frame, log_time, |json| serde_json::to_writer(json, &FrameJson(frame)))
    }

    /// Adds a new session, after a reconnection with another set-up.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn session(&mut self, session: &SessionRecord) -> Result<(), HwError> {
        self.add(Topic::Session, now(), |json| serde_json::to_writer(json, session))
    }

    /// Adds a reference frame.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn reference(&mut self, reference: &ReferenceRecord) -> Result<(), HwError> {
        self.add(Topic::Reference, now(), |json| serde_json::to_writer(json, reference))
    }

    /// Adds touches.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn touches(&mut self, touches: &TouchesRecord) -> Result<(), HwError> {
        self.add(Topic::Touches, now(), |json| serde_json::to_writer(json, touches))
    }

    /// Adds a note, such as that the instrument was unplugged.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn note(&mut self, text: &str) -> Result<(), HwError> {
        self.add(Topic::Note, now(), |json| serde_json::to_writer(json, &NoteJson { text }))
    }

    /// Adds any entry.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn write(&mut self, entry: &Entry) -> Result<(), HwError> {
        match entry {
            Entry::Session(session) => self.session(session),
            Entry::Frame(frame) => self.frame(frame),
            Entry::Reference(reference) => self.reference(reference),
            Entry::Touches(touches) => self.touches(touches),
            Entry::Note(text) => self.note(text),
        }
    }

    fn add(
        &mut self,
        topic: Topic,
        log_time: Duration,
        write: impl FnOnce(&mut Vec<u8>) -> serde_json::Result<()>,
    ) -> Result<(), HwError> {
        let index = topic as usize;
        self.json.clear();
        write(&mut self.json).map_err(|error| container_error(Place::file(&self.path), &error))?;
        let log_time_ns = u64::try_from(log_time.as_nanos()).unwrap_or(u64::MAX);
        let header = MessageHeader {
            channel_id: self.channels[index],
            sequence: self.counts[index],
            log_time: log_time_ns,
            publish_time: log_time_ns,
        };
        self.counts[index] = self.counts[index].wrapping_add(1);
        let written = self.writer.write_to_known_channel(&header, &self.json);
        self.checked(written)?;
        self.open_since.get_or_insert_with(Instant::now);
        self.tick()
    }

    /// After a failure, such as a full disk, the file is cut to its last whole chunk, and stays so.
    fn checked<T>(&mut self, written: Result<T, McapError>) -> Result<T, HwError> {
        written.map_err(|error| {
            self.finished = true;
            // where even that fails, a reader leaves the cut chunk out by itself
            let _ = self.file.set_len(self.whole_bytes);
            write_error(&self.path, error)
        })
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
        let written = self.writer.flush();
        self.checked(written)?;
        let failed = |source| HwError::Write { place: Place::file(&self.path), source };
        if self.settings.sync {
            self.file.sync_data().map_err(failed)?;
        }
        self.whole_bytes = self.file.metadata().map_err(failed)?.len();
        Ok(())
    }

    /// Ends the recording with its index, forced to the disk.
    ///
    /// # Errors
    /// [`HwError::Write`].
    pub fn finish(mut self) -> Result<(), HwError> {
        self.flush()?;
        self.finished = true;
        let written = self.writer.finish();
        self.checked(written)?;
        self.file
            .sync_data()
            .map_err(|source| HwError::Write { place: Place::file(&self.path), source })
    }
}

/// Most that is cut off a recording to go on with it: an unfinished chunk is one or two of these, the
/// index of a day less.
const MOST_CUT_BYTES: u64 = 16 << 20;

/// Refuses to go on with a recording of another set-up: nothing could read the whole.
fn same_set_up(path: &Path, session: &SessionRecord) -> Result<(), HwError> {
    let mut reader = CaptureReader::open(path)?;
    let found = loop {
        match reader.next_entry()? {
            Some(Entry::Session(found)) => break found,
            Some(_) => {}
            None => return Ok(()),
        }
    };
    let differs = if found.quadruples != session.quadruples {
        "measurements"
    } else if found.unit != session.unit {
        "the unit"
    } else if found.current_a != session.current_a {
        "the current"
    } else {
        return Ok(());
    };
    Err(HwError::Container {
        place: Place::file(path),
        what: format!("{differs} of what it holds differ from those to come"),
        mend: "record each set-up in a file of its own",
    })
}

impl Drop for CaptureWriter {
    fn drop(&mut self) {
        if !self.finished {
            // nobody is there to hear of a failure
            let _ = self.writer.finish();
        }
    }
}

fn now() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default()
}

fn check(settings: CaptureSettings) -> Result<(), HwError> {
    if settings.flush_s.is_nan() || settings.flush_s <= 0.0 {
        let value = settings.flush_s.to_string();
        return Err(HwError::Setting { name: "flush_s", value, wanted: "more than 0" });
    }
    Ok(())
}

fn write_error(path: &Path, error: McapError) -> HwError {
    let place = Place::file(path);
    match error {
        McapError::Io(source) => HwError::Write { place, source },
        other => container_error(place, &other),
    }
}
