//! Publishing only what has changed, with a heartbeat by which silence is told.

use crate::outbox::FrameCopy;
use eit_skin::{Touch, TouchState};
use std::time::{Duration, Instant};

/// How much a touch must change to be published before the next heartbeat. Touches that begin or end, electrodes
/// that fail or recover, and changes of `valid` and `whole` are always published.
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
    /// `None`: every frame.
    threshold: Option<ChangeThreshold>,
    heartbeat: Duration,
    last: Option<(Instant, FrameCopy)>,
}

impl ChangeFilter {
    pub fn new(threshold: Option<ChangeThreshold>, heartbeat: Duration) -> Self {
        Self { threshold, heartbeat, last: None }
    }

    /// Whether this frame is published, which arrived now; then the next one is compared with it.
    pub fn wants(&mut self, frame: &FrameCopy, now: Instant) -> bool {
        let Some(threshold) = self.threshold else { return true };
        let is_wanted = self.last.as_ref().is_none_or(|(at, last)| {
            let faults = |frame: &FrameCopy| frame.faults.len();
            // half a millisecond: frames that come as often as heartbeats jitter
            now.duration_since(*at) + Duration::from_micros(500) >= self.heartbeat
                || (last.epoch, last.whole, faults(last))
                    != (frame.epoch, frame.whole, faults(frame))
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
