//! A serial line with limited speed.

use std::collections::VecDeque;
use std::time::Duration;

/// Bits per byte on the line.
const BITS: f64 = 10.0;

/// One direction of a line, with the bytes in transit.
#[derive(Debug)]
pub(super) struct Line {
    /// Bytes per second; `None` for immediate transfer.
    rate: Option<f64>,
    waiting: VecDeque<u8>,
    /// Time until which the line is in use.
    busy_until: Duration,
}

impl Line {
    pub(super) fn new(baud: Option<u32>) -> Self {
        let rate = baud.map(|baud| f64::from(baud.max(1)) / BITS);
        Self { rate, waiting: VecDeque::new(), busy_until: Duration::ZERO }
    }

    pub(super) fn waiting(&self) -> usize {
        self.waiting.len()
    }

    pub(super) fn clear(&mut self) {
        self.waiting.clear();
    }

    pub(super) fn push(&mut self, bytes: &[u8], now: Duration) {
        if self.waiting.is_empty() {
            self.busy_until = self.busy_until.max(now);
        }
        self.waiting.extend(bytes);
    }

    /// Moves the bytes that have reached the other end by now to `out`.
    pub(super) fn arrived(&mut self, now: Duration, out: &mut Vec<u8>) {
        let Some(rate) = self.rate else { return out.extend(self.waiting.drain(..)) };
        let passed_s = now.saturating_sub(self.busy_until).as_secs_f64();
        let count = ((passed_s * rate) as usize).min(self.waiting.len());
        out.extend(self.waiting.drain(..count));
        self.busy_until += Duration::from_secs_f64(count as f64 / rate);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_take_their_time() {
        let mut line = Line::new(Some(9600));
        let mut out = Vec::new();
        line.push(&[7; 960], Duration::from_secs(3));
        for (ms, wanted) in [(3000, 0), (3100, 96), (3101, 96), (3500, 480), (4001, 960)] {
            line.arrived(Duration::from_millis(ms), &mut out);
            assert!(out.len().abs_diff(wanted) <= 1, "{ms} ms: {}", out.len());
        }
        // idle time is not credited to later bytes
        line.push(&[7; 96], Duration::from_secs(9));
        line.arrived(Duration::from_millis(9050), &mut out);
        assert!(out.len().abs_diff(960 + 48) <= 1, "{}", out.len());
    }
}
