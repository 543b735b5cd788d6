//! Search for the touches of a frame: found one by one, fitted together, then pruned.
//!
//! One file over 300 lines: both directions of the search share one workspace and one fit.

use super::dictionary::Dictionary;
use super::evidence::Evidence;
use super::gains;
use super::joint::remove_all;
use super::late::Late;
use super::least_squares::SmallSystem;
use super::memory::Memory;
use super::places::{Places, Spot};
use super::responses::Responses;
use super::settings::DetectorSettings;
use super::slides::{SAME_M, Slides};
use super::step::MOST_PER_ROW;
use super::vectors::{dot, widest};
use super::whitening::Whitening;
use crate::geometry::distance_m;

/// Gauss-Newton steps of each fit; starts are at most half a spacing away.
const STEPS: usize = 4;

/// Step length below which positions no longer change significantly, metres.
const ARRIVED_M: f64 = 2e-5;

/// Damping of those steps relative to each unknown's own curvature, ...
const DAMPING: f64 = 1e-3;

/// ... and its growth when a step fits worse and is undone.
const MORE_DAMPING: f64 = 100.0;

/// Least fraction of the residual that a further touch must remove for the search to go on, unless no touches explain the
/// frame yet ([`MOST_PER_ROW`]): of six fingers in a regular hexagon, one alone explains nothing.
const EXPLAINS: f64 = 0.04;

/// Factor by which the residual's excess must fall for each added touch.
const PRICE: f64 = 1.6;

/// The same for a touch that continues one of the previous frame.
const PRICE_OF_KNOWN: f64 = 1.25;

/// The same for a touch that splits off a sliding one: within the distance below of that touch and
/// of its previous position. One finger was shown as two at its sides with factors of up to 3;
/// fingers that land 22 to 45 mm beside another one are found as early as without this price.
const PRICE_OF_SPLIT: f64 = 4.0;
const SPLIT_M: f64 = 35e-3;

/// Factor by which the residual must grow without a touch that has slid and continues at less than
/// an eighth of its recent strength, after a frame with nothing stronger. The remains of a finished
/// slide made it grow 2.1 to 3.3 times; a finger of that strength would have made it grow 8 to 12
/// times. Fingers that lift may fall below it for one frame.
const LEFT_RATIO: f64 = 4.0;

/// The same for one touch in place of two that began separately. While the dents of both are free,
/// one bell fits two fingers nearly as well.
const PRICE_OF_MERGING: f64 = 1.6;

/// Fraction of the least distance below which a further touch belongs to the print of another one.
/// Without it, one of six recordings of closing fingers shows a third touch for 16 frames.
const CLOSE: f64 = 0.88;

/// If one electrode's gain leaves less than this fraction of what touches leave, it replaces the touches.
/// On simulated fabrics with sound electrodes the ratio was 1.05 and more; with a contact that got worse it
/// was 0.87 and less.
const INSTEAD: f64 = 0.95;

/// A gain that leaves less than this fraction of the frame also replaces several touches, unless
/// each beyond the first lowers the excess of the residual by this factor: a falling gain looks
/// like a group of touches around its electrode. On simulated fabrics two fingers left less than a
/// hundredth of the residual of the best gain, six a thousandth.
const MOSTLY: f64 = 0.25;
/// ... of a frame that it explains: to this fraction, or to a small residual per row. A finger
/// whose touches explained a frame 55 times better was replaced by the gain of the electrode beside
/// a drifting one (it left 0.14; with 0.05 drifting electrodes are named later).
const EXPLAINED: f64 = 0.1;
const PRICE_BESIDE_GAIN: f64 = 4.0;
/// Maximum number of touches that have a price in this way.
const MOST_PAID: usize = 3;

/// Maximum number of touches in the previous frame for which the search also starts from nothing.
const FRESH_UP_TO: usize = 3;

/// Least decrease of chi^2 at which a further position is tried.
const TRIED: f64 = 12.0;

