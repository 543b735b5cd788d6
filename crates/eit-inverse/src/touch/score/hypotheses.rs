//! Moves from the last frame's hypothesis while the score falls: birth, death, relocation.
//!
//! Births are tried at the two best places by `(d'C^-1 r)^2 / d'C^-1 d`. The denominators change slowly: a tenth of them is
//! computed again in each frame, and those of the best places before they are compared. With `P` places that is `2 n P`
//! flops a scan and `(P / 10 + 24) n^2` a frame: 0.1 and 0.9 Mflop with 104 rows and 600 places.

use super::estimate::{Estimator, Scene, residual};
use super::linear::{Factor, Symmetric};
use super::prior;
use super::settings::MOST_TOUCHES;
use super::state::{Hypothesis, TouchState, Touches};
use super::whitened::Whitened;
use crate::geometry::distance_m;
use crate::touch::detector::{dot, widest};

/// Number of moves in a frame.
const MOST_MOVES: usize = 16;
/// Estimated increase of the score without a touch up to which its death is tried; only to save time.
const MAY_DIE: f64 = 12.0;
/// Decrease of chi^2 from which a birth is tried; a birth costs more.
const MAY_BEGIN: f64 = 15.0;
/// Decrease of a score, if no touch rests, from which a start of moving touches is tried; to move costs more.
const MAY_MOVE: f64 = 6.0;
/// Part of what the best place explains from which another one is tried.
const NEARLY_BEST: f64 = 0.5;
/// Places whose denominators are computed before they are compared, and frames in which all are computed again.
const COMPARED: usize = 24;
const REFRESHED_IN: usize = 10;
/// Births are not tried nearer to a touch than this part of a finger's width.
const NEAR: f64 = 0.8;
/// Strength and position of a touch.
const PARAMETERS: f64 = 3.0;
/// Part of the frames that are damaged as a whole, times the density of the logarithm of how much.
const TORN: f64 = 1e-4;
/// Decrease of a score that counts, for rounding.
const LOWER: f64 = 1e-3;

/// Searches for the best hypothesis of a frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Search {
    pub(super) estimator: Estimator,
    /// `d'(S + E)^-1 d` at the coarse places, rows that were present, and the next place to refresh.
    squares: Vec<f64>,
    present: Vec<usize>,
    next: usize,
    /// Sum of the odds that the last frame's touches are still there.
    pub(super) known: f64,
    /// The touch that is tried elsewhere.
    pub(super) turn: usize,
    residual: Vec<f64>,
    back: Vec<f64>,
    bells: Vec<f64>,
    best: Vec<(f64, usize)>,
    span: Symmetric,
    of_span: Factor,
    products: Vec<f64>,
}

impl Search {
    /// Score with the cost of the last frame's touches that a hypothesis lets end. In a frame that is damaged as a whole all
    /// variances are larger by an unknown factor: as much as fits best.
    pub(super) fn total(&self, h: &Hypothesis) -> f64 {
        let stayed: f64 = h.touches.iter().filter_map(|t| t.before.as_ref()).map(|b| b.odds).sum();
        let (heat, rows) = (h.heat(), h.rows as f64);
        // the same data tell less of each touch's strength and place
        let of_heat = (rows - PARAMETERS * h.touches.len() as f64) * heat.ln() - 2.0 * TORN.ln();
        h.score + (of_heat - h.chi_square * (1.0 - heat.recip())).min(0.0) + self.known - stayed
    }

    fn better(&self, a: Hypothesis, b: Hypothesis) -> Hypothesis {
        if self.total(&b) < self.total(&a) { b } else { a }
    }

    /// Fits some touches of the last frame from two starts: resting as well as moving, and moving alone.
    fn begin(&mut self, scene: &Scene<'_>, frame: &mut Whitened, touches: &Touches) -> Hypothesis {
        let none = self.estimator.fit(scene, frame, &Touches::none(), 0, 0);
        if touches.is_empty() {
            return none;
        }
        let mut best = self.estimator.fit(scene, frame, touches, 2, 0);
        if self.estimator.gain_of_moving(scene, frame, &best.touches) > MAY_MOVE {
            let moving = self.estimator.fit(scene, frame, touches, 4, 2);
            best = self.better(best, moving);
        }
        self.better(best, none)
    }

