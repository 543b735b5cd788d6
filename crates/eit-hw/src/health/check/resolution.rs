//! Steps of the converter against the size of a touch.

use super::measure::median;
use crate::recording::MeasuredFrames;

/// Part of the median voltage that a touch changes. A finger on fabric changes measurements beside it
/// by some per cent, those across the skin by a tenth of that.
const TOUCH: f64 = 0.01;
/// With fewer steps a touch is coarse.
const FEW_STEPS: f64 = 4.0;
/// Values that differ by less than this part of their size differ by rounding.
const ROUNDING: f64 = 1e-9;

/// How finely an instrument tells values apart, as its quiet frames show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resolution {
    /// The smallest change from frame to frame, in the unit of the values.
    pub step: f64,
    /// Steps of a touch that changes the median voltage by 1 %.
    pub steps_per_touch: f64,
    /// Measurements that never change.
    pub still: usize,
}

impl Resolution {
    /// Of frames whose mean is `mean`; `None` where nothing changes.
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
        let sizes: Vec<f64> =
            mean.iter().map(|value| value.abs()).filter(|value| value.is_finite()).collect();
        let touch = TOUCH * median(sizes)?;
        step.is_finite().then(|| Self { step, steps_per_touch: touch / step, still })
    }

    /// Whether touches are lost in the steps: few of them, and most values stand still between them.
    pub(super) fn is_coarse(&self) -> bool {
        self.steps_per_touch < FEW_STEPS && self.still > 0
    }
}
