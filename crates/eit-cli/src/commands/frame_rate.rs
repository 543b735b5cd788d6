//! Rate at which frames arrive during a recording.

use std::time::Instant;

/// Averaging time of the recent rate, seconds.
const RECENT_S: f64 = 2.0;

/// Arrival of frames: their rate, and the longest interval between two of them.
#[derive(Debug, Default)]
pub(super) struct FrameRate {
    first: Option<Instant>,
    last: Option<Instant>,
    frames: u64,
    longest_wait_s: f64,
    /// Start of the averaging interval, and number of frames in it.
    since: Option<Instant>,
    recent_frames: u64,
    recent_hz: Option<f64>,
}

impl FrameRate {
    /// Counts a frame that arrived at `now`.
    pub fn frame(&mut self, now: Instant) {
        if let Some(last) = self.last.replace(now) {
            self.longest_wait_s = self.longest_wait_s.max(seconds(last, now));
        }
        self.first.get_or_insert(now);
        self.frames += 1;
        let since = *self.since.get_or_insert(now);
        // the first frame starts the interval
        self.recent_frames += u64::from(since != now);
        let lasted_s = seconds(since, now);
        if lasted_s >= RECENT_S {
            self.recent_hz = Some(self.recent_frames as f64 / lasted_s);
            (self.since, self.recent_frames) = (Some(now), 0);
        }
    }

    /// Returns the frame rate over the last seconds, or over all if there were fewer.
    pub fn recent_hz(&self) -> Option<f64> {
        self.recent_hz.or_else(|| self.mean_hz())
    }

    /// Returns the mean frame rate; `None` for fewer than two frames.
    pub fn mean_hz(&self) -> Option<f64> {
        let lasted_s = seconds(self.first?, self.last?);
        (lasted_s > 0.0).then(|| (self.frames - 1) as f64 / lasted_s)
    }

    /// Returns the longest interval between two frames; `None` for fewer than two.
    pub fn longest_wait_s(&self) -> Option<f64> {
        (self.frames > 1).then_some(self.longest_wait_s)
    }

    /// Describes rate and interval after a comma; empty for fewer than two frames.
    pub fn words(&self) -> String {
        match (self.mean_hz(), self.longest_wait_s()) {
            (Some(mean_hz), Some(wait_s)) => {
                format!(", {mean_hz:.1} per second, at most {wait_s:.3} s apart")
            }
            _ => String::new(),
        }
    }
}

fn seconds(from: Instant, to: Instant) -> f64 {
    to.saturating_duration_since(from).as_secs_f64()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn rates_and_the_longest_wait() {
        let (mut rate, start) = (FrameRate::default(), Instant::now());
        assert_eq!((rate.mean_hz(), rate.recent_hz(), rate.longest_wait_s()), (None, None, None));
        // 5 s at 10 Hz, a pause of 3 s, 4 s at 20 Hz
        let times = (0..50).map(|i| 100 * i).chain((0..80).map(|i| 7900 + 50 * i));
        let mut last_ms = 0;
        for time_ms in times {
            rate.frame(start + Duration::from_millis(time_ms));
            last_ms = time_ms;
        }
        let mean_hz = 129.0 / (1e-3 * last_ms as f64);
        // rounding to nanoseconds
        let near = |found: Option<f64>, wanted: f64| (found.unwrap() - wanted).abs() < 1e-6;
        assert!(near(rate.mean_hz(), mean_hz), "{rate:?}");
        assert!(near(rate.longest_wait_s(), 3.0), "{rate:?}");
        assert!(near(rate.recent_hz(), 20.0), "{rate:?}");
        assert_eq!(rate.words(), format!(", {mean_hz:.1} per second, at most 3.000 s apart"));
    }
}
