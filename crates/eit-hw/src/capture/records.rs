//! The records of a container, whole or damaged, in the memory of one chunk.
//!
//! A length that is wrong must not cost what comes after it: where a record cannot be, the file is
//! searched for the next chunk that is whole. This needs no index, so that it serves recordings of
//! programs that were killed, too. Long because reading and finding one's way again share their state.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use super::container::MAGIC;
use super::unpack::{CHUNK_HEAD, ChunkHead, MOST_CHUNK_BYTES, RECORD_HEAD, record_length};
use crate::error::{HwError, Place};

/// Opcodes of the container's records.
pub(super) mod op {
    pub const HEADER: u8 = 0x01;
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const MESSAGE_INDEX: u8 = 0x07;
    pub const ATTACHMENT: u8 = 0x09;
    pub const METADATA: u8 = 0x0C;
    pub const DATA_END: u8 = 0x0F;
}

/// Records of the index: schemas, channels, places and statistics.
const SUMMARY: [u8; 7] = [op::SCHEMA, op::CHANNEL, 0x08, 0x0A, 0x0B, 0x0D, 0x0E];
/// Longest record that is held in memory; attachments are not.
const MOST_RECORD_BYTES: u64 = 8 << 20;
/// Longest head of an attachment: its names.
const MOST_ATTACHMENT_HEAD: u64 = 1 << 16;
/// Content of chunks that is unpacked in vain, over the length of the file, until no more is tried.
const MOST_TRIES: u64 = 4;
/// Bytes that are searched at once.
const SEARCHED: usize = 1 << 16;

/// What is missing of a recording.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Damage {
    /// The recording was not finished: its program was killed.
    pub unfinished: bool,
    /// Bytes at the end that are no whole record.
    pub truncated_bytes: u64,
    /// Bytes before a whole record that are none.
    pub skipped_bytes: u64,
    /// Chunks whose checksum or content is wrong; their messages are left out.
    pub bad_chunks: usize,
    /// Chunks with a damaged head whose content is whole; their messages are read.
    pub mended_chunks: usize,
    /// Messages that cannot be read: of another version, too long, or of a topic that is not known.
    pub bad_messages: usize,
}

impl Damage {
    /// Whether something was lost or is damaged, beside an end that was not written.
    pub fn is_any(&self) -> bool {
        let Self {
            truncated_bytes, skipped_bytes, bad_chunks, mended_chunks, bad_messages, ..
        } = *self;
        truncated_bytes + skipped_bytes > 0 || bad_chunks + mended_chunks + bad_messages > 0
    }
}

/// A record that was found; [`Records::bytes`] has its content.
#[derive(Clone, Debug)]
pub(super) struct Item {
    pub op: u8,
    in_chunk: bool,
    range: Range<usize>,
    /// Where its content lies in the file; of a record in a chunk, that of the chunk.
    pub place: Range<u64>,
}

/// Reads the records of a container.
#[derive(Debug)]
pub(super) struct Records<R> {
    source: R,
    path: PathBuf,
    /// Bytes of the file.
    length: u64,
    /// Where the source stands.
    at: u64,
    /// Where the next record begins.
    position: u64,
    /// Where the last whole record of the data ended.
    whole: u64,
    /// The content of the last chunk, and how far it was told.
    chunk: Vec<u8>,
    told: usize,
    chunk_place: Range<u64>,
    /// The last record outside of a chunk.
    record: Vec<u8>,
    /// Bytes that may still be unpacked in vain.
    tries: u64,
    damage: Damage,
    is_over: bool,
}