/// A position whose touch lowers chi^2 by this much, but not enough, is remembered for one frame, ...
const REMEMBERED: f64 = 14.0;

/// ... and is a touch if both frames together lower it by this much.
const TWICE: f64 = 40.0;

/// Number of other touches above which the least share of a new touch increases, by half with each.
/// Six fingers show a seventh of up to a quarter of their strength; with a limit of three,
/// fingertips of a hand would be lost.
const CROWD: f64 = 4.0;

/// Touches closer than this fraction of the least distance are merged: the weaker one is dropped.
pub(super) const MERGE: f64 = 0.7;

/// A press is never exactly a bell. A touch closer to a stronger one than this fraction of the
/// least distance ...
const BESIDE: f64 = 1.2;

/// ... and weaker than this fraction of its strength is part of it.
const BESIDE_SHARE: f64 = 0.35;

/// Touches that together explain a frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Fit {
    pub(super) spots: Vec<Spot>,
    pub(super) strengths: Vec<f64>,
    /// Shares of the memory's columns.
    pub(super) shares: Vec<f64>,
    /// Squared length of the residual.
    pub(super) rest: f64,
    /// Factor by which the residual grows without each touch.
    pub(super) worth: Vec<f64>,
}

impl Fit {
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.spots.clone_from(&other.spots);
        self.strengths.clone_from(&other.strengths);
        self.shares.clone_from(&other.shares);
        self.worth.clone_from(&other.worth);
        self.rest = other.rest;
    }
}

/// Quantities of the skin that a search needs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene<'a> {
    pub(super) places: &'a Places,
    pub(super) dictionary: &'a Dictionary,
    pub(super) whitening: &'a Whitening,
    pub(super) memory: &'a Memory,
    pub(super) settings: &'a DetectorSettings,
    pub(super) late: &'a Late,
    /// Touches of the previous frame.
    pub(super) before: &'a Slides,
    /// Positions with too little evidence in the previous frame, and its chi^2.
    pub(super) weak: &'a [([f64; 3], f64)],
}

