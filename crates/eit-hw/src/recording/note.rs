//! What a reader skipped and what it noticed.

use std::fmt;

use crate::error::At;

/// Incomplete frames that a reader skipped.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Skipped {
    /// Number of skipped frames.
    pub frames: usize,
    /// Details of the first ones, at most 16.
    pub first: Vec<SkippedFrame>,
}

/// One skipped frame, or several merged ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SkippedFrame {
    /// Position of the problem.
    pub at: At,
    /// Why the frame cannot be used.
    pub reason: SkipReason,
}

/// Why a frame was skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum SkipReason {
    /// The line that starts a frame is missing, so the first number may be truncated.
    NoStart,
    /// The frame has the wrong number of lines.
    Lines {
        /// Number of lines found.
        found: usize,
        /// Number of lines expected.
        wanted: usize,
    },
    /// A line has the wrong number of values.
    Values {
        /// Number of values found.
        found: usize,
        /// Number of values expected.
        wanted: usize,
    },
    /// A value is not a finite number.
    NotANumber,
    /// The file ends within its last number.
    TruncatedNumber,
    /// The file ends within a binary frame.
    Bytes {
        /// Number of bytes found.
        found: usize,
        /// Number of bytes expected.
        wanted: usize,
    },
}

impl Skipped {
    /// Maximum number of entries in [`first`](Self::first).
    const LISTED: usize = 16;

    /// Counts `frames` skipped frames as one entry.
    pub(crate) fn add(&mut self, frames: usize, at: At, reason: SkipReason) {
        self.frames += frames;
        if self.first.len() < Self::LISTED {
            self.first.push(SkippedFrame { at, reason });
        }
    }
}

impl fmt::Display for Skipped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.frames {
            1 => f.write_str("1 cut frame skipped")?,
            frames => write!(f, "{frames} cut frames skipped")?,
        }
        match self.first.first() {
            Some(first) if self.frames == 1 => write!(f, " ({first})"),
            Some(first) => write!(f, " (first: {first})"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for SkipReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoStart => f.write_str("its start is missing"),
            Self::Lines { found, wanted } => write!(f, "{found} lines instead of {wanted}"),
            Self::Values { found, wanted } => {
                write!(f, "{found} values in a line instead of {wanted}")
            }
            Self::NotANumber => f.write_str("a value is not a finite number"),
            Self::TruncatedNumber => f.write_str("the file ends within a number"),
            Self::Bytes { found, wanted } => write!(f, "{found} bytes instead of {wanted}"),
        }
    }
}

impl fmt::Display for SkippedFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.at, self.reason)
    }
}

/// Something a user should know about a recording that was read.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Note {
    /// A line without any number was treated as the header.
    HeaderLine {
        /// The line, from 1.
        line: usize,
    },
    /// Something stands around the numbers and was left out.
    Stripped {
        /// What it is, in words.
        what: String,
    },
    /// The first column counts frames or time and was left out.
    Counter,
    /// Damaged files of a folder were left out.
    DamagedFiles {
        /// Number of files.
        count: usize,
        /// What is wrong with the first.
        first: String,
    },
    /// Lines were joined to frames.
    Joined {
        /// Number of lines of a frame.
        lines: usize,
    },
    /// A matrix has a line for each drive, not a column, and was read line by line.
    Turned {
        /// Number of drives.
        drives: usize,
    },
    /// The last line has no end, so its last number may be truncated.
    NoLineEnd {
        /// The line, from 1.
        line: usize,
    },
    /// The last row repeats the one before and was dropped.
    RepeatedLastRow {
        /// The line, from 1.
        line: usize,
    },
    /// Measurements that the instrument left at 0 were filled in from their reciprocals.
    FilledByReciprocity {
        /// Number of such measurements per frame.
        values: usize,
    },
    /// A drive is repeated; its first occurrence is used.
    RepeatedDrive {
        /// Electrode where current enters, from 0.
        a: u32,
        /// Electrode where current leaves, from 0.
        b: u32,
    },
    /// The numbers of the frame files have gaps.
    MissingFrameFiles {
        /// Number of missing files.
        count: u64,
        /// First missing number.
        first: u64,
    },
    /// The file marks one of its frames as the reference.
    Reference {
        /// The line, from 1.
        line: usize,
        /// Index of the frame, from 0.
        frame: usize,
    },
    /// Every row is a pair of whole numbers, such as `1,5`, which may have been one number with a
    /// decimal comma; it was read as two.
    DecimalComma,
    /// A matrix of one column was read as one frame.
    OneColumn {
        /// Number of rows.
        rows: usize,
    },
    /// One array of a file of several was read, or one whose frames are columns.
    Array {
        /// Its name, shortened.
        name: String,
        /// Its shape.
        shape: Vec<usize>,
        /// Whether a column is a frame.
        by_columns: bool,
    },
    /// Some values are NaN or infinite and count as missing; the other values of their frames are
    /// used.
    MissingValues {
        /// Number of missing values.
        values: usize,
        /// Frame of the first missing value, from 0.
        frame: usize,
        /// Index of that value in the file's order, from 0.
        value: usize,
    },
    /// A recording has damaged parts, whose frames are skipped.
    Damaged {
        /// Number of chunks with a wrong checksum or invalid content.
        chunks: usize,
        /// Number of chunks with a damaged header whose messages could still be read.
        mended: usize,
        /// Number of messages that cannot be read.
        messages: usize,
        /// Bytes skipped to reach the next intact chunk.
        skipped_bytes: u64,
        /// Bytes at the end that form no complete record.
        truncated_bytes: u64,
        /// Number of parts of a split recording that are missing.
        missing_parts: usize,
    },
}

