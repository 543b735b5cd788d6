//! Decodes bytes to text, text to lines, and fields to numbers.

use std::path::Path;

use crate::error::{HwError, Place, shortened};

/// Decodes UTF-8 text and removes a byte order mark. Rejects an empty file, bytes that are not
/// UTF-8, and control characters other than tab, form feed and line ends, which indicate a binary
/// file.
pub(super) fn decode<'a>(bytes: &'a [u8], path: &Path) -> Result<&'a str, HwError> {
    if bytes.is_empty() {
        return Err(HwError::Empty { place: Place::file(path) });
    }
    let (valid, wrong) = match std::str::from_utf8(bytes) {
        Ok(text) => (text, None),
        Err(error) => {
            let end = error.valid_up_to();
            (std::str::from_utf8(&bytes[..end]).unwrap_or_default(), Some(end))
        }
    };
    let control = valid.bytes().position(|byte| {
        byte == 0x7F || (byte < b' ' && !matches!(byte, b'\t' | b'\n' | b'\r' | 0x0C))
    });
    match control.or(wrong) {
        Some(at) => Err(HwError::NotText { place: Place::byte(path, at), byte: bytes[at] }),
        None => Ok(valid.strip_prefix('\u{FEFF}').unwrap_or(valid)),
    }
}

/// Iterates over lines with their numbers from 1; lines end with LF, CR LF or CR.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.split('\n')
        .flat_map(|line| line.strip_suffix('\r').unwrap_or(line).split('\r'))
        .zip(1..)
        .map(|(line, number)| (number, line))
}

/// Rejects text whose last line has no end, since its last number may be truncated: `-2.5E-6` cut
/// to `-2.5` is still a number. For formats written by programs; all files of these at hand end
/// with a line end.
pub(super) fn require_end(text: &str, path: &Path) -> Result<(), HwError> {
    match line_without_end(text) {
        Some(line) => Err(HwError::NoLineEnd { place: Place::line(path, line) }),
        None => Ok(()),
    }
}

/// Returns the number of the last line if it has no end.
pub(super) fn line_without_end(text: &str) -> Option<usize> {
    if text.ends_with(['\n', '\r']) { None } else { lines(text).last().map(|(line, _)| line) }
}

/// Parses a field as a number, which may be NaN or infinite; `value` is its position from 1.
pub(super) fn number(
    field: &str,
    value: usize,
    place: impl FnOnce() -> Place,
) -> Result<f64, HwError> {
    field.parse().map_err(|_| HwError::NotANumber { place: place(), value, text: shortened(field) })
}

/// Parses the `N` numbers of a line, which may be NaN or infinite; `mend` is used if there are more
/// or fewer.
pub(super) fn numbers<const N: usize>(
    content: &str,
    line: usize,
    path: &Path,
    mend: &'static str,
) -> Result<[f64; N], HwError> {
    let mut values = [0.0; N];
    let mut found = 0;
    for field in content.split_whitespace() {
        let value = number(field, found + 1, || Place::line(path, line))?;
        if let Some(slot) = values.get_mut(found) {
            *slot = value;
        }
        found += 1;
    }
    if found == N {
        return Ok(values);
    }
    Err(HwError::count(Place::line(path, line), "values", [found, N], mend))
}
