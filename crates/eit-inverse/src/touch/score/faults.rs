//! Would an electrode that is stuck, open or drifts explain a frame better than touches do?
//!
//! Asked only if the frame is unlikely, of drift also if a touch begins. The frame's score must fall by more than the fault costs. The rows of a
//! stuck electrode do not count; those of an open one are noise of the size that they have, which reciprocal halves need not
//! show. A drifting electrode adds the covariance of its gain. Each alternative is a search of its own.

use super::ScoreDetector;
use super::background::gain_column;
use super::electrodes::{ElectrodeState, Electrodes};
use super::estimate::{Scene, residual};
use super::model::Model;
use super::state::{Hypothesis, Touches};
use crate::touch::detector::dot;
use std::f64::consts::TAU;

/// Standard deviations of chi^2 beyond which a frame is unlikely.
const UNLIKELY: f64 = 6.0;
/// Misfit of the reference from which a model shows no fault: a correlation of 0.9.
const UNLIKE: f64 = 0.44;
/// Score above that of touches up to which a drift is searched for; only to save time.
const NEARLY: f64 = 200.0;
/// Standard deviation of a gain that begins to drift.
const FIRST_GAIN: f64 = 0.02;
/// Standard deviation of the logarithm of the impedance of a contact that opens: a factor of 20.
const OPEN: f64 = 3.0;
/// Least change of the voltages of an electrode that opens, relative: fingers change fewer of them, and by less.
const OPENS: f64 = 0.1;
/// Frames after which the next electrode is looked at, whether it is open no more; only to save time.
const HEALED_EVERY: u64 = 2;

/// Effect of an electrode's contact, of all rows; empty if unknown.
fn contact_of(model: &Model, electrode: usize) -> &[f64] {
    model.contact.chunks_exact(model.n).nth(electrode).unwrap_or_default()
}

impl ScoreDetector {
    /// Lets the contacts of open electrodes be anything in the next frame.
    pub(super) fn loosen_open(&mut self) {
        let Self { model, background, electrodes, .. } = self;
        for (e, _) in electrodes.is_open.iter().enumerate().filter(|(_, open)| **open) {
            background.loosen_along(OPEN, contact_of(model, e));
        }
    }

    /// Returns what explains the frame best, with the faults that it needs.
    pub(super) fn find_faults(&mut self, found: Hypothesis, dt_s: f64) -> Hypothesis {
        let n = self.frame.n() as f64;
        let begins = found.touches.iter().any(|t| t.before.is_none());
        let is_unlikely = found.chi_square > n + UNLIKELY * (2.0 * n).sqrt();
        if !begins && !is_unlikely || self.model.misfit > UNLIKE {
            return found;
        }
        let stuck = if is_unlikely { self.find_stuck(&found, dt_s) } else { None };
        if let Some(other) = stuck {
            return other;
        }
        let open = if is_unlikely { self.find_open(&found, dt_s) } else { None };
        let least = open.map_or(self.search.total(&found), |(.., total)| total);
        match (self.find_drifting(least, dt_s), open) {
            (Some(other), _) => other,
            (None, Some((electrode, other, _))) => {
                self.electrodes.is_open[electrode] = true;
                let contact = contact_of(&self.model, electrode);
                self.base.add_square(OPEN * OPEN, contact);
                self.background.loosen_along(OPEN, contact);
                self.lose(electrode, ElectrodeState::Noisy);
                other
            }
            (None, None) => found,
        }
    }

    /// Leaves an electrode out of the frame.
    fn lose(&mut self, electrode: usize, state: ElectrodeState) {
        let Self { model, electrodes, frame, other, .. } = self;
        electrodes.states[electrode] = state;
        electrodes.leave_out(model);
        let present = &frame.present;
        let counts = |row: usize| present.binary_search(&row).is_ok() && !model.of[electrode][row];
        other.set(&self.base, &self.error, &self.y, counts);
        std::mem::swap(frame, other);
    }

    fn cost_of_fault(&self, dt_s: f64) -> f64 {
        -2.0 * (self.settings.fault_hz * dt_s).ln()
    }

    /// The sound electrode, of those that may be it, whose rows some touches explain worst.
    fn worst(
        &mut self,
        touches: &Touches,
        may: impl Fn(&Electrodes, usize) -> bool,
        dt_s: f64,
    ) -> Option<usize> {
        let Self { model, settings, electrodes, frame, work, .. } = self;
        residual(&Scene { model, settings, dt_s }, frame, touches, work);
        frame.factor.multiply(work);
        let left = |e: usize| {
            let rows = frame.present.iter().zip(&*work).filter(|(i, _)| model.of[e][**i]);
            rows.map(|(_, r)| r * r).sum::<f64>()
        };
        (0..model.of.len())
            .filter(|&e| electrodes.states[e] == ElectrodeState::Sound && may(electrodes, e))
            .max_by(|&a, &b| left(a).total_cmp(&left(b)))
    }

