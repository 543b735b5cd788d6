//! Driver of boards that send lines of numbers: see [`codec::text`](crate::codec::text).

mod board;
mod listen;

pub use board::{Board, Step};
pub use listen::{Heard, listen};

use std::time::{Duration, Instant};

use super::decoded::{Decoded, RawFrame};
use super::interface::Driver;
use super::setup::{Identity, Limits, Setup};
use crate::codec::text::{Decoder, Event, Fault, Framing};
use crate::error::HwError;
use crate::readers::csv::Pairs;
use crate::recording::Note;
use crate::recording::hint::CountHint;
use crate::transport::Link;

/// Time limit for the answer to a set-up step.
const ANSWER_LIMIT: Duration = Duration::from_millis(1500);
const ATTEMPTS: u32 = 3;
/// Number of lines with the same count of numbers that shows what a board sends.
const ALIKE: usize = 2;
/// Number of lines whose counts are kept until the first frame.
const MOST_COUNTED: usize = 64;

impl Board {
    /// Creates the driver of this board.
    ///
    /// # Errors
    /// [`HwError::Setting`] if the format is invalid, its number of values differs from that of the
    /// layout, or `first_frame_s` is out of range.
    pub fn driver(self) -> Result<Box<dyn Driver>, HwError> {
        let count = self.format.measurements();
        let (found, name) = (self.layout.value_count(), "measurements of the layout");
        let found = found.unwrap_or(count);
        HwError::require(found == count, name, found, "as many as in a frame of the format")?;
        let patience_s = self.first_frame_s;
        let is_time = patience_s > 0.0 && patience_s <= 3600.0;
        HwError::require(is_time, "first_frame_s", patience_s, "above 0 and at most 3600")?;
        let decoder = Decoder::new(self.format.clone())?;
        Ok(Box::new(Text {
            board: self,
            decoder,
            asked: None,
            line_counts: Vec::new(),
            is_told: false,
        }))
    }
}

struct Text {
    board: Board,
    decoder: Decoder,
    /// Time of the open request.
    asked: Option<Instant>,
    /// Counts of numbers in the first complete lines that do not match the format.
    line_counts: Vec<usize>,
    /// Whether it was told what is left out of lines.
    is_told: bool,
}

impl Text {
    fn step(&mut self, link: &mut Link, step: &Step) -> Result<(), HwError> {
        let mut buffer = [0; 4096];
        for _ in 0..ATTEMPTS {
            link.write(step.send.as_bytes())?;
            let Some(expected) = &step.expect else { return Ok(()) };
            let sent = Instant::now();
            let mut seen = false;
            while sent.elapsed() < ANSWER_LIMIT {
                let received = link.read(&mut buffer)?;
                self.decoder.push(&buffer[..received], &mut |event| {
                    seen |= matches!(event, Event::Line(line) if line.contains(expected.as_str()));
                });
                if seen {
                    return Ok(());
                }
            }
        }
        Err(HwError::NoReply {
            endpoint: link.endpoint().to_string(),
            driver: "text",
            wanted: "answer to the set-up",
            waited_s: ANSWER_LIMIT.as_secs_f64() * f64::from(ATTEMPTS),
        })
    }

    /// Returns an error if several complete lines agree on another number of values.
    fn line_count(&mut self, link: &mut Link) -> Result<(), HwError> {
        self.line_counts.sort_unstable();
        let runs = self.line_counts.chunk_by(|one, other| one == other);
        let Some(run) = runs.max_by_key(|run| run.len()).filter(|run| run.len() >= ALIKE) else {
            return Ok(());
        };
        let format = &self.board.format;
        let (found, wanted) = (run[0], format.measurements());
        let lines = format.lines_per_frame.max(1);
        let step = if format.complex { 2 } else { 1 };
        let is_twice = found == 2 * format.values_per_line;
        let is_part = format.framing == Framing::Lines && found > 0 && found < wanted;
        let hint = if is_twice && has_decimal_commas(&link.recorded_input()) {
            CountHint::DecimalComma
        } else if is_part && wanted.is_multiple_of(found) {
            CountHint::PartOfFrame
        } else {
            CountHint::of(found * lines / step, 1, wanted, None)
        };
        Err(HwError::LineCount {
            endpoint: link.endpoint().to_string(),
            found,
            wanted,
            wanted_numbers: format.values_per_line,
            hint,
        })
    }

    fn first_frame(&mut self, link: &mut Link) -> Result<(), HwError> {
        let mut buffer = [0; 4096];
        let (start, mut whole) = (Instant::now(), false);
        while start.elapsed().as_secs_f64() < self.board.first_frame_s {
            self.idle(link)?;
            let received = link.read(&mut buffer)?;
            self.receive(&buffer[..received], &mut |decoded| {
                whole |= matches!(decoded, Decoded::Frame(_));
            });
            if whole {
                return Ok(());
            }
        }
        self.line_count(link)?;
        Err(HwError::NoReply {
            endpoint: link.endpoint().to_string(),
            driver: "text",
            wanted: "complete frame",
            waited_s: self.board.first_frame_s,
        })
    }
}

