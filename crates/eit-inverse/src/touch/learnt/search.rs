//! The touches of a frame: one more at a time while that is far more likely, each refined with the others fixed.

use super::basis::{Basis, LANES, minus2};
use super::candidate::Candidate;
use super::evaluate::Evaluate;
use super::places::SkinPlaces;
use super::thresholds::Thresholds;
use crate::learn::ResponseMap;
use pulp::Arch;

/// Strengths from which a further touch is sought, in units of the one that the squared length suggests.
const STARTS: [f64; 2] = [1.0, 2.5];
/// Rounds in which touches are refined, one after the other: for the first touch, and for further ones.
const ROUNDS: [usize; 2] = [1, 3];
/// Most touches that any settings allow.
const MOST: usize = 16;

/// What a search needs of the skin.
#[derive(Clone, Copy)]
pub(super) struct Skin<'a> {
    pub(super) basis: &'a Basis,
    /// Variance of the response at each place.
    pub(super) of_places: &'a [f64],
    pub(super) places: &'a SkinPlaces,
}

/// What a frame shows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Looked {
    pub(super) touches: usize,
    /// -2 ln L that the first touch gains, shown or not.
    pub(super) evidence: f64,
    /// Whitened squared length of the frame, and of what the touches leave.
    pub(super) whole: f64,
    pub(super) rest: f64,
}

/// Score of a hypothesis.
#[derive(Debug, Clone, Copy)]
struct Fit {
    minus2: f64,
    rest: f64,
}

#[derive(Debug, Clone)]
pub(super) struct Search {
    arch: Arch,
    freedom: f64,
    most: usize,
    /// Touches that are believed, and those of the hypothesis that is tried.
    found: Vec<Candidate>,
    tried: Vec<Candidate>,
    spare: Vec<Candidate>,
    frame: Vec<f64>,
    rest: Vec<f64>,
    variance: Vec<f64>,
    work: Vec<f64>,
    strengths: Vec<f64>,
    scores: Vec<f64>,
    /// Score of the touch that [`first`](Self::first) found.
    one: f64,
}

impl Search {
    pub(super) fn new(map: &ResponseMap, places: &SkinPlaces, most: usize) -> Self {
        let most = most.clamp(1, MOST);
        let width = map.scale.len().next_multiple_of(LANES);
        let near = places.near.iter().map(Vec::len).max().unwrap_or(0);
        let room = near.max(places.coarse.len());
        let candidate = || Candidate {
            near: Vec::with_capacity(near),
            far: Vec::with_capacity(places.coarse.len()),
            ..Candidate::default()
        };
        Self {
            arch: Arch::new(),
            freedom: map.freedom,
            most,
            found: Vec::with_capacity(most + 1),
            tried: Vec::with_capacity(most + 1),
            spare: (0..2 * most + 2).map(|_| candidate()).collect(),
            frame: vec![0.0; width],
            rest: vec![0.0; width],
            variance: vec![0.0; width],
            work: vec![0.0; width],
            strengths: vec![0.0; room],
            scores: vec![0.0; room],
            one: 0.0,
        }
    }

    /// The touches of the last frame.
    pub(super) fn candidates(&self) -> &[Candidate] {
        &self.found
    }

    /// Touches of the last frame: place, strength, and -2 ln L gained.
    pub(super) fn found(&self) -> impl Iterator<Item = (usize, f64, f64)> {
        self.found.iter().map(|c| (c.place, c.strength, c.evidence))
    }

    /// Finds the touches of a difference over all channels, in units of the scales.
    pub(super) fn look(
        &mut self,
        skin: Skin<'_>,
        thresholds: &Thresholds,
        difference: &[f64],
    ) -> Looked {
        let places = skin.places;
        let mut best = self.take(skin.basis, difference);
        let whole = best.rest;
        let mut evidence = 0.0;
        while self.found.len() < self.most {
            let is_first = self.found.is_empty();
            let mut fit = self.add(skin, ROUNDS[usize::from(!is_first)], false);
            let mut gained = best.minus2 - fit.minus2;
            if is_first {
                evidence = gained;
            }
            if !is_first && gained < self.need(places, thresholds) && !self.is_far(places) {
                // not one near the others, but perhaps one far from them
                fit = self.add(skin, ROUNDS[1], true);
                gained = best.minus2 - fit.minus2;
            }
            if gained < self.need(places, thresholds) {
                break;
            }
            self.accept(gained);
            best = fit;
        }
        self.look_far(skin);
        Looked { touches: self.found.len(), evidence, whole, rest: best.rest }
    }

    /// -2 ln L that the last of the tried touches must gain; infinite if one was dropped.
    fn need(&self, places: &SkinPlaces, thresholds: &Thresholds) -> f64 {
        match self.tried.len() {
            tried if tried <= self.found.len() => f64::INFINITY,
            1 => thresholds.first,
            _ => thresholds.more[usize::from(self.is_far(places))],
        }
    }

