//! Copies the intact part of a damaged recording to a new one.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::ops::Range;
use std::path::Path;

use mcap::records::{Channel, MessageHeader, Record, op};
use mcap::{Compression, McapError, WriteOptions, Writer};

use super::container::container_error;
use super::entry::{Entry, Topic};
use super::parts::{Files, check_new};
use super::read::SameSetUp;
use super::records::{Damage, Records};
use super::stream::MOST_MESSAGE_BYTES;
use super::write::part_file::PartFile;
use crate::error::{HwError, Place};

/// What was copied to the new recording, and what was not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Recovered {
    /// Number of frames copied.
    pub frames: u64,
    /// Number of other messages: sessions, references, touches, notes and those of other programs.
    pub messages: u64,
    /// Number of those that are sessions, which every recording of ours begins with.
    pub sessions: u64,
    /// Number of messages that were stored intact but are not what their topic holds, such as a frame
    /// without values. They are copied unchanged, and every reader skips them.
    pub unreadable: u64,
    /// Number of frames and sessions with other measurements than the first ones. They are copied
    /// unchanged, but a reader of whole recordings rejects the mix.
    pub other_set_ups: u64,
    /// Number of attachments and metadata records.
    pub attachments: u64,
    /// Number of attachments skipped because their checksum is wrong, and of unreadable metadata
    /// records.
    pub bad_attachments: u64,
    /// What is missing or damaged.
    pub damage: Damage,
}

impl Recovered {
    /// Returns whether anything was copied.
    fn is_any(&self) -> bool {
        self.frames + self.messages + self.unreadable + self.attachments > 0
    }
}

/// Copies everything intact in a damaged recording, or in the parts of a split one, to a new one: messages of every topic with their
/// times and sequence numbers, attachments and metadata, in their order.
///
/// The new recording has `.part` behind its name until it is complete: a program that is killed
/// leaves nothing that could be taken for all there is.
///
/// # Errors
/// Those of [`read`](super::read): if the disk fails midway, the new recording keeps what was read
/// before. [`HwError::Exists`] if the new file exists, [`HwError::Write`] if it cannot be written,
/// [`HwError::Busy`] if another program is writing it, and [`HwError::NothingWhole`] if nothing is
/// intact; no new file is left then.
pub fn recover(from: impl AsRef<Path>, to: impl AsRef<Path>) -> Result<Recovered, HwError> {
    let from = from.as_ref();
    let to = to.as_ref();
    check_new(to)?;
    let mut files = Files::of(from);
    let first = files.first(from)?;
    let (part, file) = PartFile::create(to)?;
    let mut copy = Copy::to(file, from).map_err(|failure| failure.at(to))?;
    let recovered = copy_all(first, &mut files, &mut copy);
    let finished = match &recovered {
        Err(Failure::Write(_)) => {
            drop(copy);
            Ok(())
        }
        _ => copy.finish(),
    };
    match (recovered, finished) {
        // the new recording keeps what could be read
        (Err(Failure::Read(error)), Ok(())) => part.keep().and(Err(error)),
        (Ok(recovered), Ok(())) if recovered.is_any() => part.keep().map(|()| recovered),
        (Err(failure), _) | (Ok(_), Err(failure)) => Err(failure.at(to)),
        (Ok(_), Ok(())) => {
            Err(HwError::NothingWhole { place: Place::file(from), bytes: files.bytes })
        }
    }
}

fn copy_all(
    first: Source,
    files: &mut Files<BufReader<File>>,
    copy: &mut Copy,
) -> Result<Recovered, Failure> {
    let (mut part, mut damage) = (Some(first), Damage::default());
    while let Some(mut records) = part {
        copy_part(&mut records, copy)?;
        damage = damage.and(records.damage());
        part = files.next()?;
        // numbers of schemas and channels are those of one file
        copy.schemas.clear();
        copy.channels.clear();
    }
    copy.recovered.damage = damage;
    copy.recovered.damage.missing_parts = files.missing;
    copy.recovered.damage.bad_messages += copy.bad_records;
    Ok(copy.recovered)
}

fn copy_part(records: &mut Source, copy: &mut Copy) -> Result<(), Failure> {
    while let Some(item) = records.next()? {
        match records.parsed(&item) {
            _ if item.op == op::METADATA => copy.metadata(records, item.place)?,
            _ if item.op == op::ATTACHMENT => copy.attachment(records, item.place)?,
            Some(Record::Schema { header, data }) => {
                let new = copy.writer.add_schema(&header.name, &header.encoding, &data)?;
                copy.schemas.insert(header.id, new);
            }
            Some(Record::Channel(channel)) => copy.channel(&channel)?,
            Some(Record::Message { header, data }) => copy.message(header, &data)?,
            None if matches!(item.op, op::SCHEMA | op::CHANNEL | op::MESSAGE) => {
                copy.bad_records += 1;
            }
            _ => {}
        }
    }
    Ok(())
}

/// Cause of a failed copy.
enum Failure {
    Read(HwError),
    Write(McapError),
}