impl Scene<'_> {
    /// Whether a touch of the previous frame may continue here.
    pub(super) fn is_known(&self, at_m: [f64; 3]) -> bool {
        self.before.spots.iter().any(|before| distance_m(before.position_m, at_m) < SAME_M)
    }

    /// Logarithm of the factor by which the residual's excess must fall for these touches.
    pub(super) fn price(&self, spots: &[Spot]) -> f64 {
        let of = |k: usize| match self.is_known(spots[k].position_m) {
            _ if self.is_split_off(spots, k) => PRICE_OF_SPLIT.ln(),
            true => PRICE_OF_KNOWN.ln(),
            false => PRICE.ln(),
        };
        (0..spots.len()).map(of).sum::<f64>() + self.merged(spots) as f64 * PRICE_OF_MERGING.ln()
    }

    /// Number of touches of the previous frame that began separately and share their nearest touch
    /// with an earlier one of them.
    fn merged(&self, spots: &[Spot]) -> usize {
        let nearest = |before: &Spot| {
            let way_m = |spot: &Spot| distance_m(spot.position_m, before.position_m);
            let ways = spots.iter().map(way_m).enumerate().filter(|(_, way_m)| *way_m < SPLIT_M);
            ways.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(k, _)| k)
        };
        let alone = || self.before.alone().enumerate();
        let is_merged = |&(k, before): &(usize, &Spot)| {
            let own = nearest(before);
            own.is_some() && alone().take(k).any(|(_, other)| nearest(other) == own)
        };
        alone().filter(is_merged).count()
    }

    /// Whether a touch has split off: it lies beside one that continues a touch of the previous
    /// frame, closer than two touches may be or beside a sliding one, and continues none itself.
    fn is_split_off(&self, spots: &[Spot], k: usize) -> bool {
        let way_m = |a: &Spot, b: &Spot| distance_m(a.position_m, b.position_m);
        let goes_on = |before: &Spot| {
            (0..spots.len())
                .min_by(|&a, &b| way_m(&spots[a], before).total_cmp(&way_m(&spots[b], before)))
        };
        let is_near = |before: &&Spot| way_m(before, &spots[k]) < SPLIT_M;
        if self.before.spots.iter().filter(is_near).any(|before| goes_on(before) == Some(k)) {
            return false;
        }
        let is_beside = |before: &Spot, near_m: f64| {
            goes_on(before).is_some_and(|at| way_m(&spots[at], &spots[k]) < near_m)
        };
        let near = || self.before.spots.iter().filter(is_near);
        near().any(|before| is_beside(before, CLOSE * self.settings.apart_m))
            || self.before.sliding().filter(is_near).any(|slid| is_beside(slid, SPLIT_M))
    }

    /// Least strength of a touch beside the others of a fit.
    pub(super) fn least_strength(&self, fit: &Fit, k: usize) -> f64 {
        let settings = self.settings;
        let goes_on = self.is_known(fit.spots[k].position_m);
        // compare with touches that explain more; in a poorly sensed corner strengths are arbitrary
        let more = (0..fit.spots.len()).filter(|&i| fit.worth[i] >= fit.worth[k]);
        let strongest = more.map(|i| fit.strengths[i]).fold(0.0, f64::max);
        // what several fingers do to each other looks like a faint one between them
        let (crowd, here) = match goes_on {
            true => (1.0, 0.0),
            false => {
                let crowd = 1.0 + 0.5 * (fit.spots.len() as f64 - 1.0 - CROWD);
                (crowd.max(1.0), self.late.here_s_m2[fit.spots[k].place])
            }
        };
        settings
            .least_s_m2
            .max(settings.least_share * crowd * strongest)
            .max(settings.least_share_of_late * self.late.strongest_s_m2)
            .max(settings.least_share_of_here * here)
    }

    /// Evidence of the previous frame for a touch here that was then too weak, chi^2.
    fn earlier(&self, at_m: [f64; 3]) -> f64 {
        let near = self.weak.iter().filter(|(weak_m, _)| distance_m(*weak_m, at_m) < SAME_M);
        near.map(|(_, gain)| *gain).fold(0.0, f64::max)
    }
}

/// Workspace of a search; searching does not allocate.
#[derive(Debug, Clone)]
pub(super) struct Search {
    rows: usize,
    responses: Responses,
    /// `[touch][value, along 1, along 2][row]`.
    columns: Vec<f64>,
    /// Slopes times strengths, `[touch][along 1, along 2][row]`.
    slopes: Vec<f64>,
    pub(super) residual: Vec<f64>,
    /// The residual, mapped back.
    back: Vec<f64>,
    /// Residual without any touch.
    pub(super) residual_without: Vec<f64>,
    system: SmallSystem,
    /// Positions from which the steps began.
    began: Vec<Spot>,
    trial: Fit,
    path: Fit,
    /// The touches that were known before a search, fitted to its frame.
    known: Fit,
    pub(super) best: Fit,
    /// Positions with too little evidence for a touch, and its chi^2.
    pub(super) weak: Vec<([f64; 3], f64)>,
}

impl Search {
    pub(super) fn new(rows: usize, settings: &DetectorSettings) -> Self {
        let most = settings.max_touches;
        Self {
            rows,
            responses: Responses::new(rows),
            columns: vec![0.0; 3 * most * rows],
            slopes: vec![0.0; 2 * most * rows],
            residual: vec![0.0; rows],
            back: vec![0.0; rows],
            residual_without: vec![0.0; rows],
            system: SmallSystem::new(3 * most + 2 + settings.trails),
            began: Vec::with_capacity(most),
            trial: Fit::default(),
            path: Fit::default(),
            known: Fit::default(),
            best: Fit::default(),
            weak: Vec::with_capacity(most),
        }
    }

