//! Copies the intact part of a damaged recording to a new one.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{BufReader, BufWriter};
use std::ops::Range;
use std::path::Path;

use mcap::records::{AttachmentHeader, MessageHeader, Metadata};
use mcap::{Compression, McapError, WriteOptions, Writer};

use super::container::container_error;
use super::content::{Attachment, Channel, Message, Schema, named_map, text_map};
use super::entry::{Entry, Topic};
use super::parts::{Files, check_new};
use super::records::{Damage, Records, op};
use super::write::storage::create_new;
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
        self.frames + self.messages + self.attachments > 0
    }
}

/// Copies everything intact in a damaged recording, or in the parts of a split one, to a new one: messages of every topic with their
/// times and sequence numbers, attachments and metadata, in their order.
///
/// # Errors
/// Those of [`read`](super::read): if the disk fails midway, the new recording keeps what was read
/// before. [`HwError::Exists`] if the new file exists, [`HwError::Write`] if it cannot be written, and
/// [`HwError::NothingWhole`] if nothing is intact; no new file is left then.
pub fn recover(from: impl AsRef<Path>, to: impl AsRef<Path>) -> Result<Recovered, HwError> {
    let from = from.as_ref();
    let to = to.as_ref();
    check_new(to)?;
    let mut files = Files::of(from);
    let first = files.first(from)?;
    let mut copy = Copy::to(to)?;
    let recovered = copy_all(first, &mut files, &mut copy);
    let finished = match &recovered {
        Err(Failure::Write(_)) => {
            drop(copy);
            Ok(())
        }
        _ => copy.finish(),
    };
    let recovered = match (recovered, finished) {
        // the new recording keeps what could be read
        (Err(Failure::Read(error)), Ok(())) => return Err(error),
        (Ok(recovered), Ok(())) if recovered.is_any() => return Ok(recovered),
        (Err(failure), _) | (Ok(_), Err(failure)) => failure.at(to),
        (Ok(_), Ok(())) => HwError::NothingWhole { place: Place::file(from), bytes: files.bytes },
    };
    // created above; an incomplete file could be taken for everything there is
    let _ = std::fs::remove_file(to);
    Err(recovered)
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
    copy.recovered.damage.bad_messages += copy.bad_messages;
    Ok(copy.recovered)
}

fn copy_part(records: &mut Source, copy: &mut Copy) -> Result<(), Failure> {
    while let Some(item) = records.next()? {
        match item.op {
            op::SCHEMA => copy.schema(records.bytes(&item))?,
            op::CHANNEL => copy.channel(records.bytes(&item))?,
            op::MESSAGE => copy.message(records.bytes(&item))?,
            op::METADATA => copy.metadata(records, item.place)?,
            op::ATTACHMENT => copy.attachment(records, item.place)?,
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
    bad_messages: usize,
    recovered: Recovered,
}

impl Copy {
    fn to(path: &Path) -> Result<Self, HwError> {
        let file = create_new(path)?;
        let writer = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .chunk_size(Some(1 << 20))
            .library(concat!("eit-hw ", env!("CARGO_PKG_VERSION"), " recover"))
            .create(BufWriter::new(file))
            .map_err(|error| Failure::Write(error).at(path))?;
        let (schemas, channels) = (HashMap::new(), HashMap::new());
        Ok(Self { writer, schemas, channels, bad_messages: 0, recovered: Recovered::default() })
    }

    fn schema(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        let Some(Schema { id, name, encoding, data }) = Schema::parse(bytes) else { return Ok(()) };
        let new = self.writer.add_schema(name, encoding, data)?;
        self.schemas.insert(id, new);
        Ok(())
    }

    fn channel(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        let Some(channel) = Channel::parse(bytes) else { return Ok(()) };
        let topic = Topic::of(&channel);
        let schema = self.schemas.get(&channel.schema).copied().unwrap_or(0);
        let metadata = text_map(channel.metadata).unwrap_or_default();
        let new = self.writer.add_channel(schema, channel.topic, channel.encoding, &metadata)?;
        self.channels.insert(channel.id, (new, topic));
        Ok(())
    }

    fn message(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        let Some(message) = Message::parse(bytes) else { return Ok(()) };
        let (channel_id, topic) = match self.channels.get(&message.channel) {
            Some(&found) => found,
            // its channel was defined in a damaged chunk
            None => {
                let is_of = |topic: &Topic| Entry::from_json(*topic, message.data).is_some();
                let Some(topic) = Topic::ALL.into_iter().find(is_of) else {
                    self.bad_messages += 1;
                    return Ok(());
                };
                (self.own_channel(topic)?, Some(topic))
            }
        };
        let header = MessageHeader {
            channel_id,
            sequence: message.sequence,
            log_time: message.log_time,
            publish_time: message.publish_time,
        };
        self.writer.write_to_known_channel(&header, message.data)?;
        match topic {
            Some(Topic::Frame) => self.recovered.frames += 1,
            _ => self.recovered.messages += 1,
        }
        Ok(())
    }

    fn own_channel(&mut self, topic: Topic) -> Result<u16, Failure> {
        let (name, text) = topic.schema();
        let schema = self.writer.add_schema(name, "jsonschema", text.as_bytes())?;
        Ok(self.writer.add_channel(schema, topic.name(), "json", &BTreeMap::new())?)
    }

    fn metadata(&mut self, records: &mut Source, place: Range<u64>) -> Result<(), Failure> {
        let bytes = records.held(place)?;
        let Some((name, metadata)) = named_map(&bytes) else {
            self.recovered.bad_attachments += 1;
            return Ok(());
        };
        self.writer.write_metadata(&Metadata { name, metadata })?;
        self.recovered.attachments += 1;
        Ok(())
    }

    fn attachment(&mut self, records: &mut Source, place: Range<u64>) -> Result<(), Failure> {
        let Some(found) = records.attachment(place)? else {
            self.recovered.bad_attachments += 1;
            return Ok(());
        };
        let Attachment { log_time, create_time, name, media_type, data, .. } = found;
        let header = AttachmentHeader { log_time, create_time, name, media_type };
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
