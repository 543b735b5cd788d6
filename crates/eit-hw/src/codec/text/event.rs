//! What a decoder of text reports.

use super::format::TextFormat;
use crate::frame::Quality;

/// Outcome of decoding the bytes received so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// A complete frame.
    Frame {
        /// Real parts, scaled.
        values: &'a [f64],
        /// Imaginary parts, scaled; empty for real values.
        imaginary: &'a [f64],
        /// Flags set by the limits of the format, and of values that the board printed as `nan`,
        /// `inf` or `ovf`: these are NaN and [`Quality::NON_FINITE`].
        quality: &'a [Quality],
    },
    /// A line outside any frame, such as a banner; control characters are replaced by `?`.
    Line(&'a str),
    /// A frame was skipped.
    Skipped(Fault),
}

/// Why a frame was skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Fault {
    /// A line has the wrong number of values.
    Values {
        /// Number of values found.
        found: usize,
        /// Number of values expected.
        wanted: usize,
    },
    /// The frame has the wrong number of lines.
    Lines {
        /// Number of lines found.
        found: usize,
        /// Number of lines expected.
        wanted: usize,
    },
    /// A field is not a number.
    NotANumber {
        /// Index of the field, from 0.
        field: usize,
    },
    /// A line is longer than [`MAX_LINE_BYTES`](super::MAX_LINE_BYTES).
    TooLong,
    /// The start of the line was not received.
    TruncatedStart,
}

/// Values of a frame, scaled, and their flags.
#[derive(Clone, Debug)]
pub(super) struct Values {
    values: Vec<f64>,
    imaginary: Vec<f64>,
    quality: Vec<Quality>,
}

impl Values {
    pub(super) fn new(format: &TextFormat) -> Self {
        let count = format.measurements();
        Self {
            values: vec![0.0; count],
            imaginary: vec![0.0; if format.complex { count } else { 0 }],
            quality: vec![Quality::GOOD; count],
        }
    }

    /// Scales the numbers of a frame, and flags them by the limits of the format.
    pub(super) fn set(&mut self, format: &TextFormat, numbers: &[f64]) {
        let step = if format.complex { 2 } else { 1 };
        let slots = self.values.iter_mut().zip(&mut self.quality).enumerate();
        for ((index, (value, quality)), parts) in slots.zip(numbers.chunks_exact(step)) {
            let mut size = 0.0_f64;
            *quality = Quality::GOOD;
            *value = parts[0] * format.scale;
            for part in parts {
                size = size.max(part.abs());
            }
            if parts.iter().any(|part| part.is_nan()) {
                *quality |= Quality::NON_FINITE;
                // of a complex value with one part, neither limit can be known
                size = f64::NAN;
            }
            if let (&[_, imaginary], Some(slot)) = (parts, self.imaginary.get_mut(index)) {
                *slot = imaginary * format.scale;
            }
            if format.saturated_from.is_some_and(|limit| size >= limit) {
                *quality |= Quality::SATURATED;
            }
            if format.open_up_to.is_some_and(|limit| size <= limit) {
                *quality |= Quality::OPEN;
            }
        }
    }

    /// The frame.
    pub(super) fn event(&self) -> Event<'_> {
        let Self { values, imaginary, quality } = self;
        Event::Frame { values, imaginary, quality }
    }
}
