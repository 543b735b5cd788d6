//! Decodes lines of text to frames.

use super::event::{Event, Fault, Values};
use super::format::{Framing, MAX_LINE_BYTES, TextFormat};
use super::line::{self, Stripped};
use super::number::Number;
use crate::error::HwError;

/// Number of pushes without bytes that are a pause.
pub(crate) const PAUSES: usize = 2;
/// Number of frames of several lines in a row, with as many lines, from which on they are passed on.
const ALIKE: usize = 3;

/// Decodes lines of numbers.
///
/// Frames without marks are lines, or the lines between two empty ones, or between two pauses: [`push`](Self::push) with no bytes,
/// twice. A frame of several lines is known to be whole once the next empty line or pause has come, and is only passed on if three
/// had as many lines and no line was a frame: two lines of half the length are none.
///
/// ```
/// use eit_hw::codec::text::{Decoder, Event, TextFormat};
/// let format = TextFormat { values_per_line: 3, ..TextFormat::default() };
/// let mut frames = Vec::new();
/// Decoder::new(format)?.push(b"5,6\n1,2.5,-3\r\n4,", &mut |event| {
///     if let Event::Frame { values, .. } = event {
///         frames.push(values.to_vec());
///     }
/// });
/// assert_eq!(frames, [[1.0, 2.5, -3.0]]);
/// # Ok::<(), eit_hw::HwError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Decoder {
    format: TextFormat,
    line: Vec<u8>,
    line_is: Line,
    /// Whether the last line ended with a carriage return, of which a line feed is a part.
    after_return: bool,
    /// Whether an empty line or a pause stands before the next line, so that a frame of several lines may start.
    may_start: bool,
    /// Number of pushes without bytes since the last byte.
    pauses: usize,
    /// Whether a line was a frame.
    is_single: bool,
    /// Number of lines of the last frame of several lines, and of frames with as many in a row.
    alike: [usize; 2],
    /// Number of lines in the open frame; `None` between frames.
    lines: Option<usize>,
    fault: Option<Fault>,
    /// Numbers of the open frame.
    numbers: Vec<f64>,
    values: Values,
    /// First number of the last line with one more than wanted.
    counter: Option<f64>,
    /// What was stripped from lines so far.
    stripped: Stripped,
}

/// How much of a line was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Line {
    Whole,
    TruncatedStart,
    TooLong,
}

impl Decoder {
    /// Creates a decoder; the bytes may start in the middle of a line or frame.
    ///
    /// # Errors
    /// [`HwError::Setting`] if the format is inconsistent.
    pub fn new(format: TextFormat) -> Result<Self, HwError> {
        format.validate()?;
        Ok(Self {
            line: Vec::with_capacity(1024),
            line_is: Line::TruncatedStart,
            after_return: false,
            may_start: false,
            pauses: 0,
            is_single: false,
            alike: [0; 2],
            lines: None,
            fault: None,
            numbers: Vec::with_capacity(format.numbers() + 1),
            values: Values::new(&format),
            counter: None,
            stripped: Stripped::default(),
            format,
        })
    }

    /// Names what stands around the numbers of lines and was left out; `None` if nothing was.
    pub fn stripped(&self) -> Option<String> {
        self.stripped.words()
    }

    /// Returns the format that lines are decoded with.
    pub fn format(&self) -> &TextFormat {
        &self.format
    }

    /// Discards an incomplete line and frame. With `at_frame_start`, the next byte starts a line
    /// and a frame, as after a request sent to a silent board.
    pub fn reset(&mut self, at_frame_start: bool) {
        self.line.clear();
        self.line_is = if at_frame_start { Line::Whole } else { Line::TruncatedStart };
        (self.after_return, self.may_start, self.is_single) = (false, false, false);
        (self.pauses, self.alike) = (0, [0; 2]);
        let open = at_frame_start && matches!(self.format.framing, Framing::EndLine(_));
        self.lines = open.then_some(0);
        self.fault = None;
        self.numbers.clear();
    }