    /// Finds the touches of whitened data `y` without lost rows and stores them in [`best`](Self::best).
    pub(super) fn run(&mut self, scene: &Scene<'_>, y: &[f64]) {
        let evidence = Evidence::new(scene.whitening.expected(), scene.whitening.present());
        self.known.spots.clear();
        self.forward(scene, y, evidence);
        self.choose(scene, y, evidence);
    }

    /// Searches again from the touches found on, after the covariance has changed.
    pub(super) fn go_on(&mut self, scene: &Scene<'_>, y: &[f64]) {
        let evidence = Evidence::new(scene.whitening.expected(), scene.whitening.present());
        let mut path = std::mem::take(&mut self.path);
        self.trial.spots.clone_from(&self.best.spots);
        path.spots.clear();
        self.fit(scene, y, &mut path);
        self.residual_without.copy_from_slice(&self.residual);
        self.best.copy_from(&path);
        let mut least_cost = evidence.cost(path.rest);
        path.spots.clone_from(&self.trial.spots);
        self.fit(scene, y, &mut path);
        self.known.copy_from(&path);
        let cost = evidence.cost(path.rest) + scene.price(&path.spots);
        if cost < least_cost {
            least_cost = cost;
            self.best.copy_from(&path);
        }
        self.grow(scene, y, evidence, &mut path, &mut least_cost);
        self.path = path;
        self.choose(scene, y, evidence);
    }

    /// Prunes the best touches, and replaces them by the touches known before the search if those,
    /// also pruned, explain the frame better: if touches lie beside the true positions, pruning can
    /// leave too few.
    fn choose(&mut self, scene: &Scene<'_>, y: &[f64], evidence: Evidence) {
        self.backward(scene, y, evidence);
        let cost = |fit: &Fit| evidence.cost(fit.rest) + scene.price(&fit.spots);
        if self.known.spots.is_empty() || cost(&self.known) >= cost(&self.best) {
            return;
        }
        std::mem::swap(&mut self.known, &mut self.best);
        self.backward(scene, y, evidence);
        if cost(&self.known) < cost(&self.best) {
            std::mem::swap(&mut self.known, &mut self.best);
            let mut best = std::mem::take(&mut self.best);
            self.fit_strengths(scene, y, &mut best);
            self.best = best;
        }
    }

    /// Searches starting from the touches of the previous frame, and from nothing, so that wrong
    /// touches do not exclude the right ones. The second search is left out while there are many
    /// touches, for its time.
    ///
    /// Keeps the touches with the least cost of the residual plus `ln(price)` of each touch.
    fn forward(&mut self, scene: &Scene<'_>, y: &[f64], evidence: Evidence) {
        let mut path = std::mem::take(&mut self.path);
        path.spots.clear();
        self.fit(scene, y, &mut path);
        self.residual_without.copy_from_slice(&self.residual);
        self.best.copy_from(&path);
        let mut least_cost = evidence.cost(path.rest);
        if scene.before.spots.len() <= FRESH_UP_TO {
            self.grow(scene, y, evidence, &mut path, &mut least_cost);
        }
        if !scene.before.spots.is_empty() {
            path.spots.clear();
            path.spots.extend_from_slice(&scene.before.spots);
            self.fit(scene, y, &mut path);
            self.known.copy_from(&path);
            let cost = evidence.cost(path.rest) + scene.price(&path.spots);
            if cost < least_cost {
                least_cost = cost;
                self.best.copy_from(&path);
            }
            self.grow(scene, y, evidence, &mut path, &mut least_cost);
        }
        self.path = path;
    }

    /// Greedy search: adds the position of the largest gain to a path and fits all touches again.
    fn grow(
        &mut self,
        scene: &Scene<'_>,
        y: &[f64],
        evidence: Evidence,
        path: &mut Fit,
        least_cost: &mut f64,
    ) {
        let mut trial = std::mem::take(&mut self.trial);
        while path.spots.len() < scene.settings.max_touches {
            let Some(place) = self.next_place(scene, path) else { break };
            trial.copy_from(path);
            trial.spots.push(scene.places.spot(place));
            self.fit(scene, y, &mut trial);
            let is_unexplained = self.best.spots.is_empty()
                && trial.rest > MOST_PER_ROW * scene.whitening.present() as f64;
            if !is_unexplained && path.rest - trial.rest < EXPLAINS * evidence.unit(path.rest) {
                break;
            }
            std::mem::swap(path, &mut trial);
            let cost = evidence.cost(path.rest) + scene.price(&path.spots);
            if cost < *least_cost {
                *least_cost = cost;
                self.best.copy_from(path);
            }
        }
        self.trial = trial;
    }

