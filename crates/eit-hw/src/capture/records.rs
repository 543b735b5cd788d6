//! Reads the records of a container, intact or damaged, using the memory of one chunk.
//!
//! By hand, because the package `mcap`, which writes recordings and parses their records, gives up
//! at the first wrong length, unpacks chunks of any size and reads attachments into memory.
//!
//! A wrong length must not cost the data after it: where no valid record follows, the file is
//! searched for the next intact chunk. No index is needed, so recordings of killed programs are
//! read as well.

mod attachment;
mod search;
mod source;
mod unpack;

use std::io::{Read, Seek};
use std::ops::Range;
use std::path::Path;

use self::attachment::Attachment;
use self::search::is_whole;
use self::source::Source;
use self::unpack::{MOST_CHUNK_BYTES, RECORD_HEAD, record_length};
use super::container::MAGIC;
use crate::error::{HwError, Place};
use crate::recording::Note;
use mcap::records::{Record, op};

/// Opcodes of the index: schemas, channels, chunk positions and statistics.
const SUMMARY: [u8; 7] = [
    op::SCHEMA,
    op::CHANNEL,
    op::CHUNK_INDEX,
    op::ATTACHMENT_INDEX,
    op::STATISTICS,
    op::METADATA_INDEX,
    op::SUMMARY_OFFSET,
];
/// Longest header of an attachment, which holds its names.
const MOST_ATTACHMENT_HEAD: u64 = 1 << 16;
/// Budget for failed attempts to unpack chunks, in bytes as a multiple of the file's length.
const MOST_TRIES: u64 = 4;
/// Block size of the search for the next chunk, in bytes.
const SEARCHED: usize = 1 << 16;

/// What is missing from a recording or damaged.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Damage {
    /// Whether the recording was not finished, as after its program was killed.
    pub unfinished: bool,
    /// Bytes at the end that form no complete record.
    pub truncated_bytes: u64,
    /// Bytes skipped to reach the next intact chunk.
    pub skipped_bytes: u64,
    /// Chunks with a wrong checksum or invalid content; their messages are skipped.
    pub bad_chunks: usize,
    /// Chunks with a damaged header but intact content; their messages are read.
    pub mended_chunks: usize,
    /// Messages that cannot be read: from another version, too long, or of an unknown topic.
    pub bad_messages: usize,
    /// Parts of a split recording that do not exist, are empty or do not begin as a recording.
    pub missing_parts: usize,
}

impl Damage {
    /// Returns whether anything was lost or damaged, apart from a missing end.
    pub fn is_any(&self) -> bool {
        let Self {
            truncated_bytes,
            skipped_bytes,
            bad_chunks,
            mended_chunks,
            bad_messages,
            missing_parts,
            ..
        } = *self;
        truncated_bytes + skipped_bytes > 0
            || bad_chunks + mended_chunks + bad_messages + missing_parts > 0
    }

    /// Returns the damage of this part and another one.
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            unfinished: self.unfinished || other.unfinished,
            truncated_bytes: self.truncated_bytes + other.truncated_bytes,
            skipped_bytes: self.skipped_bytes + other.skipped_bytes,
            bad_chunks: self.bad_chunks + other.bad_chunks,
            mended_chunks: self.mended_chunks + other.mended_chunks,
            bad_messages: self.bad_messages + other.bad_messages,
            missing_parts: self.missing_parts + other.missing_parts,
        }
    }

    /// Returns a note for the user, or `None` if [nothing was lost](Self::is_any).
    pub fn note(&self) -> Option<Note> {
        self.is_any().then_some(Note::Damaged {
            chunks: self.bad_chunks,
            mended: self.mended_chunks,
            messages: self.bad_messages,
            skipped_bytes: self.skipped_bytes,
            truncated_bytes: self.truncated_bytes,
            missing_parts: self.missing_parts,
        })
    }
}

/// A record found in the file; [`Records::bytes`] returns its content.
#[derive(Clone, Debug)]
pub(super) struct Item {
    pub(crate) op: u8,
    in_chunk: bool,
    range: Range<usize>,
    /// Byte range of its content in the file; for a record in a chunk, that of the chunk.
    pub(crate) place: Range<u64>,
}

/// Reads the records of a container.
#[derive(Debug)]
pub(super) struct Records<R> {
    source: Source<R>,
    /// Position of the next record.
    position: u64,
    /// End of the last intact data record.
    whole: u64,
    /// Content of the current chunk, and how much of it has been returned.
    chunk: Vec<u8>,
    returned: usize,
    chunk_place: Range<u64>,
    /// The last record outside a chunk.
    record: Vec<u8>,
    /// Bytes that failed attempts at unpacking may still cost.
    tries: u64,
    damage: Damage,
    is_over: bool,
}

