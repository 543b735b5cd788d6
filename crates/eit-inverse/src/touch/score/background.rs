//! Everything that is not a touch: noise, the reference and its drift, the fabric's memory, the error of the model.
//!
//! ```text
//! S = I + R + M + waves + settling,   y = z - r + settled signal
//! E = diag((eta a d)^2) + eta^2 (a d on the rows of each electrode)^2 + each electrode's own movement and contact
//! ```
//!
//! `r, R`: Kalman filter of the reference, a random walk. `M`: covariance of the trails of touches; it flows into `R` as it
//! fades, and an update does not consume it. Settling: a low-pass of the touches' signal with each time constant, whose share
//! the same filter finds. All `[row]` or `[row, row]`, in units of each row's noise.
//!
//! **Cost** for `n` rows: update of `R` `n^3` flops for the solve and `n^3` for the product of which one triangle is computed,
//! 2.2 Mflop with 104 rows; `E` `n^2 k / 2` for `k` electrode columns (64 with 16 electrodes), 0.7 Mflop.

mod error;
mod update;

use super::estimate::Scene;
use super::linear::{Factor, Symmetric};
use super::model::Model;
use super::settings::{SETTLING, ScoreSettings};
use super::state::TouchState;
use crate::geometry::distance_m;
use faer::Mat;

/// Addition to a correlation of 1: rounding.
const RIDGE: f64 = 1e-6;
/// Time over which drifts are stated, seconds.
const DRIFT_S: f64 = 60.0;
/// Part of the sheet's drift that is uneven.
const UNEVEN: f64 = 0.5;

/// State of everything that is not a touch.
#[derive(Debug, Clone, Default)]
pub(super) struct Background {
    /// Change of the reference since the start, and its covariance.
    pub(super) reference: Vec<f64>,
    pub(super) covariance: Symmetric,
    /// Random walk in [`DRIFT_S`].
    walk: Symmetric,
    /// Covariance of what the fabric remembers.
    memory: Symmetric,
    /// Variance of the field of changes that strong touches look like, and leave behind.
    disturbance: f64,
    /// Low-pass of the touches' signal with each time constant; by which share of each a signal is less, and the covariance.
    pub(super) settled: [Vec<f64>; SETTLING],
    pub(super) shares: [f64; SETTLING],
    pub(super) share_covariance: [[f64; SETTLING]; SETTLING],
    /// Relative error of the model of a change, and its least value: no better on changes than on the reference.
    pub(super) eta: f64,
    pub(super) least_eta: f64,
    /// Workspace: vectors `[column][row]`, of all rows and of those that count, and the diagonal of `E`.
    columns: Vec<f64>,
    rows: Vec<f64>,
    diagonal: Vec<f64>,
    signal: Vec<f64>,
    innovation: Vec<f64>,
    of_update: Factor,
    update: Symmetric,
}

impl Background {
    pub(super) fn new(model: &Model, s: &ScoreSettings) -> Self {
        let n = model.n;
        let mut walk = Symmetric::zeros(n);
        for (columns, std) in
            [(&model.contact, s.drift_contact), (&model.moved, s.drift_electrode_m)]
        {
            columns.chunks_exact(n).for_each(|column| walk.add_square(std * std, column));
        }
        walk.add_square(s.drift_sheet * s.drift_sheet, &model.sheet);
        walk.add_product(1.0, &uneven_drift(model, UNEVEN * s.drift_sheet));
        let mut made = Self {
            reference: vec![0.0; n],
            walk,
            settled: std::array::from_fn(|_| vec![0.0; n]),
            least_eta: s.error.max(model.misfit),
            signal: vec![0.0; n],
            ..Self::default()
        };
        made.restart(model, s);
        made
    }

    /// Forgets all frames.
    pub(super) fn restart(&mut self, model: &Model, s: &ScoreSettings) {
        self.reference.fill(0.0);
        self.covariance.reset(model.n);
        self.covariance.add_diagonal(1.0 / model.reference_frames as f64);
        self.memory.reset(model.n);
        self.disturbance = 0.0;
        self.settled.iter_mut().for_each(|settled| settled.fill(0.0));
        self.shares = [0.0; SETTLING];
        let own = s.settle * s.settle / SETTLING as f64;
        self.share_covariance =
            std::array::from_fn(|k| std::array::from_fn(|l| if k == l { own } else { 0.0 }));
        self.eta = self.least_eta;
    }

