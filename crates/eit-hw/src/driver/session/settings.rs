//! Settings of a session.

use crate::driver::queue::Overflow;
use crate::error::HwError;
use crate::frame::Quadruple;

/// Settings of a [`Session`](super::Session).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct SessionSettings {
    /// Measurements of the scene's protocol, in order; `None` keeps the instrument's own.
    pub quadruples: Option<Vec<Quadruple>>,
    /// Maximum number of frames waiting for the consumer.
    pub capacity: usize,
    /// What happens when more frames arrive.
    pub overflow: Overflow,
    /// Seconds without a frame after which [`Event::Silent`](crate::driver::Event::Silent) is
    /// reported, or three frame periods if longer. If the instrument's rate is unknown, the period
    /// is estimated from recent frames; until then it is at least 2 s.
    pub silence_s: f64,
    /// Seconds without a frame after which the instrument is set up again as if it had been lost,
    /// or six frame periods if longer: it may have restarted without notice. Ignored if `reconnect`
    /// is `None`.
    pub stall_s: f64,
    /// How to reconnect to a lost instrument; with `None` the session ends.
    pub reconnect: Option<Backoff>,
}

impl Default for SessionSettings {
    /// 64 frames, keeping the latest; 0.5 s and 2 s; reconnecting without time limit.
    fn default() -> Self {
        Self {
            quadruples: None,
            capacity: 64,
            overflow: Overflow::default(),
            silence_s: 0.5,
            stall_s: 2.0,
            reconnect: Some(Backoff::default()),
        }
    }
}

/// Exponential backoff: each wait between attempts to reconnect is twice the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Backoff {
    /// First wait in seconds.
    pub initial_s: f64,
    /// Longest wait in seconds.
    pub max_s: f64,
    /// Seconds after which the session ends with the last error; infinite for never.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::infinite"))]
    pub give_up_s: f64,
}

impl Default for Backoff {
    /// 0.1 s to 5 s, without time limit.
    fn default() -> Self {
        Self { initial_s: 0.1, max_s: 5.0, give_up_s: f64::INFINITY }
    }
}

impl SessionSettings {
    /// Checks the settings.
    ///
    /// # Errors
    /// [`HwError::Setting`] names the first invalid one.
    pub fn validate(&self) -> Result<(), HwError> {
        let positive = |name, value: f64| HwError::require(value > 0.0, name, value, "more than 0");
        let is_queue = (1..=1 << 20).contains(&self.capacity);
        HwError::require(is_queue, "capacity", self.capacity, "1 to 1048576 frames")?;
        positive("silence_s", self.silence_s)?;
        positive("stall_s", self.stall_s)?;
        let Some(backoff) = self.reconnect else { return Ok(()) };
        positive("reconnect.initial_s", backoff.initial_s)?;
        positive("reconnect.max_s", backoff.max_s)?;
        positive("reconnect.give_up_s", backoff.give_up_s)
    }
}