impl<R: Read + Seek> Records<R> {
    pub(super) fn new(mut source: R, path: &Path) -> Result<Self, HwError> {
        let failed = |source| HwError::Read { place: Place::file(path), source };
        let length = source.seek(SeekFrom::End(0)).map_err(failed)?;
        source.seek(SeekFrom::Start(0)).map_err(failed)?;
        let mut records = Self {
            source,
            path: path.to_path_buf(),
            length,
            at: 0,
            position: 0,
            whole: 0,
            chunk: Vec::new(),
            told: 0,
            chunk_place: 0..0,
            record: Vec::new(),
            tries: MOST_TRIES * length + MOST_CHUNK_BYTES,
            damage: Damage { unfinished: true, ..Damage::default() },
            is_over: false,
        };
        let mut start = [0; MAGIC.len()];
        let found = records.read_at(0, &mut start)?;
        if found == 0 {
            return Err(HwError::Empty { place: Place::file(path) });
        }
        if start[..found] != MAGIC[..found] {
            return Err(HwError::Container {
                place: Place::file(path),
                what: "is no MCAP file".into(),
                mend: "set `[recording] format` to what it is",
            });
        }
        (records.position, records.whole) = (found as u64, found as u64);
        Ok(records)
    }

    pub(super) fn damage(&self) -> Damage {
        self.damage
    }

    pub(super) fn damage_mut(&mut self) -> &mut Damage {
        &mut self.damage
    }

    /// Bytes of the file.
    pub(super) fn length(&self) -> u64 {
        self.length
    }

    /// Bytes up to the end of the last whole record that is no part of the index.
    pub(super) fn whole_bytes(&self) -> u64 {
        self.whole
    }

    /// The content of the record that was found last.
    pub(super) fn bytes(&self, item: &Item) -> &[u8] {
        let held = if item.in_chunk { &self.chunk } else { &self.record };
        held.get(item.range.clone()).unwrap_or_default()
    }

    /// A part of the file, such as an attachment, in pieces.
    pub(super) fn copy<E: From<HwError>>(
        &mut self,
        place: Range<u64>,
        mut take: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        let mut buffer = [0; 1 << 13];
        let mut at = place.start;
        while at < place.end {
            let wanted = usize::try_from(place.end - at).unwrap_or(usize::MAX).min(buffer.len());
            let found = self.read_at(at, &mut buffer[..wanted])?;
            if found == 0 {
                break;
            }
            take(&buffer[..found])?;
            at += found as u64;
        }
        Ok(())
    }

    /// A part of the file in memory, at most as long as a record that is held.
    pub(super) fn held(&mut self, place: Range<u64>) -> Result<Vec<u8>, HwError> {
        let end = place.end.min(place.start + MOST_RECORD_BYTES);
        let mut bytes = Vec::new();
        self.copy(place.start..end, |piece| {
            bytes.extend_from_slice(piece);
            Ok::<_, HwError>(())
        })?;
        Ok(bytes)
    }

    /// The attachment whose content lies here; `None` where its checksum is wrong.
    pub(super) fn attachment(&mut self, place: Range<u64>) -> Result<Option<Attachment>, HwError> {
        let head = self.held(place.start..place.end.min(place.start + MOST_ATTACHMENT_HEAD))?;
        let Some(found) = Attachment::parse(&head, &place) else { return Ok(None) };
        let crc_at = place.end - 4;
        let mut hasher = crc32fast::Hasher::new();
        self.copy(place.start..crc_at, |piece| {
            hasher.update(piece);
            Ok::<_, HwError>(())
        })?;
        let mut crc = [0; 4];
        self.read_at(crc_at, &mut crc)?;
        let crc = u32::from_le_bytes(crc);
        Ok((crc == 0 || crc == hasher.finalize()).then_some(found))
    }

    /// The next record: schemas, channels, messages, attachments and metadata; `None` at the end.
    pub(super) fn next(&mut self) -> Result<Option<Item>, HwError> {
        loop {
            if let Some(item) = self.next_in_chunk() {
                return Ok(Some(item));
            }
            if self.is_over {
                return Ok(None);
            }
            if let Some(item) = self.next_in_file()? {
                return Ok(Some(item));
            }
        }
    }