    /// Returns the best hypothesis that moves from some touches reach.
    pub(super) fn search(
        &mut self,
        scene: &Scene<'_>,
        frame: &mut Whitened,
        touches: &Touches,
    ) -> Hypothesis {
        self.refresh(scene, frame);
        let mut best = self.begin(scene, frame, touches);
        let (mut at, mut least) = (best, self.total(&best));
        let mut is_relocated = false;
        for _ in 0..MOST_MOVES {
            let falls = |search: &Self, top: &Option<Hypothesis>| {
                top.as_ref().is_some_and(|h| search.total(h) < least - LOWER)
            };
            // of several fingers that land at once, the first ones explain next to nothing of a frame that seems damaged
            let leads_on = |top: &Option<Hypothesis>| {
                top.as_ref().is_some_and(|h| {
                    let is_birth = h.touches.len() > at.touches.len();
                    at.heat() > 1.0 && is_birth && h.score < at.score - LOWER
                })
            };
            let mut top = self.births_and_deaths(scene, frame, &at);
            let goes_on = falls(self, &top) || leads_on(&top);
            if !goes_on && !best.touches.is_empty() && !is_relocated {
                is_relocated = true;
                top = self.relocations(scene, frame, &best);
            }
            match top {
                Some(h) if self.total(&h) < least - LOWER => {
                    (best, at, least) = (h, h, self.total(&h));
                }
                Some(h) if goes_on => at = h,
                _ => break,
            }
        }
        best
    }

    fn births_and_deaths(
        &mut self,
        scene: &Scene<'_>,
        frame: &mut Whitened,
        best: &Hypothesis,
    ) -> Option<Hypothesis> {
        let mut top: Option<Hypothesis> = None;
        if best.touches.len() < most_touches(scene) {
            for place in self.candidates(scene, frame, &best.touches).into_iter().flatten() {
                let born = TouchState::new(scene.model.grid.spot(place));
                let more = self.estimator.fit(scene, frame, &best.touches.with(born), 3, 0);
                top = Some(top.map_or(more, |top| self.better(top, more)));
            }
        }
        let may_die = |k: &usize| prior::worth(&best.touches[*k], scene) < MAY_DIE;
        for k in (0..best.touches.len()).filter(may_die) {
            let fewer = self.estimator.fit(scene, frame, &best.touches.without(k), 2, 0);
            top = Some(top.map_or(fewer, |top| self.better(top, fewer)));
        }
        top
    }

    /// Tries one touch, in turn, at other places, where it may stand or, between two of them, for two touches.
    fn relocations(
        &mut self,
        scene: &Scene<'_>,
        frame: &mut Whitened,
        best: &Hypothesis,
    ) -> Option<Hypothesis> {
        let k = self.turn % best.touches.len().max(1);
        let others = best.touches.without(k);
        let rest = self.estimator.fit(scene, frame, &others, 1, 0);
        let grid = &scene.model.grid;
        let mut top: Option<Hypothesis> = None;
        let places = self.candidates(scene, frame, &rest.touches);
        for place in places.into_iter().flatten() {
            let spot = grid.spot(place);
            if distance_m(best.touches[k].spot.position_m, spot.position_m) <= 2.0 * grid.pitch_m {
                continue;
            }
            let mut touches = best.touches;
            touches[k].spot = spot;
            touches[k].strength_m2 = 0.0;
            let other = self.estimator.fit(scene, frame, &touches, 3, 0);
            top = Some(top.map_or(other, |top| self.better(top, other)));
            let second = places.into_iter().flatten().find(|second| *second != place);
            if let Some(second) = second.filter(|_| touches.len() < most_touches(scene)) {
                let touches = touches.with(TouchState::new(grid.spot(second)));
                let two = self.estimator.fit(scene, frame, &touches, 3, 0);
                top = Some(top.map_or(two, |top| self.better(top, two)));
            }
        }
        top
    }

    /// Computes a tenth of the denominators again; all of them if other rows are present.
    fn refresh(&mut self, scene: &Scene<'_>, frame: &Whitened) {
        let coarse = &scene.model.grid.coarse;
        let count = match self.present == frame.present {
            true => coarse.len().div_ceil(REFRESHED_IN),
            false => coarse.len(),
        };
        self.present.clone_from(&frame.present);
        self.squares.resize(coarse.len(), 0.0);
        let first = self.next;
        let places = (0..count).map(|k| (first + k) % coarse.len());
        frame.whiten(places.clone().map(|k| bell(scene, coarse[k])), &mut self.bells);
        for (k, bell) in places.zip(self.bells.chunks_exact(frame.n().max(1))) {
            self.squares[k] = dot(bell, bell);
        }
        self.next = (first + count) % coarse.len().max(1);
    }

