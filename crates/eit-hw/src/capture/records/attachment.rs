//! Attachments, which may be larger than memory, and the lengths within other records.

use std::ops::Range;

use mcap::records::AttachmentHeader;

/// Splits off a byte string that its length precedes; returns it and the remaining bytes.
fn prefixed(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
}

/// Returns whether a record consists of `fixed` bytes and then `strings` byte strings, to its end.
pub(super) fn is_of_strings(record: &[u8], fixed: usize, strings: usize) -> bool {
    let rest = record.get(fixed..);
    (0..strings).fold(rest, |rest, _| prefixed(rest?).map(|(_, rest)| rest)) == Some(&[])
}

/// A file embedded in the container.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::capture) struct Attachment {
    pub header: AttachmentHeader,
    /// Byte range of its data in the file; a 4-byte checksum follows.
    pub data: Range<u64>,
}

impl Attachment {
    /// Parses the attachment at `place` from its first bytes.
    pub(super) fn parse(bytes: &[u8], place: &Range<u64>) -> Option<Self> {
        let text = |bytes| String::from_utf8(<[u8]>::to_vec(bytes)).ok();
        let (log_time, rest) = bytes.split_first_chunk()?;
        let (create_time, rest) = rest.split_first_chunk()?;
        let (name, rest) = prefixed(rest)?;
        let (media_type, rest) = prefixed(rest)?;
        let (length, rest) = rest.split_first_chunk()?;
        let header = AttachmentHeader {
            log_time: u64::from_le_bytes(*log_time),
            create_time: u64::from_le_bytes(*create_time),
            name: text(name)?,
            media_type: text(media_type)?,
        };
        let start = place.start + (bytes.len() - rest.len()) as u64;
        let end = start.checked_add(u64::from_le_bytes(*length))?;
        (end.checked_add(4) == Some(place.end)).then_some(Self { header, data: start..end })
    }
}
