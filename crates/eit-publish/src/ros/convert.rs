//! Frames of the skin to messages.

use super::message::{ElectrodeFaultMessage, TouchMessage, touch_state};
use eit_skin::faults::{ElectrodeFault, FaultKind};
use eit_skin::{Touch, TouchState};

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
