//! Recordings read message by message: memory for one chunk, whatever their length.

use std::collections::{HashMap, VecDeque};
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};

use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::container::MAGIC;
use super::entry::{Entry, Topic};
use crate::error::{HwError, Place};

/// Longest chunk that is unpacked, and longest record; the writer ends chunks above 1 MiB.
const MOST_CHUNK_BYTES: u64 = 64 << 20;
/// Opcode and length before each record.
const RECORD_HEAD: usize = 9;
const OP_CHUNK: u8 = 0x06;
const OP_DATA_END: u8 = 0x0F;

/// What is missing of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// The recording was not finished: its program was killed.
    pub unfinished: bool,
    /// Bytes at the end that are no whole record.
    pub truncated_bytes: usize,
    /// Chunks whose checksum or content is wrong; their messages are left out.
    pub bad_chunks: usize,
    /// Messages that cannot be read: of another version, or of a topic that was named in a bad
    /// chunk.
    pub bad_messages: usize,
}

/// Reads a recording message by message, whole or cut. Chunks that are whole and right are read,
/// whatever became of the rest; an index is not needed.
///
/// ```
/// use eit_hw::capture::{CaptureReader, CaptureSettings, CaptureWriter, Entry, SessionRecord};
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("press.mcap");
/// let settings = CaptureSettings::default();
/// CaptureWriter::create(&path, &SessionRecord::default(), settings)?.finish()?;
/// let mut reader = CaptureReader::open(&path)?;
/// assert_eq!(reader.next_entry()?, Some(Entry::Session(SessionRecord::default())));
/// assert_eq!(reader.next_entry()?, None);
/// assert!(!reader.damage().unfinished);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct CaptureReader<R> {
    source: R,
    path: PathBuf,
    channels: HashMap<u16, Option<Topic>>,
    /// Entries of the last chunk that are not told yet.
    entries: VecDeque<Entry>,
    damage: Damage,
    /// Bytes read, and bytes up to the end of the last whole record.
    position: u64,
    whole: u64,
    record: Vec<u8>,
    is_over: bool,
}

impl CaptureReader<BufReader<File>> {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`HwError::Read`], and as [`new`](CaptureReader::new).
    pub fn open(path: &Path) -> Result<Self, HwError> {
        let failed = |source| HwError::Read { place: Place::file(path), source };
        Self::new(BufReader::with_capacity(1 << 16, File::open(path).map_err(failed)?), path)
    }
}

impl<R: Read> CaptureReader<R> {
    /// Reads the recording of these bytes; `path` is for messages.
    ///
    /// # Errors
    /// [`HwError::Empty`], [`HwError::Read`], and [`HwError::Container`] for what does not start as
    /// MCAP.
    pub fn new(source: R, path: &Path) -> Result<Self, HwError> {
        let mut reader = Self {
            source,
            path: path.to_path_buf(),
            channels: HashMap::new(),
            entries: VecDeque::new(),
            damage: Damage { unfinished: true, ..Damage::default() },
            position: 0,
            whole: 0,
            record: Vec::new(),
            is_over: false,
        };
        let found = reader.fill(0, MAGIC.len())?;
        if found == 0 {
            return Err(HwError::Empty { place: Place::file(path) });
        }
        if reader.record[..found] != MAGIC[..found] {
            return Err(HwError::Container {
                place: Place::file(path),
                what: "is no MCAP file".into(),
                mend: "set `[recording] format` to what it is",
            });
        }
        reader.whole = reader.position;
        Ok(reader)
    }

    /// The next message; `None` at the end.
    ///
    /// # Errors
    /// [`HwError::Read`].
    pub fn next_entry(&mut self) -> Result<Option<Entry>, HwError> {
        while self.entries.is_empty() && !self.is_over {
            self.next_record()?;
        }
        Ok(self.entries.pop_front())
    }

    /// What is missing of it, as far as it was read; all of it after the last message.
    pub fn damage(&self) -> Damage {
        self.damage
    }

    /// Reads to the end. Bytes up to the end of the last whole record that is no part of the index.
    pub(super) fn whole_bytes(mut self) -> Result<u64, HwError> {
        while self.next_entry()?.is_some() {}
        Ok(self.whole)
    }

