//! The reference of a learnt skin, and how it follows what is no touch.

use super::{LearntSettings, Untouched};

/// Least weight of a new frame in the reference: that of one in a mean of 60.
const LEAST_FOLLOWING: f64 = 1.0 / 60.0;

/// Reference, and quiet frames that have not entered it yet: the oldest is the next one once all slots are in use.
#[derive(Debug, Clone)]
pub(super) struct Reference {
    pub(super) values: Vec<f64>,
    following: f64,
    frames: Vec<Vec<f64>>,
    next: usize,
    count: usize,
}

impl Reference {
    /// That of the untouched skin. `drift`: variance from one press to the next, over that of the noise.
    pub(super) fn new(untouched: &Untouched<'_>, settings: &LearntSettings, drift: f64) -> Self {
        let values = untouched.reference.to_vec();
        let drift_part = drift / (untouched.interval_s * untouched.rate_hz);
        let following = 0.5 * ((drift_part * (drift_part + 4.0)).sqrt() - drift_part);
        let delay_frames = (settings.delay_s * untouched.rate_hz).ceil().min(1e4) as usize;
        Self {
            following: settings.following.unwrap_or(following.max(LEAST_FOLLOWING)),
            frames: (0..=delay_frames).map(|_| vec![0.0; values.len()]).collect(),
            next: 0,
            count: 0,
            values,
        }
    }

    /// Forgets the frames that wait to enter the reference.
    pub(super) fn forget_waiting(&mut self) {
        self.count = 0;
    }

    /// Follows a frame that has been quiet, and was followed by quiet ones for a while.
    pub(super) fn follow(&mut self, frame: &[f64], is_missing: &[bool]) {
        let Self { values, following, frames, next, count } = self;
        let (slots, slot) = (frames.len(), &mut frames[*next]);
        if *count == slots {
            let waited = values.iter_mut().zip(&*slot);
            for (reference, value) in waited.filter(|(_, value)| value.is_finite()) {
                *reference += *following * (value - *reference);
            }
        }
        for ((to, value), missing) in slot.iter_mut().zip(frame).zip(is_missing) {
            *to = if *missing { f64::NAN } else { *value };
        }
        (*next, *count) = ((*next + 1) % slots, (*count + 1).min(slots));
    }
}
