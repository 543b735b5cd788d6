//! Earlier references, for when frames turn out to have been those of a faulty electrode.

/// Minimum time for which the reference is kept while frames show touches or stay unexplained,
/// seconds: longer than a fault takes to be detected.
const KEPT_S: f64 = 3.0;

/// Time after which the closing of a loose contact counts as a new change, seconds.
const JUMP_S: f64 = 60.0;

/// The reference of the last frame that needed no touch, or of three to six seconds ago, and a
/// later one.
#[derive(Debug, Clone)]
pub(super) struct EarlierReferences {
    kept_v: [Vec<f64>; 2],
    /// Time since the later one was taken, seconds.
    age_s: f64,
    /// Whether the earlier reference differs from the current one.
    is_other: bool,
    /// The reference before the current unexplained frames began, while frames may still return to
    /// it; empty if there is none.
    jump_v: Vec<f64>,
    jump_age_s: f64,
}

impl EarlierReferences {
    pub(super) fn new(reference_v: &[f64]) -> Self {
        let kept_v = [reference_v.to_vec(), reference_v.to_vec()];
        let jump_v = Vec::with_capacity(reference_v.len());
        Self { kept_v, age_s: 0.0, is_other: false, jump_v, jump_age_s: 0.0 }
    }

    /// Stores the reference after a frame recorded `dt_s` seconds after the previous one.
    pub(super) fn keep(
        &mut self,
        reference_v: &[f64],
        is_touched: bool,
        is_explained: bool,
        dt_s: f64,
    ) {
        let is_doubtful = is_touched || !is_explained;
        self.jump_age_s += dt_s;
        if !self.is_other && !is_explained && !is_touched {
            self.jump_v.clone_from(&self.kept_v[0]);
            self.jump_age_s = 0.0;
        } else if self.jump_age_s > JUMP_S {
            self.jump_v.clear();
        }
        self.is_other = is_doubtful;
        if !is_doubtful {
            self.kept_v.iter_mut().for_each(|kept_v| kept_v.copy_from_slice(reference_v));
            self.age_s = 0.0;
            return;
        }
        self.age_s += dt_s;
        if self.age_s >= KEPT_S {
            self.kept_v.swap(0, 1);
            self.kept_v[1].copy_from_slice(reference_v);
            self.age_s = 0.0;
        }
    }

    /// References to which frames may return.
    pub(super) fn others(&self) -> impl Iterator<Item = &[f64]> {
        let earliest = self.is_other.then(|| self.kept_v[0].as_slice());
        let jump = Some(self.jump_v.as_slice()).filter(|v| !v.is_empty());
        earliest.into_iter().chain(jump)
    }

    /// Sets one measurement of all stored references.
    pub(super) fn set(&mut self, measurement: usize, value_v: f64) {
        let all = self.kept_v.iter_mut().chain([&mut self.jump_v]);
        all.filter_map(|v| v.get_mut(measurement)).for_each(|v| *v = value_v);
    }

    /// Restores the earliest one.
    pub(super) fn restore(&mut self, reference_v: &mut [f64]) {
        reference_v.copy_from_slice(&self.kept_v[0]);
        self.settle(reference_v);
    }

    /// Restores one of [`others`](Self::others), to which frames have returned.
    pub(super) fn come_back(&mut self, which: usize, reference_v: &mut [f64]) {
        if let Some(other_v) = self.others().nth(which) {
            reference_v.copy_from_slice(other_v);
        }
        self.settle(reference_v);
        self.jump_v.clear();
    }

    fn settle(&mut self, reference_v: &[f64]) {
        self.kept_v.iter_mut().for_each(|kept_v| kept_v.copy_from_slice(reference_v));
        (self.age_s, self.is_other) = (0.0, false);
    }
}