impl Failure {
    fn at(self, path: &Path) -> HwError {
        match self {
            Self::Read(error) => error,
            Self::Write(McapError::Io(source)) => {
                HwError::Write { place: Place::file(path), source }
            }
            Self::Write(other) => container_error(Place::file(path), &other),
        }
    }
}

impl From<HwError> for Failure {
    fn from(error: HwError) -> Self {
        Self::Read(error)
    }
}

impl From<McapError> for Failure {
    fn from(error: McapError) -> Self {
        Self::Write(error)
    }
}

type Source = Records<BufReader<File>>;

/// The new recording, while it is written.
struct Copy {
    writer: Writer<BufWriter<File>>,
    /// IDs of schemas and channels in the old recording, mapped to those in the new one.
    schemas: HashMap<u16, u16>,
    channels: HashMap<u16, (u16, Option<Topic>)>,
    /// Messages, schemas and channels whose content is not one.
    bad_records: usize,
    same: SameSetUp,
    recovered: Recovered,
}

impl Copy {
    /// Begins the new recording in a file; `from` is used in messages only.
    fn to(file: File, from: &Path) -> Result<Self, Failure> {
        let writer = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(1 << 20))
            .library(concat!("eit-hw ", env!("CARGO_PKG_VERSION"), " recover"))
            .create(BufWriter::new(file))?;
        Ok(Self {
            writer,
            schemas: HashMap::new(),
            channels: HashMap::new(),
            bad_records: 0,
            same: SameSetUp::new(from),
            recovered: Recovered::default(),
        })
    }

    fn channel(&mut self, channel: &Channel) -> Result<(), Failure> {
        let schema = self.schemas.get(&channel.schema_id).copied().unwrap_or(0);
        let Channel { topic, message_encoding, metadata, .. } = channel;
        let new = self.writer.add_channel(schema, topic, message_encoding, metadata)?;
        self.channels.insert(channel.id, (new, Topic::of(channel)));
        Ok(())
    }

    fn message(&mut self, header: MessageHeader, data: &[u8]) -> Result<(), Failure> {
        let read = |topic| match data.len() {
            0..=MOST_MESSAGE_BYTES => Entry::from_json(topic, data),
            _ => None,
        };
        let known = self.channels.get(&header.channel_id).copied();
        let (channel_id, is_own, entry) = match known {
            Some((new, topic)) => (new, topic.is_some(), topic.and_then(read)),
            // its channel was defined in a damaged chunk
            None => {
                let found = |topic: Topic| Some((topic, read(topic)?));
                let Some((topic, entry)) = Topic::ALL.into_iter().find_map(found) else {
                    self.bad_records += 1;
                    return Ok(());
                };
                (self.own_channel(topic)?, true, Some(entry))
            }
        };
        self.writer.write_to_known_channel(&MessageHeader { channel_id, ..header }, data)?;
        self.count(is_own, entry.as_ref());
        Ok(())
    }

    /// Counts a copied message of one of our topics, or of another program.
    fn count(&mut self, is_own: bool, entry: Option<&Entry>) {
        let recovered = &mut self.recovered;
        match entry {
            Some(Entry::Frame(_)) => recovered.frames += 1,
            None if is_own => recovered.unreadable += 1,
            _ => recovered.messages += 1,
        }
        recovered.sessions += u64::from(matches!(entry, Some(Entry::Session(_))));
        let differs = entry.is_some_and(|entry| self.same.take(entry).is_err());
        recovered.other_set_ups += u64::from(differs);
    }

    fn own_channel(&mut self, topic: Topic) -> Result<u16, Failure> {
        let (name, text) = topic.schema();
        let schema = self.writer.add_schema(name, "jsonschema", text.as_bytes())?;
        Ok(self.writer.add_channel(schema, topic.name(), "json", &BTreeMap::new())?)
    }

    fn metadata(&mut self, records: &mut Source, place: Range<u64>) -> Result<(), Failure> {
        let bytes = records.held(place)?;
        let Ok(Record::Metadata(metadata)) = mcap::parse_record(op::METADATA, &bytes) else {
            self.recovered.bad_attachments += 1;
            return Ok(());
        };
        self.writer.write_metadata(&metadata)?;
        self.recovered.attachments += 1;
        Ok(())
    }

    fn attachment(&mut self, records: &mut Source, place: Range<u64>) -> Result<(), Failure> {
        let Some(found) = records.attachment(place)? else {
            self.recovered.bad_attachments += 1;
            return Ok(());
        };
        let (header, data) = (found.header, found.data);
        self.writer.start_attachment(data.end - data.start, header)?;
        records.copy(data, |piece| Ok::<_, Failure>(self.writer.put_attachment_bytes(piece)?))?;
        self.writer.finish_attachment()?;
        self.recovered.attachments += 1;
        Ok(())
    }

    fn finish(mut self) -> Result<(), Failure> {
        self.writer.finish()?;
        let file =
            self.writer.into_inner().into_inner().map_err(|e| McapError::Io(e.into_error()))?;
        file.sync_all().map_err(McapError::Io)?;
        Ok(())
    }
}