    /// Finds the position at which a further touch would explain most of the residual.
    fn next_place(&mut self, scene: &Scene<'_>, path: &Fit) -> Option<usize> {
        self.back.copy_from_slice(&self.residual);
        scene.whitening.project_back(&mut self.back);
        let (mut best, mut most) = (None, TRIED);
        let back = &self.back;
        widest(
            #[inline(always)]
            || {
                for place in 0..scene.places.len() {
                    let gain = scene.dictionary.gain(place, back);
                    if gain < most {
                        continue;
                    }
                    let at = scene.places.at[place].position_m;
                    let apart = scene.settings.apart_m;
                    if path.spots.iter().all(|s| distance_m(s.position_m, at) >= apart) {
                        (best, most) = (Some(place), gain);
                    }
                }
            },
        );
        best
    }

    /// Repeatedly drops the weakest of the touches that have too little evidence, are too faint or
    /// too close to a stronger one, and fits the others again.
    fn backward(&mut self, scene: &Scene<'_>, y: &[f64], evidence: Evidence) {
        self.weak.clear();
        let mut best = std::mem::take(&mut self.best);
        // the residual of the best fit, not of the last one on the path
        self.fit_strengths(scene, y, &mut best);
        loop {
            self.weigh(scene, y, &mut best, evidence);
            let settings = scene.settings;
            let goes_on = |k: usize| scene.is_known(best.spots[k].position_m);
            let gain_of = |k: usize| (best.worth[k] - 1.0) * evidence.unit(best.rest);
            // what presses and slides leave behind is a small part of them
            let is_doubtful = |k: usize| {
                let late = match goes_on(k) {
                    true => scene.late.here_s_m2[best.spots[k].place],
                    false => scene.late.strongest_s_m2,
                };
                best.strengths[k] < settings.least_share_of_here * late
            };
            let is_weak = |k: usize| {
                let (gain, worth) = (gain_of(k), best.worth[k]);
                let is_left =
                    scene.late.was_faint && scene.before.has_slid(best.spots[k].position_m);
                let ratio = if is_left { LEFT_RATIO } else { settings.least_ratio };
                if is_doubtful(k) && gain < (ratio - 1.0) * best.rest {
                    return true;
                }
                if goes_on(k) {
                    return gain < settings.least_gain_of_known
                        || worth < settings.least_ratio_of_known;
                }
                let earlier = scene.earlier(best.spots[k].position_m);
                let mean_worth = 1.0 + 0.5 * (gain + earlier) / evidence.unit(best.rest);
                let is_enough = gain >= settings.least_gain && worth >= settings.least_ratio;
                let are_enough =
                    earlier > 0.0 && gain + earlier >= TWICE && mean_worth >= settings.least_ratio;
                !(is_enough || are_enough)
            };
            let is_faint = |k: usize| best.strengths[k] < scene.least_strength(&best, k);
            let wrong = |&k: &usize| {
                is_weak(k)
                    || is_faint(k)
                    || is_beside(&best, k, MERGE * settings.apart_m, 1.0)
                    || (is_beside(&best, k, BESIDE * settings.apart_m, BESIDE_SHARE)
                        && !scene.before.began_alone(best.spots[k].position_m))
            };
            let worth = |k: &usize| best.worth[*k];
            let dropped =
                (0..best.spots.len()).filter(wrong).min_by(|a, b| worth(a).total_cmp(&worth(b)));
            let Some(dropped) = dropped else { break };
            if gain_of(dropped) >= REMEMBERED && !is_faint(dropped) {
                self.weak.push((best.spots[dropped].position_m, gain_of(dropped)));
            }
            best.spots.remove(dropped);
            self.fit(scene, y, &mut best);
        }
        self.best = best;
    }