    fn next_in_chunk(&mut self) -> Option<Item> {
        let rest = self.chunk.get(self.told..)?;
        let (head, rest) = rest.split_first_chunk::<RECORD_HEAD>()?;
        let length = usize::try_from(record_length(head)).ok().filter(|&l| l <= rest.len())?;
        let start = self.told + RECORD_HEAD;
        self.told = start + length;
        let range = start..self.told;
        Some(Item { op: head[0], in_chunk: true, range, place: self.chunk_place.clone() })
    }

    fn next_in_file(&mut self) -> Result<Option<Item>, HwError> {
        let at = self.position;
        let mut head = [0; RECORD_HEAD];
        if self.read_at(at, &mut head)? < RECORD_HEAD {
            return self.finish(false).map(|()| None);
        }
        let (op, length) = (head[0], record_length(&head));
        let start = at + RECORD_HEAD as u64;
        let end = start.checked_add(length).filter(|&end| end <= self.length);
        if op == op::DATA_END && self.is_end(at, length)? {
            return self.finish(true).map(|()| None);
        }
        // what was a chunk once may have lost its opcode, too
        let is_known = matches!(
            op,
            op::HEADER
                | op::SCHEMA
                | op::CHANNEL
                | op::MESSAGE
                | op::MESSAGE_INDEX
                | op::ATTACHMENT
                | op::METADATA
        );
        if !is_known && self.chunk_at(at, op, end)? {
            return Ok(None);
        }
        let is_other = is_known || op > op::DATA_END;
        let Some(end) = end.filter(|_| is_other && op != op::CHUNK) else {
            return self.find_chunk(at).map(|()| None);
        };
        let is_held = matches!(op, op::SCHEMA | op::CHANNEL | op::MESSAGE);
        if is_held {
            self.record.clear();
            if length <= MOST_RECORD_BYTES {
                self.record_at(start..end)?;
            }
        }
        let is_sure = matches!(op, op::MESSAGE_INDEX | op::CHANNEL | op::SCHEMA | op::ATTACHMENT);
        if !self.is_consistent(op, start..end)? || !(is_sure || self.can_begin(end)?) {
            return self.find_chunk(at).map(|()| None);
        }
        (self.position, self.whole) = (end, end);
        if is_held && length > MOST_RECORD_BYTES {
            self.damage.bad_messages += 1;
            return Ok(None);
        }
        let is_told = is_held || matches!(op, op::ATTACHMENT | op::METADATA);
        let range = 0..self.record.len();
        Ok(is_told.then_some(Item { op, in_chunk: false, range, place: start..end }))
    }

    /// Takes the chunk at `at`, whose record ends at `end`, where it is one; whether it is. One that
    /// is bad is left out.
    fn chunk_at(&mut self, at: u64, op: u8, end: Option<u64>) -> Result<bool, HwError> {
        let start = at + RECORD_HEAD as u64;
        let mut bytes = [0; CHUNK_HEAD];
        let found = self.read_at(start, &mut bytes)?;
        let Some(head) = ChunkHead::parse(&bytes[..found]) else { return Ok(false) };
        let content = start + head.bytes;
        let stated = head.stated_bytes().map(|length| start + length);
        let stated = stated.filter(|&end| end <= self.length);
        if op == op::CHUNK && stated.is_some() && stated == end {
            let end = stated.unwrap_or(content);
            if !self.unpack(&head, content..end)? {
                self.chunk.clear();
                self.damage.bad_chunks += 1;
            }
            (self.position, self.whole) = (end, end);
            return Ok(true);
        }
        // one of the two lengths is wrong, or the opcode: the checksum says which
        if head.crc == 0 {
            return Ok(false);
        }
        let ends = [stated, end.filter(|&end| end > content && end - start <= MOST_CHUNK_BYTES)];
        for end in ends.into_iter().flatten() {
            if self.unpack(&head, content..end)? {
                self.damage.mended_chunks += 1;
                (self.position, self.whole) = (end, end);
                return Ok(true);
            }
        }
        self.chunk.clear();
        Ok(false)
    }

