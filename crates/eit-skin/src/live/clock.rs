//! Time stamps of frames.

use eit_hw::Frame;

/// Assumed frame rate if neither the instrument nor a clock tells, hertz.
const DEFAULT_RATE_HZ: f64 = 20.0;
/// Range of measured frame rates that are believed, hertz: a clock that jumps gives others.
const RATES_HZ: std::ops::RangeInclusive<f64> = 1e-4..=1e6;
/// Longest time between two frames that is believed, seconds: 11 days.
const MOST_STEP_S: f64 = 1e6;
/// Largest time that is believed, seconds: 31 000 years. Adding a millisecond to it still changes it.
const MAX_S: f64 = 1e12;

/// Time stamps of frames: the instrument's, else those of their arrival, else sequence number over frame
/// rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    pub rate_hz: f64,
    first_host_s: Option<f64>,
    /// Added to each time since a clock jumped ahead.
    offset_s: f64,
    /// The last time returned.
    last_s: f64,
}

impl Clock {
    pub fn new(stated_hz: Option<f64>, quiet: &[Frame]) -> Self {
        let first_host_s = quiet.first().and_then(|frame| frame.host_time_s);
        let mut clock = Self {
            rate_hz: stated_hz.unwrap_or(DEFAULT_RATE_HZ),
            first_host_s,
            offset_s: 0.0,
            last_s: f64::NEG_INFINITY,
        };
        if let (None, [first, .., last]) = (stated_hz, quiet) {
            let span_s = clock.time_s(last) - clock.time_s(first);
            let steps = last.sequence.saturating_sub(first.sequence) as f64;
            let rate_hz = steps / span_s;
            if RATES_HZ.contains(&rate_hz) {
                clock.rate_hz = rate_hz;
            }
        }
        clock
    }

    /// Returns the time of the next frame. It always increases, as a tracker requires, even if a clock stands
    /// still, goes back or jumps out of all measure.
    pub fn next_s(&mut self, frame: &Frame) -> f64 {
        let read_s = self.time_s(frame);
        // the clock may make sense again by itself
        if self.offset_s != 0.0 && (0.0..=MOST_STEP_S).contains(&(read_s - self.last_s)) {
            self.offset_s = 0.0;
        }
        let time_s = read_s + self.offset_s;
        let is_first = self.last_s == f64::NEG_INFINITY;
        let before_s = if is_first { 0.0 } else { self.last_s };
        let is_sane = time_s.abs() <= MAX_S && (is_first || time_s - before_s <= MOST_STEP_S);
        let next_s = before_s + 1.0 / self.rate_hz;
        if !is_sane {
            self.offset_s = next_s - read_s;
        }
        self.last_s = if is_sane && time_s > self.last_s { time_s } else { next_s };
        self.last_s
    }

    fn time_s(&self, frame: &Frame) -> f64 {
        let host_s = || Some(frame.host_time_s? - self.first_host_s?);
        let by_number = || frame.sequence as f64 / self.rate_hz;
        frame.device_time_s.or_else(host_s).unwrap_or_else(by_number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(sequence: u64, device_time_s: f64) -> Frame {
        Frame {
            values: Vec::new(),
            imaginary: None,
            quality: Vec::new(),
            sequence,
            epoch: 0,
            device_time_s: Some(device_time_s),
            host_time_s: None,
        }
    }

    /// Clocks that go back, stand still or jump: the time always increases, by a finite step, and follows
    /// the clock again once it makes sense.
    #[test]
    fn time_increases_whatever_the_clock_does() {
        let quiet: Vec<_> = (0..10).map(|k| frame(k, 0.01 * k as f64)).collect();
        for wrong_s in [1e308, 1e9, -1e308, -5.0, 0.0, 5.0, f64::MAX] {
            let mut clock = Clock::new(None, &quiet);
            assert!((clock.rate_hz - 100.0).abs() < 1e-6, "{}", clock.rate_hz);
            let mut last_s = f64::NEG_INFINITY;
            for k in 10..200_u64 {
                let time_s = if k == 50 { wrong_s } else { 0.01 * k as f64 };
                let next_s = clock.next_s(&frame(k, time_s));
                assert!(next_s > last_s && next_s.is_finite(), "{wrong_s}, {k}: {last_s} {next_s}");
                last_s = next_s;
            }
            // 190 frames; a jump of 5 s that might be a pause is believed
            assert!(last_s < 10.0, "{wrong_s}: {last_s}");
        }
        // one wrong stamp, then frames at half the rate: the clock is followed
        let mut clock = Clock::new(None, &quiet);
        for k in 10..100_u64 {
            let time_s = if k == 50 { 3e6 } else { 0.02 * k as f64 };
            let next_s = clock.next_s(&frame(k, time_s));
            assert!(k == 50 || (next_s - time_s).abs() < 1e-9, "{k}: {next_s}");
        }
        // a jump within the first frames does not make the rate
        let jump = [frame(0, 0.0), frame(1, 1e308)];
        assert!(RATES_HZ.contains(&Clock::new(None, &jump).rate_hz));
        let mut first = Clock::new(Some(100.0), &[]);
        assert!(first.next_s(&frame(0, 1e308)) < first.next_s(&frame(1, 0.0)));
    }
}
