//! Time stamps of frames.

use crate::touches::DEFAULT_RATE_HZ;
use eit_hw::Frame;
use std::time::Instant;

/// Range of plausible frame rates, hertz; a clock that jumps gives others.
const RATES_HZ: std::ops::RangeInclusive<f64> = 1e-4..=1e6;
/// Longest plausible time between two frames, seconds: 11 days.
const MOST_STEP_S: f64 = 1e6;
/// Largest plausible time, seconds: 31 000 years. Adding a millisecond to it still changes it.
const MAX_S: f64 = 1e12;

/// When a frame was shown, and when it arrived if it was live, seconds.
#[derive(Debug, Clone, Copy)]
pub(super) struct Arrival {
    pub shown: Instant,
    pub arrived_s: Option<f64>,
}

impl Arrival {
    /// Of a frame that is shown now.
    pub(super) fn of(arrived_s: Option<f64>) -> Self {
        Self { shown: Instant::now(), arrived_s }
    }
}

/// Time stamps of frames: the instrument's, else those of their arrival, else sequence number over frame
/// rate. They increase over a whole session, whatever is reconnected ([`Clock::next_epoch`]).
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    pub rate_hz: f64,
    /// Whether that rate is assumed, as neither the instrument nor a clock tells.
    pub is_assumed: bool,
    first_host_s: Option<f64>,
    /// Added to each time since a clock jumped ahead.
    offset_s: f64,
    /// The last time returned.
    last_s: f64,
    /// When that frame arrived.
    last_host_s: Option<f64>,
}

impl Clock {
    pub(crate) fn new(stated_hz: Option<f64>, quiet: &[Frame]) -> Self {
        let first_host_s = quiet.first().and_then(|frame| frame.host_time_s);
        let mut clock = Self {
            rate_hz: DEFAULT_RATE_HZ,
            is_assumed: true,
            first_host_s,
            offset_s: 0.0,
            last_s: f64::NEG_INFINITY,
            last_host_s: None,
        };
        clock.set_rate(stated_hz, quiet);
        clock
    }

    /// Continues in the next epoch, given its first frames, with times later than those before. If
    /// the instrument's clock or frame numbers began again, the time between the arrivals is used,
    /// else that of one frame.
    pub(crate) fn next_epoch(mut self, stated_hz: Option<f64>, quiet: &[Frame]) -> Self {
        let Some(first) = quiet.first().filter(|_| self.last_s.is_finite()) else {
            return Self::new(stated_hz, quiet);
        };
        self.set_rate(stated_hz, quiet);
        let is_step = |step_s: &f64| (0.0..=MOST_STEP_S).contains(step_s);
        let read_s = self.time_s(first);
        if is_step(&(read_s - self.last_s)) {
            self.offset_s = 0.0;
        } else {
            let arrivals = first.host_time_s.zip(self.last_host_s);
            let passed_s = arrivals.map(|(first_s, last_s)| first_s - last_s).filter(is_step);
            let next_s = self.last_s + passed_s.unwrap_or(1.0 / self.rate_hz);
            self.offset_s = next_s - read_s;
        }
        self
    }

    /// Sets the stated frame rate, else estimates it from these frames.
    fn set_rate(&mut self, stated_hz: Option<f64>, quiet: &[Frame]) {
        (self.rate_hz, self.is_assumed) =
            (stated_hz.unwrap_or(DEFAULT_RATE_HZ), stated_hz.is_none());
        if let (None, [first, .., last]) = (stated_hz, quiet)
            && let (Some(first_s), Some(last_s)) = (self.read_s(first), self.read_s(last))
        {
            let span_s = last_s - first_s;
            let steps = last.sequence.saturating_sub(first.sequence) as f64;
            let rate_hz = steps / span_s;
            if RATES_HZ.contains(&rate_hz) {
                (self.rate_hz, self.is_assumed) = (rate_hz, false);
            }
        }
    }