    /// Whether the last of the tried touches is far from all others.
    fn is_far(&self, places: &SkinPlaces) -> bool {
        let Some((last, others)) = self.tried.split_last() else { return false };
        others.iter().all(|other| places.are_far(last.place, other.place))
    }

    /// Evaluates each of the found touches at all coarse places, the others fixed.
    fn look_far(&mut self, skin: Skin<'_>) {
        std::mem::swap(&mut self.found, &mut self.tried);
        for k in 0..self.tried.len() {
            self.leave(skin, Some(k));
            self.evaluate(skin, &skin.places.coarse, self.tried[k].strength, 1);
            let touch = &mut self.tried[k];
            touch.far.clear();
            touch.far.extend_from_slice(&self.scores[..skin.places.coarse.len()]);
        }
        std::mem::swap(&mut self.found, &mut self.tried);
    }

    /// Takes a difference, without touches: -2 ln L of none, and its squared length.
    fn take(&mut self, basis: &Basis, difference: &[f64]) -> Fit {
        let width = basis.width;
        for of in [&mut self.frame, &mut self.rest, &mut self.variance, &mut self.work] {
            of.resize(width, 0.0);
        }
        self.spare.append(&mut self.found);
        basis.turn(difference, &mut self.frame);
        let rest = self.frame.iter().map(|z| z * z).sum();
        Fit { minus2: basis.without_touch(difference, self.freedom, &mut self.work), rest }
    }

    /// -2 ln L that one touch gains over none, and its squared rest; the touch is then found.
    pub(super) fn first(&mut self, skin: Skin<'_>, difference: &[f64]) -> (f64, f64) {
        let none = self.take(skin.basis, difference);
        let one = self.add(skin, ROUNDS[0], false);
        let gained = none.minus2 - one.minus2;
        self.one = one.minus2;
        if !self.tried.is_empty() {
            self.accept(gained);
        }
        (gained, one.rest)
    }

    /// The touch that [`first`](Self::first) found.
    pub(super) fn first_found(&mut self, skin: Skin<'_>) -> Option<&Candidate> {
        self.look_far(skin);
        self.found.first()
    }

    /// -2 ln L that a second touch, anywhere or far from it, gains over the first, which [`first`](Self::first) found.
    pub(super) fn second(&mut self, skin: Skin<'_>, is_far: bool) -> f64 {
        self.one - self.add(skin, ROUNDS[1] - 1, is_far).minus2
    }

    /// Tries one more touch than are found, anywhere or far from all of them.
    fn add(&mut self, skin: Skin<'_>, rounds: usize, is_far: bool) -> Fit {
        self.spare.append(&mut self.tried);
        for k in 0..self.found.len() {
            let mut copy = self.spare.pop().unwrap_or_default();
            (copy.place, copy.strength) = (self.found[k].place, self.found[k].strength);
            self.tried.push(copy);
        }
        self.leave(skin, None);
        let (place, strength) = self.best_place(skin, is_far);
        let mut new = self.spare.pop().unwrap_or_default();
        (new.place, new.strength) = (place, strength);
        self.tried.push(new);
        for _ in 0..rounds {
            for k in 0..self.tried.len() {
                self.refine(skin, k);
            }
            if self.tried.len() > 1 {
                self.strengths_together(skin);
            }
        }
        for k in (0..self.tried.len()).rev() {
            if self.tried[k].strength <= 0.0 {
                let dropped = self.tried.remove(k);
                self.spare.push(dropped);
            }
        }
        self.leave(skin, None);
        self.fit(skin.basis)
    }

    fn accept(&mut self, gained: f64) {
        for (new, old) in self.tried.iter_mut().zip(&self.found) {
            new.evidence = old.evidence;
        }
        if let Some(last) = self.tried.last_mut() {
            last.evidence = gained;
        }
        std::mem::swap(&mut self.found, &mut self.tried);
    }

    /// Sets rest and variance to those of the tried touches but one.
    fn leave(&mut self, skin: Skin<'_>, but: Option<usize>) {
        self.rest.copy_from_slice(&self.frame);
        self.variance.fill(1.0);
        for (_, touch) in self.tried.iter().enumerate().filter(|(k, _)| Some(*k) != but) {
            let weight = touch.strength * touch.strength * skin.of_places[touch.place];
            let response = skin.basis.response(touch.place);
            for (rest, g) in self.rest.iter_mut().zip(response) {
                *rest -= touch.strength * g;
            }
            for (variance, lambda) in self.variance.iter_mut().zip(&skin.basis.lambda) {
                *variance += weight * lambda;
            }
        }
    }

