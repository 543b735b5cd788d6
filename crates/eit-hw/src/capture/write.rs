//! Writes recordings.

mod begin;
pub(super) mod part_file;
#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::print_stdout, reason = "a panic is a failed test")]
mod power_tests;
mod settings;
mod sink;
mod split;
pub(super) mod storage;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions, Writer};

pub use self::part_file::PartFile;
pub use self::settings::CaptureSettings;
pub use self::storage::CutTail;

use self::sink::Sink;
use self::split::Parts;
use self::storage::Storage;
use super::container::container_error;
use super::entry::{Entry, Message, Topic};
use super::json::MOST_VALUES;
use super::record::{ReferenceRecord, SessionRecord, TouchesRecord};
use super::scene;
use super::stream::MessageTimes;
use crate::error::{HwError, Place};
use crate::frame::Frame;

/// Writes a recording.
///
/// [`finish`](Self::finish) writes the index. A recording without one, as after a crash, is read
/// sequentially.
///
/// With [`CaptureSettings::part_bytes`] or [`part_s`](CaptureSettings::part_s), `press.mcap` is
/// written as `press.00001.mcap`, `press.00002.mcap` and so on. Each part is a complete recording
/// of its own; under the name `press.mcap` they are read as one.
pub struct CaptureWriter {
    writer: Writer<Sink>,
    /// Bytes that the container has produced but the file does not have yet.
    sink: Sink,
    file: Box<dyn Storage>,
    /// Length of the file up to its last complete chunk.
    whole_bytes: u64,
    path: PathBuf,
    /// What [`append`](CaptureWriter::append) cut off the end.
    cut: Option<CutTail>,
    settings: CaptureSettings,
    /// The parts of a split recording.
    parts: Option<Parts>,
    /// Temporary name of a copy until it is finished.
    part: Option<PartFile>,
    /// Those of the topics, then that of the scenes.
    channels: [u16; Topic::ALL.len() + 1],
    counts: [u32; Topic::ALL.len() + 1],
    /// Whether the last scene shows something.
    has_scene: bool,
    /// Log time of the last message; never decreases.
    log_time_ns: u64,
    /// Start of the open chunk.
    open_since: Option<Instant>,
    /// Log time of its first message.
    chunk_began_ns: Option<u64>,
    json: Vec<u8>,
    /// Number of values of a frame of the current session; `None` if it does not name them.
    width: Option<usize>,
    /// Whether nothing more is written: finished, or failed to write.
    finished: bool,
}

impl std::fmt::Debug for CaptureWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CaptureWriter")
            .field("path", &self.path)
            .field("settings", &self.settings)
            .field("counts", &self.counts)
            .finish_non_exhaustive()
    }
}

impl CaptureWriter {
    /// Returns what [`append`](Self::append) cut off the end, apart from the index.
    pub fn cut_tail(&self) -> Option<&CutTail> {
        self.cut.as_ref()
    }

