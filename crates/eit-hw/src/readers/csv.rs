//! Numbers as text: one frame per row, one frame per column, or one frame as a matrix.
//!
//! Fields are separated by semicolons, commas, tabs or spaces: the first of these, in this order,
//! that the first line of numbers contains. Everything after `#` is a comment. Blank lines are
//! skipped, and so is the first line if none of its fields starts as a number or they number eight or more columns (a header); one
//! separator may end a line. Every row must have as many values as the first.
//!
//! A comma is never a decimal one. Where every line is a pair of whole numbers as in `1,5`, a note says
//! that it was read as two ([`Note::DecimalComma`]); where pairs as in `0,25` are twice as many values as
//! measurements, the error says so ([`CountHint::DecimalComma`](crate::CountHint::DecimalComma)).

use std::path::Path;

use super::files::file_bytes;
use super::table::{self, Table};
use super::text;
use crate::error::{HwError, Place};
pub use crate::recording::FrameOrientation;
use crate::recording::packed::Packed;
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
    parse_owned(file_bytes(path, Format::Csv.name())?, path, options)
}

/// Parses the content of a CSV file, which is freed before rows become columns.
pub(super) fn parse_owned(
    bytes: Vec<u8>,
    path: &Path,
    options: &CsvOptions,
) -> Result<Recording, HwError> {
    let rows = Rows::parse(&bytes, path)?;
    drop(bytes);
    rows.recording(path, options)
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
    Rows::parse(bytes, path)?.recording(path, options)
}

/// Rows read so far.
#[derive(Default)]
struct Rows {
    values: Packed,
    columns: usize,
    count: usize,
    separator: Option<Separator>,
    header: Option<usize>,
    /// Number of the last line if it has no end.
    unended: Option<usize>,
    /// Whether a row is anything but pairs of whole numbers, as in `1,5`.
    unpaired: bool,
    /// Whether some pair looks like one number.
    decimal: bool,
}

#[derive(Clone, Copy)]
enum Separator {
    Character(char),
    Spaces,
}

impl Rows {
    fn parse(bytes: &[u8], path: &Path) -> Result<Self, HwError> {
        let content = text::decode(bytes, path)?;
        let mut rows = Self::default();
        for (line, row) in text::lines(content) {
            rows.push(row, line, path)?;
        }
        rows.unended = text::line_without_end(content);
        Ok(rows)
    }

    fn push(&mut self, line: &str, number: usize, path: &Path) -> Result<(), HwError> {
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            return Ok(());
        }
        let separator = self.separator.unwrap_or_else(|| separator_of(line));
        let first = self.count == 0;
        let is_header = || !fields(line, separator).any(is_numeric) || is_index(line, separator);
        if first && self.header.is_none() && is_header() {
            self.header = Some(number);
            // which names several columns
            self.unpaired = fields(line, separator).nth(1).is_some();
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
            self.values.end_first_row();
        }
        self.count += 1;
        if !self.unpaired {
            let pairs = Pairs::of(line);
            self.unpaired = pairs == Pairs::No;
            self.decimal |= pairs == Pairs::Likely;
        }
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

    fn recording(self, path: &Path, options: &CsvOptions) -> Result<Recording, HwError> {
        let CsvOptions { orientation, complex } = *options;
        let table = Table { values: self.values.finished(), length: self.columns };
        if table.values.len() == 0 {
            return Err(HwError::NoFrames { place: Place::file(path), skipped: 0 });
        }
        let contents = table::oriented(table, orientation, complex, path)?;
        let (layout, unit) = (Layout::ProtocolOrder, Unit::Arbitrary);
        let mut recording = Recording::new(contents, layout, unit, Format::Csv, path)?;
        recording.frames_are = Some(orientation);
        recording.notes.extend(self.header.map(|line| Note::HeaderLine { line }));
        recording.notes.extend(self.unended.map(|line| Note::NoLineEnd { line }));
        recording.may_have_decimal_commas = !self.unpaired && self.decimal;
        if self.columns == 2 && !self.unpaired {
            recording.notes.push(Note::DecimalComma);
        }
        Ok(recording.with_missing())
    }
}

/// What a line of whole numbers in pairs, such as `1,5,-0,25`, says of decimal commas.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pairs {
    /// A sign, a point, a space or nothing follows some comma: it separates numbers.
    No,
    /// They may be decimal ones.
    Possible,
    /// Some pair is a number below one or has a zero after the comma, as `0,25` and `1,05`: few whole
    /// numbers are written like that.
    Likely,
}

impl Pairs {
    pub(crate) fn of(line: &str) -> Self {
        let is_whole = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        let (mut fields, mut found) = (line.split(','), Self::Possible);
        while let Some(whole) = fields.next() {
            let whole = whole.strip_prefix(['+', '-']).unwrap_or(whole);
            let Some(part) = fields.next().filter(|part| is_whole(part) && is_whole(whole)) else {
                return Self::No;
            };
            let is_small = whole == "0" && part.bytes().any(|digit| digit != b'0');
            if is_small || (part.len() > 1 && part.starts_with('0')) {
                found = Self::Likely;
            }
        }
        found
    }
}

/// Returns whether a field is a number or starts as one, such as `0,5` or `12 mV`; no header has
/// such fields.
fn is_numeric(field: &str) -> bool {
    let digits = field.trim_start_matches(['+', '-', '.']);
    digits.starts_with(|first: char| first.is_ascii_digit()) || field.parse::<f64>().is_ok()
}

/// Returns whether a line numbers its columns from 0 or 1, as tables without names of their own do.
fn is_index(line: &str, separator: Separator) -> bool {
    let first = match fields(line, separator).next() {
        Some("0") => 0,
        Some("1") => 1,
        _ => return false,
    };
    let is_next = |(k, field): (usize, &str)| field.parse() == Ok(first + k);
    fields(line, separator).count() >= LEAST_INDEX
        && fields(line, separator).enumerate().all(is_next)
}

/// Fewest columns whose numbers are no values: a row of a table of quadruples may well be 0, 1, 2, 3.
const LEAST_INDEX: usize = 8;

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