impl Note {
    /// Writes what is damaged; nothing for other notes.
    fn fmt_damage(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let &Self::Damaged {
            chunks,
            mended,
            messages,
            skipped_bytes,
            truncated_bytes,
            missing_parts,
        } = self
        else {
            return Ok(());
        };
        if missing_parts > 0 {
            write!(f, "{missing_parts} part(s) of the recording are missing; ")?;
        }
        write!(
            f,
            "damaged: {chunks} chunk(s), {messages} message(s) and {skipped_bytes} bytes \
             skipped, {mended} chunk(s) repaired, {truncated_bytes} bytes incomplete at the \
             end; `eit convert --recover` writes an intact file"
        )
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Damaged { .. } => self.fmt_damage(f),
            Self::MissingValues { values, frame, value } => write!(
                f,
                "{values} value(s) missing (NaN or infinite); the first is value {value} of frame {frame} \
                 (from 0)"
            ),
            Self::HeaderLine { line } => {
                write!(f, "line {line} contains no number: skipped as header")
            }
            Self::Stripped { what } => write!(f, "left out around the numbers: {what}"),
            Self::Counter => f.write_str(
                "the first column grows in equal steps, as numbers or times of frames do: left out",
            ),
            Self::DamagedFiles { count, first } => {
                write!(f, "{count} damaged file(s) left out; the first: {first}")
            }
            Self::Joined { lines } => write!(f, "{lines} lines were joined to each frame"),
            Self::Turned { drives } => write!(
                f,
                "the matrix has a line for each of {drives} drives: read line by line (frames_are = \"matrix\" expects a \
                 column for each)"
            ),
            Self::NoLineEnd { line } => {
                write!(f, "line {line} has no line end: its last number may be truncated")
            }
            Self::RepeatedLastRow { line } => {
                write!(f, "line {line} repeats the previous row: dropped")
            }
            Self::FilledByReciprocity { values } => {
                write!(f, "{values} values per frame were not measured: filled by reciprocity")
            }
            Self::RepeatedDrive { a, b } => {
                write!(f, "drive ({a}, {b}) (from 0) is repeated: the first one is used")
            }
            Self::MissingFrameFiles { count, first } => {
                write!(f, "{count} frame number(s) missing, the first is {first}")
            }
            Self::Reference { line, frame } => {
                write!(f, "line {line} marks frame {frame} (from 0) as the reference")
            }
            Self::DecimalComma => f.write_str(
                "every row is a pair of whole numbers such as 1,5, which is read as two values: if it \
                 is one number with a decimal comma, write 1.5",
            ),
            Self::Array { name, shape, by_columns } => {
                let frame = if *by_columns { ", a frame in each column" } else { "" };
                write!(f, "read the array `{name}` {shape:?}{frame}")
            }
            Self::OneColumn { rows } => write!(f, "one column of {rows} rows read as one frame"),
        }
    }
}
