//! Recordings read message by message: memory for one chunk, whatever their length.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use super::content::{Channel, Message};
use super::entry::{Entry, Topic};
use super::records::{Records, op};
use crate::error::HwError;
use crate::regular::regular_file;

pub use super::records::Damage;

/// When a message was logged and published, in nanoseconds since 1970 by the recorder's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageTimes {
    /// What tools sort by; it does not go back within a recording of ours.
    pub log_ns: u64,
    /// As the clock said, also where it was set back.
    pub publish_ns: u64,
}

/// Longest message that is read, in bytes: that of 262 144 values with all their digits.
const MOST_MESSAGE_BYTES: usize = 8 << 20;

/// Reads a recording message by message, whole or cut. Chunks that are whole and right are read,
/// whatever became of the rest; an index is not needed. Chunks may be packed with LZ4 or Zstandard.
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
    records: Records<R>,
    channels: HashMap<u16, Option<Topic>>,
    times: Option<MessageTimes>,
}

impl CaptureReader<BufReader<File>> {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`HwError::Read`], [`HwError::NotAFile`], and as [`new`](CaptureReader::new).
    pub fn open(path: &Path) -> Result<Self, HwError> {
        Self::new(BufReader::with_capacity(1 << 16, regular_file(path)?), path)
    }
}

impl<R: Read + Seek> CaptureReader<R> {
    /// Reads the recording of these bytes; `path` is for messages.
    ///
    /// # Errors
    /// [`HwError::Empty`], [`HwError::Read`], and [`HwError::Container`] for what does not start as
    /// MCAP.
    pub fn new(source: R, path: &Path) -> Result<Self, HwError> {
        Ok(Self { records: Records::new(source, path)?, channels: HashMap::new(), times: None })
    }

    /// The next message; `None` at the end.
    ///
    /// # Errors
    /// [`HwError::Read`].
    pub fn next_entry(&mut self) -> Result<Option<Entry>, HwError> {
        while let Some(item) = self.records.next()? {
            match item.op {
                op::CHANNEL => {
                    let channel = Channel::parse(self.records.bytes(&item));
                    self.channels.extend(channel.map(|channel| (channel.id, Topic::of(&channel))));
                }
                op::MESSAGE => {
                    let Some(message) = Message::parse(self.records.bytes(&item)) else {
                        self.records.damage_mut().bad_messages += 1;
                        continue;
                    };
                    let topic = self.channels.get(&message.channel).copied();
                    let json = message.data;
                    let Message { log_time, publish_time, .. } = message;
                    self.times = Some(MessageTimes { log_ns: log_time, publish_ns: publish_time });
                    let entry = match topic {
                        _ if json.len() > MOST_MESSAGE_BYTES => None,
                        Some(Some(topic)) => Entry::from_json(topic, json),
                        // another program's
                        Some(None) => continue,
                        // its channel was named in a chunk that is bad
                        None => Topic::ALL.into_iter().find_map(|t| Entry::from_json(t, json)),
                    };
                    match entry {
                        Some(entry) => return Ok(Some(entry)),
                        None => self.records.damage_mut().bad_messages += 1,
                    }
                }
                _ => {}
            }
        }
        Ok(None)
    }

    /// When the last message was logged; `None` before the first.
    pub fn times(&self) -> Option<MessageTimes> {
        self.times
    }

    /// What is missing of it, as far as it was read; all of it after the last message.
    pub fn damage(&self) -> Damage {
        self.records.damage()
    }

    /// Bytes of the file.
    pub(crate) fn length(&self) -> u64 {
        self.records.length()
    }

    /// Bytes up to the end of the last whole record that is no part of the index, once all was read.
    pub(super) fn whole_bytes(&self) -> u64 {
        self.records.whole_bytes()
    }
}
