//! Validates records, and finds the next intact chunk after damage.

use std::io::{Read, Seek};
use std::ops::Range;

use mcap::records::op;

use super::attachment::{Attachment, is_of_strings};
use super::unpack::{CHUNK_HEAD, ChunkHead, MOST_CHUNK_BYTES, RECORD_HEAD, record_length};
use super::{MOST_ATTACHMENT_HEAD, Records, SEARCHED, SUMMARY};
use crate::capture::container::MAGIC;
use crate::error::HwError;

impl<R: Read + Seek> Records<R> {
    /// Reads the chunk at `at`, whose record ends at `end`; returns whether there is one. A damaged
    /// chunk is skipped.
    pub(super) fn chunk_at(&mut self, at: u64, op: u8, end: Option<u64>) -> Result<bool, HwError> {
        let start = at + RECORD_HEAD as u64;
        let mut bytes = [0; CHUNK_HEAD];
        let found = self.source.read_at(start, &mut bytes)?;
        let Some(head) = ChunkHead::parse(&bytes[..found]) else { return Ok(false) };
        let content = start + head.bytes;
        let stated = head.stated_bytes().map(|length| start + length);
        let stated = stated.filter(|&end| end <= self.source.length);
        if op == op::CHUNK && stated.is_some() && stated == end {
            let end = stated.unwrap_or(content);
            if !self.unpack(&head, content..end)? {
                self.chunk.clear();
                self.damage.bad_chunks += 1;
            }
            (self.position, self.whole) = (end, end);
            return Ok(true);
        }
        // one of the two lengths or the opcode is wrong: the checksum shows which
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

    /// Unpacks a chunk; returns whether it is intact.
    fn unpack(&mut self, head: &ChunkHead, place: Range<u64>) -> Result<bool, HwError> {
        self.returned = 0;
        if self.tries == 0 {
            return Ok(false);
        }
        self.source.record(place.clone(), &mut self.record)?;
        let is_whole = head.unpack(&self.record, &mut self.chunk);
        if !is_whole {
            let cost = (self.record.len() + self.chunk.len()) as u64;
            self.tries = self.tries.saturating_sub(cost);
        }
        self.chunk_place = place;
        Ok(is_whole)
    }

    /// Returns whether a record's content matches its own lengths, as far as they are known.
    pub(super) fn is_consistent(&mut self, op: u8, place: Range<u64>) -> Result<bool, HwError> {
        let length = place.end - place.start;
        Ok(match op {
            op::MESSAGE_INDEX => {
                let mut head = [0; 6];
                let found = self.source.read_at(place.start, &mut head)?;
                let [_, _, list @ ..] = head;
                found == head.len() && length == 6 + u64::from(u32::from_le_bytes(list))
            }
            op::MESSAGE => length >= 22,
            op::CHANNEL | op::SCHEMA => length > MOST_CHUNK_BYTES || is_whole(op, &self.record),
            op::ATTACHMENT => {
                let most = place.end.min(place.start + MOST_ATTACHMENT_HEAD);
                let head = self.source.held(place.start..most)?;
                Attachment::parse(&head, &place).is_some()
            }
            _ => true,
        })
    }

    /// Returns whether a record can begin here or the file ends.
    pub(super) fn can_begin(&mut self, at: u64) -> Result<bool, HwError> {
        let mut head = [0; RECORD_HEAD];
        let found = self.source.read_at(at, &mut head)?;
        if found < RECORD_HEAD {
            // nothing, or a record that was not completely written
            return Ok(true);
        }
        let (op, length) = (head[0], record_length(&head));
        let is_op = (op::HEADER..=op::DATA_END).contains(&op) || op >= 0x80;
        let left = self.source.length - at - RECORD_HEAD as u64;
        // a chunk may be cut by the end of the file
        Ok(is_op && (length <= left || length <= MOST_CHUNK_BYTES))
    }

    /// Continues with the next intact chunk after the damage at `at`.
    pub(super) fn find_chunk(&mut self, at: u64) -> Result<(), HwError> {
        let mut from = at + 1;
        let mut bytes = vec![0; SEARCHED + RECORD_HEAD + CHUNK_HEAD];
        while from < self.source.length {
            let found = self.source.read_at(from, &mut bytes)?;
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
                let before = (self.damage, self.position, self.whole);
                let is_whole = end <= self.source.length
                    && self.chunk_at(here, op::CHUNK, stated.and_then(|l| self.end(here, l)))?
                    && self.damage.bad_chunks == before.0.bad_chunks;
                if is_whole {
                    self.damage.skipped_bytes += here - at;
                    return Ok(());
                }
                // a failed attempt is not a record
                (self.damage, self.position, self.whole) = before;
            }
            from += SEARCHED as u64;
        }
        // no chunk follows
        self.chunk.clear();
        self.finish(false)
    }

    /// Returns whether the data end here: only the index of this file follows, up to its end.
    pub(super) fn is_end(&mut self, at: u64, length: u64) -> Result<bool, HwError> {
        const FOOTER: u64 = RECORD_HEAD as u64 + 20;
        let Some(after) = self.end(at, length).filter(|_| length == 4) else { return Ok(false) };
        let Some(footer) = self.source.length.checked_sub(FOOTER + MAGIC.len() as u64) else {
            return Ok(false);
        };
        let mut bytes = [0; FOOTER as usize + MAGIC.len()];
        if footer < after || self.source.read_at(footer, &mut bytes)? < bytes.len() {
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
        // check record by record: another recording may follow this one
        let mut at = after;
        while at < footer {
            let mut head = [0; RECORD_HEAD];
            self.source.read_at(at, &mut head)?;
            let end = self.end(at, record_length(&head));
            match end.filter(|&end| end <= footer && SUMMARY.contains(&head[0])) {
                Some(end) => at = end,
                None => return Ok(false),
            }
        }
        Ok(true)
    }

    /// Returns the end of a record of this length, if it lies within the file.
    fn end(&self, at: u64, length: u64) -> Option<u64> {
        let start = at + RECORD_HEAD as u64;
        start.checked_add(length).filter(|&end| end <= self.source.length)
    }
}

/// Returns whether a record has the length that its strings add up to, as far as it consists of some.
pub(super) fn is_whole(op: u8, record: &[u8]) -> bool {
    match op {
        op::CHANNEL => is_of_strings(record, 4, 3),
        op::SCHEMA => is_of_strings(record, 2, 3),
        _ => true,
    }
}
