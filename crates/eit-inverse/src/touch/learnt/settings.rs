//! Settings of a learnt skin's detector, and what it knows of the untouched skin.

use crate::InverseError;
use crate::check::{check_length, check_positive};
use crate::learn::ResponseMap;
use ndarray::Array2;

/// Stated error rates, from which all thresholds follow.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LearntSettings {
    /// False touches a second on an untouched skin. Default: one an hour.
    pub alarms_hz: f64,
    /// Part of the untouched frames in which the reference may stand still by chance. Default 0.01.
    pub frozen: f64,
    /// Part of single touches that may show another one beside them. Default 0.01.
    pub extra: f64,
    /// Part of true touches that may count as not explained. Default 0.001.
    pub unexplained: f64,
    /// Time for which a frame must be followed by others without a touch before the reference takes it, seconds.
    /// Default 0.5.
    pub delay_s: f64,
    /// Most touches. Default 4.
    pub max_touches: usize,
    /// Weight of a new frame in the reference; `None` from noise and drift.
    pub following: Option<f64>,
}

impl Default for LearntSettings {
    fn default() -> Self {
        Self {
            alarms_hz: 1.0 / 3600.0,
            frozen: 0.01,
            extra: 0.01,
            unexplained: 1e-3,
            delay_s: 0.5,
            max_touches: 4,
            following: None,
        }
    }
}

impl LearntSettings {
    /// Rejects settings that are not above zero.
    pub(super) fn validate(&self) -> Result<(), InverseError> {
        check_positive("alarms_hz", self.alarms_hz)?;
        check_positive("frozen", self.frozen)?;
        check_positive("extra", self.extra)?;
        check_positive("unexplained", self.unexplained)?;
        check_positive("delay_s", self.delay_s)?;
        check_positive("max_touches", self.max_touches as f64)
    }
}

/// What is known of the untouched skin, in the unit of the presses.
#[derive(Debug, Clone, Copy)]
pub struct Untouched<'a> {
    /// Voltages, `[channel]`.
    pub reference: &'a [f64],
    /// Standard deviation of the noise of a frame minus the reference, `[channel]`.
    pub noise_std: &'a [f64],
    /// Changes of the untouched skin from one press to the next, `[interval, channel]`.
    pub steps: &'a Array2<f64>,
    /// Time from one press to the next, seconds.
    pub interval_s: f64,
    /// Frames a second.
    pub rate_hz: f64,
}

impl Untouched<'_> {
    /// Rejects what does not match a map, whose places have as many `strengths`, and times that are not above zero.
    pub(super) fn check(&self, map: &ResponseMap, strengths: usize) -> Result<(), InverseError> {
        let channels = map.scale.len();
        check_length("reference", self.reference.len(), channels)?;
        check_length("noise of the channels", self.noise_std.len(), channels)?;
        check_length("channels of the untouched skin", self.steps.ncols(), channels)?;
        check_length("strengths of the places", strengths, map.places_m.len())?;
        check_positive("interval_s", self.interval_s)?;
        check_positive("rate_hz", self.rate_hz)
    }
}
