//! Rows of a frame: their change since the reference, and the background beneath it.

use super::ScoreDetector;
use super::background::gain_column;
use super::electrodes::ElectrodeState;
use crate::touch::detector::dot;

/// A contact that was lost for a second comes back with a reference of its own, up to this part of the voltages, and
/// the sooner the less.
const BACK: f64 = 0.05;

impl ScoreDetector {
    /// Sets the background, the rows that count and the change of this frame.
    pub(super) fn begin(&mut self, frame_v: &[f64], dt_s: f64) {
        self.loosen_open();
        self.advance(frame_v, dt_s);
        let Self { model, background, electrodes, .. } = self;
        background.sum(model, &mut self.base);
        for (row, &[i, j]) in model.rows.of.iter().enumerate() {
            let change =
                |i: usize| electrodes.at_first_drive(model, frame_v, i) - model.reference_v[i];
            let (sum, count) = match [self.is_missing[i], self.is_missing[j]] {
                [false, false] => (0.5 * (change(i) + change(j)), 2),
                [false, true] => (change(i), 1),
                [true, false] => (change(j), 1),
                [true, true] => (0.0, 0),
            };
            self.has_no_half[row] = count == 0;
            self.y[row] = sum / model.row_noise_v[row];
            if count == 1 {
                // one half alone has twice the variance
                self.base.add_at(row, row, 1.0);
            }
        }
        let shares = |row: usize| match model.rows.of[row].map(|i| self.is_missing[i]) {
            [false, false] => [0.5, 0.5],
            [false, true] => [1.0, 0.0],
            [true, false] => [0.0, 1.0],
            [true, true] => [0.0, 0.0],
        };
        electrodes.scan.subtract(model, shares, &mut self.y, &mut self.base);
        electrodes.remember(model, frame_v, &self.is_missing);
        background.subtract(&mut self.y);
    }

    /// Lets the reference drift, most of all on the rows of electrodes that come back or drift, and looks at the
    /// electrodes.
    fn advance(&mut self, frame_v: &[f64], dt_s: f64) {
        let Self { model, settings, background, electrodes, gains, work, .. } = self;
        background.advance(settings, dt_s);
        for e in 0..model.of.len() {
            if electrodes.states[e] == ElectrodeState::Drifting {
                background.loosen_gain(model, e, settings.gain_per_s * dt_s);
            }
        }
        electrodes.push(model, settings, frame_v, &self.is_missing, dt_s);
        for (e, &lost_s) in electrodes.lost_s.iter().enumerate().filter(|(_, s)| **s > 0.0) {
            let [before, now] = [lost_s - dt_s, lost_s].map(|s| s.clamp(0.0, 1.0));
            let part = BACK * (now * now - before * before).sqrt();
            background.loosen(model, (0..model.n).filter(|&row| model.of[e][row]), part);
        }
        gains.fill(0.0);
        for e in (0..model.of.len()).filter(|&e| electrodes.states[e] == ElectrodeState::Drifting) {
            gain_column(model, e, work);
            let product = dot(work, &background.reference);
            let part = (product / model.gain_squares[e].max(f64::MIN_POSITIVE)).powi(2);
            gains.iter_mut().zip(&model.of[e]).filter(|(_, of)| **of).for_each(|(g, _)| *g += part);
        }
    }
}
