//! Electrodes: open, shorted or noisy; stuck; drifting.
//!
//! A linear passive skin is reciprocal, so halves of pairs differ by noise, or by that of a faulty electrode:
//!
//! ```text
//! d = (v_i - v_j) - (ref_i - ref_j) - effects of drives,   d ~ N(0, var)  or  N(0, s^2), s^2 = max(mean d^2, 30 var)
//! ```
//!
//! with `var` the noise of both and what halves may differ by under a change. Electrodes, single values that are damaged, and a
//! jump of the skin within the scan are added one by one while -2 log posterior falls, and electrodes taken back. The rows of
//! a faulty electrode do not count. Drifting electrodes keep theirs: their gain is a random walk of the reference. `20 n` flops a frame and electrode.

use super::drives::{Halves, Scan, UNEVEN};
use super::model::Model;
use super::settings::ScoreSettings;
use eit_core::median_in_place;

/// Least variance of a faulty electrode's halves, relative to that of sound ones: noise that matters. With a free size noise
/// that is small by chance would be a fault of small size.
const MATTERS: f64 = 30.0;
/// Squared difference over variance up to which halves are not looked at, to save time.
const ORDINARY: f64 = 20.0;
/// Part of the values that a transmission damages.
const DAMAGED: f64 = 1e-5;
/// Part of the frames in which the skin jumps between two drives: fabric that slips under a finger.
const SUDDEN: f64 = 0.05;
/// Largest jump of a row, relative to the median of all: touches reach ten times that near the rim, damaged values more.
const JUMP: f64 = 10.0;
/// Weight of a frame in the usual time between frames.
const PERIOD: f64 = 0.1;
/// Fewest pairs by which an electrode is judged.
const LEAST_PAIRS: usize = 4;
/// Relative difference of reciprocal halves that may come and go without a change: 0.1 % of a voltage, instruments' linearity.
const LINEARITY: f64 = 1e-3;
/// Factor on the reference's own reciprocity error.
const OF_REFERENCE: f64 = 3.0;

/// What is wrong with an electrode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ElectrodeState {
    /// Nothing.
    Sound,
    /// Open, shorted or noisy: its measurements do not count.
    Noisy,
    /// Its measurements repeat exactly: they do not count.
    Stuck,
    /// Its gain drifts: its measurements count with a gain of their own.
    Drifting,
}

/// Why halves of a frame differ.
#[derive(Debug, Clone, Copy)]
enum Cause {
    /// An electrode is open, shorted or noisy.
    Electrode(usize),
    /// A value of a row is damaged.
    Value(usize),
    /// The skin has jumped within the scan.
    Sudden,
}

/// States of all electrodes.
#[derive(Debug, Clone)]
pub(super) struct Electrodes {
    pub(super) states: Vec<ElectrodeState>,
    /// Noisy electrodes that the frame has shown, not the halves of its pairs.
    pub(super) is_open: Vec<bool>,
    /// Whether all measurements of each are those of the last frame.
    pub(super) repeated: Vec<bool>,
    /// Whether a row of the frame does not count: a value of it is damaged, or one of its electrodes is faulty.
    pub(super) is_lost: Vec<bool>,
    is_damaged: Vec<bool>,
    /// The last frame, NaN where a value is missing; empty before the first.
    pub(super) last_v: Vec<f64>,
    /// Whether something explained it: otherwise it does not tell where the skin was.
    pub(super) is_last_known: bool,
    /// Usual time between frames, seconds, and that part of the time since the last one: a scan takes no longer after a gap.
    period_s: f64,
    of_gap: f64,
    pub(super) scan: Scan,
    /// Halves of each row, and the square of what drives leave of their difference, over its variance.
    halves: Vec<Halves>,
    squares: Vec<f64>,
    changes: Vec<f64>,
    /// For how long the rows of each have not counted, seconds.
    pub(super) lost_s: Vec<f64>,
}

impl Electrodes {
    pub(super) fn new(model: &Model) -> Self {
        let (n, count) = (model.n, model.of.len());
        Self {
            states: vec![ElectrodeState::Sound; count],
            is_open: vec![false; count],
            repeated: vec![false; count],
            is_lost: vec![false; n],
            is_damaged: vec![false; n],
            last_v: Vec::with_capacity(model.reference_v.len()),
            is_last_known: false,
            period_s: f64::NAN,
            of_gap: 1.0,
            scan: Scan::new(model),
            halves: vec![Halves::default(); n],
            squares: vec![0.0; n],
            changes: Vec::with_capacity(n),
            lost_s: vec![0.0; count],
        }
    }

