//! Publishes only what has changed, with a heartbeat that shows that the sender is alive.

use crate::outbox::FrameCopy;
use eit_skin::{Touch, TouchState};
use std::time::{Duration, Instant};

/// How much a touch must change to be published before the next heartbeat. Touches that begin or end,
/// electrodes that fail or recover, and changes of `valid`, `whole` and the state of the skin are always published.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangeThreshold {
    /// Movement since it was last published, metres.
    pub position_m: f64,
    /// Change of its intensity since then, relative.
    pub intensity: f64,
    /// Change of its force since then, newtons.
    pub force_n: f64,
}

impl Default for ChangeThreshold {
    /// Half a millimetre, 5 %, 0.05 N.
    fn default() -> Self {
        Self { position_m: 5e-4, intensity: 0.05, force_n: 0.05 }
    }
}

impl ChangeThreshold {
    fn has_changed(&self, before: &Touch, now: &Touch) -> bool {
        let moved = (0..3).map(|axis| (now.position_m[axis] - before.position_m[axis]).powi(2));
        let strength = (now.intensity_s_m2 - before.intensity_s_m2).abs();
        let force = match (before.force_n(), now.force_n()) {
            (Some(before), Some(now)) => (now - before).abs() > self.force_n,
            (before, now) => before.is_some() != now.is_some(),
        };
        before.id != now.id
            || (now.state != TouchState::Hold || before.state == TouchState::End)
            || (before.valid, before.whole) != (now.valid, now.whole)
            || moved.sum::<f64>().sqrt() > self.position_m
            || strength > self.intensity * before.intensity_s_m2.abs()
            || force
    }
}

/// Decides which frames are published.
#[derive(Debug)]
pub(crate) struct ChangeFilter {
    /// Thresholds; `None` publishes every frame.
    threshold: Option<ChangeThreshold>,
    heartbeat: Duration,
    last: Option<(Instant, FrameCopy)>,
}

impl ChangeFilter {
    pub(crate) fn new(threshold: Option<ChangeThreshold>, heartbeat: Duration) -> Self {
        Self { threshold, heartbeat, last: None }
    }

    /// Decides whether to publish this frame, which arrived at `now`; if so, later frames are compared with it.
    pub(crate) fn wants(&mut self, frame: &FrameCopy, now: Instant) -> bool {
        let Some(threshold) = self.threshold else { return true };
        let is_wanted = self.last.as_ref().is_none_or(|(at, last)| {
            let faults = |frame: &FrameCopy| frame.faults.len();
            // half a millisecond: frames that come as often as heartbeats jitter
            now.duration_since(*at) + Duration::from_micros(500) >= self.heartbeat
                || (last.epoch, last.whole, last.state, faults(last))
                    != (frame.epoch, frame.whole, frame.state, faults(frame))
                || last.touches.len() != frame.touches.len()
                || last.faults.iter().zip(&frame.faults).any(|(a, b)| a != b)
                || last
                    .touches
                    .iter()
                    .zip(&frame.touches)
                    .any(|(before, now)| threshold.has_changed(before, now))
        });
        if is_wanted {
            let mut memory = self.last.take().map(|(_, copy)| copy).unwrap_or_default();
            memory.clone_from(frame);
            self.last = Some((now, memory));
        }
        is_wanted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touch() -> Touch {
        Touch {
            id: 1,
            state: TouchState::Hold,
            position_m: [0.0; 3],
            normal: None,
            position_covariance_m2: [[0.0; 3]; 3],
            velocity_m_s: [0.0; 3],
            intensity_s_m2: -1e-11,
            intensity_std_s_m2: None,
            peak_s: 0.0,
            confidence: 1.0,
            age_frames: 9,
            age_s: 0.09,
            valid: true,
            whole: true,
            split_from: None,
            merged_into: None,
            learnt: None,
        }
    }

    fn frame(touches: &[Touch]) -> FrameCopy {
        FrameCopy { touches: touches.to_vec(), whole: true, ..FrameCopy::default() }
    }

    /// Each change is published at once, and only once before the heartbeat.
    #[test]
    fn what_changes_is_published() {
        let heartbeat = Duration::from_millis(100);
        let mut filter = ChangeFilter::new(Some(ChangeThreshold::default()), heartbeat);
        let start = Instant::now();
        let learnt = |force_n| {
            let force_n = Some([force_n, 0.1]);
            Touch { learnt: Some(eit_skin::LearntTouch { force_n, is_unlike: false }), ..touch() }
        };
        let sequence = [
            (vec![], true),
            (vec![], false),
            (vec![Touch { state: TouchState::Begin, ..touch() }], true),
            (vec![touch()], false),
            (vec![Touch { position_m: [4e-4, 0.0, 0.0], ..touch() }], false),
            (vec![Touch { position_m: [4e-4, 4e-4, 0.0], ..touch() }], true),
            (
                vec![Touch { position_m: [4e-4, 4e-4, 0.0], intensity_s_m2: -1.04e-11, ..touch() }],
                false,
            ),
            (
                vec![Touch { position_m: [4e-4, 4e-4, 0.0], intensity_s_m2: -1.06e-11, ..touch() }],
                true,
            ),
            (vec![Touch { valid: false, ..touch() }], true),
            (vec![learnt(1.0)], true),
            (vec![learnt(1.04)], false),
            (vec![learnt(1.06)], true),
            (vec![Touch { id: 2, ..learnt(1.06) }], true),
            (vec![Touch { id: 2, state: TouchState::End, ..learnt(1.06) }], true),
            (vec![], true),
            (vec![], false),
        ];
        for (step, (touches, wanted)) in sequence.iter().enumerate() {
            assert_eq!(filter.wants(&frame(touches), start), *wanted, "step {step}");
        }
        let whole = FrameCopy { whole: false, ..frame(&[]) };
        assert!(filter.wants(&whole, start) && !filter.wants(&whole, start));
        let reconnected = FrameCopy { epoch: 1, ..whole.clone() };
        assert!(filter.wants(&reconnected, start));
        assert!(!filter.wants(&reconnected, start + heartbeat / 2));
        assert!(filter.wants(&reconnected, start + heartbeat));
        let mut every = ChangeFilter::new(None, heartbeat);
        assert!(every.wants(&whole, start) && every.wants(&whole, start));
    }
}
