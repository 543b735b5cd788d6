//! Second look at touches of little worth, together with what they do to electrodes ([`super::joint`]).
//!
//! The search weighs a touch against the same frame without it in which the fabric may still move as if it were there.
//! Beyond the outer electrodes that movement is most of what a touch changes, so touches there are dropped, or sought
//! where their own small part fits best. Here a touch and its movement are one hypothesis: whichever of the first and
//! the last search's touches explain the frame best are taken, those of little worth are moved to where they and their
//! actions explain most, and what was dropped is tried again against pressure on contacts or a gain of one electrode,
//! either of which can happen without a touch.
//!
//! **Cost.** None for frames whose touches are all worth much, and for frames without any. Each touch that is moved or
//! tried takes a scan of some 75 positions, of `7 n` numbers and `28 n` flops for each vector projected out, and up to
//! three fits.
//!
//! Over 300 lines: the steps share one detector, whose free unknowns each of them changes.

use super::TouchDetector;
use super::evidence::Evidence;
use super::joint::{Found, remove_all};
use super::places::Spot;
use super::scene::{Fit, Scene};
use super::search::MERGE;
use super::vectors::dot;
use crate::geometry::distance_m;

/// Reach of the search around a touch, metres: from the apparent position of a finger beyond the
/// outer electrodes, without its actions, to its true one.
const REACH_M: f64 = 50e-3;

/// Maximum number of touches for which a frame is reconsidered: six fingers on the paper's disc
/// gain nothing by it, and the slowest frames would take twice as long.
const MOST_TOUCHES: usize = 4;

/// Touches with a higher evidence ratio are left where they are.
const SURE: f64 = 4.0;

/// ... and so are those whose position error without their actions is smaller than this, metres,
/// root mean square.
const VAGUE_M: f64 = 3e-3;

/// Largest increase of the cost at the mean of the possible positions of a touch, in units of
/// evidence.
const SLACK: f64 = 0.2;

/// Least evidence ratio, without its actions, of a touch beside others: the effect of a sliding
/// finger on distant electrodes is not known well.
const OWN_WORTH: f64 = 1.25;

/// Positions known better than this are refined by fits, metres, ...
const SHARP_M: f64 = 4e-3;

/// ... unless fits move them farther than this, metres, ...
const AWAY_M: f64 = 10e-3;

/// ... and position error of the others as a multiple of the distance between the scanned
/// positions.
const GRID_M: f64 = 3e-3;

impl TouchDetector {
    /// Collects candidate positions of touches.
    pub(super) fn collect(&mut self) {
        let Self { candidates, search, before, first, .. } = self;
        first.copy_from(&search.best);
        candidates.clear();
        candidates.extend_from_slice(&search.best.spots);
        candidates.extend_from_slice(&before.spots);
    }

    /// Moves weak touches to where they explain more together with their actions, and restores
    /// those that were dropped only because their actions alone explain as much.
    pub(super) fn reconsider(&mut self) {
        self.is_joint = false;
        let is_sure = self.search.best.worth.iter().all(|worth| *worth >= SURE);
        let are_many = self.search.best.spots.len() > MOST_TOUCHES;
        if self.joint.is_none() || are_many || (is_sure && self.missing().next().is_none()) {
            return;
        }
        let mut fit = std::mem::take(&mut self.held);
        self.start_from_better(&mut fit);
        let mut is_vague = [false; 16];
        self.search.covariances(&fit, |k, _, [a, _, _, d]| is_vague[k] = a + d > VAGUE_M.powi(2));
        for (k, is_vague) in is_vague.into_iter().enumerate().take(fit.spots.len()) {
            if fit.worth[k] < SURE && is_vague {
                self.relocate(&mut fit, k);
            }
        }
        self.drop_weak(&mut fit);
        for candidate in 0..self.candidates.len() {
            self.try_again(&mut fit, self.candidates[candidate].position_m);
        }
        self.drop_weak(&mut fit);
        self.finish(&mut fit);
        self.held = fit;
    }

    /// Starts from the touches of the first or the last search, whichever explain the frame better.
    fn start_from_better(&mut self, fit: &mut Fit) {
        fit.copy_from(&self.search.best);
        let cost = self.cost(fit);
        if self.missing().next().is_some() {
            let mut first = std::mem::take(&mut self.first);
            if self.cost(&mut first) < cost {
                fit.copy_from(&first);
            }
            self.first = first;
        }
        self.assess(fit, None);
        self.weigh(fit);
    }

    /// Sets these as the touches of the frame.
    fn finish(&mut self, fit: &mut Fit) {
        self.assess(fit, None);
        self.search.best.copy_from(fit);
        let mut none = std::mem::take(&mut self.other);
        none.spots.clear();
        self.strengths(&mut none);
        self.other = none;
        self.search.residual_without.copy_from_slice(&self.search.residual);
        self.strengths(fit);
        self.is_updated = false;
    }

