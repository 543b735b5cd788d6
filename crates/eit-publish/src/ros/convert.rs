//! Frames of the skin to messages.

use super::message::{ElectrodeFaultMessage, TouchMessage, touch_state};
use eit_skin::faults::{ElectrodeFault, FaultKind};
use eit_skin::{Touch, TouchFields, TouchState};

impl From<&ElectrodeFault> for ElectrodeFaultMessage {
    fn from(fault: &ElectrodeFault) -> Self {
        Self {
            electrode: u16::try_from(fault.electrode + 1).unwrap_or(u16::MAX),
            kind: match fault.kind {
                FaultKind::Contradicts => 0,
                FaultKind::Stuck => 1,
                FaultKind::Drifts => 2,
                FaultKind::Flagged => 3,
            },
            since: fault.since_s,
        }
    }
}

/// The fields of all outputs: what a message has no value for is unknown.
impl From<&TouchMessage> for TouchFields {
    fn from(touch: &TouchMessage) -> Self {
        let known = |value: f64| Some(value).filter(|value| value.is_finite());
        let other = |id: u64| Some(id).filter(|id| *id > 0);
        let normal = <[f64; 3]>::from(touch.normal);
        Self {
            id: touch.id,
            state: match touch.state {
                touch_state::BEGIN => "begin",
                touch_state::END => "end",
                _ => "hold",
            },
            position_m: touch.position.into(),
            position_std_m: [0, 4, 8].map(|index| touch.position_covariance[index].max(0.0).sqrt()),
            normal: Some(normal).filter(|normal| normal.iter().all(|part| part.is_finite())),
            velocity_m_s: touch.velocity.into(),
            intensity_s_m2: touch.intensity,
            intensity_std_s_m2: known(touch.intensity_std),
            confidence: touch.confidence,
            valid: touch.valid,
            whole: touch.whole,
            age_s: touch.age,
            force_n: known(touch.force),
            force_std_n: known(touch.force_std),
            unlike: [None, Some(false), Some(true)][usize::from(touch.likeness.min(2))],
            split_from: other(touch.split_from),
            merged_into: other(touch.merged_into),
        }
    }
}

impl From<&Touch> for TouchMessage {
    fn from(touch: &Touch) -> Self {
        let [a, b, c] = touch.position_covariance_m2;
        let mut position_covariance = [0.0; 9];
        for (row, values) in position_covariance.chunks_exact_mut(3).zip([a, b, c]) {
            row.copy_from_slice(&values);
        }
        Self {
            id: touch.id,
            state: match touch.state {
                TouchState::Begin => touch_state::BEGIN,
                TouchState::Hold => touch_state::HOLD,
                TouchState::End => touch_state::END,
            },
            position: touch.position_m.into(),
            position_covariance,
            normal: touch.normal.unwrap_or([f64::NAN; 3]).into(),
            velocity: touch.velocity_m_s.into(),
            intensity: touch.intensity_s_m2,
            intensity_std: touch.intensity_std_s_m2.unwrap_or(f64::NAN),
            force: touch.force_n().unwrap_or(f64::NAN),
            force_std: touch.force_std_n().unwrap_or(f64::NAN),
            confidence: touch.confidence,
            age: touch.age_s,
            valid: touch.valid,
            whole: touch.whole,
            likeness: match touch.learnt {
                None => 0,
                Some(learnt) if learnt.is_unlike => 2,
                Some(_) => 1,
            },
            split_from: touch.split_from.unwrap_or(0),
            merged_into: touch.merged_into.unwrap_or(0),
        }
    }
}
