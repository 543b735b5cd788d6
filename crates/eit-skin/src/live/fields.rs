//! The fields by which every output names a touch, a faulty electrode and a frame (docs/JSON_LINES.md).

use super::LiveImages;
use crate::faults::{ElectrodeFault, FaultKind};
use eit_inverse::touch::{Touch, TouchState};
use serde::{Serialize, Serializer};

/// What is known of the skin at the time of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SkinState {
    /// Touches, or the absence of any, explain the frame.
    #[default]
    Sound,
    /// They do not: it is something else, such as a fault that is not known yet. No touch is valid.
    NotExplained,
    /// The instrument repeats an old frame.
    Frozen,
    /// The reference is being taken.
    Reference,
    /// The instrument is silent or gone, or the run is over. All touches have ended.
    NoData,
}

impl SkinState {
    /// The name that outputs have for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sound => "sound",
            Self::NotExplained => "not_explained",
            Self::Frozen => "frozen",
            Self::Reference => "reference",
            Self::NoData => "no_data",
        }
    }

    /// Says why the touches are not known; `None` if they are.
    pub fn why_not_known(self) -> Option<&'static str> {
        match self {
            Self::Sound => None,
            Self::NotExplained => Some("touches do not explain the frame"),
            Self::Frozen => Some("the instrument repeats an old frame"),
            Self::Reference => Some("the reference is being taken: touch nothing"),
            Self::NoData => Some("no data"),
        }
    }
}

/// The touches of one frame, and its image if images are made.
#[derive(Debug, Clone, Copy, Default)]
pub struct TouchFrame<'a> {
    /// Number of frames shown before it since the start.
    pub number: u64,
    /// Sequence number assigned by the instrument; gaps are lost frames.
    pub sequence: u64,
    /// Number of the connection, from 0; it increases when a lost instrument is found again.
    pub epoch: u32,
    /// Time of the frame, seconds: the instrument's, else that of its arrival. It increases over the whole session,
    /// also where an instrument that was found again begins at 0.
    pub time_s: f64,
    /// Time when its last byte arrived by this computer's clock, seconds since 1970.
    pub host_time_s: Option<f64>,
    /// What is known of the skin.
    pub state: SkinState,
    /// Touches. Empty if nothing touches the skin, and if nothing is known of it: see `state`, `whole`.
    pub touches: &'a [Touch],
    /// Electrodes excluded from the frame: open, shorted, noisy, stuck or drifting.
    pub faults: &'a [ElectrodeFault],
    /// Whether every used measurement counted: no faulty electrode or bad value was excluded.
    pub whole: bool,
    /// Conductivity change of the faintest touch, siemens.
    pub level_s: f64,
    /// Time from the last byte of a live frame to its touches, seconds.
    pub latency_s: Option<f64>,
    /// The image, if images are made and this one has been.
    pub images: Option<&'a LiveImages>,
    /// Time from the last byte of a live frame to its image, seconds.
    pub image_latency_s: Option<f64>,
}

/// A frame and its touches.
#[derive(Serialize)]
struct FrameFields<'a> {
    sequence: u64,
    epoch: u32,
    time_s: f64,
    host_time_s: Option<f64>,
    latency_s: Option<f64>,
    state: &'static str,
    whole: bool,
    explained: bool,
    frozen: bool,
    faulty_electrodes: Faults<'a>,
    touches: Touches<'a>,
}

impl Serialize for TouchFrame<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let fields = FrameFields {
            sequence: self.sequence,
            epoch: self.epoch,
            time_s: self.time_s,
            host_time_s: self.host_time_s,
            latency_s: self.latency_s,
            state: self.state.name(),
            whole: self.whole,
            explained: self.state == SkinState::Sound,
            frozen: self.state == SkinState::Frozen,
            faulty_electrodes: Faults(self.faults),
            touches: Touches(self.touches),
        };
        fields.serialize(serializer)
    }
}

// serialised item by item, because collecting them first would allocate
struct Faults<'a>(&'a [ElectrodeFault]);

impl Serialize for Faults<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(FaultFields::from))
    }
}

struct Touches<'a>(&'a [Touch]);

impl Serialize for Touches<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(TouchFields::from))
    }
}

#[derive(Serialize)]
struct FaultFields {
    /// Number of the electrode, from 1.
    electrode: usize,
    fault: &'static str,
    since_s: f64,
}

impl From<&ElectrodeFault> for FaultFields {
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

/// The fields of a touch, by the names that every output has for them. Lengths in metres, times in seconds, forces in newtons.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[allow(missing_docs, reason = "docs/JSON_LINES.md describes the fields of all outputs")]
pub struct TouchFields {
    pub id: u64,
    /// `begin`, `hold` or `end`.
    pub state: &'static str,
    pub position_m: [f64; 3],
    pub position_std_m: [f64; 3],
    pub normal: Option<[f64; 3]>,
    pub velocity_m_s: [f64; 3],
    pub intensity_s_m2: f64,
    pub intensity_std_s_m2: Option<f64>,
    pub confidence: f64,
    pub valid: bool,
    pub whole: bool,
    pub age_s: f64,
    pub force_n: Option<f64>,
    pub force_std_n: Option<f64>,
    pub unlike: Option<bool>,
    pub split_from: Option<u64>,
    pub merged_into: Option<u64>,
}

/// The name that outputs have for a state of a touch.
fn touch_state_name(state: TouchState) -> &'static str {
    match state {
        TouchState::Begin => "begin",
        TouchState::Hold => "hold",
        TouchState::End => "end",
    }
}

impl From<&Touch> for TouchFields {
    fn from(touch: &Touch) -> Self {
        Self {
            id: touch.id,
            state: touch_state_name(touch.state),
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
