//! A variable of the file: what it is, and its numbers.

use std::io::{self, Error, ErrorKind, Read, copy, sink};
use std::path::Path;

use flate2::read::ZlibDecoder;

use super::stream::Stream;
use crate::error::{HwError, Place};
use crate::readers::arrays::{Listed, check_memory};
use crate::readers::number::{Kind, Numbers};

/// Types of elements.
const MATRIX: u32 = 14;
const COMPRESSED: u32 = 15;
/// Flag of an array with imaginary parts.
const COMPLEX: u32 = 0x0800;
/// Class of objects such as tables and strings, whose name stands where others have their sizes.
const OPAQUE: u32 = 17;

/// A variable as it is stored.
pub(super) struct Variable<'a> {
    file: &'a [u8],
    path: &'a Path,
    first_byte: usize,
    content: &'a [u8],
    is_compressed: bool,
    big_endian: bool,
}

/// Real or imaginary parts.
pub(super) struct Part {
    kind: Kind,
    bytes: Vec<u8>,
}

impl Part {
    pub(super) fn numbers(&self) -> Numbers<'_> {
        Numbers { kind: self.kind, bytes: &self.bytes, stride: self.kind.size }
    }
}

impl<'a> Variable<'a> {
    /// Returns the variable at this byte, and where the next one begins.
    pub(super) fn at(
        at: usize,
        file: &'a [u8],
        big_endian: bool,
        path: &'a Path,
    ) -> Result<(Self, usize), HwError> {
        let truncated = |found, wanted| {
            let mend = "the file is truncated: copy or save it again";
            HwError::count(Place::byte(path, at), "bytes of an array", [found, wanted], mend)
        };
        let rest = file.get(at..).unwrap_or_default();
        let mut stream = Stream { reader: Box::new(rest), big_endian };
        if rest.len() < 8 {
            return Err(truncated(rest.len(), 8));
        }
        let damaged = |error: Error| HwError::damaged_array(Place::byte(path, at), "", error);
        let tag = stream.tag().map_err(damaged)?;
        let (is_compressed, size) = (tag.kind == COMPRESSED, tag.bytes as usize);
        if tag.within.is_some() || !(is_compressed || tag.kind == MATRIX) {
            return Err(damaged(not_an_array(tag.kind)));
        }
        let content = rest.get(8..).and_then(|rest| rest.get(..size));
        let content = content.ok_or_else(|| truncated(rest.len() - 8, size))?;
        let variable = Self { file, path, first_byte: at, content, is_compressed, big_endian };
        // packed variables follow each other without padding
        let padding = if is_compressed { 0 } else { (8 - size % 8) % 8 };
        Ok((variable, at + 8 + size + padding))
    }