    /// Returns the time of the next frame. It always increases, as a tracker requires, even if a
    /// clock stands still, goes back or jumps.
    pub(crate) fn next_s(&mut self, frame: &Frame) -> f64 {
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
        self.last_host_s = frame.host_time_s;
        self.last_s
    }

    fn time_s(&self, frame: &Frame) -> f64 {
        self.read_s(frame).unwrap_or_else(|| frame.sequence as f64 / self.rate_hz)
    }

    /// The time by the clock of the instrument, else that of this computer.
    fn read_s(&self, frame: &Frame) -> Option<f64> {
        frame.device_time_s.or_else(|| Some(frame.host_time_s? - self.first_host_s?))
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
        assert!(!Clock::new(None, &quiet).is_assumed && !Clock::new(Some(20.0), &[]).is_assumed);
        // a jump within the first frames does not make the rate
        let jump = [frame(0, 0.0), frame(1, 1e308)];
        assert!(RATES_HZ.contains(&Clock::new(None, &jump).rate_hz));
        let mut first = Clock::new(Some(100.0), &[]);
        assert!(first.next_s(&frame(0, 1e308)) < first.next_s(&frame(1, 0.0)));
    }

    /// An instrument that begins at 0 again after it was found goes on in the session's time: by the arrivals if these
    /// are known, else by one frame. A clock that runs on is followed.
    #[test]
    fn time_goes_on_after_a_reconnection() {
        let at = |sequence, device_time_s, host_time_s| Frame {
            device_time_s,
            host_time_s,
            ..frame(sequence, 0.0)
        };
        let by = |device: [Option<f64>; 2], host: [Option<f64>; 2], sequence: [u64; 2]| {
            let frames = |from: usize| -> Vec<Frame> {
                let time_s = |start: Option<f64>, k: u64| start.map(|s| s + 0.01 * k as f64);
                let one =
                    |k| at(sequence[from] + k, time_s(device[from], k), time_s(host[from], k));
                (0..20).map(one).collect()
            };
            let (before, after) = (frames(0), frames(1));
            let mut clock = Clock::new(None, &before[..10]);
            let last_s = before[10..].iter().map(|frame| clock.next_s(frame)).last().unwrap();
            let mut clock = clock.next_epoch(None, &after[..10]);
            let mut times = after[10..].iter().map(|frame| clock.next_s(frame));
            let first_s = times.next().unwrap();
            let steps: Vec<f64> =
                times.scan(first_s, |b, t| Some(t - std::mem::replace(b, t))).collect();
            let period_s = 1.0 / clock.rate_hz;
            assert!(steps.iter().all(|step| (step - period_s).abs() < 1e-6), "{steps:?}");
            // from the last frame before to the first reference frame after
            first_s - last_s - 10.0 * period_s
        };
        let near = |found_s: f64, wanted_s: f64| {
            assert!((found_s - wanted_s).abs() < 1e-6, "{found_s} instead of {wanted_s}");
        };
        let (none, host) = ([None; 2], [Some(1e9), Some(1e9 + 5.19)]);
        near(by(none, host, [0, 0]), 5.0);
        near(by([Some(3.0), Some(8.19)], host, [0, 0]), 5.0);
        near(by([Some(3.0), Some(0.0)], host, [0, 0]), 5.0);
        near(by([Some(3.0), Some(0.0)], none, [0, 0]), 0.01);
        // numbers are no clock
        let numbered = [at(0, None, None), at(1, None, None)];
        assert!(Clock::new(None, &numbered).is_assumed);
        near(by(none, none, [7, 0]), 1.0 / DEFAULT_RATE_HZ);
        near(by(none, none, [0, 40]), 21.0 / DEFAULT_RATE_HZ);
        // this computer's clock was set back meanwhile
        near(by([Some(3.0), Some(0.0)], [Some(1e9), Some(9e8)], [0, 0]), 0.01);
        near(by(none, [Some(1e9), Some(9e8)], [0, 0]), 0.01);
    }
}
