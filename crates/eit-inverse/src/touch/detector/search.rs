//! Search for the touches of a frame: found one by one, fitted together, then pruned.

mod fit;
mod prune;

pub(super) use prune::MERGE;

use super::gains;
use super::least_squares::SmallSystem;
use super::places::Spot;
use super::responses::Responses;
use super::scene::{Fit, PRICE_OF_KNOWN, Scene};
use super::settings::DetectorSettings;
use super::step::MOST_PER_ROW;
use super::vectors::{dot, widest};
use crate::geometry::distance_m;

/// Least fraction of the residual that a further touch must remove for the search to go on, unless no touches explain the
/// frame yet ([`MOST_PER_ROW`]): of six fingers in a regular hexagon, one alone explains nothing.
const EXPLAINS: f64 = 0.04;

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

    /// Finds the touches of a frame and stores them in [`best`](Self::best).
    pub(super) fn run(&mut self, scene: &Scene<'_>) {
        self.known.spots.clear();
        self.forward(scene);
        self.choose(scene);
    }

    /// Searches again from the touches found on, after the covariance has changed.
    pub(super) fn go_on(&mut self, scene: &Scene<'_>) {
        let mut path = std::mem::take(&mut self.path);
        self.trial.spots.clone_from(&self.best.spots);
        let mut least_cost = self.start(scene, &mut path);
        path.spots.clone_from(&self.trial.spots);
        self.grow_known(scene, &mut path, &mut least_cost);
        self.path = path;
        self.choose(scene);
    }

    /// Prunes the best touches, and replaces them by the touches known before the search if those,
    /// also pruned, explain the frame better: if touches lie beside the true positions, pruning can
    /// leave too few.
    fn choose(&mut self, scene: &Scene<'_>) {
        self.backward(scene);
        if self.known.spots.is_empty() || scene.cost(&self.known) >= scene.cost(&self.best) {
            return;
        }
        std::mem::swap(&mut self.known, &mut self.best);
        self.backward(scene);
        if scene.cost(&self.known) < scene.cost(&self.best) {
            std::mem::swap(&mut self.known, &mut self.best);
            self.fit_best_again(scene);
        }
    }

    /// Searches starting from the touches of the previous frame, and from nothing, so that wrong
    /// touches do not exclude the right ones. The second search is left out while there are many
    /// touches, for its time.
    ///
    /// Keeps the touches with the least cost of the residual plus `ln(price)` of each touch.
    fn forward(&mut self, scene: &Scene<'_>) {
        let mut path = std::mem::take(&mut self.path);
        let mut least_cost = self.start(scene, &mut path);
        if scene.before.spots.len() <= FRESH_UP_TO {
            self.grow(scene, &mut path, &mut least_cost);
        }
        if !scene.before.spots.is_empty() {
            path.spots.clear();
            path.spots.extend_from_slice(&scene.before.spots);
            self.grow_known(scene, &mut path, &mut least_cost);
        }
        self.path = path;
    }

    /// Fits the frame without touches, and returns the cost.
    fn start(&mut self, scene: &Scene<'_>, path: &mut Fit) -> f64 {
        path.spots.clear();
        self.fit(scene, path);
        self.residual_without.copy_from_slice(&self.residual);
        self.best.copy_from(path);
        scene.cost(path)
    }

    /// Greedy search from touches that were known before.
    fn grow_known(&mut self, scene: &Scene<'_>, path: &mut Fit, least_cost: &mut f64) {
        self.fit(scene, path);
        self.known.copy_from(path);
        self.keep(scene, path, least_cost);
        self.grow(scene, path, least_cost);
    }

    /// Greedy search: adds the position of the largest gain to a path and fits all touches again.
    fn grow(&mut self, scene: &Scene<'_>, path: &mut Fit, least_cost: &mut f64) {
        let (mut trial, evidence) = (std::mem::take(&mut self.trial), scene.evidence());
        while path.spots.len() < scene.settings.max_touches {
            let Some(place) = self.next_place(scene, path) else { break };
            trial.copy_from(path);
            trial.spots.push(scene.places.spot(place));
            self.fit(scene, &mut trial);
            let is_unexplained = self.best.spots.is_empty()
                && trial.rest > MOST_PER_ROW * scene.whitening.present() as f64;
            if !is_unexplained && path.rest - trial.rest < EXPLAINS * evidence.unit(path.rest) {
                break;
            }
            std::mem::swap(path, &mut trial);
            self.keep(scene, path, least_cost);
        }
        self.trial = trial;
    }

    /// Keeps the touches of a path as the best ones if they cost less.
    fn keep(&mut self, scene: &Scene<'_>, path: &Fit, least_cost: &mut f64) {
        let cost = scene.cost(path);
        if cost < *least_cost {
            *least_cost = cost;
            self.best.copy_from(path);
        }
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

    /// Whether one electrode's gain, which leaves the residual `rest`, explains the frame better
    /// than the best touches. Several touches can imitate a gain, so each beyond the first must
    /// reach its price; with few electrodes ([`gains::share`]) a gain imitates touches as well, and
    /// none has a price.
    pub(super) fn is_beaten_by_gain(&self, scene: &Scene<'_>, rest: f64) -> bool {
        let evidence = scene.evidence();
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
    pub(super) fn take_back(&mut self, scene: &Scene<'_>) {
        self.best.spots.clear();
        self.best.worth.clear();
        self.fit_best_again(scene);
    }
}