    /// Returns up to two places where one more bell explains most of what touches leave.
    fn candidates(
        &mut self,
        scene: &Scene<'_>,
        frame: &mut Whitened,
        touches: &Touches,
    ) -> [Option<usize>; 2] {
        self.rank(scene, frame, touches);
        self.compare(scene, frame, touches);
        let (grid, near_m) = (&scene.model.grid, NEAR * scene.settings.apart_m);
        let mut chosen = [None; 2];
        let least = self.best.first().map_or(0.0, |(top, _)| MAY_BEGIN.max(NEARLY_BEST * top));
        for &(exact, k) in self.best.iter().filter(|(exact, _)| *exact >= least) {
            let place = grid.coarse[k];
            let way =
                |other: usize| distance_m(grid.at[other].position_m, grid.at[place].position_m);
            match chosen {
                [None, _] => chosen[0] = Some(place),
                [Some(first), _] if way(first) > near_m => {
                    chosen[1] = Some(place);
                    break;
                }
                _ if exact.is_nan() => break,
                _ => {}
            }
        }
        chosen
    }

    /// Ranks the places by the denominators of earlier frames; `best` then holds products with the residual.
    fn rank(&mut self, scene: &Scene<'_>, frame: &mut Whitened, touches: &Touches) {
        residual(scene, frame, touches, &mut self.residual);
        frame.factor.solve_transposed(&mut self.residual);
        self.back.clear();
        self.back.resize(scene.model.n, 0.0);
        frame.present.iter().zip(&self.residual).for_each(|(&i, r)| self.back[i] = *r);
        let (grid, near_m) = (&scene.model.grid, NEAR * scene.settings.apart_m);
        let Self { best, squares, back, .. } = self;
        best.clear();
        widest(
            #[inline(always)]
            || {
                for (k, &place) in grid.coarse.iter().enumerate() {
                    let product = dot(bell(scene, place), back);
                    best.push((
                        if product > 0.0 { product * product / squares[k] } else { 0.0 },
                        k,
                    ));
                }
            },
        );
        let is_near = |place: usize| {
            let at_m = grid.at[place].position_m;
            touches.iter().any(|t| distance_m(t.spot.position_m, at_m) < near_m)
        };
        best.retain(|(gain, k)| *gain > 0.0 && !is_near(grid.coarse[*k]));
        best.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        best.truncate(COMPARED);
    }

    /// Computes the denominators of the best places, without what the touches' own freedom explains of them.
    fn compare(&mut self, scene: &Scene<'_>, frame: &mut Whitened, touches: &Touches) {
        let places = self.best.iter().map(|(_, k)| bell(scene, scene.model.grid.coarse[*k]));
        frame.whiten(places, &mut self.bells);
        let n = frame.n();
        self.estimator.span(scene, frame, touches, &mut self.span);
        self.of_span.of(&self.span);
        let mut best = std::mem::take(&mut self.best);
        self.estimator.products(frame, &self.bells, &mut self.products);
        self.of_span.solve(&mut self.products);
        let count = self.span.n();
        for (at, (gain, k)) in best.iter_mut().enumerate() {
            let bell = &self.bells[at * n..(at + 1) * n];
            let explained = &self.products[at * count..(at + 1) * count];
            let own = dot(bell, bell);
            let product = *gain * self.squares[*k];
            self.squares[*k] = own;
            let left = (own - dot(explained, explained)).max(0.02 * own);
            *gain = product / left;
        }
        best.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        self.best = best;
    }
}

fn most_touches(scene: &Scene<'_>) -> usize {
    scene.settings.max_touches.min(MOST_TOUCHES)
}

/// The print at a place, of all rows.
fn bell<'a>(scene: &Scene<'a>, place: usize) -> &'a [f64] {
    &scene.model.dictionary.of(place)[..scene.model.n]
}

impl Estimator {
    /// Sets `span` to `I + F'F` of all features of some touches.
    pub(super) fn span(
        &mut self,
        scene: &Scene<'_>,
        frame: &mut Whitened,
        touches: &Touches,
        span: &mut Symmetric,
    ) {
        self.multiply(scene, frame, touches);
        let count = self.right.len();
        span.reset(count);
        for j in 0..count {
            span.column_mut(j).copy_from_slice(&self.normal[j * count + j..(j + 1) * count]);
        }
        span.add_diagonal(1.0);
    }

    /// Products `F'd` of these features with whitened vectors `d`, one after the other.
    pub(super) fn products(&mut self, frame: &Whitened, vectors: &[f64], out: &mut Vec<f64>) {
        let count = self.right.len();
        out.clear();
        out.resize(count * vectors.len() / frame.n().max(1), 0.0);
        for ((features, &cell), first) in self.features.iter().zip(&self.cells).zip(&self.starts) {
            frame.products_with(cell, vectors, &mut self.work);
            let (columns, _) = self.work.as_chunks();
            for (out, columns) in out.chunks_exact_mut(count).zip(columns) {
                for f in 0..features.count {
                    out[first + f] = features.times(f, columns);
                }
            }
        }
    }
}
