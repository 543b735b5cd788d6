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

use super::actions::{FIRST_ACTION, Features};
use super::dictionary::CONTACT_M;
use super::estimate::Scene;
use super::linear::{Factor, Symmetric};
use super::model::Model;
use super::settings::{SETTLING, ScoreSettings};
use super::state::{TouchState, Touches};
use super::whitened::Whitened;
use crate::geometry::distance_m;
use crate::touch::detector::dot;
use faer::Mat;

/// Addition to a correlation of 1: rounding.
const RIDGE: f64 = 1e-6;
/// Time over which drifts are stated, seconds.
const DRIFT_S: f64 = 60.0;
/// Part of the sheet's drift that is uneven.
const UNEVEN: f64 = 0.5;
/// Uncertainty of strength, relative, and of position, metres, beyond which a touch takes nothing more from the reference.
const WIDE_STRENGTH: f64 = 10.0;
const WIDE_M: f64 = 10e-3;
/// Disturbance by a touch relative to its strength over the skin's area: on a disc of radius `R`, 1 at the mean square distance
/// from its middle (`R^2 / 2`), 0.5 at that of two of its points (`R^2`). Chosen between them in sight of a tank.
const DISTURBED: f64 = 0.7;
/// Way from which a touch lays a trail, metres.
const LAID_FROM_M: f64 = 3e-3;
/// Distance up to which the pull of a touch on an electrode does not fall, metres.
const PULLED_M: f64 = 0.03;

