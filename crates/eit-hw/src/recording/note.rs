//! What a reader left out and what it noticed.

use std::fmt;

use crate::error::At;

/// Frames that a reader left out because they are cut.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Skipped {
    /// How many.
    pub frames: usize,
    /// The first of them, at most [`Skipped::LISTED`].
    pub first: Vec<SkippedFrame>,
}

/// One frame that was left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SkippedFrame {
    /// Where the trouble is.
    pub at: At,
    /// Why.
    pub reason: SkipReason,
}

/// Why a frame was left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SkipReason {
    /// The line that starts a frame is missing, so its first number may be cut.
    NoStart,
    /// The frame has another number of lines.
    Lines {
        /// Lines there are.
        found: usize,
        /// Lines there should be.
        wanted: usize,
    },
    /// A line has another number of values.
    Values {
        /// Values there are.
        found: usize,
        /// Values there should be.
        wanted: usize,
    },
    /// A value is no finite number.
    NotANumber,
    /// The file ends within its last number.
    TruncatedNumber,
    /// The file ends within a binary frame.
    Bytes {
        /// Bytes there are.
        found: usize,
        /// Bytes there should be.
        wanted: usize,
    },
}

impl Skipped {
    /// How many frames are listed with their place.
    pub const LISTED: usize = 16;

    /// Counts `frames`, listed as one entry.
    pub(crate) fn add(&mut self, frames: usize, at: At, reason: SkipReason) {
        self.frames += frames;
        if self.first.len() < Self::LISTED {
            self.first.push(SkippedFrame { at, reason });
        }
    }
}

impl fmt::Display for SkipReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoStart => f.write_str("its start is missing"),
            Self::Lines { found, wanted } => write!(f, "{found} lines of {wanted}"),
            Self::Values { found, wanted } => write!(f, "{found} values in a line of {wanted}"),
            Self::NotANumber => f.write_str("a value is no finite number"),
            Self::TruncatedNumber => f.write_str("the file ends within a number"),
            Self::Bytes { found, wanted } => write!(f, "{found} bytes of {wanted}"),
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
pub enum Note {
    /// A line without any number was taken for the header.
    HeaderLine {
        /// The line, from 1.
        line: usize,
    },
    /// The last line has no end: if the file was cut there, its last number is.
    NoLineEnd {
        /// The line, from 1.
        line: usize,
    },
    /// The last row repeats the one before and was left out.
    RepeatedLastRow {
        /// The line, from 1.
        line: usize,
    },
    /// Measurements that the instrument left at 0 were filled with their reciprocal ones.
    FilledByReciprocity {
        /// How many in each frame.
        values: usize,
    },
    /// A drive occurs again; its first occurrence is used.
    RepeatedDrive {
        /// Electrode where current enters, from 0.
        a: u32,
        /// Electrode where it leaves, from 0.
        b: u32,
    },
    /// The numbers of the frame files have holes.
    MissingFrameFiles {
        /// How many numbers are missing.
        count: u64,
        /// The first of them.
        first: u64,
    },
    /// The file marks one of its frames as the reference.
    Reference {
        /// The line, from 1.
        line: usize,
        /// The frame, from 0.
        frame: usize,
    },
    /// A matrix of one column was taken for one frame.
    OneColumn {
        /// Its rows.
        rows: usize,
    },
    /// Values are NaN or infinite: they are missing, and the others of their frames are used.
    MissingValues {
        /// How many.
        values: usize,
        /// Frame of the first, from 0.
        frame: usize,
        /// Its value in the file's order, from 0.
        value: usize,
    },
    /// A recording has damaged parts, whose frames are left out.
    Damaged {
        /// Chunks whose checksum or content is wrong.
        chunks: usize,
        /// Chunks with a damaged head whose messages were read all the same.
        mended: usize,
        /// Messages that cannot be read.
        messages: usize,
        /// Bytes before a whole record that are none.
        skipped_bytes: u64,
        /// Bytes at the end that are no whole record.
        truncated_bytes: u64,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Damaged { chunks, mended, messages, skipped_bytes, truncated_bytes } => write!(
                f,
                "damaged: {chunks} chunk(s), {messages} message(s) and {skipped_bytes} bytes left out, \
                 {mended} chunk(s) mended, {truncated_bytes} bytes cut off at the end; `eit recover` \
                 writes a whole file"
            ),
            Self::MissingValues { values, frame, value } => write!(
                f,
                "{values} value(s) missing, not numbers; the first is value {value} of frame {frame} \
                 (from 0)"
            ),
            Self::HeaderLine { line } => write!(f, "line {line} holds no number: header skipped"),
            Self::NoLineEnd { line } => {
                write!(f, "line {line} has no line end: its last number may be cut")
            }
            Self::RepeatedLastRow { line } => {
                write!(f, "line {line} repeats the row before: left out")
            }
            Self::FilledByReciprocity { values } => {
                write!(f, "{values} values a frame were not measured: filled by reciprocity")
            }
            Self::RepeatedDrive { a, b } => {
                write!(f, "drive ({a}, {b}) (from 0) occurs again: the first one is used")
            }
            Self::MissingFrameFiles { count, first } => {
                write!(f, "{count} frame number(s) missing, the first is {first}")
            }
            Self::Reference { line, frame } => {
                write!(f, "line {line} marks frame {frame} (from 0) as the reference")
            }
            Self::OneColumn { rows } => write!(f, "one column of {rows} rows taken for one frame"),
        }
    }
}
