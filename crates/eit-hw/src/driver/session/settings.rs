//! How a session runs.

use crate::driver::queue::Overflow;
use crate::error::HwError;
use crate::frame::Quadruple;

/// How a session runs.
#[derive(Clone, Debug, PartialEq)]
pub struct SessionSettings {
    /// Measurements of the scene's protocol, in its order; `None` takes the instrument's own.
    pub quadruples: Option<Vec<Quadruple>>,
    /// Frames that may wait for the consumer.
    pub capacity: usize,
    /// What happens to the next one.
    pub overflow: Overflow,
    /// After so long without a frame, or three frame times where that is longer,
    /// [`Event::Silent`](crate::driver::Event::Silent) is told. Of an instrument whose rate is not set, a
    /// frame time is what was seen between the last frames, and 2 s before.
    pub silence_s: f64,
    /// After so long without a frame, or six frame times where that is longer, the instrument is set up
    /// anew as if it had been lost: it may have restarted without a word. Not where `reconnect` is
    /// `None`.
    pub stall_s: f64,
    /// How a lost instrument is looked for; `None`: the session ends.
    pub reconnect: Option<Backoff>,
}

impl Default for SessionSettings {
    /// 64 frames, keeping the latest; 0.5 s and 2 s; reconnecting as long as it takes.
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

/// Exponential backoff: waits between attempts to reconnect, each twice the one before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Backoff {
    /// The first wait.
    pub initial_s: f64,
    /// The longest wait.
    pub max_s: f64,
    /// Time after which the session ends with the last error; infinite: never.
    pub give_up_s: f64,
}

impl Default for Backoff {
    /// 0.1 s to 5 s, without end.
    fn default() -> Self {
        Self { initial_s: 0.1, max_s: 5.0, give_up_s: f64::INFINITY }
    }
}

impl SessionSettings {
    /// Whether the settings can be.
    ///
    /// # Errors
    /// [`HwError::Setting`] names the first that cannot.
    pub fn validate(&self) -> Result<(), HwError> {
        let positive = |name, value: f64| {
            if value > 0.0 {
                return Ok(());
            }
            Err(HwError::Setting { name, value: value.to_string(), wanted: "more than 0" })
        };
        if self.capacity == 0 || self.capacity > 1 << 20 {
            let value = self.capacity.to_string();
            return Err(HwError::Setting {
                name: "capacity",
                value,
                wanted: "1 to 1048576 frames",
            });
        }
        positive("silence_s", self.silence_s)?;
        positive("stall_s", self.stall_s)?;
        let Some(backoff) = self.reconnect else { return Ok(()) };
        positive("reconnect.initial_s", backoff.initial_s)?;
        positive("reconnect.max_s", backoff.max_s)?;
        positive("reconnect.give_up_s", backoff.give_up_s)
    }
}