impl<R: Read + Seek> Records<R> {
    pub(super) fn new(source: R, path: &Path) -> Result<Self, HwError> {
        let source = Source::new(source, path)?;
        let tries = MOST_TRIES.saturating_mul(source.length).saturating_add(MOST_CHUNK_BYTES);
        let mut records = Self {
            source,
            position: 0,
            whole: 0,
            chunk: Vec::new(),
            returned: 0,
            chunk_place: 0..0,
            record: Vec::new(),
            tries,
            damage: Damage { unfinished: true, ..Damage::default() },
            is_over: false,
        };
        let mut start = [0; MAGIC.len()];
        let found = records.source.read_at(0, &mut start)?;
        if found == 0 {
            return Err(HwError::Empty { place: Place::file(path) });
        }
        if start[..found] != MAGIC[..found] {
            return Err(HwError::Container {
                place: Place::file(path),
                what: "is not an MCAP file".into(),
                mend: "set `[recording] format` to the file's format",
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

    /// Returns the length of the file in bytes.
    pub(super) fn length(&self) -> u64 {
        self.source.length
    }

    /// Returns the position after the last intact record that is not part of the index.
    pub(super) fn whole_bytes(&self) -> u64 {
        self.whole
    }

    /// Parses the schema, channel or message found last; `None` if it is invalid or another record.
    pub(super) fn parsed(&self, item: &Item) -> Option<Record<'_>> {
        let held = if item.in_chunk { &self.chunk } else { &self.record };
        let bytes = held.get(item.range.clone()).unwrap_or_default();
        let is_parsed = matches!(item.op, op::SCHEMA | op::CHANNEL | op::MESSAGE);
        let is_parsed = is_parsed && is_whole(item.op, bytes);
        is_parsed.then(|| mcap::parse_record(item.op, bytes).ok()).flatten()
    }

    /// Passes part of the file, such as an attachment, to `take` piece by piece.
    pub(super) fn copy<E: From<HwError>>(
        &mut self,
        place: Range<u64>,
        take: impl FnMut(&[u8]) -> Result<(), E>,
    ) -> Result<(), E> {
        self.source.copy(place, take)
    }

    /// Reads part of the file into memory, at most [`MOST_CHUNK_BYTES`].
    pub(super) fn held(&mut self, place: Range<u64>) -> Result<Vec<u8>, HwError> {
        self.source.held(place)
    }

    /// Returns the attachment at `place`, or `None` if its checksum is wrong.
    pub(super) fn attachment(&mut self, place: Range<u64>) -> Result<Option<Attachment>, HwError> {
        let head =
            self.source.held(place.start..place.end.min(place.start + MOST_ATTACHMENT_HEAD))?;
        let Some(found) = Attachment::parse(&head, &place) else { return Ok(None) };
        let crc_at = place.end - 4;
        let mut hasher = crc32fast::Hasher::new();
        self.source.copy(place.start..crc_at, |piece| {
            hasher.update(piece);
            Ok::<_, HwError>(())
        })?;
        let mut crc = [0; 4];
        self.source.read_at(crc_at, &mut crc)?;
        let crc = u32::from_le_bytes(crc);
        Ok((crc == 0 || crc == hasher.finalize()).then_some(found))
    }

    /// Returns the next schema, channel, message, attachment or metadata record; `None` at the end.
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
        let rest = self.chunk.get(self.returned..)?;
        let (head, rest) = rest.split_first_chunk::<RECORD_HEAD>()?;
        let length = usize::try_from(record_length(head)).ok().filter(|&l| l <= rest.len())?;
        let start = self.returned + RECORD_HEAD;
        self.returned = start + length;
        let range = start..self.returned;
        Some(Item { op: head[0], in_chunk: true, range, place: self.chunk_place.clone() })
    }

    fn next_in_file(&mut self) -> Result<Option<Item>, HwError> {
        let at = self.position;
        let mut head = [0; RECORD_HEAD];
        if self.source.read_at(at, &mut head)? < RECORD_HEAD {
            return self.finish(false).map(|()| None);
        }
        let (op, length) = (head[0], record_length(&head));
        let start = at + RECORD_HEAD as u64;
        let end = start.checked_add(length).filter(|&end| end <= self.source.length);
        if op == op::DATA_END && self.is_end(at, length)? {
            return self.finish(true).map(|()| None);
        }
        // a chunk may have lost its opcode, so an unknown opcode may be one
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
            if length <= MOST_CHUNK_BYTES {
                self.source.record(start..end, &mut self.record)?;
            }
        }
        let is_sure = matches!(op, op::MESSAGE_INDEX | op::CHANNEL | op::SCHEMA | op::ATTACHMENT);
        if !self.is_consistent(op, start..end)? || !(is_sure || self.can_begin(end)?) {
            return self.find_chunk(at).map(|()| None);
        }
        (self.position, self.whole) = (end, end);
        if is_held && length > MOST_CHUNK_BYTES {
            self.damage.bad_messages += 1;
            return Ok(None);
        }
        let is_returned = is_held || matches!(op, op::ATTACHMENT | op::METADATA);
        let range = 0..self.record.len();
        Ok(is_returned.then_some(Item { op, in_chunk: false, range, place: start..end }))
    }

    fn finish(&mut self, has_index: bool) -> Result<(), HwError> {
        self.is_over = true;
        self.damage.unfinished = !has_index;
        if !has_index {
            self.damage.truncated_bytes = self.source.length - self.whole;
        }
        Ok(())
    }
}
