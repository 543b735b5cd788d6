//! Watches frames for presses, and averages those of a press and of the untouched skin before it.

use super::{CollectedPress, Collecting};
use crate::error::SkinError;
use crate::learn::Press;
use crate::press_watch::{PressState, PressWatch};
use eit_hw::{Frame, Quality};
use std::collections::VecDeque;

/// Time before a press is noticed that is excluded from the untouched frames, because they may
/// already show the press, seconds.
const GUARD_S: f64 = 0.1;
/// Fewest untouched frames before a press.
const LEAST_BEFORE: usize = 3;

/// Frames, or the means of some, in the instrument's unit.
pub(super) type Values = Vec<f64>;

/// Watches for presses after the untouched skin is known.
#[derive(Debug)]
pub(super) struct Watch {
    watch: PressWatch,
    window: usize,
    guard: usize,
    /// Last frames, `window` at most.
    recent: VecDeque<Values>,
    /// Last frames of the untouched skin, and the number of the one after them.
    before: VecDeque<Values>,
    before_end: usize,
    /// Number of untouched frames without interruption.
    calm: usize,
}

impl Watch {
    /// Begins after these frames of the untouched skin; `end` is the number of the next one.
    pub(super) fn new(
        untouched: Vec<Values>,
        hold_s: f64,
        rate_hz: f64,
        end: usize,
    ) -> Result<Self, SkinError> {
        let window = ((hold_s * rate_hz) as usize).clamp(4, 1000);
        let guard = ((GUARD_S * rate_hz).ceil() as usize).clamp(1, window);
        let (watch, calm) = (PressWatch::new(&untouched, window)?, untouched.len());
        let before = untouched.into_iter().skip(calm.saturating_sub(window + guard)).collect();
        let recent = VecDeque::with_capacity(window);
        Ok(Self { watch, window, guard, recent, before, before_end: end, calm })
    }

    /// Takes the next frame, of this number.
    pub(super) fn push(&mut self, values: Values, number: usize) -> Collecting {
        let state = self.watch.push(&values);
        if self.recent.len() == self.window {
            self.recent.pop_front();
        }
        self.recent.push_back(values.clone());
        match state {
            PressState::Untouched => {
                if self.calm == 0 {
                    self.before.clear();
                }
                if self.before.len() == self.window + self.guard {
                    self.before.pop_front();
                }
                self.before.push_back(values);
                self.before_end = number + 1;
                self.calm += 1;
                // a press may begin with the next frame
                match self.calm >= self.window.max(self.guard + LEAST_BEFORE) {
                    true => Collecting::Waiting,
                    false => Collecting::Settling,
                }
            }
            state => {
                self.calm = 0;
                match state {
                    PressState::Held(_) => Collecting::Collected,
                    PressState::StillHeld => Collecting::Held,
                    _ => Collecting::Unsteady,
                }
            }
        }
    }

    /// The press that has just been held; `None` if too few untouched frames precede it.
    pub(super) fn press(&mut self, number: usize) -> Option<CollectedPress> {
        let count = self.before.len().checked_sub(self.guard).filter(|n| *n >= LEAST_BEFORE)?;
        let last = self.before_end - self.guard - 1;
        let press = Press {
            first_frame: Some(number + 1 - self.recent.len()),
            last_frame: Some(number),
            before_first: Some(last + 1 - count),
            before_last: Some(last),
            ..Press::default()
        };
        let (values, reference) = (mean(self.recent.iter()), mean(self.before.iter().take(count)));
        // a second press must have untouched frames of its own
        self.before.clear();
        Some(CollectedPress { press, values, reference })
    }
}

/// Values of a frame, NaN where they are flagged.
pub(super) fn good_values(frame: &Frame) -> Values {
    let good = |(value, quality): (&f64, &Quality)| match quality.is_good() {
        true => *value,
        false => f64::NAN,
    };
    frame.values.iter().zip(&frame.quality).map(good).collect()
}

/// Mean of the good values; NaN if there is none.
pub(super) fn mean<'a>(frames: impl Iterator<Item = &'a Values>) -> Values {
    let (mut sums, mut counts): (Values, Vec<f64>) = (Vec::new(), Vec::new());
    for frame in frames {
        sums.resize(frame.len(), 0.0);
        counts.resize(frame.len(), 0.0);
        for ((sum, count), value) in sums.iter_mut().zip(&mut counts).zip(frame) {
            if value.is_finite() {
                *sum += value;
                *count += 1.0;
            }
        }
    }
    sums.iter().zip(counts).map(|(sum, count)| sum / count).collect()
}
