//! `E`: the error of the model under touches.

use super::{Background, add_print};
use crate::geometry::distance_m;
use crate::touch::score::dictionary::CONTACT_M;
use crate::touch::score::estimate::Scene;
use crate::touch::score::linear::Symmetric;
use crate::touch::score::model::Model;
use crate::touch::score::settings::ScoreSettings;
use crate::touch::score::state::TouchState;

/// Disturbance by a touch relative to its strength over the skin's area: on a disc of radius `R`, 1 at the mean square
/// distance from its middle (`R^2 / 2`), 0.5 at that of two of its points (`R^2`). Chosen between them in sight of a
/// tank.
const DISTURBED: f64 = 0.7;
/// Distance up to which the pull of a touch on an electrode does not fall, metres.
const PULLED_M: f64 = 0.03;

impl Background {
    /// Sets `out` to `E` of some touches. `gains`: by how much each row's gain is off because an electrode drifts,
    /// squared.
    pub(in crate::touch::score) fn errors(
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
        out.add(self.beyond(scene, touches), &scene.model.field);
        self.diagonal.iter().enumerate().for_each(|(i, d)| out.add_at(i, i, *d));
        out.add_product(1.0, &self.columns);
    }

    /// Returns whether `E` of some touches is more than twice as large in any row as one that is given.
    pub(in crate::touch::score) fn grows(
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
        let beyond = self.beyond(scene, touches);
        let own = |i: usize| beyond * scene.model.field.get(i, i);
        self.diagonal.iter().enumerate().any(|(i, d)| *d + own(i) > 2.0 * given.get(i, i) + 1.0)
    }

    /// Variance of the field by which these touches disturb more than earlier ones.
    fn beyond(&self, scene: &Scene<'_>, touches: &[TouchState]) -> f64 {
        (second_order(scene.model, touches) - self.disturbance).max(0.0)
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
}

/// Variance of the changes anywhere that strong touches look like: the model is linear, but a touch of strength `a`
/// disturbs the currents like a dipole, by `a / (2 pi d^2)` at a distance `d`, relative.
pub(super) fn second_order(model: &Model, touches: &[TouchState]) -> f64 {
    let part = |touch: &TouchState| touch.strength_m2 * DISTURBED / model.area_m2;
    touches.iter().map(|touch| (part(touch) * touch.strength_m2).powi(2)).sum()
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