    /// Judges a frame by itself.
    pub(super) fn push(
        &mut self,
        model: &Model,
        s: &ScoreSettings,
        frame_v: &[f64],
        is_missing: &[bool],
        dt_s: f64,
    ) {
        self.period_s += PERIOD * (dt_s - self.period_s);
        self.period_s = if self.period_s.is_nan() { dt_s } else { self.period_s };
        self.of_gap = (self.period_s / dt_s).min(1.0);
        self.compare(model, s, frame_v, is_missing);
        self.find_noisy(model, s, dt_s);
        for (e, repeated) in self.repeated.iter_mut().enumerate() {
            let is_same = |&i: &usize| self.last_v.get(i).is_some_and(|last| *last == frame_v[i]);
            let measured = &model.of_electrode[e];
            *repeated = !measured.is_empty() && measured.iter().all(is_same);
            if self.states[e] == ElectrodeState::Stuck && !*repeated {
                self.states[e] = ElectrodeState::Sound;
            }
        }
        self.leave_out(model);
        self.scan.keep();
        for (lost_s, state) in self.lost_s.iter_mut().zip(&self.states) {
            let is_lost = matches!(state, ElectrodeState::Noisy | ElectrodeState::Stuck);
            *lost_s = if is_lost { *lost_s + dt_s } else { 0.0 };
        }
    }

    /// Updates which rows are lost.
    pub(super) fn leave_out(&mut self, model: &Model) {
        self.is_lost.fill(false);
        for (of, state) in model.of.iter().zip(&self.states) {
            if matches!(state, ElectrodeState::Noisy | ElectrodeState::Stuck) {
                self.is_lost.iter_mut().zip(of).for_each(|(lost, of)| *lost |= of);
            }
        }
        self.is_lost.iter_mut().zip(&self.is_damaged).for_each(|(lost, damaged)| *lost |= damaged);
    }

    /// Compares the halves of each row.
    fn compare(&mut self, model: &Model, s: &ScoreSettings, frame_v: &[f64], is_missing: &[bool]) {
        let change = |i: usize| frame_v[i] - model.reference_v[i];
        let is_pair = |i: usize, j: usize| i != j && !is_missing[i] && !is_missing[j];
        let largest = |[i, j]: [usize; 2]| change(i).abs().max(change(j).abs());
        let moved = |i: usize| match self.last_v.get(i) {
            Some(last) if self.is_last_known && last.is_finite() => {
                self.of_gap * (frame_v[i] - last)
            }
            _ => 0.0,
        };
        let most_moved = |[i, j]: [usize; 2]| moved(i).abs().max(moved(j).abs());
        let pairs = || model.rows.of.iter().filter(|&&[i, j]| is_pair(i, j));
        let changes = &mut self.changes;
        let mut typical = |of: &dyn Fn([usize; 2]) -> f64| {
            changes.clear();
            changes.extend(pairs().map(|&pair| of(pair).powi(2)));
            median_in_place(changes).unwrap_or(0.0)
        };
        let (typical, typical_move) = (typical(&largest), typical(&most_moved));
        let unequal = s.unequal.max(OF_REFERENCE * model.unequal);
        for (&[i, j], halves) in model.rows.of.iter().zip(&mut self.halves) {
            *halves = match is_pair(i, j) {
                true => {
                    let own = largest([i, j]).powi(2) + typical;
                    let moved_v = 0.5 * (moved(i) + moved(j)) * (model.time(i) - model.time(j));
                    let variance_v2 = model.noise_v[i].powi(2)
                        + model.noise_v[j].powi(2)
                        + unequal * unequal * own
                        + (LINEARITY * model.reference_v[i]).powi(2)
                        + (UNEVEN * self.scan.part() * moved_v).powi(2);
                    let between = (self.scan.part() * (model.time(i) - model.time(j))).abs();
                    let jump_v2 = most_moved([i, j]).powi(2).min(JUMP * JUMP * typical_move);
                    let sudden_v2 = between * (1.0 - between) * jump_v2;
                    let difference_v = change(i) - change(j);
                    Halves { difference_v, variance_v2, moved_v, sudden_v2 }
                }
                false => Halves { variance_v2: f64::INFINITY, ..Halves::default() },
            };
        }
        self.is_damaged.fill(false);
        self.leave_out(model);
        self.fit_scan(model);
    }

    /// Fits the effects of drives to the rows of sound electrodes.
    fn fit_scan(&mut self, model: &Model) {
        let Self { scan, halves, squares, is_lost, .. } = self;
        scan.fit(model, halves, |row| !is_lost[row]);
        for (row, drives) in model.drives_of_rows() {
            let Halves { difference_v, variance_v2, moved_v, .. } = halves[row];
            squares[row] =
                (difference_v - scan.difference_v(drives, moved_v)).powi(2) / variance_v2;
        }
    }