    /// Fits touches with their own actions and returns their cost.
    fn cost(&mut self, fit: &mut Fit) -> f64 {
        let rest = self.assess(fit, None);
        self.evidence().cost(rest) + self.scene().price(&fit.spots)
    }

    /// Drops touches that explain too little even together with their actions.
    fn drop_weak(&mut self, fit: &mut Fit) {
        loop {
            let with = self.assess(fit, None);
            let unit = self.evidence().unit(fit.rest);
            self.weigh(fit);
            let mut worst: Option<(usize, f64)> = None;
            for k in 0..fit.spots.len() {
                let (least_gain, least_ratio) = self.least_of(fit.spots[k].position_m);
                let is_weak = |worth: f64| (worth - 1.0) * unit < least_gain || worth < least_ratio;
                let is_faint = fit.strengths[k] < self.scene().least_strength(fit, k);
                let is_own = fit.spots.len() == 1 || fit.worth[k] >= self.least_own();
                if is_weak(fit.worth[k]) && !is_faint && is_own {
                    let joint = 1.0 + self.gain_of_touch(fit, k, with) / unit;
                    fit.worth[k] = fit.worth[k].max(joint);
                    self.is_joint |= !is_weak(joint);
                }
                let is_wrong = is_weak(fit.worth[k]) || is_faint;
                if is_wrong && worst.is_none_or(|(_, least)| fit.worth[k] < least) {
                    worst = Some((k, fit.worth[k]));
                }
            }
            let Some((worst, _)) = worst else { return };
            fit.spots.remove(worst);
            fit.worth.remove(worst);
        }
    }

    /// Least evidence ratio of a touch beside others, without its actions.
    fn least_own(&self) -> f64 {
        if self.before.sliding().next().is_some() { OWN_WORTH } else { 1.0 }
    }

    /// Least decrease of chi^2 and least evidence ratio of a touch.
    fn least_of(&self, at_m: [f64; 3]) -> (f64, f64) {
        match self.scene().is_known(at_m) {
            true => (self.settings.least_gain_of_known, self.settings.least_ratio_of_known),
            false => (self.settings.least_gain, self.settings.least_ratio),
        }
    }

    /// Decrease of the cost by a touch and its actions, compared with pressure on contacts or a
    /// gain of one electrode in its place.
    fn gain_of_touch(&mut self, fit: &Fit, k: usize, with: f64) -> f64 {
        let mut without = std::mem::take(&mut self.third);
        without.copy_from(fit);
        let at_m = without.spots.remove(k).position_m;
        let mut cost = self.assess(&mut without, Some(at_m));
        let gain = self.gains.best(&self.whitening, &self.search.residual);
        if let Some((_, rest)) = gain {
            cost += rest - dot(&self.search.residual, &self.search.residual);
        }
        self.third = without;
        cost - with
    }

    /// Candidates without a touch.
    fn missing(&self) -> impl Iterator<Item = usize> {
        let near_m = MERGE * self.settings.apart_m;
        let best = &self.search.best.spots;
        let is_free = move |&k: &usize| {
            let at_m = self.candidates[k].position_m;
            best.iter().all(|spot| distance_m(spot.position_m, at_m) >= near_m)
        };
        (0..self.candidates.len()).filter(is_free)
    }

