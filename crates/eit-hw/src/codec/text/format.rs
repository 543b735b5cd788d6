//! How frames are written as text.

use super::number::Number;
use crate::error::HwError;

/// Longest line that is taken, in bytes: 4 000 values of 16 characters.
pub const MAX_LINE_BYTES: usize = 65_536;
/// Most values of a frame, a complex one counting two.
pub const MAX_VALUES: usize = 16_384;

/// How frames are written.
#[derive(Clone, Debug, PartialEq)]
pub struct TextFormat {
    /// Where a frame starts and ends.
    pub framing: Framing,
    /// Lines of numbers in a frame.
    pub lines_per_frame: usize,
    /// Numbers of a line, a complex value being two.
    pub values_per_line: usize,
    /// How a number is written.
    pub number: Number,
    /// Whether real and imaginary parts alternate.
    pub complex: bool,
    /// Each number is multiplied by this.
    pub scale: f64,
    /// Magnitudes from here on, before scaling, are flagged saturated.
    pub saturated_from: Option<f64>,
    /// Magnitudes up to here, before scaling, are flagged open.
    pub open_up_to: Option<f64>,
}

/// Where a frame starts and ends. Lines are ended by LF, CR or both; empty ones do not count.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Framing {
    /// Frames follow each other without marks; only for one line a frame, since nothing else says
    /// which line is the first. The first line is passed over: its start may be cut.
    Lines,
    /// A line that is exactly this starts a frame.
    StartLine(String),
    /// The first line of a frame starts with this, and its numbers follow the first `:` or blank.
    Prefix(String),
    /// A line that is exactly this ends a frame.
    EndLine(String),
}

impl Default for TextFormat {
    /// Plain CSV: a frame of 208 decimals a line.
    fn default() -> Self {
        Self {
            framing: Framing::Lines,
            lines_per_frame: 1,
            values_per_line: 208,
            number: Number::Decimal,
            complex: false,
            scale: 1.0,
            saturated_from: None,
            open_up_to: None,
        }
    }
}

impl TextFormat {
    /// Measurements of a frame.
    pub fn measurements(&self) -> usize {
        self.numbers() / if self.complex { 2 } else { 1 }
    }

    pub(super) fn numbers(&self) -> usize {
        self.lines_per_frame.saturating_mul(self.values_per_line)
    }

    /// Whether the fields fit each other.
    ///
    /// # Errors
    /// [`HwError::Setting`] names the first that does not.
    pub fn validate(&self) -> Result<(), HwError> {
        let refuse = |name, value: String, wanted| Err(HwError::Setting { name, value, wanted });
        if self.numbers() == 0 || self.numbers() > MAX_VALUES {
            let value = format!("{} x {}", self.lines_per_frame, self.values_per_line);
            return refuse("lines_per_frame x values_per_line", value, "1 to 16384 values");
        }
        if self.complex && !self.values_per_line.is_multiple_of(2) {
            let value = self.values_per_line.to_string();
            return refuse("values_per_line", value, "an even number, since values are complex");
        }
        if self.framing == Framing::Lines && self.lines_per_frame != 1 {
            let value = self.lines_per_frame.to_string();
            return refuse("lines_per_frame", value, "1, or a start or end line");
        }
        if let Framing::StartLine(mark) | Framing::Prefix(mark) | Framing::EndLine(mark) =
            &self.framing
            && (mark.is_empty() || mark.trim() != mark || mark.contains(['\n', '\r']))
        {
            return refuse("frame mark", format!("{mark:?}"), "text without blanks around it");
        }
        if !self.scale.is_finite() || self.scale == 0.0 {
            return refuse("scale", self.scale.to_string(), "a finite number other than 0");
        }
        for (name, limit) in
            [("saturated_from", self.saturated_from), ("open_up_to", self.open_up_to)]
        {
            if let Some(limit) = limit.filter(|limit| !(limit.is_finite() && *limit >= 0.0)) {
                return refuse(name, limit.to_string(), "a finite number, at least 0");
            }
        }
        Ok(())
    }
}
