//! Numbers as text: one frame per row, one frame per column, or one frame as a matrix.
//!
//! Fields are separated by semicolons, commas, tabs or spaces: the first of these, in this order,
//! that the first line of numbers contains. Everything after `#` is a comment. Blank lines are
//! skipped, and so is the first line if none of its fields starts as a number (a header); one
//! separator may end a line. Every row must have as many values as the first.

use std::path::Path;

use super::files::file_bytes;
use super::{table, text};
use crate::error::{HwError, Place};
pub use crate::recording::FrameOrientation;
use crate::recording::{Format, Layout, Note, Recording, Unit};

/// Layout of a CSV file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct CsvOptions {
    /// What forms one frame.
    pub orientation: FrameOrientation,
    /// Whether rows (or columns, also those of a matrix) alternate: real parts of frame 0,
    /// imaginary parts of frame 0, real parts of frame 1 and so on.
    pub complex: bool,
}

/// Reads a CSV file.
///
/// # Errors
/// Those of [`parse`], and [`HwError::Read`] if the file cannot be read.
pub fn read(path: impl AsRef<Path>, options: &CsvOptions) -> Result<Recording, HwError> {
    let path = path.as_ref();
    parse(&file_bytes(path, Format::Csv.name())?, path, options)
}

/// Parses the content of a CSV file; `path` is used in messages only.
///
/// The layout is [`Layout::ProtocolOrder`], the unit [`Unit::Arbitrary`]. A value that is NaN or
/// infinite counts as missing and is flagged [`Quality::NON_FINITE`](crate::Quality::NON_FINITE).
///
/// # Errors
/// [`HwError`] for an empty or binary file, a field that is not a number, a row whose length
/// differs from the first, or an odd number of rows or columns where they alternate.
pub fn parse(
    bytes: &[u8],
    path: impl AsRef<Path>,
    options: &CsvOptions,
) -> Result<Recording, HwError> {
    let path = path.as_ref();
    let content = text::decode(bytes, path)?;
    let mut rows = Rows::default();
    for (line, row) in text::lines(content) {
        rows.push(row, line, path)?;
    }
    let CsvOptions { orientation, complex } = *options;
    let table = table::frames(rows.values, rows.columns, path, 0)?;
    let (real, imaginary) = table::oriented(table, orientation, complex, path)?;
    let mut recording =
        Recording::new(real, imaginary, Layout::ProtocolOrder, Unit::Arbitrary, Format::Csv, path);
    recording.frames_are = Some(orientation);
    recording.notes.extend(rows.header.map(|line| Note::HeaderLine { line }));
    recording.notes.extend(text::line_without_end(content).map(|line| Note::NoLineEnd { line }));
    Ok(recording.with_missing())
}

/// Rows read so far.
#[derive(Default)]
struct Rows {
    values: Vec<f64>,
    columns: usize,
    count: usize,
    separator: Option<Separator>,
    header: Option<usize>,
}

#[derive(Clone, Copy)]
enum Separator {
    Character(char),
    Spaces,
}

impl Rows {
    fn push(&mut self, line: &str, number: usize, path: &Path) -> Result<(), HwError> {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            return Ok(());
        }
        let separator = self.separator.unwrap_or_else(|| separator_of(line));
        let first = self.count == 0;
        if first && self.header.is_none() && !fields(line, separator).any(is_numeric) {
            self.header = Some(number);
            return Ok(());
        }
        self.separator = Some(separator);
        let mut columns = 0;
        for field in fields(line, separator) {
            self.values.push(text::number(field, columns + 1, || Place::line(path, number))?);
            columns += 1;
        }
        if first {
            self.columns = columns;
        }
        self.count += 1;
        if columns == self.columns {
            return Ok(());
        }
        Err(HwError::Count {
            place: Place::line(path, number),
            what: "values",
            found: columns,
            wanted: self.columns,
            mend: "every row must have as many values as the first: remove or complete this one",
        })
    }
}

/// Returns whether a field is a number or starts as one, such as `0,5` or `12 mV`; no header has
/// such fields.
fn is_numeric(field: &str) -> bool {
    let digits = field.trim_start_matches(['+', '-', '.']);
    digits.starts_with(|first: char| first.is_ascii_digit()) || field.parse::<f64>().is_ok()
}

/// Returns the first of semicolon, comma and tab that the line contains, otherwise spaces.
fn separator_of(line: &str) -> Separator {
    [';', ',', '\t']
        .into_iter()
        .find(|&separator| line.contains(separator))
        .map_or(Separator::Spaces, Separator::Character)
}

/// Splits a trimmed line into fields. Two iterators in one, of which the unused one is empty.
fn fields(line: &str, separator: Separator) -> impl Iterator<Item = &str> {
    let (separated, spaced) = match separator {
        Separator::Character(character) => {
            let line = line.strip_suffix(character).unwrap_or(line);
            (Some(line.split(character).map(str::trim)), None)
        }
        Separator::Spaces => (None, Some(line.split_whitespace())),
    };
    separated.into_iter().flatten().chain(spaced.into_iter().flatten())
}

/// Returns the first field of a trimmed line.
pub(super) fn first_field(line: &str) -> &str {
    fields(line, separator_of(line)).next().unwrap_or_default()
}
