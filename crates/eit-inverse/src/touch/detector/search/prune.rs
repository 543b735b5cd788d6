//! Pruning: touches that have too little evidence, or are a part of others, are dropped.

use super::Search;
use crate::geometry::distance_m;
use crate::touch::detector::scene::{Fit, Scene};

/// Factor by which the residual must grow without a touch that has slid and continues at less than
/// an eighth of its recent strength, after a frame with nothing stronger. The remains of a finished
/// slide made it grow 2.1 to 3.3 times; a finger of that strength would have made it grow 8 to 12
/// times. Fingers that lift may fall below it for one frame.
const LEFT_RATIO: f64 = 4.0;

/// A position whose touch lowers chi^2 by this much, but not enough, is remembered for one frame, ...
const REMEMBERED: f64 = 14.0;

/// ... and is a touch if both frames together lower it by this much.
const TWICE: f64 = 40.0;

/// Touches closer than this fraction of the least distance are merged: the weaker one is dropped.
pub(in super::super) const MERGE: f64 = 0.7;

/// A press is never exactly a bell. A touch closer to a stronger one than this fraction of the
/// least distance ...
const BESIDE: f64 = 1.2;

/// ... and weaker than this fraction of its strength is part of it.
const BESIDE_SHARE: f64 = 0.35;

impl Search {
    /// Whether all of the best touches are so faint beside a recent one that they may be its
    /// remains.
    pub(in super::super) fn may_be_left_behind(&self, scene: &Scene<'_>) -> bool {
        let least = scene.settings.least_share_of_here * scene.late.strongest_s_m2;
        !self.best.spots.is_empty() && self.best.strengths.iter().all(|s| *s < least)
    }

    /// Drops the best touches that the changed covariance explains.
    pub(in super::super) fn prune(&mut self, scene: &Scene<'_>) {
        let mut without = std::mem::take(&mut self.trial);
        without.spots.clear();
        self.fit(scene, &mut without);
        self.trial = without;
        self.residual_without.copy_from_slice(&self.residual);
        self.backward(scene);
    }

    /// Repeatedly drops the weakest of the touches that have too little evidence, are too faint or
    /// too close to a stronger one, and fits the others again.
    pub(super) fn backward(&mut self, scene: &Scene<'_>) {
        self.weak.clear();
        let mut best = std::mem::take(&mut self.best);
        // the residual of the best fit, not of the last one on the path
        self.fit_strengths(scene, &mut best);
        loop {
            self.weigh(scene, &mut best);
            let is_wrong = |k: &usize| scene.is_wrong(&best, *k);
            let worth = |k: &usize| best.worth[*k];
            let dropped =
                (0..best.spots.len()).filter(is_wrong).min_by(|a, b| worth(a).total_cmp(&worth(b)));
            let Some(dropped) = dropped else { break };
            let gain = scene.gain(&best, dropped);
            if gain >= REMEMBERED && !scene.is_faint(&best, dropped) {
                self.weak.push((best.spots[dropped].position_m, gain));
            }
            best.spots.remove(dropped);
            self.fit(scene, &mut best);
        }
        self.best = best;
    }
}

impl Scene<'_> {
    /// Decrease of chi^2 by a touch of a fit.
    fn gain(&self, fit: &Fit, k: usize) -> f64 {
        (fit.worth[k] - 1.0) * self.evidence().unit(fit.rest)
    }

    /// Whether a touch is too faint beside the others, or a recent one.
    fn is_faint(&self, fit: &Fit, k: usize) -> bool {
        fit.strengths[k] < self.least_strength(fit, k)
    }

    /// Whether a touch is so faint beside recent ones that it may be what is left of them.
    fn is_doubtful(&self, fit: &Fit, k: usize) -> bool {
        // what presses and slides leave behind is a small part of them
        let late = match self.is_known(fit.spots[k].position_m) {
            true => self.late.here_s_m2[fit.spots[k].place],
            false => self.late.strongest_s_m2,
        };
        fit.strengths[k] < self.settings.least_share_of_here * late
    }

    /// Whether a touch has too little evidence.
    fn is_weak(&self, fit: &Fit, k: usize) -> bool {
        let (settings, at_m) = (self.settings, fit.spots[k].position_m);
        let (gain, worth) = (self.gain(fit, k), fit.worth[k]);
        let is_left = self.late.was_faint && self.before.has_slid(at_m);
        let ratio = if is_left { LEFT_RATIO } else { settings.least_ratio };
        if self.is_doubtful(fit, k) && gain < (ratio - 1.0) * fit.rest {
            return true;
        }
        if self.is_known(at_m) {
            return gain < settings.least_gain_of_known || worth < settings.least_ratio_of_known;
        }
        let earlier = self.earlier(at_m);
        let mean_worth = 1.0 + 0.5 * (gain + earlier) / self.evidence().unit(fit.rest);
        let is_enough = gain >= settings.least_gain && worth >= settings.least_ratio;
        let are_enough =
            earlier > 0.0 && gain + earlier >= TWICE && mean_worth >= settings.least_ratio;
        !(is_enough || are_enough)
    }

    /// Whether a touch is to be dropped.
    fn is_wrong(&self, fit: &Fit, k: usize) -> bool {
        let apart_m = self.settings.apart_m;
        self.is_weak(fit, k)
            || self.is_faint(fit, k)
            || is_beside(fit, k, MERGE * apart_m, 1.0)
            || (is_beside(fit, k, BESIDE * apart_m, BESIDE_SHARE)
                && !self.before.began_alone(fit.spots[k].position_m))
    }
}

/// Returns whether a touch is within `near_m` of one of which it has less than the fraction `share`.
fn is_beside(fit: &Fit, k: usize, near_m: f64, share: f64) -> bool {
    let stronger = (0..fit.spots.len()).filter(|&i| fit.strengths[k] < share * fit.strengths[i]);
    let mut way = stronger.map(|i| distance_m(fit.spots[i].position_m, fit.spots[k].position_m));
    way.any(|way_m| way_m < near_m)
}
