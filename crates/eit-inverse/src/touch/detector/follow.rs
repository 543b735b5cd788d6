//! The reference: what a frame is compared with, and how it follows what touches do not explain.

use super::TouchDetector;
use super::gains::BLAME_FROM;
use super::vectors::dot;

/// Squared length per row up to which a frame matches an earlier reference, and above which it does
/// not match the current one; noise leaves up to 0.7.
const AS_BEFORE: [f64; 2] = [1.5, 10.0];

impl TouchDetector {
    /// Folds the differences from the reference into rows.
    pub(super) fn subtract_reference(&mut self, frame: &[f64]) {
        let Self { rows, reference_v, difference, is_missing, folded, lost, .. } = self;
        for (i, difference) in difference.iter_mut().enumerate() {
            *difference = if is_missing[i] { 0.0 } else { frame[i] - reference_v[i] };
        }
        rows.fold_present(difference, is_missing, folded, lost);
    }

    /// Returns the earlier reference that the frame matches, except for noise, if it differs far
    /// from the current one. The change that has disappeared was neither touch nor drift, such as a
    /// loose contact, and was part of the reference for a while.
    pub(super) fn came_back(&mut self) -> Option<usize> {
        let Self { whitening, rows, earlier, reference_v, difference, is_missing, .. } = self;
        let [least, most] = AS_BEFORE.map(|part| part * whitening.present() as f64);
        self.work.copy_from_slice(&self.white);
        whitening.project(&mut self.work);
        if dot(&self.work, &self.work) < most {
            return None;
        }
        earlier.others().position(|other_v| {
            for (i, own) in self.since_earlier.iter_mut().enumerate() {
                let since = if is_missing[i] { 0.0 } else { reference_v[i] - other_v[i] };
                *own = difference[i] + since;
            }
            rows.fold_present(&self.since_earlier, is_missing, &mut self.touch_v, &mut self.lost);
            whitening.apply(&self.touch_v, &mut self.work);
            whitening.project(&mut self.work);
            dot(&self.work, &self.work) < least
        })
    }

    /// Updates the reference and the memory.
    pub(super) fn follow(&mut self, dt_s: f64) {
        let best = &self.search.best;
        let is_touched = !best.spots.is_empty();
        self.touch_v.fill(0.0);
        self.memory_v.fill(0.0);
        for (spot, strength) in best.spots.iter().zip(&best.strengths) {
            self.dictionary.add_volts(spot, *strength, &mut self.touch_v);
        }
        if is_touched {
            // what memory explains must not enter the reference while it cannot be told from touches
            self.memory.add_volts(&best.shares, &mut self.memory_v);
        }
        self.acted_v.fill(0.0);
        if is_touched {
            // ends with the touches, and must not stay in the reference
            self.whitening.explained(&self.search.residual, &mut self.work, &mut self.acted_v);
        }
        let time_s = if is_touched { self.settings.touched_s } else { self.settings.idle_s };
        let weight = -(-dt_s / time_s).exp_m1();
        for (row, pair) in self.rows.of.iter().enumerate() {
            let explained = self.touch_v[row] + self.memory_v[row];
            let [first, second] = *pair;
            for i in [first, second].into_iter().take(if first == second { 1 } else { 2 }) {
                if !self.is_missing[i] {
                    let rest =
                        self.difference[i] - self.rows.ratio[i] * explained - self.acted_v[row];
                    self.reference_v[i] += weight * rest;
                }
            }
        }
        let is_explained = best.rest <= BLAME_FROM * self.whitening.present() as f64;
        self.earlier.keep(&self.reference_v, is_touched, is_explained, dt_s);
        let best = &self.search.best;
        let fade = if is_touched { 0.0 } else { weight };
        let touches = best.spots.iter().zip(&best.strengths).zip(&self.errors_m);
        let touches = touches.map(|((spot, strength), error_m)| (*spot, *strength, *error_m));
        let skin = (&self.places, &self.dictionary);
        self.memory.take(&self.touch_v, touches, dt_s, fade, skin, &self.settings);
        self.late.take(&best.spots, &best.strengths, &self.places, &self.settings, dt_s);
        self.before.take(&best.spots, &self.errors_m, dt_s);
        self.weak.clone_from(&self.search.weak);
    }
}
