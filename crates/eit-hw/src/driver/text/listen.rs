//! Listens to a board of which nothing is known yet.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::codec::text::line::{self, Stripped};
use crate::codec::text::{MAX_LINE_BYTES, MAX_VALUES, PAUSES};
use crate::error::HwError;
use crate::transport::{Endpoint, Link};

/// Maximum number of frames kept; 64 of 16 384 values are 8 MB.
const MOST_FRAMES: usize = 64;
/// Number of characters kept of a line that is not a frame.
const SAMPLE: usize = 80;
/// Minimum number of values of a line that may be a frame: four electrodes give four.
const FEWEST_VALUES: usize = 4;
/// Number of equal blocks of lines that are frames of several lines.
const LEAST_BLOCKS: usize = 3;
/// Number of lines whose first number grows by chance once in 40 000.
const LEAST_COUNTED: usize = 8;

/// What was received from a port while listening.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct Heard {
    /// Most frequent count of numbers per line; 0 if no line consisted of numbers only.
    pub values: usize,
    /// The last lines with that count, at most 64, in order of arrival.
    pub frames: Vec<Vec<f64>>,
    /// Number of lines with that count.
    pub frame_lines: usize,
    /// What lines are if they are parts of frames: as many lines, with as many numbers, stand between empty lines or pauses. Whole
    /// frames may arrive so, too, from a busy computer.
    pub joined: Option<Box<Self>>,
    /// Number of complete lines with another count or with anything but numbers.
    pub other_lines: usize,
    /// First 80 characters of the last line that was not a plain row of numbers, with `?` for
    /// control characters.
    pub other_line: Option<String>,
    /// Frames per second between the first and the last frame; `None` for fewer than three frames.
    pub rate_hz: Option<f64>,
    /// What stands around the numbers of lines and was left out; `None` if nothing was.
    pub stripped: Option<String>,
    /// Number of bytes received.
    pub bytes: u64,
    /// Fraction of bytes that are not text, 0 to 1; a high value means a binary protocol or a wrong
    /// baud rate.
    pub binary_share: f64,
}

impl Heard {
    /// Returns the smallest change between consecutive values of a column: the converter's
    /// resolution or less. `None` if no value changed.
    pub fn step(&self) -> Option<f64> {
        let changes = self.frames.windows(2).flat_map(|pair| {
            pair[0].iter().zip(&pair[1]).map(|(before, after)| (after - before).abs())
        });
        changes.filter(|change| *change > 0.0).min_by(f64::total_cmp)
    }
}

/// Listens to a port for `duration` and counts the numbers in each line. Sends nothing.
///
/// Fields are separated by commas, semicolons, tabs and spaces, as in
/// [`Decoder`](crate::codec::text::Decoder). The first line is skipped, since its start may be
/// missing.
///
/// # Errors
/// [`HwError::Open`] if the port cannot be opened, [`HwError::Lost`] if the connection is lost.
pub fn listen(endpoint: &Endpoint, duration: Duration) -> Result<Heard, HwError> {
    let mut link = Link::open(endpoint)?;
    let mut lines = Lines::default();
    let (start, mut buffer) = (Instant::now(), [0; 4096]);
    while start.elapsed() < duration {
        let received = link.read(&mut buffer)?;
        lines.push(&buffer[..received], start.elapsed().as_secs_f64());
    }
    Ok(lines.heard())
}

/// Accumulates received lines.
#[derive(Default)]
struct Lines {
    line: Vec<u8>,
    after_return: bool,
    pauses: usize,
    /// Lines since the last empty line or pause: their numbers, and how many they are; `None` before the first.
    block: Option<(Vec<f64>, usize)>,
    /// The last [`MOST_FRAMES`] blocks of several lines.
    blocks: Vec<(Vec<f64>, usize)>,
    /// Per size of such a block in lines and numbers: their number, and when the first and the last of them ended, in seconds.
    block_counts: BTreeMap<(usize, usize), (usize, f64, f64)>,
    /// Whether the current line is known to be complete; the start of the first may be missing.
    is_whole: bool,
    /// The last [`MOST_FRAMES`] lines of numbers.
    numbers: Vec<Vec<f64>>,
    /// Per count of numbers: number of lines, and when the first and the last of them ended, in
    /// seconds.
    counts: BTreeMap<usize, (usize, f64, f64)>,
    lines: usize,
    stripped: Stripped,
    other: Option<String>,
    bytes: u64,
    binary: u64,
}

