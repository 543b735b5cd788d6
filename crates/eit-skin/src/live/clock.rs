//! Time stamps of frames.

use eit_hw::Frame;

/// Assumed frame rate if neither the instrument nor a clock tells, hertz.
const DEFAULT_RATE_HZ: f64 = 20.0;

/// Time stamps of frames: the instrument's, else those of their arrival, else sequence number over frame
/// rate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    pub rate_hz: f64,
    first_host_s: Option<f64>,
    /// The last time returned.
    last_s: f64,
}

impl Clock {
    pub fn new(stated_hz: Option<f64>, quiet: &[Frame]) -> Self {
        let first_host_s = quiet.first().and_then(|frame| frame.host_time_s);
        let mut clock = Self {
            rate_hz: stated_hz.unwrap_or(DEFAULT_RATE_HZ),
            first_host_s,
            last_s: f64::NEG_INFINITY,
        };
        if let (None, [first, .., last]) = (stated_hz, quiet) {
            let span_s = clock.time_s(last) - clock.time_s(first);
            let steps = last.sequence.saturating_sub(first.sequence) as f64;
            if span_s > 0.0 {
                clock.rate_hz = steps / span_s;
            }
        }
        clock
    }

    /// Returns the time of the next frame. It always increases, as a tracker requires, even if a clock stands
    /// still or goes back.
    pub fn next_s(&mut self, frame: &Frame) -> f64 {
        let time_s = self.time_s(frame);
        let is_later = time_s > self.last_s;
        self.last_s = if is_later { time_s } else { self.last_s + 1.0 / self.rate_hz };
        self.last_s
    }

    fn time_s(&self, frame: &Frame) -> f64 {
        let host_s = || Some(frame.host_time_s? - self.first_host_s?);
        let by_number = || frame.sequence as f64 / self.rate_hz;
        frame.device_time_s.or_else(host_s).unwrap_or_else(by_number)
    }
}