/// Returns whether the complete lines received are pairs of whole numbers, as decimal commas make them, or
/// numbers with commas between semicolons.
fn has_decimal_commas(received: &[u8]) -> bool {
    let text = String::from_utf8_lossy(received);
    // the first and the last line may be truncated
    let lines = text.trim_end_matches(|end| end != '\n').lines().skip(1);
    let is_number = |field: &str| {
        let is_comma = |c: char| c == ',' || c.is_ascii_digit() || "+-eE".contains(c);
        !field.is_empty() && field.matches(',').count() == 1 && field.chars().all(is_comma)
    };
    let between = |line: &str| {
        line.contains(';')
            && line.trim().trim_end_matches(';').split(';').map(str::trim).all(is_number)
    };
    if lines.clone().next().is_some() && lines.clone().all(between) {
        return true;
    }
    let pairs = lines.map(|line| Pairs::of(line.trim().trim_end_matches(',')));
    pairs.fold(Pairs::Possible, |all, one| match (all, one) {
        (Pairs::No, _) | (_, Pairs::No) => Pairs::No,
        (Pairs::Likely, _) => Pairs::Likely,
        (Pairs::Possible, one) => one,
    }) == Pairs::Likely
}

impl Driver for Text {
    fn name(&self) -> &'static str {
        "text"
    }

    fn connect(&mut self, link: &mut Link) -> Result<Setup, HwError> {
        self.decoder.reset(false);
        self.asked = None;
        self.line_counts.clear();
        // a board that streams by itself never falls silent
        link.drain(Duration::from_millis(100), Duration::from_millis(300))?;
        for step in self.board.steps.clone() {
            self.step(link, &step)?;
        }
        self.first_frame(link)?;
        let format = &self.board.format;
        Ok(Setup {
            identity: Identity {
                driver: "text",
                name: self.board.name.clone(),
                serial: String::new(),
            },
            layout: self.board.layout.clone(),
            value_count: format.measurements(),
            complex: format.complex,
            unit: self.board.unit,
            frame_rate_hz: None,
            // the decoder applies the format's own limits
            limits: Limits { stuck_frames: Some(64), ..Limits::default() },
        })
    }

    fn start(&mut self, _: &mut Link) -> Result<(), HwError> {
        Ok(())
    }

    fn receive(&mut self, bytes: &[u8], on_decoded: &mut dyn FnMut(Decoded<'_>)) {
        let (asked, counts) = (&mut self.asked, &mut self.line_counts);
        self.decoder.push(bytes, &mut |event| match event {
            Event::Frame { values, imaginary, quality } => {
                *asked = None;
                let (counter, device_time_s) = (None, None);
                on_decoded(Decoded::Frame(RawFrame {
                    values,
                    imaginary,
                    quality,
                    counter,
                    device_time_s,
                }));
            }
            Event::Skipped(fault) => {
                *asked = None;
                if let Fault::Values { found, .. } = fault
                    && counts.len() < MOST_COUNTED
                {
                    counts.push(found);
                }
                on_decoded(Decoded::TruncatedFrame);
            }
            // rows of numbers outside a frame are the rest of a truncated one
            Event::Line(line)
                if line.starts_with(|c: char| c.is_ascii_alphabetic() || c == '!') =>
            {
                on_decoded(Decoded::Notice(line));
            }
            Event::Line(line) => on_decoded(Decoded::Damaged { bytes: line.len() as u64 }),
        });
        if !self.is_told
            && let Some(what) = self.decoder.stripped()
        {
            self.is_told = true;
            on_decoded(Decoded::Notice(&Note::Stripped { what }.to_string()));
        }
    }

    fn idle(&mut self, link: &mut Link) -> Result<(), HwError> {
        let Some(request) = &self.board.request else { return Ok(()) };
        let patience = Duration::from_secs_f64(self.board.first_frame_s / 2.0);
        if self.asked.is_some_and(|asked| asked.elapsed() < patience) {
            return Ok(());
        }
        // a late answer to the previous request would look like the start of a frame
        if self.asked.is_some() {
            link.drain(Duration::from_millis(50), Duration::from_millis(500))?;
        }
        self.decoder.reset(true);
        self.asked = Some(Instant::now());
        link.write(request.as_bytes())
    }

    fn stop(&mut self, _: &mut Link) -> Result<(), HwError> {
        // none of the boards has a stop command
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::has_decimal_commas;

    #[test]
    fn decimal_commas_of_a_board() {
        assert!(has_decimal_commas(b"12,0,51\r\n0,51,0,52\r\n1,02,0,50\r\n0,"));
        assert!(has_decimal_commas(b"12;0,51\r\n0,512345;-0,52;\r\n1,02; 1,5e-3\r\n0,"));
        for text in ["9\n0,51;0.52\n", "9\n1,2;3,4;5,6,7\n", "9\n0,51;a,52\n", "9\n1;2;3\n"] {
            assert!(!has_decimal_commas(text.as_bytes()), "{text:?}");
        }
        // whole numbers, a sign, points, nothing complete
        for text in ["9\n1,2,3,4\n", "9\n0,51,0,-52\n", "9\n0.51,0.52\n", "0,51,0,52\n", ""] {
            assert!(!has_decimal_commas(text.as_bytes()), "{text:?}");
        }
    }
}