impl Lines {
    fn push(&mut self, bytes: &[u8], time_s: f64) {
        self.bytes += bytes.len() as u64;
        self.pauses = if bytes.is_empty() { self.pauses + 1 } else { 0 };
        if self.pauses == PAUSES && self.line.is_empty() {
            self.end_block(time_s);
        }
        for &byte in bytes {
            let after_return = std::mem::replace(&mut self.after_return, byte == b'\r');
            match byte {
                b'\n' if after_return => {}
                b'\n' | b'\r' => {
                    let line = std::mem::take(&mut self.line);
                    if self.is_whole {
                        self.take(line.trim_ascii(), time_s);
                    }
                    self.is_whole = true;
                }
                byte => {
                    let is_text = byte == b'\t' || (b' '..=b'~').contains(&byte);
                    self.binary += u64::from(!is_text);
                    if self.line.len() < MAX_LINE_BYTES {
                        self.line.push(byte);
                    }
                }
            }
        }
    }

    fn take(&mut self, line: &[u8], time_s: f64) {
        if line.is_empty() {
            return self.end_block(time_s);
        }
        self.lines += 1;
        let mut numbers = Vec::new();
        let text = String::from_utf8_lossy(line);
        let read = line::numbers(&text, |value| numbers.push(value));
        let is_known = numbers.iter().all(|value| value.is_finite());
        let read = read.ok().filter(|_| is_known && !numbers.is_empty());
        if let (Some((block, lines)), true) = (&mut self.block, read.is_some()) {
            let room = MAX_VALUES.saturating_sub(block.len());
            block.extend(numbers.iter().take(room));
            *lines += 1;
        }
        let fits = (FEWEST_VALUES..=MAX_VALUES).contains(&numbers.len());
        let Some(stripped) = read.filter(|_| fits) else {
            let text = String::from_utf8_lossy(&line[..line.len().min(4 * SAMPLE)]);
            let printable = |c: char| if c.is_ascii_graphic() || c == ' ' { c } else { '?' };
            self.other = Some(text.chars().take(SAMPLE).map(printable).collect());
            return;
        };
        self.stripped = self.stripped.or(stripped);
        let count = self.counts.entry(numbers.len()).or_insert((0, time_s, time_s));
        *count = (count.0 + 1, count.1, time_s);
        if self.numbers.len() == MOST_FRAMES {
            self.numbers.remove(0);
        }
        self.numbers.push(numbers);
    }

    /// Ends a block of lines at an empty line or a pause.
    fn end_block(&mut self, time_s: f64) {
        let block = self.block.replace((Vec::new(), 0));
        let Some((numbers, lines)) = block.filter(|(_, lines)| *lines > 1) else { return };
        let count = self.block_counts.entry((lines, numbers.len())).or_insert((0, time_s, time_s));
        *count = (count.0 + 1, count.1, time_s);
        if self.blocks.len() == MOST_FRAMES {
            self.blocks.remove(0);
        }
        self.blocks.push((numbers, lines));
    }

    /// Frames of several lines, if that is what most lines are parts of.
    fn of_several_lines(&mut self) -> Option<Heard> {
        let (&(lines_per_frame, values), &(count, first_s, last_s)) =
            self.block_counts.iter().max_by_key(|(_, (count, ..))| *count)?;
        let frame_lines = count * lines_per_frame;
        if count < LEAST_BLOCKS || values < FEWEST_VALUES || 2 * frame_lines < self.lines {
            return None;
        }
        self.blocks.retain(|(numbers, lines)| (numbers.len(), *lines) == (values, lines_per_frame));
        let frames = std::mem::take(&mut self.blocks);
        let rate_hz = (last_s > first_s).then(|| (count - 1) as f64 / (last_s - first_s));
        let frames = frames.into_iter().map(|(numbers, _)| numbers).collect();
        Some(Heard { values, frames, frame_lines, rate_hz, ..Heard::default() })
    }

    /// Drops a first column of whole numbers that grow from line to line.
    fn drop_counter(&mut self) -> bool {
        let first: Vec<f64> = self.numbers.iter().map(|numbers| numbers[0]).collect();
        let is_next = |pair: &[f64]| pair[1] > pair[0] && pair[1].fract() == 0.0;
        let is_counter = first.len() >= LEAST_COUNTED && first.windows(2).all(is_next);
        if is_counter {
            self.numbers.iter_mut().for_each(|numbers| _ = numbers.remove(0));
            self.stripped = self.stripped.or(Stripped::LABEL);
        }
        is_counter
    }