    /// Unpacks a chunk; whether it is whole.
    fn unpack(&mut self, head: &ChunkHead, place: Range<u64>) -> Result<bool, HwError> {
        self.told = 0;
        if self.tries == 0 {
            return Ok(false);
        }
        self.record.clear();
        self.record_at(place.clone())?;
        let is_whole = head.unpack(&self.record, &mut self.chunk);
        if !is_whole {
            let cost = (self.record.len() + self.chunk.len()) as u64;
            self.tries = self.tries.saturating_sub(cost);
        }
        self.chunk_place = place;
        Ok(is_whole)
    }

    /// Whether a record's content fits its own lengths, as far as they are known.
    fn is_consistent(&mut self, op: u8, place: Range<u64>) -> Result<bool, HwError> {
        let length = place.end - place.start;
        Ok(match op {
            op::MESSAGE_INDEX => {
                let mut head = [0; 6];
                let found = self.read_at(place.start, &mut head)?;
                let [_, _, list @ ..] = head;
                found == head.len() && length == 6 + u64::from(u32::from_le_bytes(list))
            }
            op::MESSAGE => length >= 22,
            op::CHANNEL => length > MOST_RECORD_BYTES || Channel::parse(&self.record).is_some(),
            op::ATTACHMENT => {
                let most = place.end.min(place.start + MOST_ATTACHMENT_HEAD);
                let head = self.held(place.start..most)?;
                Attachment::parse(&head, &place).is_some()
            }
            op::SCHEMA => length > MOST_RECORD_BYTES || Schema::parse(&self.record).is_some(),
            _ => true,
        })
    }

    /// Whether a record can begin here, or the file ends.
    fn can_begin(&mut self, at: u64) -> Result<bool, HwError> {
        let mut head = [0; RECORD_HEAD];
        let found = self.read_at(at, &mut head)?;
        if found < RECORD_HEAD {
            // nothing, or a record that was not written to its end
            return Ok(true);
        }
        let (op, length) = (head[0], record_length(&head));
        let is_op = (op::HEADER..=op::DATA_END).contains(&op) || op >= 0x80;
        let left = self.length - at - RECORD_HEAD as u64;
        // a chunk may be cut by the end of the file
        Ok(is_op && (length <= left || length <= MOST_CHUNK_BYTES))
    }

    /// Goes on with the next whole chunk behind the damage at `at`.
    fn find_chunk(&mut self, at: u64) -> Result<(), HwError> {
        let mut from = at + 1;
        let mut bytes = vec![0; SEARCHED + RECORD_HEAD + CHUNK_HEAD];
        while from < self.length {
            let found = self.read_at(from, &mut bytes)?;
            for start in 0..found.min(SEARCHED) {
                if bytes[start] != op::CHUNK {
                    continue;
                }
                let Some(head) = bytes[start..found]
                    .get(RECORD_HEAD..)
                    .and_then(ChunkHead::parse)
                    .and_then(|head| head.stated_bytes())
                else {
                    continue;
                };
                let here = from + start as u64;
                let end = here + RECORD_HEAD as u64 + head;
                let stated = bytes[start..].first_chunk().map(record_length);
                let before = self.damage;
                let is_whole = end <= self.length
                    && self.chunk_at(here, op::CHUNK, stated.and_then(|l| self.end(here, l)))?
                    && self.damage.bad_chunks == before.bad_chunks;
                if is_whole {
                    self.damage.skipped_bytes += here - at;
                    return Ok(());
                }
                self.damage = before;
            }
            from += SEARCHED as u64;
        }
        // nothing more
        self.chunk.clear();
        self.finish(false)
    }

    /// Where a record of this length ends, within the file.
    fn end(&self, at: u64, length: u64) -> Option<u64> {
        let start = at + RECORD_HEAD as u64;
        start.checked_add(length).filter(|&end| end <= self.length)
    }

