//! Chunk headers, and decompression within limits.

use std::io::Read;

/// Longest chunk, compressed or not, and longest record outside of chunks but for attachments. Writers end chunks at 1 to 4 MiB.
pub(super) const MOST_CHUNK_BYTES: u64 = 16 << 20;
/// Bytes before each record: its opcode and length.
pub(super) const RECORD_HEAD: usize = 9;
/// Bytes before the name of the compression: two times, size and checksum of the content.
const BEFORE_NAME: usize = 28;
/// Longest name of a compression: `lz4`, `zstd` or none.
const MOST_NAME: usize = 4;
/// Longest chunk header, including the name of the compression and the compressed size.
pub(super) const CHUNK_HEAD: usize = BEFORE_NAME + 4 + MOST_NAME + 8;

/// The header of a chunk.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChunkHead {
    unpacked_bytes: u64,
    /// CRC-32 of the content; 0 if unknown.
    pub(super) crc: u32,
    compression: Compression,
    /// Length of the header.
    pub(super) bytes: u64,
    /// Length of the compressed content.
    pub(super) packed_bytes: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Compression {
    None,
    Lz4,
    Zstd,
    /// An unknown or damaged name.
    Other,
}

impl ChunkHead {
    /// Parses a chunk header; returns `None` if these bytes are not one.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let number =
            |at: usize| bytes.get(at..)?.first_chunk::<8>().map(|bytes| u64::from_le_bytes(*bytes));
        let short =
            |at: usize| bytes.get(at..)?.first_chunk::<4>().map(|bytes| u32::from_le_bytes(*bytes));
        let name_bytes = usize::try_from(short(BEFORE_NAME)?).ok().filter(|&n| n <= MOST_NAME)?;
        let name = BEFORE_NAME + 4;
        let compression = match bytes.get(name..name + name_bytes)? {
            b"" => Compression::None,
            b"lz4" => Compression::Lz4,
            b"zstd" => Compression::Zstd,
            _ => Compression::Other,
        };
        let head = Self {
            unpacked_bytes: number(16)?,
            crc: short(24)?,
            compression,
            bytes: (name + name_bytes + 8) as u64,
            packed_bytes: number(name + name_bytes)?,
        };
        (head.unpacked_bytes <= MOST_CHUNK_BYTES).then_some(head)
    }

    /// Returns the length of the record according to its header, without opcode and length field;
    /// `None` if longer than a chunk can be.
    pub(super) fn stated_bytes(&self) -> Option<u64> {
        (self.packed_bytes <= MOST_CHUNK_BYTES).then(|| self.bytes + self.packed_bytes)
    }

    /// Unpacks the content into `out`; returns whether it is intact: the stated length, the right
    /// checksum if there is one, and only complete records.
    pub(super) fn unpack(&self, packed: &[u8], out: &mut Vec<u8>) -> bool {
        let ways: &[Compression] = match self.compression {
            Compression::Other => &[Compression::Lz4, Compression::Zstd, Compression::None],
            // as named
            _ => std::slice::from_ref(&self.compression),
        };
        // a damaged name cannot be guessed without a checksum
        if self.compression == Compression::Other && self.crc == 0 {
            return false;
        }
        ways.iter().any(|way| self.unpack_as(*way, packed, out))
    }

    fn unpack_as(&self, way: Compression, packed: &[u8], out: &mut Vec<u8>) -> bool {
        out.clear();
        // one extra byte reveals content longer than stated
        let most = self.unpacked_bytes + 1;
        let left = match way {
            Compression::None | Compression::Other => {
                let mut packed = packed;
                let read = packed.by_ref().take(most).read_to_end(out);
                read.is_ok().then_some(packed.len())
            }
            Compression::Lz4 => lz4::Decoder::new(packed).ok().and_then(|mut decoder| {
                decoder.by_ref().take(most).read_to_end(out).ok()?;
                let (left, ended) = decoder.finish();
                ended.ok().map(|()| left.len())
            }),
            Compression::Zstd => ruzstd::decoding::StreamingDecoder::new_with_max_window_size(
                packed,
                MOST_CHUNK_BYTES,
            )
            .ok()
            .and_then(|mut decoder| {
                decoder.by_ref().take(most).read_to_end(out).ok()?;
                Some(decoder.into_inner().len())
            }),
        };
        // all input must be used: otherwise a length is wrong and data after it would be skipped
        left == Some(0)
            && out.len() as u64 == self.unpacked_bytes
            && (self.crc == 0 || crc32fast::hash(out) == self.crc)
            && is_of_records(out)
    }
}

/// Returns whether the bytes consist of complete records.
fn is_of_records(mut bytes: &[u8]) -> bool {
    while let Some((head, rest)) = bytes.split_first_chunk::<RECORD_HEAD>() {
        let length = usize::try_from(record_length(head)).ok();
        let Some(next) = length.and_then(|length| rest.get(length..)) else { return false };
        bytes = next;
    }
    bytes.is_empty()
}

/// Returns the length field of a record header.
pub(super) fn record_length(head: &[u8; RECORD_HEAD]) -> u64 {
    let [_, length @ ..] = *head;
    u64::from_le_bytes(length)
}