    fn heard(mut self) -> Heard {
        let joined = self.of_several_lines();
        let joined = joined.map(|frames| Box::new(self.with_rest(frames)));
        let most = self.counts.iter().max_by_key(|(_, (lines, ..))| *lines);
        let (values, (frame_lines, first_s, last_s)) =
            most.map_or((0, (0, 0.0, 0.0)), |(values, count)| (*values, *count));
        self.numbers.retain(|numbers| numbers.len() == values);
        let values = values - usize::from(self.drop_counter());
        let span_s = last_s - first_s;
        let rate_hz = (frame_lines >= 3 && span_s > 0.0).then(|| (frame_lines - 1) as f64 / span_s);
        let frames = std::mem::take(&mut self.numbers);
        self.with_rest(Heard { values, frames, frame_lines, joined, rate_hz, ..Heard::default() })
    }

    /// Adds what stood around and between the lines of frames.
    fn with_rest(&self, heard: Heard) -> Heard {
        let other_lines = self.lines.saturating_sub(heard.frame_lines);
        Heard {
            other_lines,
            other_line: self.other.clone().filter(|_| other_lines > 0),
            stripped: self.stripped.words(),
            bytes: self.bytes,
            binary_share: self.binary as f64 / self.bytes.max(1) as f64,
            ..heard
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(text: &[u8]) -> Heard {
        let mut lines = Lines::default();
        // one byte at a time, one per second
        for (at, byte) in text.iter().enumerate() {
            lines.push(&[*byte], at as f64);
        }
        lines.heard()
    }

    #[test]
    fn the_count_that_comes_most_often_is_the_frame() {
        let found = heard(b"9,9\nhello\n1,2,3,4\n1;2;3.5;4\r\n1 2, 3, 4,\n1,2,3\n5\t6\t7\t8");
        assert_eq!(found.values, 4);
        assert_eq!(
            found.frames,
            [[1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.5, 4.0], [1.0, 2.0, 3.0, 4.0]]
        );
        assert_eq!((found.frame_lines, found.other_lines), (3, 2));
        assert_eq!(found.step(), Some(0.5));
        assert_eq!(found.other_line.as_deref(), Some("1,2,3"));
        // 22 s from the end of the first frame to that of the last: two frame periods
        assert!((found.rate_hz.unwrap() - 2.0 / 22.0).abs() < 1e-12, "{:?}", found.rate_hz);
    }

    /// Frames of several lines, down to one value each, are those between empty lines or pauses.
    #[test]
    fn lines_between_pauses_are_frames() {
        for (text, lines) in [("1,2\r\n3,4\r\n5,6\r\n", 3), ("1\n2\n3\n4\n5\n6\n", 6)] {
            for pause in [&b"\r\n"[..], b""] {
                let mut received = Lines::default();
                for frame in 0..5 {
                    // the first is cut
                    let text = if frame == 0 { &text[2..] } else { text };
                    received.push(text.as_bytes(), f64::from(frame));
                    (0..PAUSES).for_each(|_| received.push(pause, f64::from(frame)));
                }
                let found = *received.heard().joined.unwrap();
                assert_eq!(found.values, 6);
                assert_eq!(found.frames, vec![[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]; 4]);
                assert_eq!((found.frame_lines, found.rate_hz), (4 * lines, Some(1.0)));
            }
        }
        // without pauses
        assert_eq!(heard(b"9\n1,2,3,4\n1,2,3,5\n1,2,3,6\n").joined, None);
    }

    #[test]
    fn noise_and_silence_are_no_frames() {
        assert_eq!(heard(b""), Heard::default());
        let garbage: Vec<u8> = (0..4000_u32).map(|i| (i * 7919 % 251) as u8).collect();
        let found = heard(&garbage);
        assert_eq!((found.values, found.frames.len()), (0, 0));
        assert!(found.binary_share > 0.5, "{}", found.binary_share);
        let not_finite = heard(b"x\n1,2,inf,4\n1,2,nan,4\n");
        assert_eq!((not_finite.values, not_finite.other_lines), (0, 2));
    }
}
