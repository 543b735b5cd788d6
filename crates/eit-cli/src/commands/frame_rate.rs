//! Rate at which frames arrive during a recording.

use crate::commands::prelude::*;

/// Arrival of frames: their rate while frames come, and the longest interval between two of them.
#[derive(Debug, Default)]
pub(super) struct FrameRate {
    last: Option<Instant>,
    longest_wait_s: f64,
    /// Number and sum of the intervals between frames without those of an interruption.
    intervals: u64,
    sum_s: f64,
    /// Whether the instrument has been silent or unplugged since the last frame.
    is_interrupted: bool,
    /// Start of the averaging interval, and number of frames in it.
    since: Option<Instant>,
    recent_frames: u64,
    recent_hz: Option<f64>,
    /// Whether the rate was too low when last looked at.
    is_slow: bool,
}

impl FrameRate {
    /// Counts a frame that arrived at `now`.
    pub(super) fn frame(&mut self, now: Instant) {
        if let Some(last) = self.last.replace(now) {
            let interval_s = seconds(last, now);
            self.longest_wait_s = self.longest_wait_s.max(interval_s);
            if std::mem::take(&mut self.is_interrupted) {
                self.since = None;
            } else {
                self.intervals += 1;
                self.sum_s += interval_s;
            }
        }
        let since = *self.since.get_or_insert(now);
        // the first frame starts the interval
        self.recent_frames = if since == now { 0 } else { self.recent_frames + 1 };
        let lasted_s = seconds(since, now);
        if lasted_s >= 2.0 {
            self.recent_hz = Some(self.recent_frames as f64 / lasted_s);
            (self.since, self.recent_frames) = (Some(now), 0);
        }
    }

    /// Excludes the time from the last frame to the next one from the rate: the instrument is silent
    /// or unplugged.
    pub(super) fn interrupt(&mut self) {
        self.is_interrupted = self.last.is_some();
    }

    /// Returns the frame rate over the last two seconds, or over all if there were fewer.
    pub(super) fn recent_hz(&self) -> Option<f64> {
        self.recent_hz.or_else(|| self.mean_hz())
    }

    /// Describes a rate that has fallen below nine tenths of the stated one or is back; `None` while
    /// that does not change.
    pub(super) fn change(&mut self, stated_hz: Option<f64>) -> Option<String> {
        let (stated_hz, recent_hz) = (stated_hz?, self.recent_hz?);
        let is_slow = recent_hz < 0.9 * stated_hz;
        let is_new = std::mem::replace(&mut self.is_slow, is_slow) != is_slow;
        let state = if is_slow { "only " } else { "again " };
        is_new.then(|| format!("{state}{recent_hz:.1} of {stated_hz} frames per second arrive"))
    }

    /// Returns whether the rate was too low when [`change`](Self::change) was last called.
    pub(super) fn is_slow(&self) -> bool {
        self.is_slow
    }

    /// Returns the mean frame rate while frames came; `None` for fewer than two frames.
    pub(super) fn mean_hz(&self) -> Option<f64> {
        (self.sum_s > 0.0).then(|| self.intervals as f64 / self.sum_s)
    }

    /// Returns the longest interval between two frames; `None` for fewer than two.
    pub(super) fn longest_wait_s(&self) -> Option<f64> {
        (self.longest_wait_s > 0.0).then_some(self.longest_wait_s)
    }

    /// Describes rate and interval after a comma; empty for fewer than two frames.
    pub(super) fn description(&self) -> String {
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
        assert_eq!(rate.description(), format!(", {mean_hz:.1} per second, at most 3.000 s apart"));
    }

    #[test]
    fn a_rate_that_falls_is_reported_once_and_its_return_too() {
        let (mut rate, start) = (FrameRate::default(), Instant::now());
        // 5 s at 100 Hz, 6 s at 80 Hz, 5 s at 95 Hz
        let intervals_us = [(500, 10_000), (480, 12_500), (475, 10_526)];
        let (mut reported, mut time_us) = (Vec::new(), 0);
        for interval_us in intervals_us.iter().flat_map(|&(count, us)| vec![us; count]) {
            rate.frame(start + Duration::from_micros(time_us));
            reported.extend(rate.change(Some(100.0)).map(|words| (time_us / 1_000_000, words)));
            assert_eq!(rate.change(None), None);
            time_us += interval_us;
        }
        let [(fell_s, fell), (back_s, back)] = &reported[..] else { unreachable!("{reported:?}") };
        assert!((6..=9).contains(fell_s) && fell.starts_with("only 8"), "{reported:?}");
        assert!((12..=15).contains(back_s) && back.starts_with("again 9"), "{reported:?}");
        assert!(back.ends_with("of 100 frames per second arrive"), "{reported:?}");
    }

    #[test]
    fn silence_does_not_count_for_the_rate() {
        let (mut rate, start) = (FrameRate::default(), Instant::now());
        rate.interrupt();
        // 5 s at 10 Hz, unplugged for 60 s, 1 s at 10 Hz
        for time_ms in (0..50).map(|i| 100 * i).chain((0..10).map(|i| 65_000 + 100 * i)) {
            if time_ms == 65_000 {
                rate.interrupt();
            }
            rate.frame(start + Duration::from_millis(time_ms));
            if time_ms >= 65_000 {
                assert!((rate.recent_hz().unwrap() - 10.0).abs() < 1e-6, "{rate:?}");
            }
        }
        assert!((rate.mean_hz().unwrap() - 10.0).abs() < 1e-6, "{rate:?}");
        assert!((rate.longest_wait_s().unwrap() - 60.1).abs() < 1e-6, "{rate:?}");
    }
}
