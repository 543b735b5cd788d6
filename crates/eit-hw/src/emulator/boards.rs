//! Emulated boards that send lines of numbers.

use std::time::Duration;

use super::device::{Device, Pace, ValueSource};
use crate::codec::text::Framing;
use crate::driver::Board;
use crate::frame::Quadruple;
use crate::recording::Layout;

/// A board that sends frames as its [`Board`] describes: by itself, or one per request.
pub struct BoardDevice {
    board: Board,
    source: ValueSource,
    frame_rate_hz: f64,
    quadruples: Vec<Quadruple>,
    values: Vec<f64>,
    pace: Option<Pace>,
    /// Number of frames requested.
    asked: u32,
    heard: String,
    sequence: u64,
}

impl std::fmt::Debug for BoardDevice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BoardDevice")
            .field("board", &self.board)
            .field("frame_rate_hz", &self.frame_rate_hz)
            .field("sequence", &self.sequence)
            .finish_non_exhaustive()
    }
}

impl BoardDevice {
    /// Creates a board that streams at this rate, or answers requests at once if it needs them.
    pub fn new(board: Board, frame_rate_hz: f64, source: ValueSource) -> Self {
        let quadruples = match &board.layout {
            Layout::Quadruples(quadruples) => quadruples.clone(),
            _ => Vec::new(),
        };
        let step = if board.format.complex { 2 } else { 1 };
        let values = vec![0.0; step * board.format.measurements()];
        Self {
            board,
            source,
            frame_rate_hz,
            quadruples,
            values,
            pace: None,
            asked: 0,
            heard: String::new(),
            sequence: 0,
        }
    }

    /// Appends the next frame as the board formats it.
    fn frame(&mut self, out: &mut Vec<u8>) {
        (self.source)(self.sequence, &self.quadruples, &mut self.values);
        self.sequence += 1;
        let format = &self.board.format;
        if let Framing::StartLine(mark) = &format.framing {
            out.extend(mark.bytes());
            out.extend(b"\n");
        }
        for line in self.values.chunks(format.values_per_line.max(1)) {
            if let Framing::Prefix(mark) = &format.framing {
                out.extend(mark.bytes());
                out.extend(if mark.starts_with('!') { b" ".iter() } else { b": ".iter() });
            }
            for value in line {
                out.extend(format.number.write(value / format.scale).bytes());
                // most boards end a line with a comma, but not those with one value per line
                out.extend(if format.values_per_line > 1 { b",".iter() } else { b"".iter() });
            }
            out.extend(b"\r\n");
        }
        if let Framing::EndLine(mark) = &format.framing {
            out.extend(mark.bytes());
            out.extend(b"\r\n");
        }
    }
}

impl Device for BoardDevice {
    fn receive(&mut self, bytes: &[u8], _: Duration, out: &mut Vec<u8>) {
        /// No board has a longer receive buffer.
        const MOST: usize = 256;
        self.heard.push_str(&String::from_utf8_lossy(bytes));
        for step in &self.board.steps {
            if let Some(at) = self.heard.find(&step.send) {
                self.heard.drain(..at + step.send.len());
                out.extend(step.expect.iter().flat_map(|text| text.bytes()));
                out.extend(b"\r\n");
            }
        }
        if let Some(request) = &self.board.request {
            while let Some(at) = self.heard.find(request.as_str()) {
                self.heard.drain(..at + request.len());
                self.asked = self.asked.saturating_add(1);
            }
        }
        if self.heard.len() > MOST {
            self.heard.clear();
        }
    }

    fn poll(&mut self, now: Duration, out: &mut Vec<u8>) {
        if self.board.request.is_some() {
            if self.asked > 0 {
                self.asked -= 1;
                self.frame(out);
            }
            return;
        }
        let rate = self.frame_rate_hz;
        while self.pace.get_or_insert_with(|| Pace::new(rate, now)).due(now).is_some() {
            self.frame(out);
        }
    }

    fn power_cycle(&mut self) {
        self.heard.clear();
        self.asked = 0;
        self.pace = None;
    }
}
