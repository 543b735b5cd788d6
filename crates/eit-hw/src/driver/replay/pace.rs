//! Pace of a replay, by the clocks of the recording.

use std::time::{Duration, Instant};

use crate::error::HwError;
use crate::frame::Frame;

/// Speed at which a recording is played.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Pace {
    /// Delivers each frame on request: as fast as the consumer, or step by step.
    #[default]
    OnDemand,
    /// A multiple of the recorded speed; 1 is real time. Timed by the instrument's clock or,
    /// without one and where it goes back or ahead by more than a minute, by the host's. Backward
    /// steps of the host's clock are ignored, and so are those above ten seconds, because the clock
    /// may have been set; so neither a wrong clock nor a long pause makes a replay wait. Frames
    /// without a time are delivered on request.
    Speed(f64),
}

/// Longest step of the instrument's clock that counts as elapsed time, in seconds.
const MOST_DEVICE_STEP_S: f64 = 60.0;
/// Longest step of the host's clock that counts as elapsed time, in seconds; it was set if longer.
const MOST_HOST_STEP_S: f64 = 10.0;

/// A consumer that was busy for longer, such as with its set-up, gets what follows at the wanted speed, and no burst.
const MOST_LATE: Duration = Duration::from_millis(100);

/// Times of a frame by the instrument's and the host's clock, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Times {
    device_s: Option<f64>,
    host_s: Option<f64>,
}

impl Times {
    fn of(frame: &Frame) -> Self {
        let finite = |time_s: Option<f64>| time_s.filter(|time_s| time_s.is_finite());
        Self { device_s: finite(frame.device_time_s), host_s: finite(frame.host_time_s) }
    }

    /// Returns the time elapsed since an earlier frame; 0 if no clock shows it.
    fn since(self, before: Self) -> f64 {
        let step_s = |now: Option<f64>, before: Option<f64>, most_s| {
            now.zip(before).map(|(now, before)| now - before).filter(|s| (0.0..=most_s).contains(s))
        };
        step_s(self.device_s, before.device_s, MOST_DEVICE_STEP_S)
            .or_else(|| step_s(self.host_s, before.host_s, MOST_HOST_STEP_S))
            .unwrap_or(0.0)
    }
}

/// When frames are due.
#[derive(Debug)]
pub(super) struct Clock {
    pace: Pace,
    /// When the first frame was delivered, recorded seconds since then, and times of the last frame.
    start: Option<(Instant, f64, Times)>,
}

impl Clock {
    /// A clock that starts with the first frame.
    ///
    /// # Errors
    /// [`HwError::Setting`] for a pace that is not above 0.
    pub(super) fn new(pace: Pace) -> Result<Self, HwError> {
        if let Pace::Speed(times) = pace {
            let is_speed = times > 0.0 && times.is_finite();
            HwError::require(is_speed, "speed", times, "a number above 0")?;
        }
        Ok(Self { pace, start: None })
    }

    /// Skips the pause before the next frame.
    pub(super) fn restart(&mut self) {
        self.start = None;
    }

    /// Returns how long until a frame is due; zero if it is due now. Frames without times are as far apart as at
    /// `rate_hz`.
    pub(super) fn due_in(&mut self, frame: &Frame, rate_hz: Option<f64>) -> Duration {
        let Pace::Speed(times) = self.pace else { return Duration::ZERO };
        let mut now = Times::of(frame);
        if now == Times::default() {
            let rate_hz = rate_hz.filter(|hz| *hz > 0.0 && hz.is_finite());
            let Some(rate_hz) = rate_hz else { return Duration::ZERO };
            now.device_s = Some(frame.sequence as f64 / rate_hz);
        }
        let (start, since_s, before) = self.start.get_or_insert_with(|| (Instant::now(), 0.0, now));
        *since_s += now.since(*before);
        *before = now;
        let after = Duration::try_from_secs_f64(*since_s / times).unwrap_or_default();
        let late = start.elapsed().saturating_sub(after);
        if late > MOST_LATE {
            *start += late;
        }
        after.saturating_sub(start.elapsed())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Clocks that go back, jump to another century or stand still neither stop a replay nor let it run
    /// ahead while the other clock is right.
    #[test]
    fn wrong_clocks_do_not_make_a_replay_wait() {
        let times = |device_s, host_s| Times { device_s, host_s };
        let both = |device_s: f64, host_s: f64| times(Some(device_s), Some(host_s));
        for (before, now, wanted_s) in [
            (both(5.0, 100.0), both(5.01, 100.02), 0.01),
            // a pause of the instrument counts, also where the host's clock was set
            (both(5.0, 100.0), both(45.0, 7.0), 40.0),
            // the instrument's clock is wrong: the host's counts
            (both(5.0, 100.0), both(1e9, 100.5), 0.5),
            (both(5.0, 100.0), both(4.99, 100.5), 0.5),
            (both(5.0, 100.0), both(1e308, 100.5), 0.5),
            // both are
            (both(5.0, 100.0), both(1e9, 1e9), 0.0),
            (both(5.0, 100.0), both(-1e9, -1e9), 0.0),
            // one of them is missing
            (times(None, Some(100.0)), times(None, Some(100.5)), 0.5),
            (times(None, Some(100.0)), times(None, Some(3700.0)), 0.0),
            (times(Some(5.0), None), times(Some(5.5), None), 0.5),
            (times(Some(5.0), None), times(None, Some(7.0)), 0.0),
        ] {
            let found_s = now.since(before);
            assert!((found_s - wanted_s).abs() < 1e-9, "{before:?} {now:?}: {found_s}");
        }
    }
}
