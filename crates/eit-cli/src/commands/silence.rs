//! Time in which a live instrument sends nothing, and the frames that are missing for it.

use crate::commands::prelude::*;
use eit_hw::driver::Event;
use serde::Serialize;

/// Silence at the start from which it is shown; later silences are reported by the session.
const SHOWN: Duration = Duration::from_millis(500);

/// Whether an instrument sends nothing at the moment.
#[derive(Debug)]
pub(super) struct Silence {
    /// Start of the silence; also set before the first frame.
    since: Option<Instant>,
    /// Whether the session has reported it.
    is_reported: bool,
}

impl Silence {
    /// Before the first frame.
    pub(super) fn new() -> Self {
        Self { since: Some(Instant::now()), is_reported: false }
    }

    pub(super) fn follow(&mut self, event: &Event) {
        match event {
            Event::Frame(_) => (self.since, self.is_reported) = (None, false),
            Event::Silent { .. } | Event::Disconnected { .. } => {
                self.since.get_or_insert_with(Instant::now);
                self.is_reported = true;
            }
            _ => {}
        }
    }

    /// Returns the length of a silence that is long enough to be shown.
    pub(super) fn shown(&self) -> Option<Duration> {
        self.since.map(|since| since.elapsed()).filter(|length| *length > SHOWN)
    }

    /// Whether the instrument is silent or unplugged: the session has reported it, or it had time to send its first
    /// frame.
    pub(super) fn is_silent(&self) -> bool {
        self.is_silent_at(Instant::now())
    }

    fn is_silent_at(&self, now: Instant) -> bool {
        let is_long = |since| now.saturating_duration_since(since) > SHOWN;
        self.since.is_some_and(|since| self.is_reported || is_long(since))
    }
}

/// Time without data, as a command reports it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct NoData {
    silent_s: f64,
    disconnected_s: f64,
    /// Estimate of the frames that would have come; `None` if no rate is known.
    #[serde(rename = "no_data_frames_estimate")]
    frames: Option<u64>,
    ended_silent: bool,
    /// Frame rate that the instrument states, or else measured while frames came.
    #[serde(skip)]
    stated_hz: Option<f64>,
    #[serde(skip)]
    measured_hz: Option<f64>,
}

impl NoData {
    /// Of this time silent and disconnected.
    pub(super) fn new(
        [silent_s, disconnected_s]: [f64; 2],
        stated_hz: Option<f64>,
        measured_hz: Option<f64>,
        ended_silent: bool,
    ) -> Self {
        let missing = |rate_hz: f64| (rate_hz * (silent_s + disconnected_s)).round() as u64;
        let frames = stated_hz.or(measured_hz).map(missing);
        Self { silent_s, disconnected_s, frames, ended_silent, stated_hz, measured_hz }
    }

    /// Describes it after a semicolon; empty if data came all the time.
    pub(super) fn description(&self) -> String {
        let mut words = String::new();
        let Self { silent_s, disconnected_s, .. } = *self;
        if silent_s + disconnected_s > 0.0 {
            words += &format!("; no data for {:.1} s", silent_s + disconnected_s);
            words += &match (silent_s > 0.0, disconnected_s > 0.0) {
                (true, true) => {
                    format!(" (silent {silent_s:.1} s, disconnected {disconnected_s:.1} s)")
                }
                (true, false) => " (silent)".to_owned(),
                _ => " (disconnected)".to_owned(),
            };
            if let Some(frames) = self.frames {
                let rate = match (self.stated_hz, self.measured_hz) {
                    (Some(hz), _) => format!("the stated {hz}"),
                    (None, hz) => format!("the measured {:.1}", hz.unwrap_or_default()),
                };
                words += &format!(": an estimated {frames} frames at {rate} per second");
            }
        }
        if self.ended_silent {
            words += "; it was silent or unplugged at the end: check its power and cable";
        }
        words
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_the_time_without_data_are_estimated() {
        for (no_data_s, stated_hz, measured_hz, frames, words) in [
            ([0.0, 0.0], Some(100.0), Some(99.0), Some(0), ""),
            (
                [0.0, 1.504],
                Some(100.0),
                Some(99.0),
                Some(150),
                "; no data for 1.5 s (disconnected): an estimated 150 frames at the stated 100 per second",
            ),
            (
                [2.0, 1.504],
                None,
                Some(99.0),
                Some(347),
                "; no data for 3.5 s (silent 2.0 s, disconnected 1.5 s): an estimated 347 frames at the \
                 measured 99.0 per second",
            ),
            ([2.0, 0.0], None, None, None, "; no data for 2.0 s (silent)"),
        ] {
            let data = NoData::new(no_data_s, stated_hz, measured_hz, false);
            assert_eq!((data.frames, data.description().as_str()), (frames, words));
            let ended = NoData::new(no_data_s, stated_hz, measured_hz, true).description();
            let end = "; it was silent or unplugged at the end: check its power and cable";
            assert_eq!(ended, format!("{words}{end}"));
        }
    }

    /// Ended right after its start, an instrument is not told to be without power.
    #[test]
    fn the_first_half_second_is_no_silence() {
        let start = Instant::now();
        let silent = |since, is_reported, after_s| {
            Silence { since, is_reported }.is_silent_at(start + Duration::from_secs_f64(after_s))
        };
        assert!(!silent(None, false, 9.0) && !silent(None, true, 9.0));
        assert!(!silent(Some(start), false, 0.0) && !silent(Some(start), false, 0.5));
        assert!(silent(Some(start), false, 0.6) && silent(Some(start), true, 0.0));
    }
}