    /// Writes after the first `whole_bytes` of a file; 0 for a new one.
    fn on(
        file: Box<dyn Storage>,
        path: &Path,
        settings: CaptureSettings,
        whole_bytes: u64,
    ) -> Result<Self, HwError> {
        let library = concat!("eit-hw ", env!("CARGO_PKG_VERSION"));
        // chunks are assembled in memory and written in one go, without seeking back
        let mut options = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(1 << 20))
            .disable_seeking(true)
            .library(library);
        let goes_on = whole_bytes > 0;
        if goes_on {
            // an index and a checksum of the new part would be taken for those of the whole file
            options = options
                .emit_summary_records(false)
                .emit_summary_offsets(false)
                .calculate_data_section_crc(false);
        }
        let error = |error| write_error(path, error);
        let sink = Sink::default();
        let mut writer = options.create(sink.clone()).map_err(error)?;
        if goes_on {
            // the file already has the magic and the header
            sink.drain(|_| ());
        }
        let mut channels = [0; Topic::ALL.len() + 1];
        let no_metadata = BTreeMap::new();
        let topics = Topic::ALL.map(|topic| (topic.name(), topic.schema()));
        let topics = topics.into_iter().chain([(scene::TOPIC, scene::SCHEMA)]);
        for ((topic, (name, text)), channel) in topics.zip(&mut channels) {
            let schema = writer.add_schema(name, "jsonschema", text.as_bytes()).map_err(error)?;
            *channel = writer.add_channel(schema, topic, "json", &no_metadata).map_err(error)?;
        }
        Ok(Self {
            writer,
            sink,
            file,
            whole_bytes,
            path: path.to_path_buf(),
            cut: None,
            settings,
            parts: None,
            part: None,
            channels,
            counts: [0; Topic::ALL.len() + 1],
            has_scene: false,
            log_time_ns: 0,
            open_since: None,
            chunk_began_ns: None,
            json: Vec::new(),
            width: None,
            finished: false,
        })
    }

    /// Checks that frames of this many values, real and imaginary together, can be recorded: longer
    /// ones could not be read back.
    ///
    /// # Errors
    /// [`HwError::LongFrame`].
    pub fn check_frame(values: usize) -> Result<(), HwError> {
        if values <= MOST_VALUES {
            return Ok(());
        }
        Err(HwError::LongFrame { values, most: MOST_VALUES })
    }

    /// Writes a frame. Once the buffers have grown, allocates only what the container needs per
    /// chunk.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written, [`HwError::LongFrame`], and
    /// [`HwError::Inconsistent`] if a field's length is not the session's number of measurements.
    pub fn frame(&mut self, frame: &Frame) -> Result<(), HwError> {
        Self::check_frame(frame.values.len() + frame.imaginary.as_ref().map_or(0, Vec::len))?;
        frame.check(self.width, &self.path)?;
        self.add(Message::Frame(frame), None)
    }

    /// Writes a new session, after a reconnection with another set-up.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written.
    pub fn session(&mut self, session: &SessionRecord) -> Result<(), HwError> {
        self.add(Message::Session(session), None)
    }

    /// Writes a reference frame.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written.
    pub fn reference(&mut self, reference: &ReferenceRecord) -> Result<(), HwError> {
        self.add(Message::Reference(reference), None)
    }

    /// Writes the touches of a frame.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written.
    pub fn touches(&mut self, touches: &TouchesRecord) -> Result<(), HwError> {
        self.add(Message::Touches(touches), None)
    }

    /// Writes a note, for example that the instrument was unplugged.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written.
    pub fn note(&mut self, text: &str) -> Result<(), HwError> {
        self.add(Message::Note(text), None)
    }

    /// Writes any entry.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written.
    pub fn write(&mut self, entry: &Entry) -> Result<(), HwError> {
        match entry {
            Entry::Frame(frame) => self.frame(frame),
            other => self.add(other.into(), None),
        }
    }

    /// Writes an entry of another recording with its original times.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written.
    pub fn write_at(&mut self, entry: &Entry, times: MessageTimes) -> Result<(), HwError> {
        self.add(entry.into(), Some(times))
    }

    /// Writes a message, with times of its own if it has some.
    fn add(&mut self, message: Message<'_>, times: Option<MessageTimes>) -> Result<(), HwError> {
        match message {
            Message::Frame(_) => self.split_if_due()?,
            Message::Session(session) => {
                self.width = Some(session.quadruples.len()).filter(|&count| count > 0);
                if let Some(parts) = &mut self.parts {
                    parts.set_session(session);
                }
            }
            _ => {}
        }
        let times = times.unwrap_or_else(|| {
            let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            let arrival = match message {
                // time of arrival, not of writing
                Message::Frame(frame) => frame.host_time_s.map(Duration::try_from_secs_f64),
                _ => None,
            };
            let time = arrival.and_then(Result::ok).unwrap_or(now);
            let publish_ns = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
            // tools sort by log time: a clock that is set back must not reorder frames
            MessageTimes { log_ns: self.log_time_ns.max(publish_ns), publish_ns }
        });
        self.json.clear();
        let written = message.write(&mut self.json);
        written.map_err(|error| container_error(Place::file(&self.path), &error))?;
        self.put(message.topic() as usize, times)?;
        if let Message::Touches(touches) = message
            && let Some((scene, is_seen)) = scene::of(touches, times.publish_ns)
            && (std::mem::replace(&mut self.has_scene, is_seen) || is_seen)
        {
            self.json.clear();
            let written = serde_json::to_writer(&mut self.json, &scene);
            written.map_err(|error| container_error(Place::file(&self.path), &error))?;
            self.put(Topic::ALL.len(), times)?;
        }
        self.open_since.get_or_insert_with(Instant::now);
        self.tick()
    }

    /// Adds the message that `json` holds to a channel.
    fn put(&mut self, index: usize, times: MessageTimes) -> Result<(), HwError> {
        self.log_time_ns = self.log_time_ns.max(times.log_ns);
        let header = MessageHeader {
            channel_id: self.channels[index],
            sequence: self.counts[index],
            log_time: times.log_ns,
            publish_time: times.publish_ns,
        };
        self.counts[index] = self.counts[index].wrapping_add(1);
        if self.finished {
            return Err(write_error(&self.path, McapError::AttemptedWriteAfterFailure));
        }
        let written = self.writer.write_to_known_channel(&header, &self.json);
        self.packed(written)?;
        // a copy is written faster than it was recorded
        let began_ns = *self.chunk_began_ns.get_or_insert(times.log_ns);
        let span_s = 1e-9 * times.log_ns.saturating_sub(began_ns) as f64;
        if span_s >= self.settings.flush_s { self.flush() } else { Ok(()) }
    }

    /// Moves what the container has packed to the file. After a failure, such as a full disk, the
    /// file is truncated to its last complete chunk and nothing more is written.
    fn packed<T>(&mut self, packed: Result<T, McapError>) -> Result<T, HwError> {
        let Self { sink, file, whole_bytes, .. } = self;
        let written = packed.and_then(|packed| {
            let append = |bytes: &[u8]| file.append(bytes).map(|()| bytes.len() as u64);
            *whole_bytes += sink.drain(append).transpose()?.unwrap_or(0);
            Ok(packed)
        });
        written.map_err(|error| {
            self.finished = true;
            // if even that fails, readers skip the incomplete chunk
            let _ = self.file.cut(self.whole_bytes);
            write_error(&self.path, error)
        })
    }

    /// Writes the open chunk if it is older than [`CaptureSettings::flush_s`]. Call it a few times
    /// per second while no messages arrive.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written.
    pub fn tick(&mut self) -> Result<(), HwError> {
        match self.open_since {
            Some(since) if since.elapsed().as_secs_f64() >= self.settings.flush_s => self.flush(),
            _ => Ok(()),
        }
    }

    /// Writes the open chunk.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written.
    pub fn flush(&mut self) -> Result<(), HwError> {
        (self.open_since, self.chunk_began_ns) = (None, None);
        let packed = self.writer.flush();
        self.packed(packed)?;
        if self.file.is_removed() {
            self.finished = true;
            let source = std::io::Error::other("the file was removed while it was recorded");
            return Err(HwError::Write { place: Place::file(&self.path), source });
        }
        if self.settings.sync { self.sync() } else { Ok(()) }
    }

    fn sync(&mut self) -> Result<(), HwError> {
        let failed = |source| HwError::Write { place: Place::file(&self.path), source };
        self.file.sync().map_err(failed)
    }

    /// Ends the recording: writes the index and forces the file to the disk.
    ///
    /// # Errors
    /// [`HwError::Write`] if the file cannot be written.
    pub fn finish(mut self) -> Result<(), HwError> {
        self.flush()?;
        self.finished = true;
        let packed = self.writer.finish();
        let finished = self.packed(packed).and_then(|_| self.sync());
        let previous = self.parts.as_mut().map_or(Ok(()), |parts| parts.ended(true));
        finished.and(previous)?;
        self.part.take().map_or(Ok(()), PartFile::keep)
    }
}

impl Drop for CaptureWriter {
    fn drop(&mut self) {
        if !self.finished {
            self.finished = true;
            let packed = self.writer.finish();
            // a destructor cannot report a failure
            let _ = self.packed(packed);
            let _ = self.parts.as_mut().map(|parts| parts.ended(true));
        }
    }
}

fn write_error(path: &Path, error: McapError) -> HwError {
    let place = Place::file(path);
    match error {
        McapError::Io(source) => HwError::Write { place, source },
        other => container_error(place, &other),
    }
}
