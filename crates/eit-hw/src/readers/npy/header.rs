//! The header of an array: its shape and number type.

use std::path::Path;

use super::{MAGIC, MEND};
use crate::error::{HwError, Place};
use crate::readers::number::Kind;
use crate::readers::wrong_field;

/// Content of the header.
pub(in crate::readers) struct Header {
    pub(in crate::readers) first_byte: usize,
    pub(in crate::readers) kind: Kind,
    pub(in crate::readers) complex: bool,
    pub(in crate::readers) fortran: bool,
    pub(in crate::readers) shape: Vec<usize>,
}

impl Header {
    /// Parses the header; what follows it may be cut off.
    pub(in crate::readers) fn parse(bytes: &[u8], path: impl AsRef<Path>) -> Result<Self, HwError> {
        let path = path.as_ref();
        let place = || Place::file(path);
        if bytes.is_empty() {
            return Err(HwError::Empty { place: place() });
        }
        let wrong = |field, text: &str, wanted| wrong_field(place(), field, text, wanted, MEND);
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
        let (kind, complex) = quoted(descr)
            .and_then(number)
            .ok_or_else(|| wrong("type", descr, "a number such as '<f8' or '<c16'"))?;
        let order = entry(&header, "fortran_order");
        let fortran = match (order.starts_with("True"), order.starts_with("False")) {
            (true, _) => true,
            (_, true) => false,
            _ => return Err(wrong("fortran_order", order, "True or False")),
        };
        let list = entry(&header, "shape");
        let shape = shape(list).ok_or_else(|| wrong("shape", list, "a list such as (4, 208)"))?;
        Ok(Self { first_byte, kind, complex, fortran, shape })
    }

    /// Returns the number of bytes behind the header; `None` if no memory could hold them.
    pub(in crate::readers) fn data_bytes(&self) -> Option<usize> {
        let count = self.shape.iter().try_fold(1_usize, |count, &size| count.checked_mul(size))?;
        count.checked_mul(self.kind.size)?.checked_mul(if self.complex { 2 } else { 1 })
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

/// Parses a type such as `<f8`, and whether numbers are pairs of it.
fn number(descr: &str) -> Option<(Kind, bool)> {
    let big_endian = descr.starts_with('>');
    match descr.trim_start_matches(['<', '>', '|', '=']) {
        "c8" => Some((Kind::parse("f4", big_endian)?, true)),
        "c16" => Some((Kind::parse("f8", big_endian)?, true)),
        name => Some((Kind::parse(name, big_endian)?, false)),
    }
}