    /// Appends up to `wanted` bytes behind the first `kept` of the record; how many there were.
    fn fill(&mut self, kept: usize, wanted: usize) -> Result<usize, HwError> {
        self.record.resize(kept + wanted, 0);
        let mut filled = 0;
        while filled < wanted {
            match self.source.read(&mut self.record[kept + filled..]) {
                Ok(0) => break,
                Ok(count) => filled += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(source) => {
                    return Err(HwError::Read { place: Place::file(&self.path), source });
                }
            }
        }
        self.position += filled as u64;
        Ok(filled)
    }

    fn next_record(&mut self) -> Result<(), HwError> {
        let found = self.fill(0, RECORD_HEAD)?;
        let Some((&[op, ref length @ ..], _)) =
            self.record[..found].split_first_chunk::<RECORD_HEAD>()
        else {
            return self.finish(false);
        };
        let length = u64::from_le_bytes(*length);
        if op == OP_DATA_END {
            return self.finish(true);
        }
        // a wrong length must not ask for all memory
        let Some(length) = usize::try_from(length).ok().filter(|&l| l as u64 <= MOST_CHUNK_BYTES)
        else {
            return self.finish(false);
        };
        if self.fill(RECORD_HEAD, length)? < length {
            return self.finish(false);
        }
        self.whole = self.position;
        let record = std::mem::take(&mut self.record);
        if op == OP_CHUNK {
            if !self.chunk(&record) {
                self.damage.bad_chunks += 1;
            }
        } else if let Ok(found) = mcap::parse_record(op, &record[RECORD_HEAD..]) {
            self.take(found);
        }
        self.record = record;
        Ok(())
    }

    /// Goes to the end of the file, which shows whether the recording was finished. What is after
    /// the data is the index, which repeats what is known.
    fn finish(&mut self, has_data_end: bool) -> Result<(), HwError> {
        self.is_over = true;
        let mut end: Vec<u8> = Vec::new();
        loop {
            let found = self.fill(0, 1 << 16)?;
            if found == 0 {
                break;
            }
            end.extend(&self.record[..found]);
            let old = end.len().saturating_sub(MAGIC.len());
            end.drain(..old);
        }
        if has_data_end {
            self.damage.unfinished = end != MAGIC;
        } else {
            self.damage.truncated_bytes =
                usize::try_from(self.position - self.whole).unwrap_or(usize::MAX);
        }
        Ok(())
    }

    /// Takes the messages of a chunk, all or none; whether it was right.
    fn chunk(&mut self, record: &[u8]) -> bool {
        // after two times; a wrong length must not ask for all memory
        let unpacked = record.get(RECORD_HEAD + 16..).and_then(|bytes| bytes.first_chunk::<8>());
        if unpacked.is_none_or(|bytes| u64::from_le_bytes(*bytes) > MOST_CHUNK_BYTES) {
            return false;
        }
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(MOST_CHUNK_BYTES as usize);
        let (mut reader, mut left) = (LinearReader::new_with_options(options), record);
        let (entries, damage) = (self.entries.len(), self.damage);
        let mut is_right = true;
        while let Some(event) = reader.next_event() {
            match event {
                Ok(LinearReadEvent::ReadRequest(need)) => {
                    let (now, after) = left.split_at(need.min(left.len()));
                    reader.insert(now.len()).copy_from_slice(now);
                    reader.notify_read(now.len());
                    left = after;
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    match mcap::parse_record(opcode, data) {
                        Ok(record) => self.take(record),
                        Err(_) => is_right = false,
                    }
                }
                // a record alone has no end of file: only what came before it counts
                Err(_) if left.is_empty() && self.entries.len() > entries => break,
                Err(_) => {
                    is_right = false;
                    break;
                }
            }
        }
        if !is_right {
            self.entries.truncate(entries);
            self.damage = damage;
        }
        is_right
    }

    fn take(&mut self, record: Record<'_>) {
        match record {
            Record::Channel(channel) => {
                // others may have written topics of their own
                let topic = Topic::ALL.into_iter().find(|topic| topic.name() == channel.topic);
                self.channels
                    .insert(channel.id, topic.filter(|_| channel.message_encoding == "json"));
            }
            Record::Message { header, data } => {
                let topic = match self.channels.get(&header.channel_id) {
                    Some(Some(topic)) => Some(*topic),
                    // another program's
                    Some(None) => return,
                    // its channel was named in a chunk that is bad
                    None => None,
                };
                match topic.and_then(|topic| Entry::from_json(topic, &data)) {
                    Some(entry) => self.entries.push_back(entry),
                    None => self.damage.bad_messages += 1,
                }
            }
            _ => {}
        }
    }
}
