//! What a board prints, before anything is known of it.

use std::time::{Duration, Instant};

use crate::codec::text::{MAX_LINE_BYTES, MAX_VALUES, Number};
use crate::error::HwError;
use crate::transport::{Endpoint, Link};

/// Frames that are kept; 64 of 16 384 values are 8 MB.
const MOST_FRAMES: usize = 64;
/// Characters of a line that is no frame.
const SAMPLE: usize = 80;
/// Fewest numbers of a line that may be a frame: four electrodes give four.
const FEWEST_VALUES: usize = 4;

/// What a port printed while it was listened to.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heard {
    /// Numbers of a line, the count that came most often; 0 where no line held numbers alone.
    pub values: usize,
    /// The last lines of that count, up to 64, in the order that they came.
    pub frames: Vec<Vec<f64>>,
    /// How many lines had that count.
    pub frame_lines: usize,
    /// Whole lines that had another count or were not numbers alone.
    pub other_lines: usize,
    /// The last of those, its first 80 characters, without control characters.
    pub other_line: Option<String>,
    /// Frames a second between the first and the last of them; `None` for fewer than three.
    pub rate_hz: Option<f64>,
    /// Bytes that came.
    pub bytes: u64,
    /// Of those, the share that no text holds, 0 to 1: much of it is a binary protocol or a wrong baud rate.
    pub binary_share: f64,
}

impl Heard {
    /// Smallest step between two values of the same column, `None` where none ever changed: the
    /// converter's resolution, or less.
    pub fn step(&self) -> Option<f64> {
        let changes = self.frames.windows(2).flat_map(|pair| {
            pair[0].iter().zip(&pair[1]).map(|(before, after)| (after - before).abs())
        });
        changes.filter(|change| *change > 0.0).min_by(f64::total_cmp)
    }
}

/// Listens to a port for `duration` and counts the numbers of each line. Sends nothing.
///
/// Fields are split at commas, semicolons, tabs and blanks, as by
/// [`Decoder`](crate::codec::text::Decoder). The first line is passed over: its start may be cut.
///
/// # Errors
/// [`HwError::Open`] where the port cannot be opened, [`HwError::Lost`] where it goes away.
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

/// Lines so far.
#[derive(Default)]
struct Lines {
    line: Vec<u8>,
    /// The first line's start may be cut.
    is_whole: bool,
    /// Lines of numbers and when they ended, seconds; the last [`MOST_FRAMES`].
    numbers: Vec<Vec<f64>>,
    /// For each count of numbers: lines, and when the first and the last of them ended.
    counts: std::collections::BTreeMap<usize, (usize, f64, f64)>,
    lines: usize,
    other: Option<String>,
    bytes: u64,
    binary: u64,
}

impl Lines {
    fn push(&mut self, bytes: &[u8], time_s: f64) {
        self.bytes += bytes.len() as u64;
        for &byte in bytes {
            match byte {
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
            return;
        }
        self.lines += 1;
        let separator = |byte: &u8| matches!(byte, b',' | b';' | b'\t' | b' ');
        let fields = line.split(separator).filter(|field| !field.is_empty());
        let numbers: Option<Vec<f64>> =
            fields.take(MAX_VALUES + 1).map(|field| Number::Decimal.parse(field)).collect();
        let fits = |numbers: &Vec<f64>| (FEWEST_VALUES..=MAX_VALUES).contains(&numbers.len());
        let Some(numbers) = numbers.filter(fits) else {
            let text = String::from_utf8_lossy(&line[..line.len().min(4 * SAMPLE)]);
            let printable = |c: char| if c.is_ascii_graphic() || c == ' ' { c } else { '?' };
            self.other = Some(text.chars().take(SAMPLE).map(printable).collect());
            return;
        };
        let count = self.counts.entry(numbers.len()).or_insert((0, time_s, time_s));
        *count = (count.0 + 1, count.1, time_s);
        if self.numbers.len() == MOST_FRAMES {
            self.numbers.remove(0);
        }
        self.numbers.push(numbers);
    }

    fn heard(mut self) -> Heard {
        let most = self.counts.iter().max_by_key(|(_, (lines, ..))| *lines);
        let (values, (frame_lines, first_s, last_s)) =
            most.map_or((0, (0, 0.0, 0.0)), |(values, count)| (*values, *count));
        self.numbers.retain(|numbers| numbers.len() == values);
        let span_s = last_s - first_s;
        let rate_hz = (frame_lines >= 3 && span_s > 0.0).then(|| (frame_lines - 1) as f64 / span_s);
        Heard {
            values,
            frames: self.numbers,
            frame_lines,
            other_lines: self.lines - frame_lines,
            other_line: self.other,
            rate_hz,
            bytes: self.bytes,
            binary_share: self.binary as f64 / self.bytes.max(1) as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(text: &[u8]) -> Heard {
        let mut lines = Lines::default();
        // one byte at a time, a line of four numbers every half second
        for (at, byte) in text.iter().enumerate() {
            lines.push(&[*byte], at as f64);
        }
        lines.heard()
    }

    #[test]
    fn the_count_that_comes_most_often_is_the_frame() {
        let found = heard(b"9,9\nhello\n1,2,3,4\n1;2;3.5;4\r\n1 2 3,4,\n1,2,3\n5\t6\t7\t8");
        assert_eq!(found.values, 4);
        assert_eq!(
            found.frames,
            [[1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 3.5, 4.0], [1.0, 2.0, 3.0, 4.0]]
        );
        assert_eq!((found.frame_lines, found.other_lines), (3, 2));
        assert_eq!(found.step(), Some(0.5));
        assert_eq!(found.other_line.as_deref(), Some("1,2,3"));
        // 21 bytes from the end of the first of them to that of the last: two frames
        assert!((found.rate_hz.unwrap() - 2.0 / 20.0).abs() < 1e-12, "{:?}", found.rate_hz);
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
