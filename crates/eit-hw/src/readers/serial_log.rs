//! Raw serial logs of decimal numbers: 16 electrodes, adjacent drive and measurement.
//!
//! A line `s` starts a frame: one line per drive d = (d, d+1), with the amplitudes of the measured
//! pairs (d+2+k, d+3+k) mod 16 for k = 0 to 12. A line `ref:` starts a frame that the program
//! marked as its reference; `data:` ends it. A single line with all values of a frame is a frame,
//! too. Lines are logged as received over the serial line, so frames can be incomplete: each
//! incomplete frame is skipped and counted, and so is a first frame without its `s`, whose first
//! number may have lost digits. Without a checksum or counter two errors go undetected: a digit
//! lost within a line, and a loss of exactly one frame's lines that joins the start of one frame to
//! the end of the next. Amplitudes are unsigned, in the converter's volts at an unknown gain
//! ([`Unit::Arbitrary`]).

use std::path::Path;

use super::text;
use crate::error::{At, HwError, Place};
use crate::frame::Quality;
use crate::recording::{Contents, Format, Layout, Note, Recording, SkipReason, Skipped, Unit};

/// Layout of a serial log.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct SerialLogOptions {
    /// Lines per frame: number of drives.
    pub lines_per_frame: usize,
    /// Values per line: number of measured pairs.
    pub values_per_line: usize,
    /// Full scale of the converter: larger or equal values are flagged [`Quality::SATURATED`].
    pub full_scale: Option<f64>,
}

impl SerialLogOptions {
    /// Number of values per frame.
    const fn size(&self) -> usize {
        self.lines_per_frame.saturating_mul(self.values_per_line)
    }
}

impl Default for SerialLogOptions {
    /// 16 lines of 13 values, full scale 6.55.
    fn default() -> Self {
        Self { lines_per_frame: 16, values_per_line: 13, full_scale: Some(6.55) }
    }
}

/// Parses the content of a serial log; `path` is used in messages only.
///
/// The layout is [`Layout::ProtocolOrder`].
///
/// # Errors
/// [`HwError::Empty`], and [`HwError::NoFrames`] if no frame is complete.
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    options: &SerialLogOptions,
) -> Result<Recording, HwError> {
    if bytes.is_empty() {
        return Err(HwError::Empty { place: Place::file(path) });
    }
    let mut log = Log::new(*options, bytes.len());
    for (bytes, line) in bytes.split_inclusive(|&byte| byte == b'\n').zip(1..) {
        log.line(bytes, line);
    }
    log.close();
    let contents = Contents {
        real: log.values,
        quality: Some(log.quality),
        value_count: options.size(),
        skipped: log.skipped,
        ..Contents::default()
    };
    let (layout, unit) = (Layout::ProtocolOrder, Unit::Arbitrary);
    let mut recording = Recording::new(contents, layout, unit, Format::SerialLog, path)?;
    recording.reference_frame = log.reference.map(|(_, frame)| frame);
    recording.notes.extend(log.reference.map(|(line, frame)| Note::Reference { line, frame }));
    Ok(recording)
}

/// Returns whether a trimmed line is one of those that divide a log.
pub(super) fn is_mark(line: &[u8]) -> bool {
    matches!(line, b"s" | b"ref:" | b"data:")
}

/// Returns whether text without any mark has the lines and numbers per line of complete frames.
pub(super) fn looks_like_unmarked(content: &str, options: &SerialLogOptions) -> bool {
    let mut lines = 0_usize;
    for (_, line) in text::lines(content) {
        match line.split_whitespace().count() {
            0 => {}
            values if values == options.values_per_line => lines += 1,
            _ => return false,
        }
    }
    lines > 0 && options.lines_per_frame > 0 && lines.is_multiple_of(options.lines_per_frame)
}

/// State of the line parser.
struct Log {
    options: SerialLogOptions,
    /// Values and flags of complete frames.
    values: Vec<f64>,
    quality: Vec<Quality>,
    /// Values of the open frame.
    frame: Vec<f64>,
    open: Option<Open>,
    skipped: Skipped,
    /// Line and frame index of the first reference.
    reference: Option<(usize, usize)>,
}

/// A frame being read.
struct Open {
    start: usize,
    mark: Mark,
    lines: usize,
    fault: Option<(At, SkipReason)>,
}

