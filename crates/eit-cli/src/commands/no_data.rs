//! Time in which a live instrument sent nothing, and the frames that are missing for it.

use eit_hw::driver::{Setup, Statistics};
use serde_json::{Value, json};

/// Time without data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NoData {
    silent_s: f64,
    disconnected_s: f64,
    /// Frame rate that the instrument states, or else measured while frames came.
    stated_hz: Option<f64>,
    measured_hz: Option<f64>,
    ended_silent: bool,
}

impl NoData {
    pub fn of(
        setup: &Setup,
        statistics: &Statistics,
        measured_hz: Option<f64>,
        ended_silent: bool,
    ) -> Self {
        Self {
            silent_s: statistics.silent_s,
            disconnected_s: statistics.disconnected_s,
            stated_hz: setup.frame_rate_hz,
            measured_hz,
            ended_silent,
        }
    }

    /// Estimates how many frames would have come; `None` if no rate is known.
    fn frames(&self) -> Option<u64> {
        let rate_hz = self.stated_hz.or(self.measured_hz)?;
        Some((rate_hz * (self.silent_s + self.disconnected_s)).round() as u64)
    }

    /// Describes the time without data after a semicolon; empty if there was none.
    pub fn words(&self) -> String {
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
            if let Some(frames) = self.frames() {
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

    /// Adds the time without data to the JSON of a command.
    pub fn add_to(&self, json: &mut Value) {
        json["silent_s"] = json!(self.silent_s);
        json["disconnected_s"] = json!(self.disconnected_s);
        json["no_data_frames_estimate"] = json!(self.frames());
        json["ended_silent"] = json!(self.ended_silent);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_of_the_time_without_data_are_estimated() {
        let data = NoData {
            silent_s: 0.0,
            disconnected_s: 0.0,
            stated_hz: Some(100.0),
            measured_hz: Some(99.0),
            ended_silent: false,
        };
        assert_eq!((data.words(), data.frames()), (String::new(), Some(0)));
        let unplugged = NoData { disconnected_s: 1.504, ..data };
        let words = "; no data for 1.5 s (disconnected): an estimated 150 frames at the stated 100 per second";
        assert_eq!(unplugged.words(), words);
        let both = NoData { silent_s: 2.0, stated_hz: None, ..unplugged };
        let words = "; no data for 3.5 s (silent 2.0 s, disconnected 1.5 s): an estimated 347 frames at the \
                     measured 99.0 per second";
        assert_eq!(both.words(), words);
        let unknown = NoData { measured_hz: None, ended_silent: true, ..both };
        assert_eq!(unknown.frames(), None);
        assert!(
            unknown.words().ends_with(
                "1.5 s); it was silent or unplugged at the end: check its power and cable"
            )
        );
    }
}