    /// Whether all of the best touches are so faint beside a recent one that they may be its
    /// remains.
    pub(super) fn may_be_left_behind(&self, scene: &Scene<'_>) -> bool {
        let least = scene.settings.least_share_of_here * scene.late.strongest_s_m2;
        !self.best.spots.is_empty() && self.best.strengths.iter().all(|s| *s < least)
    }

    /// Drops the best touches that the changed covariance explains; `y` is whitened by it.
    pub(super) fn prune(&mut self, scene: &Scene<'_>, y: &[f64]) {
        let evidence = Evidence::new(scene.whitening.expected(), scene.whitening.present());
        let mut without = std::mem::take(&mut self.trial);
        without.spots.clear();
        self.fit(scene, y, &mut without);
        self.trial = without;
        self.residual_without.copy_from_slice(&self.residual);
        self.backward(scene, y, evidence);
    }

    /// Whether one electrode's gain, which leaves the residual `rest`, explains the frame better
    /// than the best touches. Several touches can imitate a gain, so each beyond the first must
    /// reach its price; with few electrodes ([`gains::share`]) a gain imitates touches as well, and
    /// none has a price.
    pub(super) fn is_beaten_by_gain(&self, scene: &Scene<'_>, rest: f64) -> bool {
        let evidence = Evidence::new(scene.whitening.expected(), scene.whitening.present());
        let share = gains::share(scene.whitening);
        match self.best.spots.len() {
            0 => false,
            touches if touches == 1 || share < 1.0 => rest < share * INSTEAD * self.best.rest,
            touches => {
                let without = dot(&self.residual_without, &self.residual_without);
                let is_explained = rest < MOST_PER_ROW * scene.whitening.present() as f64
                    || rest < EXPLAINED * without;
                let price = match is_explained && rest < MOSTLY * without {
                    true => (touches - 1).min(MOST_PAID) as f64 * PRICE_BESIDE_GAIN.ln(),
                    false => (touches - 1) as f64 * PRICE_OF_KNOWN.ln(),
                };
                rest < INSTEAD * self.best.rest
                    || evidence.cost(rest) < evidence.cost(self.best.rest) + price
            }
        }
    }

    /// Discards all touches, so that only memory explains the frame.
    pub(super) fn take_back(&mut self, scene: &Scene<'_>, y: &[f64]) {
        let mut best = std::mem::take(&mut self.best);
        best.spots.clear();
        best.worth.clear();
        self.fit_strengths(scene, y, &mut best);
        self.best = best;
    }

    /// Computes the factor by which the residual grows without each touch, with positions fixed.
    pub(super) fn weigh(
        &mut self,
        scene: &Scene<'_>,
        y: &[f64],
        fit: &mut Fit,
        evidence: Evidence,
    ) {
        let (touches, size) = (fit.spots.len(), fit.spots.len() + scene.memory.columns());
        self.set_linear(scene, y, touches);
        let whole = dot(y, y);
        fit.worth.clear();
        for k in 0..touches {
            let fall = self.system.solve_bounded(size, touches, &scene.memory.bounds, Some(k));
            fit.worth.push(evidence.worth(whole - fall, fit.rest));
        }
    }

    /// Removes the span of these touches' responses and their derivatives, `basis`, from whitened
    /// data. Afterwards the best touches must be fitted again.
    pub(super) fn without(
        &mut self,
        scene: &Scene<'_>,
        spots: &[Spot],
        y: &mut [f64],
        basis: &mut Vec<f64>,
    ) {
        let mut fit = std::mem::take(&mut self.trial);
        fit.spots.clear();
        fit.spots.extend_from_slice(spots);
        self.fit_strengths(scene, y, &mut fit);
        self.span(fit.spots.len(), basis);
        remove_all(y, basis);
        self.trial = fit;
    }

