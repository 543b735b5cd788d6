//! Earlier references, for when frames turn out to have been those of a faulty electrode.

/// Time for which the reference is kept at least while frames show touches or stay unexplained, seconds: longer than a
/// fault stays unnoticed.
const KEPT_S: f64 = 3.0;

/// The reference of the last frame that no touch was needed to explain, or of three to six seconds ago, and a later one.
#[derive(Debug, Clone)]
pub(super) struct EarlierReferences {
    kept_v: [Vec<f64>; 2],
    /// Time since the later one was taken, seconds.
    age_s: f64,
}

impl EarlierReferences {
    pub(super) fn new(reference_v: &[f64]) -> Self {
        Self { kept_v: [reference_v.to_vec(), reference_v.to_vec()], age_s: 0.0 }
    }

    /// Takes the reference after a frame recorded `dt_s` seconds after the previous one.
    pub(super) fn keep(&mut self, reference_v: &[f64], is_doubtful: bool, dt_s: f64) {
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

    /// Sets one measurement of all.
    pub(super) fn set(&mut self, measurement: usize, value_v: f64) {
        self.kept_v.iter_mut().for_each(|kept_v| kept_v[measurement] = value_v);
    }

    /// Restores the earliest one.
    pub(super) fn restore(&mut self, reference_v: &mut [f64]) {
        reference_v.copy_from_slice(&self.kept_v[0]);
        self.kept_v[1].copy_from_slice(reference_v);
        self.age_s = 0.0;
    }
}