/// State of everything that is not a touch.
#[derive(Debug, Clone)]
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
        let least_eta = s.error.max(model.misfit);
        let mut made = Self {
            reference: vec![0.0; n],
            covariance: Symmetric::zeros(n),
            walk,
            memory: Symmetric::zeros(n),
            disturbance: 0.0,
            settled: std::array::from_fn(|_| vec![0.0; n]),
            shares: [0.0; SETTLING],
            share_covariance: [[0.0; SETTLING]; SETTLING],
            eta: least_eta,
            least_eta,
            columns: Vec::new(),
            rows: Vec::new(),
            diagonal: Vec::new(),
            signal: vec![0.0; n],
            innovation: Vec::new(),
            of_update: Factor::default(),
            update: Symmetric::default(),
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

    /// Sets `out` to `E` of some touches. `gains`: by how much each row's gain is off because an electrode drifts, squared.
    pub(super) fn errors(
        &mut self,
        scene: &Scene<'_>,
        touches: &[TouchState],
        eta: f64,
        gains: &[f64],
        out: &mut Symmetric,
    ) {
        let n = scene.model.n;
        out.reset(n);
        if touches.is_empty() {
            return;
        }
        self.set_error(scene, touches, eta, gains);
        let beyond = second_order(scene.model, touches) - self.disturbance;
        out.add(beyond.max(0.0), &scene.model.field);
        self.diagonal.iter().enumerate().for_each(|(i, d)| out.add_at(i, i, *d));
        out.add_product(1.0, &self.columns);
    }

    /// Returns whether `E` of some touches is more than twice as large in any row as one that is given.
    pub(super) fn grows(
        &mut self,
        scene: &Scene<'_>,
        touches: &[TouchState],
        eta: f64,
        gains: &[f64],
        given: &Symmetric,
    ) -> bool {
        if touches.is_empty() {
            return false;
        }
        self.set_error(scene, touches, eta, gains);
        for column in self.columns.chunks_exact(scene.model.n) {
            self.diagonal.iter_mut().zip(column).for_each(|(d, c)| *d += c * c);
        }
        let beyond = second_order(scene.model, touches) - self.disturbance;
        let own = |i: usize| beyond.max(0.0) * scene.model.field.get(i, i);
        self.diagonal.iter().enumerate().any(|(i, d)| *d + own(i) > 2.0 * given.get(i, i) + 1.0)
    }

    /// Sets the parts of `E`: a diagonal, and columns.
    fn set_error(&mut self, scene: &Scene<'_>, touches: &[TouchState], eta: f64, gains: &[f64]) {
        let (model, s, n) = (scene.model, scene.settings, scene.model.n);
        self.diagonal.clear();
        self.diagonal.resize(n, 0.0);
        let mut whole = std::mem::take(&mut self.signal);
        whole.fill(0.0);
        for touch in touches {
            self.columns.clear();
            self.columns.resize(n, 0.0);
            add_print(scene, touch, touch.strength_m2, &mut self.columns);
            for (i, signal) in self.columns.iter().enumerate() {
                whole[i] += signal;
                self.diagonal[i] += (eta * eta + gains[i]) * signal * signal;
            }
        }
        self.columns.clear();
        let far = |d: f64| (PULLED_M / d).min(1.0);
        let near = |d: f64| (-d / CONTACT_M).exp();
        self.electrode_columns(&model.moved_at, &model.moved, |at_m| {
            s.single * s.pull_m * of_touches(s, touches, at_m, far)
        });
        self.electrode_columns(&model.contact_at, &model.contact, |at_m| {
            s.single * s.press * of_touches(s, touches, at_m, near)
        });
        for of in &model.of {
            for i in 0..n {
                let error = if of[i] { (eta * eta + gains[i]).sqrt() * whole[i] } else { 0.0 };
                self.columns.push(error);
            }
        }
        self.signal = whole;
    }

    /// Adds columns of electrodes, each with a factor that depends on where it is.
    fn electrode_columns(
        &mut self,
        at_m: &[[f64; 3]],
        columns: &[f64],
        factor: impl Fn([f64; 3]) -> f64,
    ) {
        let n = columns.len() / at_m.len().max(1);
        for (at_m, column) in at_m.iter().zip(columns.chunks_exact(n.max(1))) {
            let factor = factor(*at_m);
            self.columns.extend(column.iter().map(|c| factor * c));
        }
    }

    /// Updates reference, memory and settling after a frame `y` of all rows that these touches explain.
    pub(super) fn learn(
        &mut self,
        scene: &Scene<'_>,
        frame: &Whitened,
        heat: f64,
        touches: &mut Touches,
        y: &[f64],
    ) {
        let n = scene.model.n;
        self.signal.fill(0.0);
        let mut signal = std::mem::take(&mut self.signal);
        touches.iter().for_each(|t| add_print(scene, t, t.strength_m2, &mut signal));
        self.set_update(scene, frame, heat, touches);
        self.innovation.clear();
        self.innovation.extend(frame.present.iter().map(|&i| y[i] - signal[i]));
        self.update_reference(frame, n);
        // while something moves on the skin, errors of its print look like what it leaves behind
        if touches.is_empty() {
            self.update_shares(frame, scene.settings);
        }
        self.remember(scene, touches);
        let fading = self.disturbance * (-2.0 * scene.dt_s / scene.settings.trail_s).exp();
        self.disturbance = fading.max(second_order(scene.model, touches));
        for (settled, time_s) in self.settled.iter_mut().zip(scene.settings.settle_s) {
            let weight = -(-scene.dt_s / time_s).exp_m1();
            settled.iter_mut().zip(&signal).for_each(|(s, now)| *s += weight * (now - *s));
        }
        self.signal = signal;
    }

    /// Factorises the covariance by which the reference is updated: touches have wide priors, and their errors last, so that
    /// each frame tells less; `heat`: by how much an unlikely frame tells less still.
    fn set_update(&mut self, scene: &Scene<'_>, frame: &Whitened, heat: f64, touches: &Touches) {
        self.update.set(&frame.covariance);
        let (s, n) = (scene.settings, scene.model.n);
        let lasting = 2.0 * s.error_s / scene.dt_s;
        self.columns.clear();
        for touch in touches.iter() {
            let features = Features::new(touch, s);
            let rows = scene.model.dictionary.of(touch.spot.place);
            for feature in 0..features.count {
                let weight = match feature {
                    0 => WIDE_STRENGTH * touch.strength_m2,
                    f if f < FIRST_ACTION => WIDE_M,
                    _ => lasting.sqrt(),
                };
                let from = self.columns.len();
                self.columns.resize(from + n, 0.0);
                features.add_rows(feature, weight, rows, &mut self.columns[from..]);
            }
            let own = self.columns.len() - features.count * n;
            for (a, &i) in frame.present.iter().enumerate() {
                let print = self.columns[own + i] / WIDE_STRENGTH;
                self.update.add_at(a, a, self.eta * self.eta * lasting * print * print);
            }
        }
        self.rows.clear();
        for column in self.columns.chunks_exact(n) {
            self.rows.extend(frame.present.iter().map(|&i| column[i]));
        }
        self.update.add_product(1.0, &self.rows);
        let field = &scene.model.field;
        let weight = lasting * second_order(scene.model, touches);
        for (a, &i) in frame.present.iter().enumerate() {
            for (b, &j) in frame.present[..=a].iter().enumerate() {
                self.update.add_at(a, b, weight * field.get(i, j));
            }
        }
        self.update.scale(heat);
        self.of_update.of(&self.update);
    }

    /// `r += R C^-1 (y - D a)`, `R -= R C^-1 R`.
    fn update_reference(&mut self, frame: &Whitened, n: usize) {
        let Self { covariance, rows, of_update, innovation, reference, .. } = self;
        rows.clear();
        for i in 0..n {
            rows.extend(frame.present.iter().map(|&j| covariance.get(i, j)));
        }
        of_update.solve(rows);
        of_update.solve(innovation);
        let m = frame.n().max(1);
        for (r, row) in reference.iter_mut().zip(rows.chunks_exact(m)) {
            *r += dot(row, innovation);
        }
        covariance.add_inner_product(-1.0, rows, frame.n());
    }

    /// The same of the shares by which the fabric settles; [`Self::update_reference`] has whitened the innovation.
    fn update_shares(&mut self, frame: &Whitened, s: &ScoreSettings) {
        self.rows.clear();
        for settled in &self.settled {
            self.rows.extend(frame.present.iter().map(|&i| settled[i]));
        }
        self.of_update.solve(&mut self.rows);
        let white = |k: usize| &self.rows[k * frame.n()..(k + 1) * frame.n()];
        let p = self.share_covariance;
        let sum = |of: &dyn Fn(usize) -> f64| (0..SETTLING).map(of).sum::<f64>();
        let gain: [f64; SETTLING] = std::array::from_fn(|k| dot(white(k), &self.innovation));
        let known: [[f64; SETTLING]; SETTLING] =
            std::array::from_fn(|k| std::array::from_fn(|l| dot(white(k), white(l))));
        for k in 0..SETTLING {
            self.shares[k] -= sum(&|l| p[k][l] * gain[l]);
            for l in 0..SETTLING {
                self.share_covariance[k][l] -= sum(&|i| p[k][i] * sum(&|j| known[i][j] * p[j][l]));
            }
            let own = &mut self.share_covariance[k][k];
            // touches differ by as much as in their trails
            *own = own.max(s.trail * s.trail);
        }
    }

    /// Lets trails fade, and adds those of touches that press harder or have moved.
    fn remember(&mut self, scene: &Scene<'_>, touches: &mut Touches) {
        let (s, n) = (scene.settings, scene.model.n);
        let time_s = if touches.is_empty() { s.trail_s } else { s.error_s };
        self.memory.scale((-2.0 * scene.dt_s / time_s).exp());
        for touch in touches.iter_mut() {
            let part = newly_laid(touch, s);
            if part <= 0.0 {
                continue;
            }
            self.columns.clear();
            self.columns.resize(n, 0.0);
            add_print(scene, touch, s.trail * touch.strength_m2, &mut self.columns);
            self.memory.add_square(part, &self.columns);
            let ring = &scene.model.dictionary.of(touch.spot.place)[6 * n..7 * n];
            self.memory.add_square(part * (s.trail_ring * touch.strength_m2).powi(2), ring);
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

/// Variance of the changes anywhere that strong touches look like: the model is linear, but a touch of strength `a` disturbs the
/// currents like a dipole, by `a / (2 pi d^2)` at a distance `d`, relative.
fn second_order(model: &Model, touches: &[TouchState]) -> f64 {
    let part = |touch: &TouchState| touch.strength_m2 * DISTURBED / model.area_m2;
    touches.iter().map(|touch| (part(touch) * touch.strength_m2).powi(2)).sum()
}

/// Effect of an electrode's gain on all rows.
pub(super) fn gain_column(model: &Model, electrode: usize, out: &mut Vec<f64>) {
    out.clear();
    out.extend((0..model.n).map(|row| model.gain(electrode, row)));
}

/// Part of a whole trail that a touch lays in this frame.
fn newly_laid(touch: &mut TouchState, s: &ScoreSettings) -> f64 {
    let moved_m = distance_m(touch.spot.position_m, touch.laid_at_m);
    if moved_m > LAID_FROM_M {
        (touch.laid_at_m, touch.laid_m2) = (touch.spot.position_m, touch.strength_m2);
        (moved_m / s.trail_m).min(1.0)
    } else if touch.strength_m2 > touch.laid_m2 {
        let before = std::mem::replace(&mut touch.laid_m2, touch.strength_m2);
        1.0 - before / touch.strength_m2
    } else {
        0.0
    }
}

/// Root of the sum of squares over touches of a function of the distance to a point.
fn of_touches(
    s: &ScoreSettings,
    touches: &[TouchState],
    at_m: [f64; 3],
    of: impl Fn(f64) -> f64,
) -> f64 {
    let square = |t: &TouchState| {
        let part = t.strength_m2 / (t.strength_m2 + s.typical_m2);
        (part * of(distance_m(t.spot.position_m, at_m))).powi(2)
    };
    touches.iter().map(square).sum::<f64>().sqrt()
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
