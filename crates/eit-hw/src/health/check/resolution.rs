//! Step size of the converter compared with the size of a touch.

use crate::recording::MeasuredFrames;
use eit_core::median;

/// Relative change of the median voltage by a touch. A finger on fabric changes measurements next
/// to it by some per cent, those across the skin by a tenth of that.
const TOUCH: f64 = 0.01;
/// Number of steps per touch below which the converter is coarse.
const FEW_STEPS: f64 = 4.0;
/// Relative difference below which two values differ only by rounding.
const ROUNDING: f64 = 1e-9;

/// Resolution of an instrument, estimated from quiet frames.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Resolution {
    /// Smallest change from frame to frame, in the unit of the values.
    pub step: f64,
    /// Number of steps in a touch that changes the median voltage by 1 %.
    pub steps_per_touch: f64,
    /// Number of measurements that never change.
    pub still: usize,
}

impl Resolution {
    /// Estimates the resolution from frames whose mean is `mean`; returns `None` if nothing
    /// changes.
    pub(super) fn of(frames: &MeasuredFrames, mean: &[f64]) -> Option<Self> {
        let (mut step, mut still) = (f64::INFINITY, 0);
        for (values, quality) in frames.values.columns().into_iter().zip(frames.quality.columns()) {
            let good = values.iter().zip(quality).filter(|(v, q)| v.is_finite() && q.is_good());
            let (mut before, mut changes) = (None, false);
            for (&value, _) in good {
                if let Some(before) = before {
                    let change: f64 = f64::abs(value - before);
                    if change > ROUNDING * value.abs() {
                        step = step.min(change);
                        changes = true;
                    }
                }
                before = Some(value);
            }
            still += usize::from(!changes);
        }
        let sizes = mean.iter().map(|value| value.abs()).filter(|value| value.is_finite());
        let touch = TOUCH * median(sizes)?;
        step.is_finite().then(|| Self { step, steps_per_touch: touch / step, still })
    }

    /// Returns whether touches are lost in the steps: a touch has few, and some measurements never
    /// change.
    pub(super) fn is_coarse(&self) -> bool {
        self.steps_per_touch < FEW_STEPS && self.still > 0
    }
}
