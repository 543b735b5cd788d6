//! What a frame tells of the reference, of settling, and of what touches leave behind.

use super::error::second_order;
use super::{Background, add_print};
use crate::geometry::distance_m;
use crate::touch::detector::dot;
use crate::touch::score::actions::{FIRST_ACTION, Features};
use crate::touch::score::estimate::Scene;
use crate::touch::score::settings::{SETTLING, ScoreSettings};
use crate::touch::score::state::{TouchState, Touches};
use crate::touch::score::whitened::Whitened;

/// Uncertainty of strength, relative, and of position, metres, beyond which a touch takes nothing more from the
/// reference.
const WIDE_STRENGTH: f64 = 10.0;
const WIDE_M: f64 = 10e-3;
/// Way from which a touch lays a trail, metres.
const LAID_FROM_M: f64 = 3e-3;

impl Background {
    /// Updates reference, memory and settling after a frame `y` of all rows that these touches explain.
    pub(in crate::touch::score) fn learn(
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

    /// Factorises the covariance by which the reference is updated: touches have wide priors, and their errors last, so
    /// that each frame tells less; `heat`: by how much an unlikely frame tells less still.
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
