//! What messages of a recording hold, beside frames.

use serde::{Deserialize, Serialize};

use super::json::bounded;

use crate::driver::setup::Setup;
use crate::frame::Quadruple;
use crate::recording::Unit;

/// What was recorded, and with what: the first message of a recording, and another one each time
/// that it changes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SessionRecord {
    /// Name of the driver.
    pub driver: String,
    /// Kind of instrument.
    pub instrument: String,
    /// What tells it from others of its kind.
    pub serial: String,
    /// Unit of the values: `volt`, `ohm` or `arbitrary`.
    pub unit: UnitName,
    /// Electrodes `[a, b, m, n]` of each value; empty: in the order of the scene.
    #[serde(deserialize_with = "bounded")]
    pub quadruples: Vec<Quadruple>,
    /// Amplitude of the drive current in ampere.
    #[serde(default)]
    pub current_a: Option<f64>,
    /// Its frequency in hertz.
    #[serde(default)]
    pub frequency_hz: Option<f64>,
    /// Frames a second.
    #[serde(default)]
    pub frame_rate_hz: Option<f64>,
    /// The scene file, as it was; empty where there is none.
    #[serde(default)]
    pub scene_toml: String,
    /// Program that recorded it.
    #[serde(default)]
    pub recorder: String,
}

impl SessionRecord {
    /// The record of an instrument whose frames hold these measurements, such as the
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

/// A unit by its name.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UnitName {
    /// Volt.
    Volt,
    /// Ohm.
    Ohm,
    /// Not known.
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

/// A reference frame that was taken: the one that is subtracted from now on, within its epoch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceRecord {
    /// Epoch in which it holds.
    pub epoch: u32,
    /// Its values, in the order of the frames; `null` where one is not finite.
    #[serde(deserialize_with = "bounded")]
    pub values: Vec<Option<f64>>,
}

/// Touches found in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TouchesRecord {
    /// Sequence of the frame.
    pub sequence: u64,
    /// The touches.
    #[serde(deserialize_with = "bounded")]
    pub touches: Vec<TouchRecord>,
}

/// One touch.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TouchRecord {
    /// Number that it keeps while it lasts. Earlier recordings call it `name`.
    #[serde(alias = "name")]
    pub id: u64,
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Radius in metres.
    pub radius_m: Option<f64>,
    /// Force in newton, where it is calibrated.
    pub force_n: Option<f64>,
}

/// Something that was said.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NoteRecord {
    pub(super) text: String,
}

/// A [`NoteRecord`] to be written.
#[derive(Serialize)]
pub(super) struct NoteJson<'a> {
    pub(super) text: &'a str,
}