    /// Fits the strengths of the best touches again.
    pub(super) fn fit_best_again(&mut self, scene: &Scene<'_>, y: &[f64]) {
        let mut best = std::mem::take(&mut self.best);
        self.fit_strengths(scene, y, &mut best);
        self.best = best;
    }

    /// Orthonormal vectors that span the responses of the last fit's touches and their derivatives.
    pub(super) fn span(&self, touches: usize, basis: &mut Vec<f64>) {
        basis.clear();
        let n = self.rows;
        for column in self.columns.chunks_exact(n).take(3 * touches) {
            let from = basis.len();
            basis.extend_from_slice(column);
            let (before, new) = basis.split_at_mut(from);
            for _ in 0..2 {
                remove_all(new, before);
            }
            let length = dot(new, new).sqrt();
            if length > 1e-6 * dot(column, column).sqrt() {
                new.iter_mut().for_each(|v| *v /= length);
            } else {
                basis.truncate(from);
            }
        }
    }

    /// Returns the decrease of chi^2 by each of several touches that are fitted together, starting
    /// at given positions.
    pub(super) fn gains_at(&mut self, scene: &Scene<'_>, y: &[f64], spots: Vec<Spot>) -> Vec<f64> {
        let mut fit = Fit { spots, ..Fit::default() };
        self.fit(scene, y, &mut fit);
        let (touches, size) = (fit.spots.len(), fit.spots.len() + scene.memory.columns());
        self.set_linear(scene, y, touches);
        let mut fall =
            |left_out| self.system.solve_bounded(size, touches, &scene.memory.bounds, left_out);
        let whole = fall(None);
        (0..touches).map(|k| whole - fall(Some(k))).collect()
    }

    /// Fits positions and strengths of all touches together. If full steps increase the residual,
    /// they are undone and replaced by damped steps, none of which may increase it.
    pub(super) fn fit(&mut self, scene: &Scene<'_>, y: &[f64], fit: &mut Fit) {
        self.fit_strengths(scene, y, fit);
        if fit.spots.is_empty() {
            return;
        }
        let rest = fit.rest;
        self.began.clone_from(&fit.spots);
        for _ in 0..STEPS {
            let length_m = self.step(scene, fit, DAMPING);
            self.fit_strengths(scene, y, fit);
            if length_m < ARRIVED_M {
                break;
            }
        }
        if fit.rest > rest {
            fit.spots.clone_from(&self.began);
            self.fit_strengths(scene, y, fit);
            self.fit_damped(scene, y, fit);
        }
    }

    fn fit_damped(&mut self, scene: &Scene<'_>, y: &[f64], fit: &mut Fit) {
        let mut damping = MORE_DAMPING * DAMPING;
        for _ in 0..STEPS {
            let rest = fit.rest;
            self.began.clone_from(&fit.spots);
            self.step(scene, fit, damping);
            self.fit_strengths(scene, y, fit);
            if fit.rest > rest {
                fit.spots.clone_from(&self.began);
                self.fit_strengths(scene, y, fit);
                damping *= MORE_DAMPING;
            }
        }
    }

    /// Fits strengths with positions fixed and the shares of memories, and updates the residual.
    pub(super) fn fit_strengths(&mut self, scene: &Scene<'_>, y: &[f64], fit: &mut Fit) {
        let (n, touches) = (self.rows, fit.spots.len());
        for (spot, columns) in fit.spots.iter().zip(self.columns.chunks_exact_mut(3 * n)) {
            let own = scene.dictionary.own(spot.place);
            self.responses.write(own, scene.whitening, spot, columns);
        }
        self.set_linear(scene, y, touches);
        let size = touches + scene.memory.columns();
        self.system.solve_bounded(size, touches, &scene.memory.bounds, None);
        let (strengths, shares) = self.system.solution[..size].split_at(touches);
        fit.strengths.clear();
        fit.strengths.extend_from_slice(strengths);
        fit.shares.clear();
        fit.shares.extend_from_slice(shares);
        self.residual.copy_from_slice(y);
        let values = self.columns.chunks_exact(n).step_by(3);
        let memories = scene.memory.whitened.chunks_exact(n);
        let columns = values.zip(strengths).chain(memories.zip(shares));
        for (column, amount) in columns {
            self.residual.iter_mut().zip(column).for_each(|(r, c)| *r -= amount * c);
        }
        fit.rest = dot(&self.residual, &self.residual);
    }