    /// Leaves out the electrode that repeats and whose rows are explained worst.
    fn find_stuck(&mut self, found: &Hypothesis, dt_s: f64) -> Option<Hypothesis> {
        let cost = self.cost_of_fault(dt_s);
        let stuck = self.worst(&found.touches, |electrodes, e| electrodes.repeated[e], dt_s)?;
        let Self { model, settings, search, frame, other, .. } = self;
        let scene = Scene { model, settings, dt_s };
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
        let is_better = search.total(&found) + cost < whole + of_row.clamp(-1.0, 0.0) * fewer;
        if !is_better {
            return None;
        }
        self.lose(stuck, ElectrodeState::Stuck);
        Some(found)
    }

    /// Score of the rows of an electrode as noise of the size that they have, at least that of an open contact, of those that
    /// the frame has.
    fn score_of_noise(&self, electrode: usize) -> f64 {
        let Self { model, frame, y, .. } = self;
        let of = &model.of[electrode];
        let rows = || frame.present.iter().copied().filter(|&row| of[row]);
        let count = rows().count() as f64;
        let sum: f64 = rows().map(|row| y[row] * y[row]).sum();
        let whole: f64 = rows().map(|row| model.sheet[row] * model.sheet[row]).sum();
        let size = sum.max(OPENS * OPENS * whole) / count.max(1.0);
        count * size.max(1.0).ln() + sum / size.max(1.0)
    }

    /// The electrode whose rows what is known explains worst, if it is open; with what explains the frame then, and its score.
    fn find_open(&mut self, found: &Hypothesis, dt_s: f64) -> Option<(usize, Hypothesis, f64)> {
        let whole = self.search.total(found);
        let known = self.touches;
        let open = self.worst(&known, |_, _| true, dt_s)?;
        let cost = self.cost_of_fault(dt_s) + self.score_of_noise(open);
        let Self { model, settings, search, frame, other, .. } = self;
        let scene = Scene { model, settings, dt_s };
        let contact = contact_of(model, open);
        self.base.add_square(OPEN * OPEN, contact);
        let present = &frame.present;
        let counts = |row: usize| present.binary_search(&row).is_ok() && !model.of[open][row];
        other.set(&self.base, &self.error, &self.y, counts);
        self.base.add_square(-OPEN * OPEN, contact);
        let known = search.estimator.fit(&scene, other, &self.touches, 3, 0);
        if other.n() == 0 || search.total(&known) + cost >= whole + NEARLY {
            return None;
        }
        let found = search.search(&scene, other, &self.touches);
        let total = search.total(&found) + cost;
        (total < whole).then_some((open, found, total))
    }

    /// Uses an open electrode again, one in turn, once its rows are no noise.
    pub(super) fn close(&mut self, found: Hypothesis, dt_s: f64) -> Hypothesis {
        let count = self.electrodes.is_open.len();
        let e = (self.frames / HEALED_EVERY) as usize % count.max(1);
        let is_turn = self.frames.is_multiple_of(HEALED_EVERY);
        if !is_turn || !self.electrodes.is_open.get(e).is_some_and(|open| *open) {
            return found;
        }
        let whole = self.search.total(&found);
        let Self { model, settings, electrodes, search, frame, other, .. } = self;
        let scene = Scene { model, settings, dt_s };
        (electrodes.states[e], electrodes.is_open[e]) = (ElectrodeState::Sound, false);
        electrodes.leave_out(model);
        let counts = |row: usize| !electrodes.is_lost[row] && !self.has_no_half[row];
        other.set(&self.base, &self.error, &self.y, counts);
        let with = search.search(&scene, other, &self.touches);
        std::mem::swap(frame, other);
        let heal = -2.0 * (settings.heal_hz * HEALED_EVERY as f64 * dt_s).min(0.5).ln();
        if self.search.total(&with) + heal < whole + self.score_of_noise(e) {
            return with;
        }
        std::mem::swap(&mut self.frame, &mut self.other);
        (self.electrodes.states[e], self.electrodes.is_open[e]) = (ElectrodeState::Noisy, true);
        self.electrodes.leave_out(&self.model);
        found
    }

    /// Gives the electrode a gain of its own that explains most of what the last frame's touches leave, or of the whole frame, if
    /// the score falls below `whole`.
    fn find_drifting(&mut self, whole: f64, dt_s: f64) -> Option<Hypothesis> {
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
