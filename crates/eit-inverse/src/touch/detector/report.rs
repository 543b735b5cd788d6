//! What is reported of a frame: its touches, how they explain it, and an electrode that explains it better.

use super::gains::BLAME_FROM;
use super::step::{DetectedTouch, DetectorStep, is_explained};
use super::vectors::dot;
use super::{Scene, TouchDetector};
use crate::touch::skin::in_space;

impl TouchDetector {
    /// Finds an electrode whose gain explains this frame better than its touches, or far better together with them; the
    /// former, a contact that got worse, takes the touches away.
    pub(super) fn blamed(&mut self) -> Option<usize> {
        let alone = self.gains.best(&self.whitening, &self.search.residual_without);
        let scene = scene!(self);
        match alone {
            Some((electrode, rest))
                if !self.is_joint && self.search.is_beaten_by_gain(&scene, rest) =>
            {
                self.search.take_back(&scene);
                Some(electrode)
            }
            _ => {
                let whole = dot(&self.whitened, &self.whitened);
                self.gains.blamed(&self.search, &self.whitening, whole)
            }
        }
    }

    /// Finds an electrode whose gain explains this frame together with the touches of the last
    /// explained frame, if nothing else does: a contact that changes under a finger.
    pub(super) fn blamed_beside_known(&mut self) -> Option<usize> {
        if self.search.best.rest <= BLAME_FROM * self.whitening.present() as f64 {
            self.known.clone_from(&self.search.best.spots);
            return None;
        }
        if self.known.is_empty() {
            return None;
        }
        self.work.copy_from_slice(&self.whitened);
        let Self { search, gains, known, basis, work, .. } = self;
        let scene = scene!(self);
        search.without(&scene, known, work, basis);
        let blamed = gains.beside_known(&self.whitening, work, basis);
        search.fit_best_again(&scene);
        blamed
    }

    /// Sets the touches of the frame.
    pub(super) fn report(&mut self) {
        let (sign, gain) = (self.settings.sign.factor(), self.whitening.present().max(1) as f64);
        let Self { search, places, dictionary, touches, errors_m, .. } = self;
        touches.clear();
        errors_m.clear();
        let best = std::mem::take(&mut search.best);
        for (k, spot) in best.spots.iter().enumerate() {
            touches.push(DetectedTouch {
                position_m: spot.position_m,
                normal: places.normal(spot),
                position_covariance_m2: [[0.0; 3]; 3],
                strength_s_m2: sign * best.strengths[k],
                strength_std_s_m2: 0.0,
                peak_s: sign * best.strengths[k] * dictionary.top(spot.place),
                worth: best.worth[k],
                learnt: None,
            });
        }
        let excess = (best.rest / gain).max(1.0);
        let homes: [usize; 16] =
            std::array::from_fn(|k| best.spots.get(k).map_or(0, |spot| spot.place));
        let spreads: [_; 16] = std::array::from_fn(|k| best.spots.get(k)?.spread_m2);
        search.covariances(&best, |k, strength, [a, b, c, d]| {
            let plane = [[excess * a, excess * b], [excess * c, excess * d]];
            let own = in_space(plane, places.at[homes[k]].tangents);
            touches[k].position_covariance_m2 = spreads[k].unwrap_or(own);
            let square = |m: [[f64; 3]; 3]| (0..3).map(|i| m[i][i]).sum::<f64>();
            errors_m.push(spreads[k].map_or(a + d, square).sqrt());
            touches[k].strength_std_s_m2 = (excess * strength).sqrt();
        });
        search.best = best;
    }

    /// How the frame is explained.
    pub(super) fn step(&self, blamed: Option<usize>) -> DetectorStep {
        let (rows, rest) = (self.whitening.present(), self.search.best.rest);
        let [whole, without] =
            [&self.whitened, &self.search.residual_without].map(|values| dot(values, values));
        let step = DetectorStep::new(rows, [whole, rest], is_explained(rows, whole, rest));
        DetectorStep { chi_square_without: without, blamed, ..step }
    }
}