    /// Decodes bytes as they arrive and calls `on_event` for each completed frame. No bytes: nothing arrived for a while.
    pub fn push(&mut self, bytes: &[u8], on_event: &mut impl FnMut(Event<'_>)) {
        self.pauses = if bytes.is_empty() { self.pauses.saturating_add(1) } else { 0 };
        if self.pauses == PAUSES && self.line.is_empty() {
            self.between_frames(on_event);
        }
        for &byte in bytes {
            let after_return = std::mem::replace(&mut self.after_return, byte == b'\r');
            if byte == b'\n' && after_return {
                continue;
            }
            if byte != b'\n' && byte != b'\r' {
                if self.line.len() < MAX_LINE_BYTES {
                    self.line.push(byte);
                } else {
                    self.line_is = Line::TooLong;
                }
                continue;
            }
            let line = std::mem::take(&mut self.line);
            self.take(line.trim_ascii(), on_event);
            self.line = line;
            self.line.clear();
            self.line_is = Line::Whole;
        }
    }

    /// Takes a line by the framing of the format.
    fn take(&mut self, line: &[u8], on_event: &mut impl FnMut(Event<'_>)) {
        let cut = match self.line_is {
            Line::Whole => None,
            Line::TruncatedStart => Some(Fault::TruncatedStart),
            Line::TooLong => Some(Fault::TooLong),
        };
        if line.is_empty() {
            return self.between_frames(on_event);
        }
        let is = |mark: &String| cut.is_none() && line == mark.as_bytes();
        // the framing is moved out while the frame is worked on
        let framing = std::mem::replace(&mut self.format.framing, Framing::Lines);
        match &framing {
            Framing::Lines => self.line_of_frame(line, cut, on_event),
            Framing::StartLine(mark) if is(mark) => self.open(on_event),
            Framing::EndLine(mark) if is(mark) => {
                self.close(on_event);
                self.open(on_event);
            }
            Framing::Prefix(mark) if cut.is_none() && line.starts_with(mark.as_bytes()) => {
                self.open(on_event);
                let rest = &line[mark.len()..];
                let colon = rest.iter().position(|&byte| byte == b':').map_or(0, |at| at + 1);
                self.numbers(&rest[colon..], None, on_event);
                self.close_if_whole(on_event);
            }
            _ if self.lines.is_some() => {
                self.numbers(line, cut, on_event);
                // with an end line, only that line ends a frame
                if !matches!(framing, Framing::EndLine(_)) {
                    self.close_if_whole(on_event);
                }
            }
            _ => Self::tell_line(line, on_event),
        }
        self.format.framing = framing;
    }

    /// Takes a line that is a frame, or a part of one whose start is known.
    fn line_of_frame(
        &mut self,
        line: &[u8],
        cut: Option<Fault>,
        on_event: &mut impl FnMut(Event<'_>),
    ) {
        let may_start = std::mem::take(&mut self.may_start);
        if self.lines.is_none() {
            self.open(on_event);
        }
        let before = self.numbers.len();
        self.numbers(line, cut, on_event);
        match self.fault {
            Some(Fault::Values { found, wanted })
                if !self.is_single && (may_start || before > 0) && before + found <= wanted =>
            {
                self.fault = None;
            }
            None if before > 0 => {
                // a whole frame after a part of one
                let wanted = self.format.values_per_line;
                on_event(Event::Skipped(Fault::Values { found: before, wanted }));
                self.numbers.clear();
                (self.lines, self.is_single) = (Some(0), true);
                self.numbers(line, cut, on_event);
                self.close(on_event);
            }
            _ => {
                self.is_single |= self.fault.is_none();
                self.close(on_event);
            }
        }
    }

    /// Ends a frame of several lines; the next line may start one.
    fn between_frames(&mut self, on_event: &mut impl FnMut(Event<'_>)) {
        if self.format.framing != Framing::Lines {
            return;
        }
        self.may_start = true;
        let Some(lines) = self.lines.replace(1).filter(|lines| *lines > 0) else {
            self.lines = None;
            return;
        };
        let wanted = self.format.numbers();
        let fault = Fault::Values { found: self.numbers.len() / lines, wanted };
        self.fault = self.fault.or((self.numbers.len() != wanted).then_some(fault));
        if self.fault.is_none() {
            let [last, count] = self.alike;
            self.alike = [lines, if last == lines { count.saturating_add(1) } else { 1 }];
            if self.alike[1] < ALIKE {
                self.lines = None;
                return;
            }
        }
        self.close(on_event);
    }

    /// Passes on a line outside frames.
    fn tell_line(line: &[u8], on_event: &mut impl FnMut(Event<'_>)) {
        const MOST: usize = 200;
        let text: String = String::from_utf8_lossy(&line[..line.len().min(MOST)])
            .chars()
            .map(|c| if c.is_control() { '?' } else { c })
            .collect();
        on_event(Event::Line(&text));
    }

    /// Starts a frame; one still open is incomplete and closed first.
    fn open(&mut self, on_event: &mut impl FnMut(Event<'_>)) {
        if self.lines.is_some_and(|lines| lines > 0) {
            self.close(on_event);
        }
        self.lines = Some(0);
        self.fault = None;
        self.numbers.clear();
    }

    /// Adds the numbers of a line to the open frame.
    fn numbers(&mut self, line: &[u8], cut: Option<Fault>, on_event: &mut impl FnMut(Event<'_>)) {
        let (before, wanted) = (self.numbers.len(), self.format.values_per_line);
        let (mut found, fault) = self.parse(line, before + wanted + 1);
        let fault = cut.or(fault);
        // one more in front, which grows: numbers or times of frames
        if found == wanted + 1
            && self.format.lines_per_frame == 1
            && let Some(&first) = self.numbers.get(before)
            && self.counter.replace(first).is_some_and(|last| first > last)
        {
            self.numbers.remove(before);
            found = wanted;
            self.stripped = self.stripped.or(Stripped::LABEL);
        }
        self.numbers.truncate(self.format.numbers().min(before + wanted));
        // a banner between frames that end with a mark
        if before == 0
            && self.lines == Some(0)
            && matches!(fault, Some(Fault::NotANumber { field: 0 }))
        {
            self.numbers.clear();
            return Self::tell_line(line, on_event);
        }
        let fault = fault.or((found != wanted).then_some(Fault::Values { found, wanted }));
        self.fault = self.fault.or(fault);
        self.lines = self.lines.map(|lines| lines.saturating_add(1));
    }

    /// Reads the numbers of a line, of which at most as many are kept that there are `most` of the frame; returns how
    /// many were found, and the first field that is none.
    fn parse(&mut self, line: &[u8], most: usize) -> (usize, Option<Fault>) {
        let (mut found, mut fault) = (0, None);
        let numbers = &mut self.numbers;
        let mut take = |number: f64| {
            found += 1;
            if numbers.len() < most {
                numbers.push(number);
            }
        };
        if self.format.number == Number::Decimal {
            let text = String::from_utf8_lossy(line);
            match line::numbers(&text, take) {
                Ok(stripped) => self.stripped = self.stripped.or(stripped),
                Err(wrong) => fault = fault.or(Some(Fault::NotANumber { field: wrong.field })),
            }
        } else {
            let separator = |byte: &u8| matches!(byte, b',' | b';' | b'\t' | b' ');
            let fields = line.split(separator).filter(|field| !field.is_empty());
            for (index, field) in fields.enumerate() {
                // the frame is whole: this value is missing
                let missing = || Number::is_not_finite(field).then_some(f64::NAN);
                match self.format.number.parse(field).or_else(missing) {
                    Some(number) => take(number),
                    None => fault = fault.or(Some(Fault::NotANumber { field: index })),
                }
            }
        }
        (found, fault)
    }

    /// Ends a frame that is faulty or has all of its lines.
    fn close_if_whole(&mut self, on_event: &mut impl FnMut(Event<'_>)) {
        if self.fault.is_some() || self.lines == Some(self.format.lines_per_frame) {
            self.close(on_event);
        }
    }

    /// Ends a frame, and passes it on or says why not.
    fn close(&mut self, on_event: &mut impl FnMut(Event<'_>)) {
        let Some(found) = self.lines.take() else { return };
        let wanted = self.format.lines_per_frame;
        if found == 0 {
            return;
        }
        let fault = self.fault.or((found != wanted).then_some(Fault::Lines { found, wanted }));
        if let Some(fault) = fault {
            return on_event(Event::Skipped(fault));
        }
        self.values.set(&self.format, &self.numbers);
        on_event(self.values.event());
    }
}
