//! Who an instrument is and what it sends.

use std::fmt;

use crate::recording::{Layout, Unit};

/// Who answers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Name of the driver: `eits1`, `sciospec`, `text`.
    pub driver: &'static str,
    /// Kind of instrument.
    pub name: String,
    /// What tells it from others of its kind; empty where it does not say.
    pub serial: String,
}

impl Identity {
    /// What an instrument or a recording says of itself, on one line.
    pub(crate) fn told(driver: &'static str, name: &str, serial: &str) -> Self {
        let line = |text: &str| text.replace(char::is_control, "?");
        Self { driver, name: line(name), serial: line(serial) }
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.name)?;
        if self.serial.is_empty() { Ok(()) } else { write!(f, " {}", self.serial) }
    }
}

/// What an instrument that was set up will send.
#[derive(Clone, Debug, PartialEq)]
pub struct Setup {
    /// Who it is.
    pub identity: Identity,
    /// Electrodes of each value.
    pub layout: Layout,
    /// Values of a frame, in that layout.
    pub value_count: usize,
    /// Whether they are complex.
    pub complex: bool,
    /// Their unit.
    pub unit: Unit,
    /// Frames a second, where it is known.
    pub frame_rate_hz: Option<f64>,
    /// What values can be.
    pub limits: Limits,
}

/// What values of an instrument can be. The default knows nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Limits {
    /// Magnitude of the largest value: those within 0.1 % of it are flagged saturated, those
    /// beyond it by more than 0.1 % over range.
    pub full_scale: Option<f64>,
    /// Magnitudes up to here are those of an input with nothing connected.
    pub open_up_to: Option<f64>,
    /// After so many frames in which a value does not change while half of the others do, it is
    /// flagged stuck. `None`: never.
    pub stuck_frames: Option<u32>,
}