    /// Returns the elements of the array.
    fn stream(&self) -> io::Result<Stream<'a>> {
        let big_endian = self.big_endian;
        if !self.is_compressed {
            return Ok(Stream { reader: Box::new(self.content), big_endian });
        }
        let mut stream = Stream { reader: Box::new(ZlibDecoder::new(self.content)), big_endian };
        match stream.tag()?.kind {
            MATRIX => Ok(stream),
            kind => Err(not_an_array(kind)),
        }
    }

    fn damaged(&self, error: Error) -> HwError {
        HwError::damaged_array(Place::byte(self.path, self.first_byte), "", error)
    }

    /// Returns what the variable is.
    pub(super) fn listed(&self) -> Result<Listed, HwError> {
        let head = self.stream().and_then(|mut stream| head(&mut stream));
        head.map(|(listed, _)| listed).map_err(|error| self.damaged(error))
    }

    /// Returns the real and, if there are any, the imaginary parts of an array of numbers.
    pub(super) fn parts(&self) -> Result<[Option<Part>; 2], HwError> {
        let damaged = |error| self.damaged(error);
        let mut stream = self.stream().map_err(damaged)?;
        let (listed, is_complex) = head(&mut stream).map_err(damaged)?;
        let shape = listed.shape.iter();
        let count = shape.copied().try_fold(1_usize, usize::checked_mul).unwrap_or(usize::MAX);
        let mut parts = [None, None];
        let part_count = if is_complex { 2 } else { 1 };
        for part in parts.iter_mut().take(part_count) {
            *part = Some(self.part(&mut stream, count, part_count)?);
        }
        // to the end, where the checksum is
        match copy(&mut stream.reader.take(8), &mut sink()).map_err(damaged)? {
            // padding
            0..8 => Ok(parts),
            _ => Err(damaged(invalid("more than its numbers follows".to_owned()))),
        }
    }

    fn part(&self, stream: &mut Stream<'_>, count: usize, parts: usize) -> Result<Part, HwError> {
        let damaged = |error| self.damaged(error);
        let tag = stream.tag().map_err(damaged)?;
        let kind = kind(tag.kind, self.big_endian).ok_or_else(|| {
            damaged(invalid(format!("its numbers are of the unknown type {}", tag.kind)))
        })?;
        let wrong = |found| {
            let wanted = count.saturating_mul(kind.size);
            let mend = "the file is damaged: copy or save it again";
            let place = Place::byte(self.path, self.first_byte);
            HwError::count(place, "bytes of numbers", [found, wanted], mend)
        };
        let size = tag.bytes as usize;
        if count.checked_mul(kind.size) != Some(size) {
            return Err(wrong(size));
        }
        check_memory(kind, size, [count, parts], self.file, self.path)?;
        let bytes = match tag.within {
            Some(within) => within[..size].to_vec(),
            None => {
                let mut bytes = Vec::with_capacity(size);
                let mut data = stream.reader.by_ref().take(size as u64);
                data.read_to_end(&mut bytes).map_err(damaged)?;
                bytes
            }
        };
        if bytes.len() < size {
            return Err(wrong(bytes.len()));
        }
        // after the last part there may be none
        if parts == 2 {
            stream.skip_padding(&tag).or_else(|error| match error.kind() {
                ErrorKind::UnexpectedEof => Ok(()),
                _ => Err(damaged(error)),
            })?;
        }
        Ok(Part { kind, bytes })
    }
}

/// Reads name, shape and class, and whether the numbers are complex.
fn head(stream: &mut Stream<'_>) -> io::Result<(Listed, bool)> {
    let flags = stream.element()?;
    let flags = flags.first_chunk().ok_or_else(|| invalid("its flags are cut off".to_owned()))?;
    let flags = stream.number(*flags);
    let class = flags & 0xFF;
    let mut shape = Vec::new();
    if class != OPAQUE {
        for word in stream.element()?.chunks_exact(4) {
            let size = stream.number([word[0], word[1], word[2], word[3]]);
            shape.push(size as usize);
        }
    }
    let name = String::from_utf8_lossy(&stream.element()?).into_owned();
    let other = match class {
        6..=15 => None,
        1 => Some("a cell array"),
        2 => Some("a struct"),
        4 => Some("text"),
        5 => Some("a sparse matrix"),
        _ => Some("an object"),
    };
    Ok((Listed { name, shape, other }, flags & COMPLEX != 0))
}

/// Returns the type of stored numbers, which may be narrower than the class.
fn kind(code: u32, big_endian: bool) -> Option<Kind> {
    let name = match code {
        1 => "i1",
        2 => "u1",
        3 => "i2",
        4 => "u2",
        5 => "i4",
        6 => "u4",
        7 => "f4",
        9 => "f8",
        12 => "i8",
        13 => "u8",
        _ => return None,
    };
    Kind::parse(name, big_endian)
}

fn not_an_array(kind: u32) -> Error {
    invalid(format!("an element of type {kind} is no array"))
}

fn invalid(text: String) -> Error {
    Error::new(ErrorKind::InvalidData, text)
}
