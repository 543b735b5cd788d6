//! Numbers as text: one frame a row, or one frame a column.
//!
//! Fields are separated by semicolons, commas, tabs or spaces, whichever of these the first line
//! of numbers holds, looked for in this order. Everything after `#` is a comment. A first line of
//! which no field starts as a number is a header and is skipped, and so are blank lines; one
//! separator may end a line. Every row must have as many values as the first.

use std::path::Path;

use ndarray::Array2;

use super::{Format, file_bytes, table, text};
use crate::error::{HwError, Place};
use crate::recording::{Layout, Note, Recording, Unit};

/// What one frame is in a CSV file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FrameOrientation {
    /// A row.
    #[default]
    Rows,
    /// A column.
    Columns,
}

/// How a CSV file is laid out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CsvOptions {
    /// What one frame is.
    pub orientation: FrameOrientation,
    /// Rows (or columns) alternate: real parts of frame 0, imaginary parts of frame 0, real parts
    /// of frame 1 and so on.
    pub complex: bool,
}

/// Reads a CSV file.
///
/// # Errors
/// [`HwError`], see [`parse`], and where the file cannot be read.
pub fn read(path: &Path, options: &CsvOptions) -> Result<Recording, HwError> {
    parse(&file_bytes(path, Format::Csv.name())?, path, options)
}

/// Frames of a CSV file with this content; `path` is for messages.
///
/// The layout is [`Layout::AsScene`], the unit [`Unit::Arbitrary`].
///
/// # Errors
/// [`HwError`] for an empty or binary file, a field that is no number, a NaN or infinite value, a
/// row of another length than the first, and an odd number of rows where they alternate.
pub fn parse(bytes: &[u8], path: &Path, options: &CsvOptions) -> Result<Recording, HwError> {
    let content = text::decode(bytes, path)?;
    let mut rows = Rows::default();
    for (line, row) in text::lines(content) {
        rows.push(row, line, path, options)?;
    }
    let table = table::frames(rows.values, rows.columns, path, 0)?;
    let table = match options.orientation {
        FrameOrientation::Rows => table,
        FrameOrientation::Columns => table.reversed_axes(),
    };
    let (real, imaginary) = if options.complex {
        let (real, imaginary) = alternating(&table, path, options.orientation)?;
        (real, Some(imaginary))
    } else {
        (table.as_standard_layout().into_owned(), None)
    };
    let mut recording =
        Recording::new(real, imaginary, Layout::AsScene, Unit::Arbitrary, Format::Csv, path);
    recording.notes.extend(rows.header.map(|line| Note::HeaderLine { line }));
    recording.notes.extend(text::line_without_end(content).map(|line| Note::NoLineEnd { line }));
    Ok(recording)
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
    fn push(
        &mut self,
        line: &str,
        number: usize,
        path: &Path,
        options: &CsvOptions,
    ) -> Result<(), HwError> {
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
            let value = text::number(field, columns + 1, || Place::line(path, number))?;
            if !value.is_finite() {
                let (frame, measurement) = position(self.count, columns, options);
                let place = Place::line(path, number);
                return Err(HwError::NonFinite { place, frame, measurement, value });
            }
            self.values.push(value);
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
            mend: "every row must have as many as the first: remove or complete this one",
        })
    }
}

/// Whether a field is a number or starts as one, such as `0,5` and `12 mV`: no header has such.
fn is_numeric(field: &str) -> bool {
    let digits = field.trim_start_matches(['+', '-', '.']);
    digits.starts_with(|first: char| first.is_ascii_digit()) || field.parse::<f64>().is_ok()
}

/// The first of semicolon, comma and tab that the line holds, else spaces.
fn separator_of(line: &str) -> Separator {
    [';', ',', '\t']
        .into_iter()
        .find(|&separator| line.contains(separator))
        .map_or(Separator::Spaces, Separator::Character)
}

/// Fields of a trimmed line. Two iterators in one: the one not used is empty.
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

/// The first field of a trimmed line.
pub(super) fn first_field(line: &str) -> &str {
    fields(line, separator_of(line)).next().unwrap_or_default()
}

/// Frame and measurement of the value in this row and column, all from 0.
fn position(row: usize, column: usize, options: &CsvOptions) -> (usize, usize) {
    let (frame, measurement) = match options.orientation {
        FrameOrientation::Rows => (row, column),
        FrameOrientation::Columns => (column, row),
    };
    (if options.complex { frame / 2 } else { frame }, measurement)
}

/// Real and imaginary parts out of rows that alternate.
fn alternating(
    table: &Array2<f64>,
    path: &Path,
    orientation: FrameOrientation,
) -> Result<(Array2<f64>, Array2<f64>), HwError> {
    let rows = table.nrows();
    if !rows.is_multiple_of(2) {
        return Err(HwError::Count {
            place: Place::file(path),
            what: match orientation {
                FrameOrientation::Rows => "rows",
                FrameOrientation::Columns => "columns",
            },
            found: rows,
            wanted: rows + 1,
            mend: "they alternate real and imaginary: add the last or set `[recording] complex = \
                   false`",
        });
    }
    let part = |first: usize| {
        Array2::from_shape_fn((rows / 2, table.ncols()), |(frame, value)| {
            table[[2 * frame + first, value]]
        })
    };
    Ok((part(0), part(1)))
}