    fn set_linear(&mut self, scene: &Scene<'_>, y: &[f64], touches: usize) {
        let n = self.rows;
        let (columns, memories) = (&self.columns, &scene.memory.whitened);
        let column = |i: usize| match i.checked_sub(touches) {
            None => &columns[3 * i * n..(3 * i + 1) * n],
            Some(k) => &memories[k * n..(k + 1) * n],
        };
        self.system.set(column, touches + scene.memory.columns(), y);
    }

    /// Takes one damped Gauss-Newton step of the positions, at most one spacing long; returns the longest, metres.
    fn step(&mut self, scene: &Scene<'_>, fit: &mut Fit, damping: f64) -> f64 {
        let touches = fit.spots.len();
        self.set_all(fit);
        let step = self.system.solve_damped(3 * touches, damping);
        let mut longest_m: f64 = 0.0;
        for (k, spot) in fit.spots.iter_mut().enumerate().filter(|(_, s)| s.spread_m2.is_none()) {
            let along = [step[touches + 2 * k], step[touches + 2 * k + 1]];
            let length = along[0].hypot(along[1]);
            let part = (scene.places.spacing_m / length.max(f64::MIN_POSITIVE)).min(1.0);
            *spot = scene.places.moved(spot, along.map(|a| part * a));
            longest_m = longest_m.max(part * length);
        }
        longest_m
    }

    /// Sets the Gram matrix of strengths and positions, with memories held; the right-hand side is the
    /// residual.
    fn set_all(&mut self, fit: &Fit) {
        let (n, touches) = (self.rows, fit.spots.len());
        for (k, strength) in fit.strengths.iter().enumerate() {
            let from = &self.columns[(3 * k + 1) * n..(3 * k + 3) * n];
            let to = &mut self.slopes[2 * k * n..2 * (k + 1) * n];
            to.iter_mut().zip(from).for_each(|(t, f)| *t = strength * f);
        }
        let (columns, slopes) = (&self.columns, &self.slopes);
        let column = |i: usize| match i.checked_sub(touches) {
            None => &columns[3 * i * n..(3 * i + 1) * n],
            Some(k) => &slopes[k * n..(k + 1) * n],
        };
        self.system.set(column, 3 * touches, &self.residual);
    }

    /// Computes the variance of each touch's strength and the covariance of its two steps along the skin,
    /// passed as `(index, strength, [11, 12, 21, 22])`, in units of the noise with all nuisance parameters.
    pub(super) fn covariances(&mut self, best: &Fit, mut each: impl FnMut(usize, f64, [f64; 4])) {
        let touches = best.spots.len();
        self.set_all(best);
        for k in 0..touches {
            let (mut strength, mut place) = ([0.0], [0.0; 4]);
            self.system.inverse_block(3 * touches, k, 1, &mut strength);
            self.system.inverse_block(3 * touches, touches + 2 * k, 2, &mut place);
            each(k, strength[0], place);
        }
    }
}

/// Returns whether a touch is within `near_m` of one of which it has less than the fraction `share`.
fn is_beside(fit: &Fit, k: usize, near_m: f64, share: f64) -> bool {
    let stronger = (0..fit.spots.len()).filter(|&i| fit.strengths[k] < share * fit.strengths[i]);
    let mut way = stronger.map(|i| distance_m(fit.spots[i].position_m, fit.spots[k].position_m));
    way.any(|way_m| way_m < near_m)
}
