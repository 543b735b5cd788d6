//! Size of the model's error, found from the frames.

use super::ScoreDetector;
use super::estimate::Scene;
use super::state::Hypothesis;

/// Factor by which another size of the model's error is tried, and the frames between.
const ETA_STEP: f64 = 1.2;
const ETA_EVERY: u64 = 10;

impl ScoreDetector {
    /// Tries a larger or smaller error of the model, in turn.
    pub(super) fn fit_error(&mut self, found: &Hypothesis, dt_s: f64) {
        if found.touches.is_empty() || !self.frames.is_multiple_of(ETA_EVERY) {
            return;
        }
        let is_larger = self.frames / ETA_EVERY % 2 == 1;
        let other_eta = self.background.eta * if is_larger { ETA_STEP } else { ETA_STEP.recip() };
        let own = self.cost_of_error(found, self.background.eta, dt_s);
        if self.cost_of_error(found, other_eta, dt_s) < own {
            self.background.eta = other_eta.max(self.background.least_eta);
        }
    }

    /// Score of some touches with an error of the model.
    fn cost_of_error(&mut self, found: &Hypothesis, eta: f64, dt_s: f64) -> f64 {
        let Self { model, settings, background, search, frame, other, other_error, .. } = self;
        let scene = Scene { model, settings, dt_s };
        background.errors(&scene, &found.touches, eta, &self.gains, other_error);
        let present = &frame.present;
        other.set(&self.base, other_error, &self.y, |row| present.binary_search(&row).is_ok());
        let fit = search.estimator.fit(&scene, other, &found.touches, 1, 0);
        fit.score + ((eta / settings.error).ln() / settings.error_std).powi(2)
    }
}
