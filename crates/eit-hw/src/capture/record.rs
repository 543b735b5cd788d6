//! Content of a recording's messages other than frames.

use std::borrow::Cow;

use serde::de::IgnoredAny;
use serde::{Deserialize, Serialize};

use super::json::bounded;

use crate::driver::setup::Setup;
use crate::frame::Quadruple;
use crate::recording::Unit;

/// Describes what was recorded and with which instrument: the first message of a recording,
/// repeated whenever it changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionRecord {
    /// Name of the driver.
    pub driver: String,
    /// Model or type of the instrument.
    pub instrument: String,
    /// Serial number or other identifier of this unit.
    pub serial: String,
    /// Unit of the values: `volt`, `ohm` or `arbitrary`.
    pub unit: UnitName,
    /// Electrodes `[a, b, m, n]` of each value; empty if values are in the scene's order.
    #[serde(deserialize_with = "bounded")]
    pub quadruples: Vec<Quadruple>,
    /// Amplitude of the drive current in ampere.
    #[serde(default)]
    pub current_a: Option<f64>,
    /// Frequency of the drive current in hertz.
    #[serde(default)]
    pub frequency_hz: Option<f64>,
    /// Frames per second.
    #[serde(default)]
    pub frame_rate_hz: Option<f64>,
    /// Text of the scene file; empty if there is none.
    #[serde(default)]
    pub scene_toml: String,
    /// Program that made the recording.
    #[serde(default)]
    pub recorder: String,
    /// Whether this repeats the session at the start of a further part of a split recording, whose
    /// frames continue those of the previous part.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub continues: bool,
}

impl SessionRecord {
    /// Creates the record of an instrument whose frames hold `quadruples`, such as the
    /// [`quadruples`](crate::driver::SessionSettings::quadruples) of its session.
    pub fn of(setup: &Setup, quadruples: &[Quadruple]) -> Self {
        Self {
            driver: setup.identity.driver.to_owned(),
            instrument: setup.identity.name.clone(),
            serial: setup.identity.serial.clone(),
            unit: setup.unit.into(),
            quadruples: quadruples.to_vec(),
            frame_rate_hz: setup.frame_rate_hz,
            recorder: concat!("eit-hw ", env!("CARGO_PKG_VERSION")).to_owned(),
            ..Self::default()
        }
    }
}

/// Unit of the values, serialised by name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UnitName {
    /// Voltages in volts.
    Volt,
    /// Values are in ohms: voltage over current.
    Ohm,
    /// The unit is not known.
    #[default]
    Arbitrary,
}

impl From<Unit> for UnitName {
    fn from(unit: Unit) -> Self {
        match unit {
            Unit::Volt => Self::Volt,
            Unit::Ohm => Self::Ohm,
            Unit::Arbitrary => Self::Arbitrary,
        }
    }
}

impl From<UnitName> for Unit {
    fn from(name: UnitName) -> Self {
        match name {
            UnitName::Volt => Self::Volt,
            UnitName::Ohm => Self::Ohm,
            UnitName::Arbitrary => Self::Arbitrary,
        }
    }
}

/// A new reference frame: subtracted from the frames that follow, within its epoch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceRecord {
    /// Epoch in which the reference is valid.
    pub epoch: u32,
    /// Mean of the frames, values in their order; `null` if not finite.
    #[serde(deserialize_with = "bounded")]
    pub values: Vec<Option<f64>>,
    /// Sequence numbers of these frames, in their order; empty if not known.
    #[serde(default, deserialize_with = "bounded", skip_serializing_if = "Vec::is_empty")]
    pub sequences: Vec<u64>,
    /// Number of the last frame that was not searched for touches, because their detector was not set up; `None`: the last of
    /// `sequences`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until: Option<u64>,
}

/// The touches of one frame, also of an untouched one: the JSON object that other outputs have for a frame, with at least `sequence` and
/// `touches` (docs/JSON_LINES.md). Kept as text: this crate finds no touches.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(Serialize, Deserialize))]
pub struct TouchesRecord {
    sequence: u64,
    json: String,
}

impl TouchesRecord {
    /// Takes a JSON object; `None` if it is none or lacks `sequence` or a list of `touches`.
    pub fn new(json: String) -> Option<Self> {
        #[derive(Deserialize)]
        struct Head {
            sequence: u64,
            #[serde(rename = "touches")]
            _touches: Vec<IgnoredAny>,
        }
        let head: Head = serde_json::from_str(&json).ok()?;
        Some(Self { sequence: head.sequence, json })
    }

    /// Sequence number of the frame.
    pub fn sequence(&self) -> u64 {
        self.sequence
    }

    /// The object.
    pub fn json(&self) -> &str {
        &self.json
    }
}

/// A text note.
#[derive(Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NoteRecord<'a> {
    pub(super) text: Cow<'a, str>,
}