    /// Score of what [`leave`](Self::leave) left.
    fn fit(&self, basis: &Basis) -> Fit {
        let (mut square, mut logarithm) = (0.0, 0.0);
        for (rest, variance) in self.rest.iter().zip(&self.variance) {
            square += rest * rest / variance;
            logarithm += variance.ln();
        }
        let minus2 = minus2(square, logarithm, basis.channels.len(), self.freedom);
        Fit { minus2, rest: square }
    }

    /// Evaluates one more touch at some places into `strengths` and `scores`.
    fn evaluate(&mut self, skin: Skin<'_>, places: &[usize], first: f64, rounds: usize) {
        let Self { arch, freedom, rest, variance, strengths, scores, .. } = self;
        let freedom = *freedom;
        arch.dispatch(Evaluate {
            skin,
            places,
            rest,
            variance,
            first,
            rounds,
            freedom,
            strengths,
            scores,
        });
    }

    /// Best coarse place for one more touch, anywhere or far from all others, and its strength.
    fn best_place(&mut self, skin: Skin<'_>, is_far: bool) -> (usize, f64) {
        let Skin { basis, places, .. } = skin;
        let square: f64 = self.rest.iter().zip(&self.variance).map(|(r, v)| r * r / v).sum();
        let guess = ((square - basis.channels.len() as f64).max(1e-9) / basis.typical2).sqrt();
        let mut best = (f64::INFINITY, places.coarse.first().copied().unwrap_or(0), 0.0);
        for start in STARTS {
            self.evaluate(skin, &places.coarse, start * guess, 1);
            let evaluated = self.scores.iter().zip(&self.strengths).zip(&places.coarse);
            for ((&score, &strength), &place) in evaluated {
                let is_beside = |touch: &Candidate| !places.are_far(touch.place, place);
                if strength > 0.0 && score < best.0 && !(is_far && self.found.iter().any(is_beside))
                {
                    best = (score, place, strength);
                }
            }
        }
        (best.1, best.2)
    }

    /// Moves one of the tried touches to the best fine place near it, the others fixed.
    fn refine(&mut self, skin: Skin<'_>, k: usize) {
        self.leave(skin, Some(k));
        let home = skin.places.home(self.tried[k].place);
        let near = &skin.places.near[home];
        self.evaluate(skin, near, self.tried[k].strength, 2);
        let scores = self.scores[..near.len()].iter().enumerate();
        let best = scores.min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(at, _)| at);
        let (place, strength) = (near[best], self.strengths[best]);
        let touch = &mut self.tried[k];
        (touch.place, touch.strength, touch.home) = (place, strength, home);
        touch.near.clear();
        touch.near.extend_from_slice(&self.scores[..near.len()]);
    }

    /// Refits all strengths together, unless one falls below zero.
    fn strengths_together(&mut self, skin: Skin<'_>) {
        self.leave(skin, None);
        let count = self.tried.len().min(MOST);
        let mut matrix = [[0.0; MOST + 1]; MOST];
        for (i, (row, touch)) in matrix.iter_mut().zip(&self.tried).enumerate() {
            let response = skin.basis.response(touch.place);
            let weighted = |other: &[f64]| -> f64 {
                let values = response.iter().zip(other).zip(&self.variance);
                values.map(|((g, o), v)| g * o / v).sum()
            };
            for (value, other) in row.iter_mut().zip(&self.tried) {
                *value = weighted(skin.basis.response(other.place));
            }
            row[i] += 1e-9;
            row[MOST] = weighted(&self.frame);
        }
        eliminate(&mut matrix, count);
        if matrix[..count].iter().all(|row| row[MOST] > 0.0) {
            for (touch, row) in self.tried.iter_mut().zip(&matrix) {
                touch.strength = row[MOST];
            }
        }
    }

    /// Standard deviation of the strength of a found touch, relative to it.
    pub(super) fn relative_std(&self, k: usize, basis: &Basis, map: &ResponseMap) -> f64 {
        let touch = &self.found[k];
        let mut square = 0.0;
        for (g, lambda) in basis.response(touch.place).iter().zip(&basis.lambda) {
            let of = |t: &Candidate| t.strength * t.strength * map.variance[t.place] * lambda;
            square += g * g / (1.0 + self.found.iter().map(of).sum::<f64>());
        }
        1.0 / (square.max(f64::MIN_POSITIVE).sqrt() * touch.strength)
    }
}

/// Gauss-Jordan elimination of a small positive definite system; the solution is in the last column.
fn eliminate(matrix: &mut [[f64; MOST + 1]; MOST], count: usize) {
    for k in 0..count {
        let pivot = matrix[k][k];
        matrix[k].iter_mut().for_each(|v| *v /= pivot);
        let row = matrix[k];
        for (_, other) in matrix[..count].iter_mut().enumerate().filter(|(i, _)| *i != k) {
            let factor = other[k];
            other.iter_mut().zip(row).for_each(|(v, r)| *v -= factor * r);
        }
    }
}
