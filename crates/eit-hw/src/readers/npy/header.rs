//! The header of an array: its shape and number type.

use std::path::Path;

use super::{MAGIC, MEND};
use crate::error::{HwError, Place, shortened};

/// Content of the header.
pub(super) struct Header {
    pub(crate) first_byte: usize,
    pub(crate) kind: Kind,
    pub(crate) fortran: bool,
    pub(crate) shape: Vec<usize>,
}

impl Header {
    pub(super) fn parse(bytes: &[u8], path: impl AsRef<Path>) -> Result<Self, HwError> {
        let path = path.as_ref();
        let place = || Place::file(path);
        if bytes.is_empty() {
            return Err(HwError::Empty { place: place() });
        }
        let wrong = |field, text: &str, wanted| HwError::Field {
            place: place(),
            field,
            text: shortened(text),
            wanted,
            mend: MEND,
        };
        let Some(rest) = bytes.strip_prefix(MAGIC) else {
            let start = String::from_utf8_lossy(&bytes[..bytes.len().min(MAGIC.len())]);
            return Err(wrong("its start", &start, "the NPY magic \\x93NUMPY"));
        };
        let (length, start) = match *rest {
            [1, _, low, high, ..] => (usize::from(u16::from_le_bytes([low, high])), 10),
            [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([a, b, c, d]) as usize, 12),
            _ => return Err(wrong("version", "", "1, 2 or 3")),
        };
        let first_byte = start + length.min(bytes.len());
        let Some(header) = bytes.get(start..first_byte).filter(|header| header.len() == length)
        else {
            return Err(HwError::count(
                Place::byte(path, start),
                "bytes of header",
                [bytes.len().saturating_sub(start), length],
                "the file is truncated: copy it again",
            ));
        };
        let header = String::from_utf8_lossy(header);
        let descr = entry(&header, "descr");
        let kind = quoted(descr)
            .and_then(Kind::parse)
            .ok_or_else(|| wrong("type", descr, "a number such as '<f8' or '<c16'"))?;
        let order = entry(&header, "fortran_order");
        let fortran = match (order.starts_with("True"), order.starts_with("False")) {
            (true, _) => true,
            (_, true) => false,
            _ => return Err(wrong("fortran_order", order, "True or False")),
        };
        let list = entry(&header, "shape");
        let shape = shape(list).ok_or_else(|| wrong("shape", list, "a list such as (4, 208)"))?;
        Ok(Self { first_byte, kind, fortran, shape })
    }
}

/// Returns what follows `'key':` in the header; empty if the key is missing.
fn entry<'a>(header: &'a str, key: &str) -> &'a str {
    let after = |quote: char| {
        let quoted = format!("{quote}{key}{quote}");
        header.split_once(quoted.as_str()).map(|(_, rest)| rest)
    };
    after('\'')
        .or_else(|| after('"'))
        .and_then(|rest| rest.trim_start().strip_prefix(':'))
        .map_or("", str::trim_start)
}

/// Returns the quoted text at the start.
fn quoted(text: &str) -> Option<&str> {
    let quote = text.chars().next().filter(|quote| matches!(quote, '\'' | '"'))?;
    text[1..].split_once(quote).map(|(inside, _)| inside)
}

/// Parses the tuple of sizes at the start.
fn shape(text: &str) -> Option<Vec<usize>> {
    let (inside, _) = text.strip_prefix('(')?.split_once(')')?;
    let sizes = inside.trim().trim_end_matches(',').trim();
    if sizes.is_empty() {
        return Some(Vec::new());
    }
    sizes.split(',').map(|size| size.trim().trim_end_matches('L').parse().ok()).collect()
}

/// Type of a stored number, or of either part of a complex one.
#[derive(Clone, Copy)]
pub(super) struct Kind {
    number: Number,
    pub complex: bool,
    big_endian: bool,
    /// Number of bytes of one part: 1, 2, 4 or 8.
    pub size: usize,
}

#[derive(Clone, Copy)]
enum Number {
    Float,
    Signed,
    Unsigned,
}

impl Kind {
    /// Parses a type such as `<f8`.
    fn parse(descr: &str) -> Option<Self> {
        let (order, rest) = match descr.as_bytes().first()? {
            b'<' | b'|' | b'=' => (false, &descr[1..]),
            b'>' => (true, &descr[1..]),
            _ => (false, descr),
        };
        let (number, complex, size) = match rest {
            "f4" => (Number::Float, false, 4),
            "f8" => (Number::Float, false, 8),
            "c8" => (Number::Float, true, 4),
            "c16" => (Number::Float, true, 8),
            "i1" => (Number::Signed, false, 1),
            "i2" => (Number::Signed, false, 2),
            "i4" => (Number::Signed, false, 4),
            "i8" => (Number::Signed, false, 8),
            "u1" => (Number::Unsigned, false, 1),
            "u2" => (Number::Unsigned, false, 2),
            "u4" => (Number::Unsigned, false, 4),
            "u8" => (Number::Unsigned, false, 8),
            _ => return None,
        };
        Some(Self { number, complex, big_endian: order, size })
    }

    pub(super) const fn parts(self) -> usize {
        if self.complex { 2 } else { 1 }
    }

    pub(super) const fn bytes(self) -> usize {
        self.parts() * self.size
    }

    /// Decodes one part from its `size` bytes. Integers beyond 2^53 are rounded.
    pub(super) fn value(self, bytes: &[u8]) -> f64 {
        // the number in the low bytes of 8, least significant first
        let mut wide = [0; 8];
        for (slot, index) in wide.iter_mut().zip(0..bytes.len()) {
            *slot = bytes[if self.big_endian { bytes.len() - 1 - index } else { index }];
        }
        let raw = u64::from_le_bytes(wide);
        match self.number {
            // only the low 4 bytes are filled
            Number::Float if self.size == 4 => f64::from(f32::from_bits(raw as u32)),
            Number::Float => f64::from_bits(raw),
            Number::Unsigned => raw as f64,
            Number::Signed => {
                let unused = 64 - 8 * self.size as u32;
                ((raw << unused) as i64 >> unused) as f64
            }
        }
    }
}
