//! Parsers for the content of container records: channels, schemas, messages, attachments,
//! metadata.

use std::collections::BTreeMap;
use std::ops::Range;

/// Splits off a length-prefixed byte string; returns it and the remaining bytes.
fn prefixed(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

fn text(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let (text, rest) = prefixed(bytes)?;
    Some((std::str::from_utf8(text).ok()?, rest))
}

/// The stream that a message belongs to: its topic, schema and encoding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Channel<'a> {
    pub id: u16,
    pub schema: u16,
    pub topic: &'a str,
    pub encoding: &'a str,
    /// Metadata, encoded as [`text_map`] reads it.
    pub metadata: &'a [u8],
}

impl<'a> Channel<'a> {
    pub(super) fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (id, rest) = bytes.split_first_chunk()?;
        let (schema, rest) = rest.split_first_chunk()?;
        let (topic, rest) = text(rest)?;
        let (encoding, rest) = text(rest)?;
        let (metadata, []) = prefixed(rest)? else { return None };
        let (id, schema) = (u16::from_le_bytes(*id), u16::from_le_bytes(*schema));
        Some(Self { id, schema, topic, encoding, metadata })
    }
}

/// A file embedded in the container.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Attachment {
    pub log_time: u64,
    pub create_time: u64,
    pub name: String,
    pub media_type: String,
    /// Byte range of its data in the file; a 4-byte checksum follows.
    pub data: Range<u64>,
}

impl Attachment {
    /// Parses the attachment at `place` from its first bytes.
    pub(super) fn parse(bytes: &[u8], place: &Range<u64>) -> Option<Self> {
        let (log_time, rest) = bytes.split_first_chunk()?;
        let (create_time, rest) = rest.split_first_chunk()?;
        let (name, rest) = text(rest)?;
        let (media_type, rest) = text(rest)?;
        let (length, rest) = rest.split_first_chunk()?;
        let start = place.start + (bytes.len() - rest.len()) as u64;
        let end = start.checked_add(u64::from_le_bytes(*length))?;
        (end.checked_add(4) == Some(place.end)).then(|| Self {
            log_time: u64::from_le_bytes(*log_time),
            create_time: u64::from_le_bytes(*create_time),
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: start..end,
        })
    }
}

/// Parses a map of strings to strings.
pub(super) fn text_map(mut bytes: &[u8]) -> Option<BTreeMap<String, String>> {
    let mut map = BTreeMap::new();
    while !bytes.is_empty() {
        let (key, rest) = text(bytes)?;
        let (value, rest) = text(rest)?;
        map.insert(key.to_owned(), value.to_owned());
        bytes = rest;
    }
    Some(map)
}

/// Parses the content of a metadata record: a name and its map.
pub(super) fn named_map(bytes: &[u8]) -> Option<(String, BTreeMap<String, String>)> {
    let (name, rest) = text(bytes)?;
    let (map, _) = prefixed(rest)?;
    Some((name.to_owned(), text_map(map)?))
}

/// The schema of a channel's messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Schema<'a> {
    pub id: u16,
    pub name: &'a str,
    pub encoding: &'a str,
    pub data: &'a [u8],
}

impl<'a> Schema<'a> {
    pub(super) fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (id, rest) = bytes.split_first_chunk()?;
        let (name, rest) = text(rest)?;
        let (encoding, rest) = text(rest)?;
        let (data, []) = prefixed(rest)? else { return None };
        Some(Self { id: u16::from_le_bytes(*id), name, encoding, data })
    }
}

/// One message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Message<'a> {
    pub channel: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
    pub data: &'a [u8],
}

impl<'a> Message<'a> {
    pub(super) fn parse(bytes: &'a [u8]) -> Option<Self> {
        let (channel, rest) = bytes.split_first_chunk()?;
        let (sequence, rest) = rest.split_first_chunk()?;
        let (log_time, rest) = rest.split_first_chunk()?;
        let (publish_time, data) = rest.split_first_chunk()?;
        Some(Self {
            channel: u16::from_le_bytes(*channel),
            sequence: u32::from_le_bytes(*sequence),
            log_time: u64::from_le_bytes(*log_time),
            publish_time: u64::from_le_bytes(*publish_time),
            data,
        })
    }
}
