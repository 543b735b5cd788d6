//! Content of the lines. Fields are described in `schema/touches.schema.json` and docs/JSON_LINES.md.

use eit_skin::faults::{ElectrodeFault, FaultKind};
use eit_skin::{Touch, TouchFrame, TouchState};
use serde::{Serialize, Serializer};

/// The first line: describes the skin and its source.
#[derive(Serialize)]
#[serde(tag = "type", rename = "start")]
pub(crate) struct StartLine<'a> {
    pub(crate) version: u32,
    pub(crate) skin: &'a str,
    pub(crate) instrument: &'a str,
    pub(crate) electrodes: usize,
    pub(crate) reference_frames: usize,
    pub(crate) host_time_s: Option<f64>,
}

/// An event between frames.
#[derive(Serialize, Default)]
#[serde(tag = "type", rename = "event")]
pub(crate) struct EventLine<'a> {
    pub(crate) event: &'static str,
    pub(crate) text: &'a str,
    pub(crate) host_time_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) frames: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) for_s: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) epoch: Option<u32>,
}

/// The touches of one frame.
#[derive(Serialize)]
#[serde(tag = "type", rename = "frame")]
pub(crate) struct FrameLine<'a> {
    sequence: u64,
    epoch: u32,
    time_s: f64,
    host_time_s: Option<f64>,
    latency_s: Option<f64>,
    whole: bool,
    explained: bool,
    frozen: bool,
    faulty_electrodes: Faults<'a>,
    touches: Touches<'a>,
}

impl<'a> From<&TouchFrame<'a>> for FrameLine<'a> {
    fn from(frame: &TouchFrame<'a>) -> Self {
        Self {
            sequence: frame.sequence,
            epoch: frame.epoch,
            time_s: frame.time_s,
            host_time_s: frame.host_time_s,
            latency_s: frame.latency_s,
            whole: frame.whole,
            explained: frame.explained,
            frozen: frame.frozen,
            faulty_electrodes: Faults(frame.faults),
            touches: Touches(frame.touches),
        }
    }
}

// serialised item by item, because collecting them first would allocate
struct Faults<'a>(&'a [ElectrodeFault]);

impl Serialize for Faults<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(FaultPart::from))
    }
}

struct Touches<'a>(&'a [Touch]);

impl Serialize for Touches<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(TouchPart::from))
    }
}

#[derive(Serialize)]
struct FaultPart {
    /// Number of the electrode, from 1.
    electrode: usize,
    fault: &'static str,
    since_s: f64,
}

impl From<&ElectrodeFault> for FaultPart {
    fn from(fault: &ElectrodeFault) -> Self {
        let kind = match fault.kind {
            FaultKind::Contradicts => "contradicts",
            FaultKind::Stuck => "stuck",
            FaultKind::Drifts => "drifts",
            FaultKind::Flagged => "flagged",
        };
        Self { electrode: fault.electrode + 1, fault: kind, since_s: fault.since_s }
    }
}

#[derive(Serialize)]
struct TouchPart {
    id: u64,
    state: &'static str,
    position_m: [f64; 3],
    position_std_m: [f64; 3],
    /// Present for touches found in frames.
    normal: Option<[f64; 3]>,
    velocity_m_s: [f64; 3],
    intensity_s_m2: f64,
    intensity_std_s_m2: Option<f64>,
    confidence: f64,
    valid: bool,
    whole: bool,
    age_s: f64,
    /// Known only if the skin has learnt from presses of known force.
    force_n: Option<f64>,
    force_std_n: Option<f64>,
    /// Whether the touch differs from all presses learnt; known only if the skin has learnt.
    unlike: Option<bool>,
    split_from: Option<u64>,
    merged_into: Option<u64>,
}

impl From<&Touch> for TouchPart {
    fn from(touch: &Touch) -> Self {
        Self {
            id: touch.id,
            state: match touch.state {
                TouchState::Begin => "begin",
                TouchState::Hold => "hold",
                TouchState::End => "end",
            },
            position_m: touch.position_m,
            position_std_m: touch.position_std_m(),
            normal: touch.normal,
            velocity_m_s: touch.velocity_m_s,
            intensity_s_m2: touch.intensity_s_m2,
            intensity_std_s_m2: touch.intensity_std_s_m2,
            confidence: touch.confidence,
            valid: touch.valid,
            whole: touch.whole,
            age_s: touch.age_s,
            force_n: touch.force_n(),
            force_std_n: touch.force_std_n(),
            unlike: touch.learnt.map(|learnt| learnt.is_unlike),
            split_from: touch.split_from,
            merged_into: touch.merged_into,
        }
    }
}
