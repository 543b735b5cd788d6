//! Crash-safe recordings of a live instrument in MCAP (feature `mcap`).
//!
//! [MCAP](https://mcap.dev) is a container of time-stamped messages that names its own schemas, so
//! any MCAP tool shows a recording without this crate. Messages are JSON, in chunks with a CRC each,
//! compressed with LZ4, and the file ends with an index. A chunk is written at the latest one second
//! after its first message: whatever kills the program, all that came before the last second is
//! read back. docs/RECORDING.md has the schemas.

mod json;
mod read;
mod stream;
mod write;

use std::sync::LazyLock;

use serde::{Deserialize, Serialize};

use json::{FrameJson, FrameRecord};
pub use read::{Capture, Damage, parse, read};
pub use stream::CaptureReader;
pub use write::{CaptureSettings, CaptureWriter};

use crate::driver::Setup;
use crate::error::HwError;
use crate::frame::{Frame, Quadruple};

/// First bytes of an MCAP file.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

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

impl From<crate::Unit> for UnitName {
    fn from(unit: crate::Unit) -> Self {
        match unit {
            crate::Unit::Volt => Self::Volt,
            crate::Unit::Ohm => Self::Ohm,
            crate::Unit::Arbitrary => Self::Arbitrary,
        }
    }
}

impl From<UnitName> for crate::Unit {
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
    pub values: Vec<Option<f64>>,
}

/// Touches found in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TouchesRecord {
    /// Sequence of the frame.
    pub sequence: u64,
    /// The touches.
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

/// The topics of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Topic {
    Session,
    Frame,
    Reference,
    Touches,
    Note,
}

impl Topic {
    const ALL: [Self; 5] = [Self::Session, Self::Frame, Self::Reference, Self::Touches, Self::Note];

    const fn name(self) -> &'static str {
        match self {
            Self::Session => "/eit/session",
            Self::Frame => "/eit/frame",
            Self::Reference => "/eit/reference",
            Self::Touches => "/eit/touches",
            Self::Note => "/eit/note",
        }
    }

    const fn schema(self) -> (&'static str, &'static str) {
        match self {
            Self::Session => ("eit.Session", include_str!("capture/session.schema.json")),
            Self::Frame => ("eit.Frame", include_str!("capture/frame.schema.json")),
            Self::Reference => ("eit.Reference", include_str!("capture/reference.schema.json")),
            Self::Touches => ("eit.Touches", include_str!("capture/touches.schema.json")),
            Self::Note => ("eit.Note", include_str!("capture/note.schema.json")),
        }
    }
}

/// Something that was said.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NoteRecord {
    text: String,
}

/// A [`NoteRecord`] to be written.
#[derive(Serialize)]
struct NoteJson<'a> {
    text: &'a str,
}

/// One message of a recording, in their order.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Entry {
    /// What the following frames are.
    Session(SessionRecord),
    /// A frame.
    Frame(Frame),
    /// A reference.
    Reference(ReferenceRecord),
    /// Touches.
    Touches(TouchesRecord),
    /// A note.
    Note(String),
}

impl Entry {
    fn from_json(topic: Topic, json: &[u8]) -> Option<Self> {
        match topic {
            Topic::Session => serde_json::from_slice(json).ok().map(Self::Session),
            Topic::Frame => serde_json::from_slice::<FrameRecord>(json)
                .ok()
                .and_then(FrameRecord::into_frame)
                .map(Self::Frame),
            Topic::Reference => serde_json::from_slice(json).ok().map(Self::Reference),
            Topic::Touches => serde_json::from_slice(json).ok().map(Self::Touches),
            Topic::Note => serde_json::from_slice::<NoteRecord>(json)
                .ok()
                .map(|record| Self::Note(record.text)),
        }
    }
}

/// The metadata of every channel: none.
static NO_METADATA: LazyLock<std::collections::BTreeMap<String, String>> =
    LazyLock::new(std::collections::BTreeMap::new);

/// What the container says, as an error of this crate.
fn container(place: crate::Place, what: &impl ToString) -> HwError {
    let what = what.to_string().replace(char::is_control, "?");
    HwError::Container { place, what, mend: "record it anew" }
}