    /// Whether the data really end here: what follows is the index of this file, up to its end.
    fn is_end(&mut self, at: u64, length: u64) -> Result<bool, HwError> {
        const FOOTER: u64 = RECORD_HEAD as u64 + 20;
        let after = at + RECORD_HEAD as u64 + length;
        let Some(footer) = self.length.checked_sub(FOOTER + MAGIC.len() as u64) else {
            return Ok(false);
        };
        let mut bytes = [0; FOOTER as usize + MAGIC.len()];
        if length != 4 || footer < after || self.read_at(footer, &mut bytes)? < bytes.len() {
            return Ok(false);
        }
        let summary = bytes[RECORD_HEAD..].first_chunk().map_or(0, |b| u64::from_le_bytes(*b));
        let begins_here = match summary {
            0 => footer == after,
            start => start == after,
        };
        if bytes[0] != op::FOOTER || !begins_here || !bytes.ends_with(MAGIC) {
            return Ok(false);
        }
        // record by record: another recording may lie behind this one
        let mut at = after;
        while at < footer {
            let mut head = [0; RECORD_HEAD];
            self.read_at(at, &mut head)?;
            let end = self.end(at, record_length(&head));
            match end.filter(|&end| end <= footer && SUMMARY.contains(&head[0])) {
                Some(end) => at = end,
                None => return Ok(false),
            }
        }
        Ok(true)
    }

    fn finish(&mut self, has_index: bool) -> Result<(), HwError> {
        self.is_over = true;
        self.damage.unfinished = !has_index;
        if !has_index {
            self.damage.truncated_bytes = self.length - self.whole;
        }
        Ok(())
    }

    /// The content of a record, grown as it is read: a length alone asks for no memory.
    fn record_at(&mut self, place: Range<u64>) -> Result<(), HwError> {
        self.seek(place.start)?;
        let read = (&mut self.source).take(place.end - place.start).read_to_end(&mut self.record);
        let read =
            read.map_err(|source| HwError::Read { place: Place::file(&self.path), source })?;
        self.at += read as u64;
        Ok(())
    }

    fn seek(&mut self, to: u64) -> Result<(), HwError> {
        if self.at != to {
            // relative, so that a buffer is kept
            let failed = |source| HwError::Read { place: Place::file(&self.path), source };
            let step = to as i64 - self.at as i64;
            self.source.seek_relative(step).map_err(failed)?;
            self.at = to;
        }
        Ok(())
    }

    /// Bytes from `at` on, fewer at the end of the file; how many.
    fn read_at(&mut self, at: u64, bytes: &mut [u8]) -> Result<usize, HwError> {
        self.seek(at)?;
        let mut filled = 0;
        while filled < bytes.len() && at + (filled as u64) < self.length {
            let most = usize::try_from(self.length - at).unwrap_or(usize::MAX).min(bytes.len());
            match self.source.read(&mut bytes[filled..most]) {
                Ok(0) => break,
                Ok(count) => filled += count,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(source) => {
                    return Err(HwError::Read { place: Place::file(&self.path), source });
                }
            }
        }
        self.at += filled as u64;
        Ok(filled)
    }
}

/// A list of bytes behind its length, and what follows.
fn prefixed(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

fn text(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let (text, rest) = prefixed(bytes)?;
    Some((std::str::from_utf8(text).ok()?, rest))
}

/// What a message is of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Channel<'a> {
    pub id: u16,
    pub schema: u16,
    pub topic: &'a str,
    pub encoding: &'a str,
    /// A map, see [`text_map`].
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

/// A file within the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Attachment {
    pub log_time: u64,
    pub create_time: u64,
    pub name: String,
    pub media_type: String,
    /// Where its bytes lie in the file; a checksum of four follows.
    pub data: Range<u64>,
}

impl Attachment {
    /// The attachment that lies at `place` and begins with these bytes.
    fn parse(bytes: &[u8], place: &Range<u64>) -> Option<Self> {
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

/// Pairs of texts.
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

/// The content of a metadata record: a name and its map.
pub(super) fn named_map(bytes: &[u8]) -> Option<(String, BTreeMap<String, String>)> {
    let (name, rest) = text(bytes)?;
    let (map, _) = prefixed(rest)?;
    Some((name.to_owned(), text_map(map)?))
}

/// How messages are described.
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
