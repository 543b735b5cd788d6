//! Numbers as text: one frame per row, one frame per column, or one frame as a matrix.
//!
//! Lines are read as those of boards ([`codec::text`](crate::codec::text)), and a note says what was stripped from them. Everything
//! after `#` is a comment. Blank lines are skipped, and so is the first line if none of its fields starts as a number or they number
//! eight or more columns (a header). Every row must have as many values as the first.
//!
//! Where commas alone separate, they are no decimal ones. Where every line is a pair of whole numbers as in `1,5`, a note says
//! that it was read as two ([`Note::DecimalComma`]); where pairs as in `0,25` are twice as many values as
//! measurements, the error says so ([`CountHint::DecimalComma`](crate::CountHint::DecimalComma)).

use std::path::Path;

use super::ReadOptions;
use super::table::Table;
use super::text;
use crate::codec::text::line::{self, Stripped};
use crate::error::{HwError, Place, shortened};
use crate::recording::{Contents, Format, FrameOrientation, Layout, Note, Recording, Unit};

/// Parses the content of a CSV file; `path` is used in messages only.
///
/// The layout is [`Layout::ProtocolOrder`], the unit [`Unit::Arbitrary`]. A value that is NaN or
/// infinite counts as missing and is flagged [`Quality::NON_FINITE`](crate::Quality::NON_FINITE).
///
/// # Errors
/// [`HwError`] for an empty or binary file, a field that is not a number, a row whose length
/// differs from the first, or an odd number of rows or columns where they alternate.
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    options: &ReadOptions,
) -> Result<Recording, HwError> {
    Rows::parse(bytes, path)?.recording(path, options)
}

/// Rows read so far.
#[derive(Default)]
struct Rows {
    values: Vec<f64>,
    columns: usize,
    count: usize,
    stripped: Stripped,
    header: Option<usize>,
    /// Number of the last line if it has no end.
    unended: Option<usize>,
    /// Whether a row is anything but pairs of whole numbers, as in `1,5`.
    unpaired: bool,
    /// Whether some pair looks like one number.
    decimal: bool,
}

impl Rows {
    fn parse(bytes: &[u8], path: &Path) -> Result<Self, HwError> {
        let content = text::decode(bytes, path)?;
        // at most one value per two bytes, so that the list need not grow
        let mut rows = Self { values: Vec::with_capacity(bytes.len() / 2 + 1), ..Self::default() };
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
        let first = self.count == 0;
        let is_header = || !fields(line).any(is_numeric) || is_index(line);
        if first && self.header.is_none() && is_header() {
            self.header = Some(number);
            // which names several columns
            self.unpaired = fields(line).nth(1).is_some();
            return Ok(());
        }
        let before = self.values.len();
        let stripped = line::numbers(line, |value| self.values.push(value));
        let stripped = stripped.map_err(|wrong| HwError::NotANumber {
            place: Place::line(path, number),
            value: wrong.field + 1,
            text: shortened(wrong.text),
        })?;
        self.stripped = self.stripped.or(stripped);
        let columns = self.values.len() - before;
        if first {
            self.columns = columns;
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
        Err(HwError::count(
            Place::line(path, number),
            "values",
            [columns, self.columns],
            "every row must have as many values as the first: remove or complete this one",
        ))
    }

    /// Whether the first column grows in equal steps, as numbers and times of frames do.
    fn counts(&self) -> bool {
        if self.columns < 2 || self.count < LEAST_COUNTED {
            return false;
        }
        let first: Vec<f64> = self.values.iter().step_by(self.columns).copied().collect();
        let step = first[1] - first[0];
        let is_step = |pair: &[f64]| (pair[1] - pair[0] - step).abs() <= 1e-6 * step;
        step > 0.0 && first.windows(2).all(is_step)
    }

    fn recording(self, path: &Path, options: &ReadOptions) -> Result<Recording, HwError> {
        let (orientation, complex) = (options.frames_are.unwrap_or_default(), options.complex);
        let has_counter = orientation == FrameOrientation::Rows && self.counts();
        if self.values.is_empty() {
            return Err(HwError::NoFrames { place: Place::file(path), skipped: 0 });
        }
        let contents = if orientation == FrameOrientation::Rows && !complex {
            let (real, value_count) = (self.values, self.columns);
            Contents { real, value_count, ..Contents::default() }
        } else {
            let by_rows = orientation == FrameOrientation::Rows;
            let (rows, columns) = (self.count, self.columns);
            let vectors = if by_rows { [rows, columns] } else { [columns, rows] };
            let mut table = Table::new(vectors, orientation, complex, false, path)?;
            for (at, value) in self.values.into_iter().enumerate() {
                let (row, column) = (at / columns, at % columns);
                let (vector, index) = if by_rows { (row, column) } else { (column, row) };
                table.put(vector, index, value, 0.0);
            }
            table.contents()
        };
        let (layout, unit) = (Layout::ProtocolOrder, Unit::Arbitrary);
        let mut recording = Recording::new(contents, layout, unit, Format::Csv, path)?;
        recording.matrix =
            (orientation == FrameOrientation::Matrix).then_some([self.count, self.columns]);
        recording.frames_are = Some(orientation);
        recording.notes.extend(self.header.map(|line| Note::HeaderLine { line }));
        recording.notes.extend(self.unended.map(|line| Note::NoLineEnd { line }));
        recording.has_counter = has_counter;
        recording.notes.extend(self.stripped.words().map(|what| Note::Stripped { what }));
        recording.may_have_decimal_commas = !self.unpaired && self.decimal;
        if self.columns == 2 && !self.unpaired {
            recording.notes.push(Note::DecimalComma);
        }
        Ok(recording.with_missing())
    }
}

/// What a line of pairs of whole numbers, such as `1,5,-0,25`, indicates about decimal commas.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pairs {
    /// A sign, a point, a space or nothing follows some comma: it separates numbers.
    No,
    /// The commas may be decimal commas.
    Possible,
    /// Some pair looks like a number below one or has a zero after the comma (`0,25`, `1,05`),
    /// which pairs of whole numbers rarely do.
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

/// Returns whether a line numbers the columns from 0 or 1, as tables without column names do.
fn is_index(line: &str) -> bool {
    let first = match fields(line).next() {
        Some("0") => 0,
        Some("1") => 1,
        _ => return false,
    };
    let is_next = |(k, field): (usize, &str)| field.parse() == Ok(first + k);
    fields(line).count() >= LEAST_INDEX && fields(line).enumerate().all(is_next)
}

/// Fewest rows whose first column may be a counter.
const LEAST_COUNTED: usize = 4;
/// Fewest columns of such a line: a row of a table of quadruples may well be 0, 1, 2, 3.
const LEAST_INDEX: usize = 8;

/// Splits a header into fields.
fn fields(line: &str) -> impl Iterator<Item = &str> {
    let fields = line.split([',', ';', '\t', ' ']).map(|field| field.trim_matches(['"', '\'']));
    fields.filter(|field| !field.is_empty())
}
