//! Quality flags derived from the values themselves.

use super::decoded::RawFrame;
use super::setup::Limits;
use crate::frame::Quality;

/// Sets quality flags for the values of one stream.
#[derive(Clone, Debug)]
pub(super) struct Marker {
    limits: Limits,
    last: Vec<[f64; 2]>,
    same: Vec<u32>,
    is_first: bool,
    pub(super) quality: Vec<Quality>,
}

impl Marker {
    pub(super) fn new(limits: Limits, value_count: usize) -> Self {
        Self {
            limits,
            last: vec![[0.0; 2]; value_count],
            same: vec![0; value_count],
            is_first: true,
            quality: vec![Quality::GOOD; value_count],
        }
    }

    /// Fills `quality` with the frame's own flags and those derived from its values, whose number
    /// was given to [`Marker::new`].
    pub(super) fn mark(&mut self, frame: &RawFrame<'_>) {
        let mut changed = 0;
        let value = |index: usize| {
            let part = |parts: &[f64]| parts.get(index).copied().unwrap_or_default();
            [part(frame.values), part(frame.imaginary)]
        };
        for (index, quality) in self.quality.iter_mut().enumerate() {
            let parts = value(index);
            *quality = frame.quality.get(index).copied().unwrap_or_default();
            let size = parts[0].abs().max(parts[1].abs());
            if parts.iter().any(|part| !part.is_finite()) {
                // the driver itself sets missing values to NaN
                if !quality.contains(Quality::MISSING) {
                    *quality |= Quality::NON_FINITE;
                }
            } else {
                if self.limits.full_scale.is_some_and(|limit| size > 1.001 * limit) {
                    *quality |= Quality::OVER_RANGE;
                } else if self.limits.full_scale.is_some_and(|limit| size >= 0.999 * limit) {
                    *quality |= Quality::SATURATED;
                }
                if self.limits.open_up_to.is_some_and(|limit| size <= limit) {
                    *quality |= Quality::OPEN;
                }
            }
            if parts != self.last[index] {
                changed += 1;
            }
        }
        self.mark_stuck(changed, value);
    }

    fn mark_stuck(&mut self, changed: usize, value: impl Fn(usize) -> [f64; 2]) {
        let Some(most) = self.limits.stuck_frames else { return };
        let others_live = 2 * changed >= self.quality.len() && !self.is_first;
        self.is_first = false;
        let slots = self.last.iter_mut().zip(&mut self.same).zip(&mut self.quality);
        for (index, ((last, same), quality)) in slots.enumerate() {
            let now = value(index);
            if now != *last {
                (*last, *same) = (now, 0);
            } else if others_live {
                *same = same.saturating_add(1);
            }
            if *same >= most.max(1) {
                *quality |= Quality::STUCK;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(values: &[f64]) -> RawFrame<'_> {
        RawFrame { values, imaginary: &[], quality: &[], counter: None, device_time_s: None }
    }

    #[test]
    fn flags_by_value() {
        let limits =
            Limits { full_scale: Some(1.0), open_up_to: Some(1e-6), stuck_frames: Some(3) };
        let mut marker = Marker::new(limits, 5);
        marker.mark(&frame(&[0.5, 1.0, -1.2, f64::NAN, 0.0]));
        let wanted = [
            Quality::GOOD,
            Quality::SATURATED,
            Quality::OVER_RANGE,
            Quality::NON_FINITE,
            Quality::OPEN,
        ];
        assert_eq!(marker.quality, wanted);
        for step in 1..=3 {
            let live = f64::from(step) / 10.0;
            marker.mark(&frame(&[0.5, live, live, live, live]));
            assert_eq!(marker.quality[0].contains(Quality::STUCK), step == 3);
        }
        // if nothing changes the whole stream has stopped, and no value counts as stuck
        let mut still = Marker::new(limits, 2);
        (0..9).for_each(|_| still.mark(&frame(&[0.5, 0.4])));
        assert_eq!(still.quality, [Quality::GOOD; 2]);
    }
}
