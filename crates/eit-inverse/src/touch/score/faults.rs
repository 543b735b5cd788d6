//! Would an electrode that is stuck, or one that drifts, explain a frame better than touches do?
//!
//! Asked only if a touch begins or the frame is unlikely. A stuck electrode's rows do not count; the frame's score must fall by
//! more than the fault costs. A drifting electrode adds the covariance of its gain. Each alternative is a search of its own.

use super::ScoreDetector;
use super::background::gain_column;
use super::electrodes::ElectrodeState;
use super::estimate::{Scene, residual};
use super::state::Hypothesis;
use crate::touch::detector::dot;
use std::f64::consts::TAU;

/// Standard deviations of chi^2 beyond which a frame is unlikely.
const UNLIKELY: f64 = 6.0;
/// Score above that of touches up to which a drift is searched for; only to save time.
const NEARLY: f64 = 200.0;
/// Standard deviation of a gain that begins to drift.
const FIRST_GAIN: f64 = 0.02;

impl ScoreDetector {
    /// Returns what explains the frame best, with the faults that it needs.
    pub(super) fn find_faults(&mut self, found: Hypothesis, dt_s: f64) -> Hypothesis {
        let n = self.frame.n() as f64;
        let begins = found.touches.iter().any(|t| t.before.is_none());
        let is_unlikely = found.chi_square > n + UNLIKELY * (2.0 * n).sqrt();
        if !begins && !is_unlikely {
            return found;
        }
        let stuck = if is_unlikely { self.find_stuck(&found, dt_s) } else { None };
        if let Some(other) = stuck {
            return other;
        }
        let drifting = self.find_drifting(&found, dt_s);
        drifting.unwrap_or(found)
    }

    fn cost_of_fault(&self, dt_s: f64) -> f64 {
        -2.0 * (self.settings.fault_hz * dt_s).ln()
    }

    /// Leaves out the electrode that repeats and whose rows are explained worst.
    fn find_stuck(&mut self, found: &Hypothesis, dt_s: f64) -> Option<Hypothesis> {
        let cost = self.cost_of_fault(dt_s);
        let Self { model, settings, electrodes, search, frame, other, work, .. } = self;
        let scene = Scene { model, settings, dt_s };
        residual(&scene, frame, &found.touches, work);
        frame.factor.multiply(work);
        let left = |e: usize| {
            let rows = frame.present.iter().zip(&*work).filter(|(i, _)| model.of[e][**i]);
            rows.map(|(_, r)| r * r).sum::<f64>()
        };
        let stuck = (0..model.of.len())
            .filter(|&e| electrodes.repeated[e] && electrodes.states[e] == ElectrodeState::Sound)
            .max_by(|&a, &b| left(a).total_cmp(&left(b)))?;
        let present = &frame.present;
        let counts = |row: usize| present.binary_search(&row).is_ok() && !model.of[stuck][row];
        other.set(&self.base, &self.error, &self.y, counts);
        if other.n() == 0 {
            return None;
        }
        let whole = search.total(found);
        let found = search.search(&scene, other, &self.touches);
        // a row that repeats has the density of a step of the converter instead of its own
        let of_row = TAU.ln() + 2.0 * (model.typical_noise_v / model.step_v.max(1e-30)).ln();
        let fewer = (frame.n() - other.n()) as f64;
        if search.total(&found) + cost >= whole + of_row.clamp(-1.0, 0.0) * fewer {
            return None;
        }
        electrodes.states[stuck] = ElectrodeState::Stuck;
        electrodes.leave_out(model);
        std::mem::swap(frame, other);
        Some(found)
    }

    /// Gives the electrode a gain of its own that explains most of what the last frame's touches leave, or of the whole frame.
    fn find_drifting(&mut self, found: &Hypothesis, dt_s: f64) -> Option<Hypothesis> {
        let whole = self.search.total(found);
        let mut tried = None;
        for with_touches in [true, false] {
            let Some(electrode) = self.most_drifting(with_touches, dt_s) else { continue };
            if tried == Some(electrode) {
                continue;
            }
            tried = Some(electrode);
            if let Some(other) = self.try_drifting(electrode, whole, dt_s) {
                return Some(other);
            }
        }
        None
    }

    fn most_drifting(&mut self, with_touches: bool, dt_s: f64) -> Option<usize> {
        let cost = self.cost_of_fault(dt_s);
        let Self { model, settings, electrodes, search, frame, other, work, .. } = self;
        let scene = Scene { model, settings, dt_s };
        let mut left = std::mem::take(&mut other.data);
        left.clone_from(&frame.data);
        if with_touches {
            let known = search.estimator.fit(&scene, frame, &self.touches, 3, 0);
            residual(&scene, frame, &known.touches, &mut left);
        }
        let mut most = (cost, None);
        for e in (0..model.of.len()).filter(|&e| electrodes.states[e] == ElectrodeState::Sound) {
            work.clear();
            work.extend(frame.present.iter().map(|&row| model.gain(e, row)));
            frame.factor.solve(work);
            let gain = dot(work, &left).powi(2) / dot(work, work).max(1e-9);
            if gain > most.0 {
                most = (gain, Some(e));
            }
        }
        other.data = left;
        most.1
    }

    fn try_drifting(&mut self, electrode: usize, whole: f64, dt_s: f64) -> Option<Hypothesis> {
        let cost = self.cost_of_fault(dt_s);
        let Self { model, settings, background, search, frame, other, work, .. } = self;
        let scene = Scene { model, settings, dt_s };
        gain_column(model, electrode, work);
        self.base.add_square(FIRST_GAIN * FIRST_GAIN, work);
        let present = &frame.present;
        other.set(&self.base, &self.error, &self.y, |row| present.binary_search(&row).is_ok());
        let known = search.estimator.fit(&scene, other, &self.touches, 3, 0);
        let found = match search.total(&known) + cost < whole + NEARLY {
            true => search.search(&scene, other, &self.touches),
            false => known,
        };
        if search.total(&found) + cost >= whole {
            self.base.add_square(-FIRST_GAIN * FIRST_GAIN, work);
            return None;
        }
        self.electrodes.states[electrode] = ElectrodeState::Drifting;
        background.loosen_gain(model, electrode, FIRST_GAIN);
        std::mem::swap(frame, other);
        Some(found)
    }
}
