//! Range of frames of a recording, written "N..M".

use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// Frames N to M - 1, from 0; written "N..M" in a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub struct FrameRange {
    /// First frame.
    pub start: usize,
    /// End of the range: one past the last frame.
    pub end: usize,
}

impl FrameRange {
    /// Returns the number of frames.
    pub fn count(self) -> usize {
        self.end.saturating_sub(self.start)
    }
}

impl From<Range<usize>> for FrameRange {
    fn from(Range { start, end }: Range<usize>) -> Self {
        Self { start, end }
    }
}

impl fmt::Display for FrameRange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..{}", self.start, self.end)
    }
}

impl From<FrameRange> for String {
    fn from(range: FrameRange) -> Self {
        range.to_string()
    }
}

impl FromStr for FrameRange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once("..");
        let numbers = parts.and_then(|(start, end)| {
            Some(Self { start: start.trim().parse().ok()?, end: end.trim().parse().ok()? })
        });
        numbers.ok_or_else(|| format!("\"{text}\" is not a range of frames: write \"N..M\""))
    }
}

impl TryFrom<String> for FrameRange {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}
