//! What a scan of drives does to reciprocal halves: an amplifier that leaks, and a skin that changes meanwhile.
//!
//! A sheet is reciprocal, so halves of a pair differ by what differs between their drives:
//!
//! ```text
//! v_ij - v_ji = o_i - o_j + s (t_i - t_j) c + noise,   o ~ N(0, offset_v^2),   s ~ N(mean, variance) of the last frame
//! ```
//!
//! An amplifier of finite rejection adds a part of the common potential, which changes with every contact: all that it reads in a
//! drive is off by one unknown `o`. Drives are measured one after the other, at times `t` from 0 to 1, over a part `s` of the
//! time between frames, in which the pair changes by `c`. Least squares with one unknown a drive and `s`; what halves cannot
//! tell, the mean of all offsets, stays in the covariance. `D^3 / 3 + 2 n^2` flops for `D` drives.
//!
//! Values are then those of the first drive's time, between the last frame and this one.

use super::linear::{Factor, Symmetric};
use super::model::Model;

/// Standard deviation of the part of the time between frames that a scan takes, before anything has moved.
const SCAN: f64 = 0.5;
/// The same that is left however often it was measured: nothing moves evenly.
const LEAST_SCAN: f64 = 0.02;
/// Part of a change by which it is uneven within a frame.
pub(super) const UNEVEN: f64 = 0.3;

/// Halves of a row.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Halves {
    /// How much more the first has changed than the second since the reference, volts.
    pub(super) difference_v: f64,
    /// Variance of that without effects of drives; infinite if one is missing.
    pub(super) variance_v2: f64,
    /// Change of the pair since the last frame times how much later the first is taken in a scan.
    pub(super) moved_v: f64,
    /// Variance in addition if the skin has jumped at any time of the scan, instead of moving evenly.
    pub(super) sudden_v2: f64,
}

/// Effects of drives in a frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Scan {
    /// Most probable offsets of drives, volts, relative to the reference; then the part of a frame's time that a scan takes.
    fit: Vec<f64>,
    covariance: Symmetric,
    /// The part of the last frames, and its variance.
    part: f64,
    variance: f64,
    precision: Symmetric,
    factor: Factor,
    work: Vec<f64>,
}

impl Scan {
    pub(super) fn new(model: &Model) -> Self {
        let count = model.offsets_v.len() + 1;
        let (fit, covariance) = (vec![0.0; count], Symmetric::zeros(count));
        Self { fit, covariance, variance: SCAN * SCAN, ..Self::default() }
    }

    /// Fits the effects to the halves of rows.
    pub(super) fn fit(&mut self, model: &Model, halves: &[Halves], counts: impl Fn(usize) -> bool) {
        let Self { fit, covariance, precision, factor, work, .. } = self;
        let (all, s) = (fit.len(), fit.len() - 1);
        precision.reset(all);
        fit.fill(0.0);
        for (d, offset_v) in model.offsets_v.iter().enumerate() {
            precision.add_at(d, d, offset_v.max(f64::MIN_POSITIVE.sqrt()).powi(-2));
        }
        precision.add_at(s, s, self.variance.recip());
        fit[s] = self.part / self.variance;
        for (row, [a, b]) in model.drives_of_rows() {
            let Halves { difference_v, variance_v2, moved_v, .. } = halves[row];
            let weight = variance_v2.recip();
            if a == b || weight == 0.0 || !counts(row) {
                continue;
            }
            let mut add = |i: usize, j: usize, value: f64| precision.add_at(i, j, weight * value);
            add(a, a, 1.0);
            add(b, b, 1.0);
            add(a, b, -1.0);
            add(s, a, moved_v);
            add(s, b, -moved_v);
            add(s, s, moved_v * moved_v);
            fit[a] += weight * difference_v;
            fit[b] -= weight * difference_v;
            fit[s] += weight * difference_v * moved_v;
        }
        factor.of(precision);
        factor.solve(fit);
        factor.solve_transposed(fit);
        factor.invert(covariance, work);
    }

    /// Keeps what the last fit tells of the time that a scan takes.
    pub(super) fn keep(&mut self) {
        let s = self.fit.len() - 1;
        self.part = self.fit[s].clamp(0.0, 1.0);
        self.variance = self.covariance.get(s, s).max(LEAST_SCAN * LEAST_SCAN);
    }

    /// Part of the time between frames that a scan takes.
    pub(super) fn part(&self) -> f64 {
        self.part
    }

    /// By how much the halves of a row differ because of their drives, volts.
    pub(super) fn difference_v(&self, [a, b]: [usize; 2], moved_v: f64) -> f64 {
        self.fit[a] - self.fit[b] + self.fit[self.fit.len() - 1] * moved_v
    }

    /// Subtracts the offsets from rows, and adds their covariance. `shares`: of each half in its row.
    pub(super) fn subtract(
        &mut self,
        model: &Model,
        shares: impl Fn(usize) -> [f64; 2],
        y: &mut [f64],
        covariance: &mut Symmetric,
    ) {
        let part = |row: usize| shares(row).map(|share| share / model.row_noise_v[row]);
        for (i, of_i) in model.drives_of_rows() {
            let parts = part(i);
            y[i] -= parts[0] * self.fit[of_i[0]] + parts[1] * self.fit[of_i[1]];
            self.work.clear();
            self.work.extend((0..self.fit.len()).map(|d| {
                parts[0] * self.covariance.get(d, of_i[0])
                    + parts[1] * self.covariance.get(d, of_i[1])
            }));
            let out = covariance.column_mut(i);
            for ((j, of_j), out) in model.drives_of_rows().skip(i).zip(out) {
                let others = part(j);
                *out += others[0] * self.work[of_j[0]] + others[1] * self.work[of_j[1]];
            }
        }
    }
}