    /// Keeps a frame for the next one.
    pub(super) fn remember(&mut self, model: &Model, frame_v: &[f64], is_missing: &[bool]) {
        self.is_last_known = true;
        self.last_v.clear();
        let values = frame_v.iter().zip(is_missing);
        self.last_v.extend(values.map(|(v, missing)| if *missing { f64::NAN } else { *v }));
        for (pair, _) in model.rows.of.iter().zip(&self.is_damaged).filter(|(_, damaged)| **damaged)
        {
            pair.iter().for_each(|&i| self.last_v[i] = f64::NAN);
        }
    }

    /// Value of a measurement at the time of the first drive of a scan.
    pub(super) fn at_first_drive(&self, model: &Model, frame_v: &[f64], i: usize) -> f64 {
        match self.last_v.get(i) {
            Some(last) if self.is_last_known && last.is_finite() => {
                frame_v[i] - self.of_gap * self.scan.part() * model.time(i) * (frame_v[i] - last)
            }
            _ => frame_v[i],
        }
    }

    /// Adds and heals noisy electrodes while -2 log posterior falls.
    fn find_noisy(&mut self, model: &Model, s: &ScoreSettings, dt_s: f64) {
        let is_noisy = |state: &ElectrodeState| *state == ElectrodeState::Noisy;
        let is_ordinary = |square: &f64| *square < ORDINARY;
        if !self.states.iter().any(is_noisy) && self.squares.iter().all(is_ordinary) {
            return;
        }
        let [fault, heal] = [s.fault_hz, s.heal_hz].map(|hz| -2.0 * (hz * dt_s).min(0.5).ln());
        let mut is_sudden = false;
        while let Some(cause) = self.likeliest(model, fault, is_sudden) {
            match cause {
                Cause::Electrode(e) => self.states[e] = ElectrodeState::Noisy,
                Cause::Value(row) => self.is_damaged[row] = true,
                Cause::Sudden => {
                    is_sudden = true;
                    self.halves.iter_mut().for_each(|h| h.variance_v2 += h.sudden_v2);
                }
            }
            self.leave_out(model);
            self.fit_scan(model);
        }
        for e in 0..self.states.len() {
            if self.states[e] != ElectrodeState::Noisy || self.is_open[e] {
                continue;
            }
            // its own rows tell the effects of its drives, and others may have explained what it was accused of
            let least = if self.lost_s[e] > 0.0 { -heal } else { fault };
            self.states[e] = ElectrodeState::Sound;
            self.leave_out(model);
            self.fit_scan(model);
            if self.gain(model, e) > least {
                self.states[e] = ElectrodeState::Noisy;
                self.leave_out(model);
                self.fit_scan(model);
            }
        }
    }

    /// What lets -2 log posterior of the halves fall most; `None` if nothing does.
    fn likeliest(&self, model: &Model, fault: f64, is_sudden: bool) -> Option<Cause> {
        let counted = || (0..model.n).filter(|&row| !self.is_lost[row]);
        let sound = (0..self.states.len()).filter(|&e| self.states[e] != ElectrodeState::Noisy);
        let electrodes = sound.map(|e| (self.gain(model, e) - fault, Cause::Electrode(e)));
        let values = counted().map(|row| {
            let square = self.squares[row].max(1.0);
            (square - square.ln() - 1.0 + 2.0 * DAMAGED.ln(), Cause::Value(row))
        });
        let of_row = |row: usize| {
            let larger = self.halves[row].sudden_v2 / self.halves[row].variance_v2;
            self.squares[row] * larger / (1.0 + larger) - larger.ln_1p()
        };
        let of_sudden = counted().map(of_row).sum::<f64>() + 2.0 * SUDDEN.ln();
        let sudden = (!is_sudden).then_some((of_sudden, Cause::Sudden));
        let causes = electrodes.chain(values).chain(sudden).filter(|(gain, _)| *gain > 0.0);
        causes.max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, cause)| cause)
    }

    /// Decrease of -2 log likelihood if an electrode is noisy, besides the others that are faulty.
    fn gain(&self, model: &Model, electrode: usize) -> f64 {
        let is_faulty = |e: usize| {
            e != electrode
                && matches!(self.states[e], ElectrodeState::Noisy | ElectrodeState::Stuck)
        };
        let counts = |row: usize| {
            model.of[electrode][row]
                && self.halves[row].variance_v2.is_finite()
                && !self.is_damaged[row]
                && !(0..model.of.len()).any(|e| is_faulty(e) && model.of[e][row])
        };
        let rows = || (0..model.n).filter(|&row| counts(row));
        let (mut count, mut sum) = (0, 0.0);
        for row in rows() {
            count += 1;
            sum += self.squares[row] * self.halves[row].variance_v2;
        }
        if count < LEAST_PAIRS {
            return 0.0;
        }
        let mean = sum / count as f64;
        rows()
            .map(|row| {
                let variance = self.halves[row].variance_v2;
                let size = mean.max(MATTERS * variance);
                let square = self.squares[row];
                square + variance.ln() - size.ln() - square * variance / size
            })
            .sum()
    }
}
