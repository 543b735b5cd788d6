//! Reads recordings message by message, using the memory of one chunk.

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

/// Log and publish times of a message, in nanoseconds since 1970 by the recorder's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageTimes {
    /// Time that tools sort by; never decreases in a recording of this crate.
    pub log_ns: u64,
    /// Time as the clock showed it, even after it was set back.
    pub publish_ns: u64,
}

/// Longest message that is read, in bytes: enough for 262 144 values with all their digits.
const MOST_MESSAGE_BYTES: usize = 8 << 20;

/// Reads a recording message by message, even if its end is missing.
///
/// Intact chunks are read even if others are damaged; no index is needed. Chunks may be compressed
/// with LZ4 or Zstandard, or not at all.
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
    /// Opens the recording at `path`.
    ///
    /// # Errors
    /// [`HwError::Read`], [`HwError::NotAFile`], and those of [`new`](CaptureReader::new).
    pub fn open(path: &Path) -> Result<Self, HwError> {
        Self::new(BufReader::with_capacity(1 << 16, regular_file(path)?), path)
    }
}

impl<R: Read + Seek> CaptureReader<R> {
    /// Reads a recording from `source`; `path` is used in messages only.
    ///
    /// # Errors
    /// [`HwError::Empty`]; [`HwError::Read`]; [`HwError::Container`] if the source does not start
    /// as MCAP.
    pub fn new(source: R, path: &Path) -> Result<Self, HwError> {
        Ok(Self { records: Records::new(source, path)?, channels: HashMap::new(), times: None })
    }

    /// Returns the next message, or `None` at the end.
    ///
    /// # Errors
    /// [`HwError::Read`] if the source cannot be read.
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
                        // written by another program
                        Some(None) => continue,
                        // its channel was defined in a damaged chunk
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

    /// Returns the times of the last message read, or `None` before the first.
    pub fn times(&self) -> Option<MessageTimes> {
        self.times
    }

    /// Returns the damage found so far; complete once [`next_entry`](Self::next_entry) has returned
    /// `None`.
    pub fn damage(&self) -> Damage {
        self.records.damage()
    }

    /// Returns the length of the file in bytes.
    pub(crate) fn length(&self) -> u64 {
        self.records.length()
    }

    /// Returns the position after the last intact record that is not part of the index; valid once
    /// everything has been read.
    pub(super) fn whole_bytes(&self) -> u64 {
        self.records.whole_bytes()
    }
}
