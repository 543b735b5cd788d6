//! Layout of frames written as text.

use super::number::Number;
use crate::error::HwError;

/// Longest line accepted, in bytes: 4 000 values of 16 characters.
pub const MAX_LINE_BYTES: usize = 65_536;
/// Maximum number of values per frame; a complex value counts as two.
pub const MAX_VALUES: usize = 16_384;

/// Layout of frames written as text.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct TextFormat {
    /// How frames are delimited.
    pub framing: Framing,
    /// Lines of numbers per frame.
    pub lines_per_frame: usize,
    /// Numbers per line; a complex value counts as two.
    pub values_per_line: usize,
    /// How numbers are written.
    pub number: Number,
    /// Whether real and imaginary parts alternate.
    pub complex: bool,
    /// Factor applied to each number.
    pub scale: f64,
    /// Magnitude, before scaling, from which a value is flagged saturated.
    pub saturated_from: Option<f64>,
    /// Magnitude, before scaling, up to which a value is flagged open.
    pub open_up_to: Option<f64>,
}

/// How frames are delimited. Lines end with LF, CR or both; empty lines are ignored.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Framing {
    /// One line per frame, without marks; with several lines, nothing would say which is the first.
    /// The first line received is skipped, as its start may be missing.
    Lines,
    /// A line that equals this text starts a frame.
    StartLine(String),
    /// The first line of a frame starts with this text; numbers follow it, or the next `:` if there
    /// is one.
    Prefix(String),
    /// A line that equals this text ends a frame.
    EndLine(String),
}

impl Default for TextFormat {
    /// Plain CSV: one frame of 208 decimal numbers per line.
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
    /// Returns the number of measurements per frame.
    pub fn measurements(&self) -> usize {
        self.numbers() / if self.complex { 2 } else { 1 }
    }

    pub(super) fn numbers(&self) -> usize {
        self.lines_per_frame.saturating_mul(self.values_per_line)
    }

    /// Checks that the settings are consistent.
    ///
    /// # Errors
    /// [`HwError::Setting`] names the first that is not.
    pub fn validate(&self) -> Result<(), HwError> {
        let refuse = |name, value: String, wanted| Err(HwError::Setting { name, value, wanted });
        if self.numbers() == 0 || self.numbers() > MAX_VALUES {
            let value = format!("{} x {}", self.lines_per_frame, self.values_per_line);
            return refuse("lines_per_frame x values_per_line", value, "1 to 16384 values");
        }
        if self.complex && !self.values_per_line.is_multiple_of(2) {
            let value = self.values_per_line.to_string();
            return refuse("values_per_line", value, "an even number for complex values");
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
