//! The elements of an array, packed or not.

use std::io::{Error, ErrorKind, Read, Result};

/// Most bytes of an element that is no data: flags, sizes or a name.
const MOST_BYTES: u32 = 1024;

/// Reads elements one after the other.
pub(super) struct Stream<'a> {
    pub reader: Box<dyn Read + 'a>,
    pub big_endian: bool,
}

/// What stands before the data of an element.
pub(super) struct Tag {
    pub kind: u32,
    pub bytes: u32,
    /// The data, if they are so short that they stand in the tag.
    pub within: Option<[u8; 4]>,
}

impl Stream<'_> {
    fn word(&mut self) -> Result<[u8; 4]> {
        let mut word = [0; 4];
        self.reader.read_exact(&mut word)?;
        Ok(word)
    }

    pub(super) fn number(&self, word: [u8; 4]) -> u32 {
        if self.big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) }
    }

    pub(super) fn tag(&mut self) -> Result<Tag> {
        let word = self.word()?;
        let first = self.number(word);
        let second = self.word()?;
        let bytes = first >> 16;
        match bytes {
            0 => Ok(Tag { kind: first, bytes: self.number(second), within: None }),
            1..=4 => Ok(Tag { kind: first & 0xFFFF, bytes, within: Some(second) }),
            _ => Err(Error::new(ErrorKind::InvalidData, format!("a tag states {bytes} bytes"))),
        }
    }

    /// Skips the bytes up to the next multiple of eight.
    pub(super) fn skip_padding(&mut self, tag: &Tag) -> Result<()> {
        let padding = if tag.within.is_some() { 0 } else { (8 - tag.bytes % 8) % 8 };
        self.reader.read_exact(&mut [0; 8][..padding as usize])
    }

    /// Returns the data of a short element.
    pub(super) fn element(&mut self) -> Result<Vec<u8>> {
        let tag = self.tag()?;
        if let Some(within) = tag.within {
            return Ok(within[..tag.bytes as usize].to_vec());
        }
        if tag.bytes > MOST_BYTES {
            let text = format!("its head has an element of {} bytes", tag.bytes);
            return Err(Error::new(ErrorKind::InvalidData, text));
        }
        let mut data = vec![0; tag.bytes as usize];
        self.reader.read_exact(&mut data)?;
        self.skip_padding(&tag)?;
        Ok(data)
    }
}