    fn scene(&self) -> Scene<'_> {
        scene!(self)
    }

    /// Fits touches with their own actions free, and pressure on contacts at one more place if asked for; returns the
    /// residual and the logarithm of the determinant.
    fn assess(&mut self, fit: &mut Fit, pressed: Option<[f64; 3]>) -> f64 {
        self.free(fit, pressed);
        let scene = scene!(self);
        self.search.fit(&scene, fit);
        fit.rest + self.whitening.log_determinant()
    }

    /// Frees the actions of touches, and pressure on contacts at one more place if asked for.
    fn free(&mut self, fit: &Fit, pressed: Option<[f64; 3]>) {
        let Self { electrodes, places, dents, before, .. } = self;
        electrodes.clear();
        electrodes.add(&fit.spots, before, places, dents);
        let own = electrodes.actions.len();
        if let Some(at_m) = pressed {
            electrodes.press(at_m);
        }
        self.whitening.free(&electrodes.actions, &electrodes.dented);
        electrodes.actions.truncate(own);
        self.project();
    }

    fn strengths(&mut self, fit: &mut Fit) {
        let scene = scene!(self);
        self.search.fit_strengths(&scene, fit);
    }

    fn evidence(&mut self) -> Evidence {
        self.whitening.expect();
        self.scene().evidence()
    }

    fn weigh(&mut self, fit: &mut Fit) {
        self.whitening.expect();
        let scene = scene!(self);
        self.search.weigh(&scene, fit);
    }

    /// Moves a touch to where it explains most together with its actions.
    fn relocate(&mut self, fit: &mut Fit, k: usize) {
        let cost = self.assess(fit, None);
        let unit = self.evidence().unit(fit.rest);
        let mut other = std::mem::take(&mut self.other);
        other.copy_from(fit);
        other.spots.remove(k);
        self.free(&other, None);
        self.strengths(&mut other);
        let near_m = MERGE * self.settings.apart_m;
        let is_allowed = |at_m: [f64; 3]| {
            let others = fit.spots.iter().enumerate().filter(|(i, _)| *i != k);
            others.map(|(_, spot)| distance_m(spot.position_m, at_m)).all(|way_m| way_m >= near_m)
        };
        let around = (fit.spots[k].position_m, REACH_M);
        let found = self.scan(other.spots.len(), fit.rest, around, is_allowed);
        if let Some(found) = found {
            other.copy_from(fit);
            other.spots[k] = self.spot_of(&found);
            let moved = self.assess_near(&mut other, k, &found);
            // a mean position fits a little worse than the best one
            let slack = if other.spots[k].spread_m2.is_some() { SLACK * unit } else { 0.0 };
            if other.strengths[k] > 0.0 && moved < cost + slack {
                self.weigh(&mut other);
                fit.copy_from(&other);
            }
        }
        self.other = other;
    }

    /// Scans the residual of the last fit, of some touches.
    fn scan(
        &mut self,
        touches: usize,
        rest: f64,
        around: ([f64; 3], f64),
        is_allowed: impl Fn([f64; 3]) -> bool,
    ) -> Option<Found> {
        let excess = (rest / self.whitening.present().max(1) as f64).max(1.0);
        let Self { joint, whitening, places, search, basis, .. } = self;
        search.span(touches, basis);
        remove_all(&mut search.residual, basis);
        joint.as_mut()?.scan(
            whitening,
            places,
            (&search.residual, excess),
            basis,
            around,
            is_allowed,
        )
    }

    /// Position of a touch: the mean if its effect on electrodes hardly determines it, else the
    /// best one, which fits then refine.
    fn spot_of(&self, found: &Found) -> Spot {
        match found.std_m() < SHARP_M {
            true => self.places.spot(found.place),
            false => self.mean_spot(found),
        }
    }

    fn mean_spot(&self, found: &Found) -> Spot {
        let mut spread_m2 = found.covariance_m2;
        (0..3).for_each(|i| spread_m2[i][i] += GRID_M.powi(2));
        Spot { spread_m2: Some(spread_m2), ..self.places.nearest(found.mean_m) }
    }

    /// Like [`assess`](Self::assess), but a touch that would move away without its actions stays
    /// where it was found.
    fn assess_near(&mut self, fit: &mut Fit, k: usize, found: &Found) -> f64 {
        let cost = self.assess(fit, None);
        let from_m = self.places.at[found.place].position_m;
        if fit.spots[k].spread_m2.is_some() || distance_m(fit.spots[k].position_m, from_m) < AWAY_M
        {
            return cost;
        }
        fit.spots[k] = self.mean_spot(found);
        self.assess(fit, None)
    }

    /// Adds a touch near a position if it explains enough together with its actions.
    fn try_again(&mut self, fit: &mut Fit, from_m: [f64; 3]) {
        let (near_m, apart_m) = (MERGE * self.settings.apart_m, self.settings.apart_m);
        let is_free = |at_m: [f64; 3], near_m: f64| {
            fit.spots.iter().all(|spot| distance_m(spot.position_m, at_m) >= near_m)
        };
        if fit.spots.len() >= self.settings.max_touches || !is_free(from_m, near_m) {
            return;
        }
        self.free(fit, None);
        let mut other = std::mem::take(&mut self.other);
        other.copy_from(fit);
        self.strengths(&mut other);
        let around = (from_m, REACH_M);
        let found = self.scan(fit.spots.len(), 0.0, around, |at_m| is_free(at_m, apart_m));
        let found = found.filter(|found| found.evidence >= self.settings.least_gain_of_known);
        if let Some(found) = found {
            other.spots.push(self.spot_of(&found));
            let new = fit.spots.len();
            if self.is_enough(&mut other, new, &found)
                && is_free(other.spots[new].position_m, near_m)
            {
                fit.copy_from(&other);
                self.is_joint = true;
            }
        }
        self.other = other;
    }

    /// Whether a further touch explains enough together with its actions; sets its evidence ratio.
    fn is_enough(&mut self, fit: &mut Fit, new: usize, found: &Found) -> bool {
        let with = self.assess_near(fit, new, found);
        let unit = self.evidence().unit(fit.rest);
        self.weigh(fit);
        if new > 0 && fit.worth[new] < self.least_own() {
            return false;
        }
        let gain = self.gain_of_touch(fit, new, with);
        fit.worth[new] = 1.0 + gain / unit;
        let (least_gain, least_ratio) = self.least_of(fit.spots[new].position_m);
        gain >= least_gain
            && fit.worth[new] >= least_ratio
            && fit.strengths[new] >= self.scene().least_strength(fit, new)
    }
}
