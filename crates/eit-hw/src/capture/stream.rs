//! Reads recordings message by message, using the memory of one chunk.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::Path;

use super::entry::{Entry, Topic};
use super::parts::Files;
use super::record::SessionRecord;
use super::records::Records;
use crate::error::HwError;
use mcap::records::{Record, op};

pub use super::records::Damage;

/// Log and publish times of a message, in nanoseconds since 1970 by the recorder's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct MessageTimes {
    /// Time that tools sort by; never decreases in a recording of this crate.
    pub log_ns: u64,
    /// Time as the clock showed it, even after it was set back.
    pub publish_ns: u64,
}

impl MessageTimes {
    /// Both times are this one.
    pub fn at(ns: u64) -> Self {
        Self { log_ns: ns, publish_ns: ns }
    }
}

/// Longest message that is read, in bytes: enough for 262 144 values with all their digits.
pub(super) const MOST_MESSAGE_BYTES: usize = 8 << 20;

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
    further: Option<Further<R>>,
}

/// Further parts of a split recording, and the state of the parts before.
#[derive(Debug)]
struct Further<R> {
    files: Files<R>,
    /// Damage of the parts before the current one.
    damage: Damage,
    /// Whether a session was read, and whether the part before the current one is missing.
    has_session: bool,
    is_gap: bool,
}

impl CaptureReader<BufReader<File>> {
    /// Opens the recording at `path`. If no file has that name but its [parts](super::files) exist,
    /// they are read as one recording.
    ///
    /// # Errors
    /// [`HwError::Read`], [`HwError::NotAFile`], and those of [`new`](CaptureReader::new).
    pub fn open(path: impl AsRef<Path>) -> Result<Self, HwError> {
        let path = path.as_ref();
        let mut files = Files::of(path);
        let records = files.first(path)?;
        let further =
            Further { files, damage: Damage::default(), has_session: false, is_gap: false };
        Ok(Self { records, channels: HashMap::new(), times: None, further: Some(further) })
    }
}

impl<R: Read + Seek> CaptureReader<R> {
    /// Reads a recording from `source`; `path` is used in messages only.
    ///
    /// # Errors
    /// [`HwError::Empty`]; [`HwError::Read`]; [`HwError::Container`] if the source does not start
    /// as MCAP.
    pub fn new(source: R, path: impl AsRef<Path>) -> Result<Self, HwError> {
        let path = path.as_ref();
        let records = Records::new(source, path)?;
        Ok(Self { records, channels: HashMap::new(), times: None, further: None })
    }

    /// Returns the next message, or `None` at the end.
    ///
    /// # Errors
    /// [`HwError::Read`] if the source cannot be read.
    pub fn next_entry(&mut self) -> Result<Option<Entry>, HwError> {
        loop {
            match self.next_in_part()? {
                Some(Entry::Session(session)) => {
                    if let Some(session) = self.merged(session) {
                        return Ok(Some(Entry::Session(session)));
                    }
                }
                Some(entry) => return Ok(Some(entry)),
                None if self.next_part()? => {}
                None => return Ok(None),
            }
        }
    }

    /// Returns one session for all parts that it was repeated in.
    fn merged(&mut self, session: SessionRecord) -> Option<SessionRecord> {
        let Some(further) = &mut self.further else { return Some(session) };
        let is_repeated = std::mem::replace(&mut further.has_session, true) && session.continues;
        match (is_repeated, further.is_gap) {
            (false, _) => Some(session),
            (true, false) => None,
            // another run may have begun in the missing part
            (true, true) => Some(SessionRecord { continues: false, ..session }),
        }
    }

    /// Continues with the next part; returns false if there is none.
    fn next_part(&mut self) -> Result<bool, HwError> {
        let Some(further) = &mut self.further else { return Ok(false) };
        let missing = further.files.missing;
        let Some(next) = further.files.next()? else { return Ok(false) };
        further.damage = further.damage.and(self.records.damage());
        further.is_gap = further.files.missing > missing;
        self.records = next;
        self.channels.clear();
        Ok(true)
    }

    fn next_in_part(&mut self) -> Result<Option<Entry>, HwError> {
        while let Some(item) = self.records.next()? {
            match self.records.parsed(&item) {
                Some(Record::Channel(channel)) => {
                    self.channels.insert(channel.id, Topic::of(&channel));
                }
                Some(Record::Message { header, data: json }) => {
                    let (log_ns, publish_ns) = (header.log_time, header.publish_time);
                    self.times = Some(MessageTimes { log_ns, publish_ns });
                    let entry = match self.channels.get(&header.channel_id).copied() {
                        _ if json.len() > MOST_MESSAGE_BYTES => None,
                        Some(Some(topic)) => Entry::from_json(topic, &json),
                        // written by another program
                        Some(None) => continue,
                        // its channel was defined in a damaged chunk
                        None => Topic::ALL.into_iter().find_map(|t| Entry::from_json(t, &json)),
                    };
                    match entry {
                        Some(entry) => return Ok(Some(entry)),
                        None => self.records.damage_mut().bad_messages += 1,
                    }
                }
                None if item.op == op::MESSAGE => self.records.damage_mut().bad_messages += 1,
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
        let damage = self.records.damage();
        self.further.as_ref().map_or(damage, |further| Damage {
            missing_parts: further.files.missing,
            ..further.damage.and(damage)
        })
    }

    /// Returns the length of the recording in bytes.
    pub(crate) fn length(&self) -> u64 {
        self.further.as_ref().map_or(self.records.length(), |further| further.files.bytes)
    }

    /// Returns the position after the last intact record that is not part of the index; valid once
    /// everything has been read.
    pub(super) fn whole_bytes(&self) -> u64 {
        self.records.whole_bytes()
    }
}
