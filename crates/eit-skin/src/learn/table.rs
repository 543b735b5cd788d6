//! The table of presses: a CSV file with a line per press.

use crate::error::SkinError;
use crate::scene::{Must, check_numbers, read_file_of};
use serde::Deserialize;
use std::path::Path;

/// Maximum size of the table; ten thousand presses take about a megabyte.
const MOST_BYTES: u64 = 64 << 20;

/// Maximum number of presses: a year of robot time, and 30 MB.
const MOST_PRESSES: usize = 200_000;

/// A line of the table.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Press {
    /// Position along x, metres.
    pub x_m: f64,
    /// Position along y, metres.
    pub y_m: f64,
    /// Height on a curved skin, metres.
    #[serde(default)]
    pub z_m: Option<f64>,
    /// Force, newtons.
    #[serde(default)]
    pub force_n: Option<f64>,
    /// Depth, metres: recorded in tables made with robots, but not used.
    #[serde(default)]
    pub depth_m: Option<f64>,
    /// First frame of the press, from 0; if absent, each press has one frame, in order.
    #[serde(default)]
    pub first_frame: Option<usize>,
    /// Last frame of the press, from 0.
    #[serde(default)]
    pub last_frame: Option<usize>,
    /// First frame of the untouched skin before it; if absent, the reference of the recording is used.
    #[serde(default)]
    pub before_first: Option<usize>,
    /// Last frame of the untouched skin before it.
    #[serde(default)]
    pub before_last: Option<usize>,
}

/// Presses in the order of time.
#[derive(Debug, Clone, PartialEq)]
pub struct PressTable {
    /// Presses in the order of the file's lines.
    pub presses: Vec<Press>,
    /// File name, for messages.
    pub place: String,
    /// Line of each press in the file, from 1.
    lines: Vec<usize>,
}

/// Counts the lines of a text, record by record.
struct Lines<'a> {
    bytes: &'a [u8],
    /// Position up to which lines were counted, and the line there, from 1.
    at: usize,
    line: usize,
}

impl Lines<'_> {
    /// Line of a record that begins at a byte offset, after those asked for before; empty lines before it belong
    /// to no record.
    fn of(&mut self, begin: usize) -> usize {
        let is_end = |byte: &&u8| matches!(**byte, b'\n' | b'\r');
        let rest = self.bytes.get(begin..).unwrap_or_default();
        let end = begin + rest.iter().take_while(is_end).count();
        let passed = self.bytes.get(self.at..end).unwrap_or_default();
        self.line += passed.iter().filter(|byte| **byte == b'\n').count();
        self.at = self.at.max(end);
        self.line
    }
}

impl PressTable {
    /// Reads a CSV file with the columns of [`Press`].
    ///
    /// # Errors
    ///
    /// A file that cannot be read; an unknown column; a value that is not a number, with its line; more than 200 000
    /// presses.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, SkinError> {
        let path = path.as_ref();
        let place = path.display().to_string();
        let refused = |e: csv::Error| {
            SkinError::input(format!(
                "{place}: {e}; columns are x_m, y_m and optionally z_m, force_n, depth_m, first_frame, \
                 last_frame, before_first, before_last"
            ))
        };
        let bytes = read_file_of(path, MOST_BYTES)?;
        let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(&*bytes);
        let header = reader.headers().map_err(refused)?.clone();
        let (mut presses, mut lines) = (Vec::new(), Vec::new());
        let mut counted = Lines { bytes: &bytes, at: 0, line: 1 };
        for record in reader.records() {
            if presses.len() == MOST_PRESSES {
                return Err(SkinError::input(format!("{place}: more than {MOST_PRESSES} presses")));
            }
            let record = record.map_err(refused)?;
            lines.push(counted.of(record.position().map_or(0, |at| at.byte() as usize)));
            presses.push(record.deserialize(Some(&header)).map_err(refused)?);
        }
        let table = Self { presses, place, lines };
        table.validate()?;
        Ok(table)
    }

    /// Creates a table of presses that are not in a file; lines count from 2, as after a header.
    ///
    /// # Errors
    ///
    /// The errors of [`PressTable::read`].
    pub fn new(presses: Vec<Press>, place: &str) -> Result<Self, SkinError> {
        let lines = (2..presses.len() + 2).collect();
        let table = Self { presses, place: place.to_owned(), lines };
        table.validate()?;
        Ok(table)
    }

    /// Returns the line of a press, from 1.
    pub fn line(&self, press: usize) -> usize {
        self.lines.get(press).copied().unwrap_or(0)
    }

    /// Returns the name of a press in messages.
    pub fn name(&self, press: usize) -> String {
        format!("{}, line {}", self.place, self.line(press))
    }

    fn validate(&self) -> Result<(), SkinError> {
        if self.presses.is_empty() {
            return Err(SkinError::input(format!("{}: no presses", self.place)));
        }
        for (k, press) in self.presses.iter().enumerate() {
            check_numbers([
                ("x_m", Some(press.x_m), Must::Finite),
                ("y_m", Some(press.y_m), Must::Finite),
                ("z_m", press.z_m, Must::Finite),
                ("force_n", press.force_n, Must::Positive),
            ])
            .map_err(|e| e.within(&self.name(k)))?;
            let ranges = [
                ("last_frame", press.first_frame, press.last_frame),
                ("before_last", press.before_first, press.before_last),
            ];
            for (key, first, last) in ranges {
                if let Some(last) = last
                    && first.is_none_or(|first| last < first)
                {
                    let (value, must) = (last as f64, "at or after its first frame");
                    return Err(SkinError::OutOfRange { key, value, must }.within(&self.name(k)));
                }
            }
        }
        Ok(())
    }
}