    /// Lets the reference drift, and what the fabric remembers flow into it.
    pub(super) fn advance(&mut self, s: &ScoreSettings, dt_s: f64) {
        self.covariance.add(dt_s / DRIFT_S, &self.walk);
        self.covariance.add_diagonal((dt_s / s.drift_s).min(1.0));
        self.covariance.add(2.0 * dt_s / s.trail_s, &self.memory);
    }

    /// Sets `total` to `S`.
    pub(super) fn sum(&self, model: &Model, total: &mut Symmetric) {
        total.set(&self.covariance);
        total.add(1.0, &self.memory);
        total.add(1.0, &model.waves);
        total.add(self.disturbance, &model.field);
        total.add_diagonal(1.0);
        for (k, a) in self.settled.iter().enumerate() {
            for (l, b) in self.settled.iter().enumerate() {
                total.add_outer(self.share_covariance[k][l], a, b);
            }
        }
    }

    /// Subtracts from rows what is known of the reference and of settling.
    pub(super) fn subtract(&self, rows: &mut [f64]) {
        rows.iter_mut().zip(&self.reference).for_each(|(row, r)| *row -= r);
        for (settled, share) in self.settled.iter().zip(self.shares) {
            rows.iter_mut().zip(settled).for_each(|(row, s)| *row += share * s);
        }
    }

    /// Forgets the reference of rows: they have one of their own, up to a part of their voltage.
    pub(super) fn loosen(&mut self, model: &Model, rows: impl Iterator<Item = usize>, part: f64) {
        for i in rows {
            self.covariance.add_at(i, i, (part * model.sheet[i]).powi(2));
        }
    }

    /// Adds the variance of a change of all rows.
    pub(super) fn loosen_along(&mut self, std: f64, change: &[f64]) {
        self.covariance.add_square(std * std, change);
    }

    /// Adds the variance of an electrode's gain.
    pub(super) fn loosen_gain(&mut self, model: &Model, electrode: usize, std: f64) {
        gain_column(model, electrode, &mut self.columns);
        self.covariance.add_square(std * std, &self.columns);
    }
}

/// Factor `[place][row]` of the covariance of an uneven drift of the sheet: a Gaussian field of this standard deviation whose
/// correlation (Matérn, 3/2) has half of the skin's longer side as its length.
fn uneven_drift(model: &Model, std: f64) -> Vec<f64> {
    let grid = &model.grid;
    let at = |k: usize| grid.at[grid.dents[k]].position_m;
    let places = grid.dents.len();
    let kernel = Mat::from_fn(places, places, |i, j| {
        let d = 3.0_f64.sqrt() * distance_m(at(i), at(j)) / model.half_m;
        (1.0 + d) * (-d).exp() + if i == j { RIDGE } else { 0.0 }
    });
    let of_place = std * model.area_m2 / places as f64;
    let prints =
        Mat::from_fn(model.n, places, |row, k| of_place * model.dictionary.of(grid.dents[k])[row]);
    let root = kernel.llt(faer::Side::Lower).map(|factor| factor.L().to_owned());
    let product = root.map(|root| &prints * root).unwrap_or(prints);
    product.col_iter().flat_map(|column| column.iter().copied().collect::<Vec<_>>()).collect()
}

/// Effect of an electrode's gain on all rows.
pub(super) fn gain_column(model: &Model, electrode: usize, out: &mut Vec<f64>) {
    out.clear();
    out.extend((0..model.n).map(|row| model.gain(electrode, row)));
}

/// Adds the effect of a touch's print on all rows, with a strength.
fn add_print(scene: &Scene<'_>, touch: &TouchState, strength_m2: f64, out: &mut [f64]) {
    let n = out.len();
    let columns = scene.model.dictionary.of(touch.spot.place);
    let [print, ..] = touch.print();
    for (column, factor) in columns.chunks_exact(n).zip(print) {
        out.iter_mut().zip(column).for_each(|(o, c)| *o += strength_m2 * factor * c);
    }
}
