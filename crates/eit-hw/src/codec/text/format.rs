//! Layout of frames written as text.

use super::number::Number;
use crate::error::HwError;

/// Longest line accepted, in bytes: 4 000 values of 16 characters.
pub const MAX_LINE_BYTES: usize = 65_536;
/// Maximum number of values per frame; a complex value counts as two.
pub(crate) const MAX_VALUES: usize = 16_384;

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
    /// One line per frame, without marks; or several with an empty line or a pause between frames, which says which is the first.
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
        HwError::require(
            (1..=MAX_VALUES).contains(&self.numbers()),
            "lines_per_frame x values_per_line",
            format!("{} x {}", self.lines_per_frame, self.values_per_line),
            "1 to 16384 values",
        )?;
        let (lines, values) = (self.lines_per_frame, self.values_per_line);
        let is_even = !self.complex || values.is_multiple_of(2);
        HwError::require(is_even, "values_per_line", values, "an even number for complex values")?;
        let is_framed = self.framing != Framing::Lines || lines == 1;
        HwError::require(is_framed, "lines_per_frame", lines, "1, or a start or end line")?;
        if let Framing::StartLine(mark) | Framing::Prefix(mark) | Framing::EndLine(mark) =
            &self.framing
        {
            let is_plain = !mark.is_empty() && mark.trim() == mark && !mark.contains(['\n', '\r']);
            let wanted = "text without blanks around it";
            HwError::require(is_plain, "frame mark", format!("{mark:?}"), wanted)?;
        }
        let is_factor = self.scale.is_finite() && self.scale != 0.0;
        HwError::require(is_factor, "scale", self.scale, "a finite number other than 0")?;
        for (name, limit) in
            [("saturated_from", self.saturated_from), ("open_up_to", self.open_up_to)]
        {
            let limit = limit.unwrap_or(0.0);
            let is_valid = limit.is_finite() && limit >= 0.0;
            HwError::require(is_valid, name, limit, "a finite number, at least 0")?;
        }
        Ok(())
    }
}