#[derive(Clone, Copy, PartialEq)]
enum Mark {
    None,
    Frame,
    Reference,
}

impl Log {
    /// For a log of this length.
    fn new(options: SerialLogOptions, bytes: usize) -> Self {
        Self {
            options,
            // at most one value per two bytes, so that the lists need not grow
            values: Vec::with_capacity(bytes / 2),
            quality: Vec::with_capacity(bytes / 2),
            frame: Vec::new(),
            open: None,
            skipped: Skipped::default(),
            reference: None,
        }
    }

    fn start(&mut self, start: usize, mark: Mark) {
        self.close();
        self.open = Some(Open { start, mark, lines: 0, fault: None });
    }

    fn line(&mut self, bytes: &[u8], line: usize) {
        match bytes.trim_ascii() {
            b"" => {}
            b"s" => self.start(line, Mark::Frame),
            b"ref:" => self.start(line, Mark::Reference),
            b"data:" => self.close(),
            _ => self.numbers(bytes, line),
        }
    }

    fn numbers(&mut self, bytes: &[u8], line: usize) {
        let SerialLogOptions { lines_per_frame, values_per_line, .. } = self.options;
        let before = self.frame.len();
        let (found, fault) = self.push_values(bytes);
        if fault.is_none() && found == self.options.size() {
            // a complete frame in one line, whatever was open before
            let frame = self.frame.split_off(before);
            self.start(line, Mark::Frame);
            self.frame.extend(frame);
            if let Some(open) = &mut self.open {
                open.lines = lines_per_frame;
            }
            self.close();
            return;
        }
        let open =
            self.open.get_or_insert(Open { start: line, mark: Mark::None, lines: 0, fault: None });
        open.lines += 1;
        let count = SkipReason::Values { found, wanted: values_per_line };
        let fault = fault.or((found != values_per_line).then_some(count));
        if open.fault.is_none() {
            open.fault = fault.map(|reason| (At::Line(line), reason));
        }
        // too many lines are only counted
        if open.fault.is_some() || open.lines > lines_per_frame {
            self.frame.clear();
        }
    }

    /// Appends the numbers of a line, at most those of a frame; returns their count and what is
    /// wrong with them.
    fn push_values(&mut self, bytes: &[u8]) -> (usize, Option<SkipReason>) {
        let (mut found, most) = (0, self.options.size());
        for field in bytes.split(u8::is_ascii_whitespace).filter(|field| !field.is_empty()) {
            found += 1;
            let number = std::str::from_utf8(field).ok().and_then(|field| field.parse().ok());
            match number.filter(|value: &f64| value.is_finite()) {
                Some(value) if found <= most => self.frame.push(value),
                Some(_) => {}
                None => return (found, Some(SkipReason::NotANumber)),
            }
        }
        // only a separator or line end shows that the last number is complete
        let ended = bytes.last().is_some_and(u8::is_ascii_whitespace);
        (found, (!ended).then_some(SkipReason::TruncatedNumber))
    }

    /// Ends the open frame, which is kept if complete and skipped otherwise.
    fn close(&mut self) {
        let Some(open) = self.open.take() else { return };
        let lines_per_frame = self.options.lines_per_frame;
        let lines = SkipReason::Lines { found: open.lines, wanted: lines_per_frame };
        let at = At::Line(open.start);
        let fault = if open.mark == Mark::None {
            Some((at, SkipReason::NoStart))
        } else {
            open.fault.or((open.lines != lines_per_frame).then_some((at, lines)))
        };
        if let Some((at, reason)) = fault {
            self.frame.clear();
            // a lost `s` merges frames: count them by their lines
            let frames = open
                .lines
                .checked_div(lines_per_frame)
                .map_or(1, |_| open.lines.div_ceil(lines_per_frame).max(1));
            self.skipped.add(frames, at, reason);
            return;
        }
        let whole = self.values.len().checked_div(self.options.size()).unwrap_or_default();
        if open.mark == Mark::Reference && self.reference.is_none() {
            self.reference = Some((open.start, whole));
        }
        for value in self.frame.drain(..) {
            let is_saturated = self.options.full_scale.is_some_and(|most| value >= most);
            self.quality.push(if is_saturated { Quality::SATURATED } else { Quality::GOOD });
            self.values.push(value);
        }
    }
}
