//! Identity of an instrument, and the format of what it sends.

use std::fmt;

use crate::recording::{Layout, Unit};

/// Identity reported by the instrument.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Identity {
    /// Name of the driver: `eits1`, `sciospec`, `text`.
    pub driver: &'static str,
    /// Model or type of the instrument.
    pub name: String,
    /// Serial number or other identifier; empty if the instrument reports none.
    pub serial: String,
}

impl Identity {
    /// Creates an identity from the texts of an instrument or recording, each reduced to one line.
    pub(crate) fn one_line(driver: &'static str, name: &str, serial: &str) -> Self {
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

/// Format of the frames that a configured instrument sends.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Setup {
    /// Identity of the instrument.
    pub identity: Identity,
    /// Electrodes of each value.
    pub layout: Layout,
    /// Number of values per frame, in that layout.
    pub value_count: usize,
    /// Whether values are complex.
    pub complex: bool,
    /// Unit of the values that the driver delivers.
    pub unit: Unit,
    /// Frames per second, if known.
    pub frame_rate_hz: Option<f64>,
    /// Values at which a frame is flagged as saturated, open or stuck.
    pub limits: Limits,
}

/// Limits on an instrument's values. The default has none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Limits {
    /// Magnitude of the largest value. Values within 0.1 % of it are flagged saturated, larger ones
    /// over range.
    pub full_scale: Option<f64>,
    /// Largest magnitude of an input with nothing connected.
    pub open_up_to: Option<f64>,
    /// Number of frames after which a value that stays constant while at least half of all values
    /// change is flagged stuck; `None` for never.
    pub stuck_frames: Option<u32>,
}
