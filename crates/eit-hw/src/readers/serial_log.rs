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

use ndarray::Zip;

use super::files::file_bytes;
use super::{table, text};
use crate::error::{At, HwError, Place};
use crate::frame::Quality;
use crate::recording::{Format, Layout, Note, Recording, SkipReason, Skipped, Unit};

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

impl Default for SerialLogOptions {
    /// 16 lines of 13 values, full scale 6.55.
    fn default() -> Self {
        Self { lines_per_frame: 16, values_per_line: 13, full_scale: Some(6.55) }
    }
}

/// Reads a serial log.
///
/// # Errors
/// Those of [`parse`], and [`HwError::Read`] if the file cannot be read.
pub fn read(path: impl AsRef<Path>, options: &SerialLogOptions) -> Result<Recording, HwError> {
    let path = path.as_ref();
    parse(&file_bytes(path, Format::SerialLog.name())?, path, options)
}

/// Parses the content of a serial log; `path` is used in messages only.
///
/// The layout is [`Layout::ProtocolOrder`].
///
/// # Errors
/// [`HwError::Empty`], and [`HwError::NoFrames`] if no frame is complete.
pub fn parse(
    bytes: &[u8],
    path: impl AsRef<Path>,
    options: &SerialLogOptions,
) -> Result<Recording, HwError> {
    let path = path.as_ref();
    if bytes.is_empty() {
        return Err(HwError::Empty { place: Place::file(path) });
    }
    let mut log = Log::new(*options);
    for (bytes, line) in bytes.split_inclusive(|&byte| byte == b'\n').zip(1..) {
        log.line(bytes, line);
    }
    log.close();
    let count = options.lines_per_frame.saturating_mul(options.values_per_line);
    let real = table::frames(log.values, count, path, log.skipped.frames)?;
    let mut recording =
        Recording::new(real, None, Layout::ProtocolOrder, Unit::Arbitrary, Format::SerialLog, path);
    if let Some(full_scale) = options.full_scale {
        Zip::from(&mut recording.quality).and(&recording.real).for_each(|quality, &value| {
            if value >= full_scale {
                *quality |= Quality::SATURATED;
            }
        });
    }
    recording.skipped = log.skipped;
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
    /// Values of complete frames, followed by those of the open one.
    values: Vec<f64>,
    /// Number of values of the complete frames.
    whole: usize,
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
    fn new(options: SerialLogOptions) -> Self {
        Self {
            options,
            values: Vec::new(),
            whole: 0,
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
        let before = self.values.len();
        let (found, fault) = self.push_values(bytes);
        if fault.is_none() && found == lines_per_frame.saturating_mul(values_per_line) {
            // a complete frame in one line, whatever was open before
            let frame = self.values.split_off(before);
            self.start(line, Mark::Frame);
            self.values.extend(frame);
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
        if open.fault.is_some() {
            self.values.truncate(self.whole);
        }
    }

    /// Appends the numbers of a line; returns their count and what is wrong with them.
    fn push_values(&mut self, bytes: &[u8]) -> (usize, Option<SkipReason>) {
        let mut found = 0;
        for field in bytes.split(u8::is_ascii_whitespace).filter(|field| !field.is_empty()) {
            found += 1;
            let number = std::str::from_utf8(field).ok().and_then(|field| field.parse().ok());
            match number.filter(|value: &f64| value.is_finite()) {
                Some(value) => self.values.push(value),
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
        let SerialLogOptions { lines_per_frame, values_per_line, .. } = self.options;
        let lines = SkipReason::Lines { found: open.lines, wanted: lines_per_frame };
        let at = At::Line(open.start);
        let fault = if open.mark == Mark::None {
            Some((at, SkipReason::NoStart))
        } else {
            open.fault.or((open.lines != lines_per_frame).then_some((at, lines)))
        };
        if let Some((at, reason)) = fault {
            self.values.truncate(self.whole);
            // a lost `s` merges frames: count them by their lines
            let frames = open
                .lines
                .checked_div(lines_per_frame)
                .map_or(1, |_| open.lines.div_ceil(lines_per_frame).max(1));
            self.skipped.add(frames, at, reason);
            return;
        }
        let count = lines_per_frame.saturating_mul(values_per_line);
        if open.mark == Mark::Reference && self.reference.is_none() {
            self.reference = Some((open.start, self.whole / count.max(1)));
        }
        self.whole = self.values.len();
    }
}
