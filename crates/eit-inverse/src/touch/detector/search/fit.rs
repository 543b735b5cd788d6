//! Fits of touches to a frame: strengths, positions, and how well they are known.

use super::Search;
use crate::touch::detector::joint::remove_all;
use crate::touch::detector::places::Spot;
use crate::touch::detector::scene::{Fit, Scene};
use crate::touch::detector::vectors::dot;

/// Gauss-Newton steps of each fit; starts are at most half a spacing away.
const STEPS: usize = 4;

/// Step length below which positions no longer change significantly, metres.
const ARRIVED_M: f64 = 2e-5;

/// Damping of those steps relative to each unknown's own curvature, ...
const DAMPING: f64 = 1e-3;

/// ... and its growth when a step fits worse and is undone.
const MORE_DAMPING: f64 = 100.0;

impl Search {
    /// Fits positions and strengths of all touches together. If full steps increase the residual,
    /// they are undone and replaced by damped steps, none of which may increase it.
    pub(in super::super) fn fit(&mut self, scene: &Scene<'_>, fit: &mut Fit) {
        self.fit_strengths(scene, fit);
        if fit.spots.is_empty() {
            return;
        }
        let rest = fit.rest;
        self.began.clone_from(&fit.spots);
        for _ in 0..STEPS {
            let length_m = self.step(scene, fit, DAMPING);
            self.fit_strengths(scene, fit);
            if length_m < ARRIVED_M {
                break;
            }
        }
        if fit.rest > rest {
            fit.spots.clone_from(&self.began);
            self.fit_strengths(scene, fit);
            self.fit_damped(scene, fit);
        }
    }

    /// Takes damped steps, none of which may increase the residual.
    fn fit_damped(&mut self, scene: &Scene<'_>, fit: &mut Fit) {
        let mut damping = MORE_DAMPING * DAMPING;
        for _ in 0..STEPS {
            let rest = fit.rest;
            self.began.clone_from(&fit.spots);
            self.step(scene, fit, damping);
            self.fit_strengths(scene, fit);
            if fit.rest > rest {
                fit.spots.clone_from(&self.began);
                self.fit_strengths(scene, fit);
                damping *= MORE_DAMPING;
            }
        }
    }

    /// Fits strengths with positions fixed and the shares of memories, and updates the residual.
    pub(in super::super) fn fit_strengths(&mut self, scene: &Scene<'_>, fit: &mut Fit) {
        let (n, touches) = (self.rows, fit.spots.len());
        for (spot, columns) in fit.spots.iter().zip(self.columns.chunks_exact_mut(3 * n)) {
            let own = scene.dictionary.own(spot.place);
            self.responses.write(own, scene.whitening, spot, columns);
        }
        self.set_linear(scene, touches);
        let size = touches + scene.memory.columns();
        self.system.solve_bounded(size, touches, &scene.memory.bounds, None);
        let (strengths, shares) = self.system.solution[..size].split_at(touches);
        fit.strengths.clear();
        fit.strengths.extend_from_slice(strengths);
        fit.shares.clear();
        fit.shares.extend_from_slice(shares);
        self.residual.copy_from_slice(scene.frame);
        let values = self.columns.chunks_exact(n).step_by(3);
        let memories = scene.memory.whitened.chunks_exact(n);
        let columns = values.zip(strengths).chain(memories.zip(shares));
        for (column, amount) in columns {
            self.residual.iter_mut().zip(column).for_each(|(r, c)| *r -= amount * c);
        }
        fit.rest = dot(&self.residual, &self.residual);
    }

    /// Sets the Gram matrix of strengths and shares of memories.
    fn set_linear(&mut self, scene: &Scene<'_>, touches: usize) {
        let n = self.rows;
        let (columns, memories) = (&self.columns, &scene.memory.whitened);
        let column = |i: usize| match i.checked_sub(touches) {
            None => &columns[3 * i * n..(3 * i + 1) * n],
            Some(k) => &memories[k * n..(k + 1) * n],
        };
        self.system.set(column, touches + scene.memory.columns(), scene.frame);
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
    pub(in super::super) fn covariances(
        &mut self,
        best: &Fit,
        mut each: impl FnMut(usize, f64, [f64; 4]),
    ) {
        let touches = best.spots.len();
        self.set_all(best);
        for k in 0..touches {
            let (mut strength, mut place) = ([0.0], [0.0; 4]);
            self.system.inverse_block(3 * touches, k, 1, &mut strength);
            self.system.inverse_block(3 * touches, touches + 2 * k, 2, &mut place);
            each(k, strength[0], place);
        }
    }

    /// Fits the strengths of the best touches again.
    pub(in super::super) fn fit_best_again(&mut self, scene: &Scene<'_>) {
        let mut best = std::mem::take(&mut self.best);
        self.fit_strengths(scene, &mut best);
        self.best = best;
    }

    /// Computes the factor by which the residual grows without each touch, with positions fixed.
    pub(in super::super) fn weigh(&mut self, scene: &Scene<'_>, fit: &mut Fit) {
        let evidence = scene.evidence();
        let (touches, size) = (fit.spots.len(), fit.spots.len() + scene.memory.columns());
        self.set_linear(scene, touches);
        let whole = dot(scene.frame, scene.frame);
        fit.worth.clear();
        for k in 0..touches {
            let fall = self.system.solve_bounded(size, touches, &scene.memory.bounds, Some(k));
            fit.worth.push(evidence.worth(whole - fall, fit.rest));
        }
    }

    /// Returns the decrease of chi^2 by each of several touches that are fitted together, starting
    /// at given positions.
    pub(in super::super) fn gains_at(&mut self, scene: &Scene<'_>, spots: Vec<Spot>) -> Vec<f64> {
        let mut fit = Fit { spots, ..Fit::default() };
        self.fit(scene, &mut fit);
        let (touches, size) = (fit.spots.len(), fit.spots.len() + scene.memory.columns());
        self.set_linear(scene, touches);
        let mut fall =
            |left_out| self.system.solve_bounded(size, touches, &scene.memory.bounds, left_out);
        let whole = fall(None);
        (0..touches).map(|k| whole - fall(Some(k))).collect()
    }

    /// Removes the span of these touches' responses and their derivatives, `basis`, from whitened
    /// data. Afterwards the best touches must be fitted again.
    pub(in super::super) fn without(
        &mut self,
        scene: &Scene<'_>,
        spots: &[Spot],
        y: &mut [f64],
        basis: &mut Vec<f64>,
    ) {
        let mut fit = std::mem::take(&mut self.trial);
        fit.spots.clear();
        fit.spots.extend_from_slice(spots);
        self.fit_strengths(scene, &mut fit);
        self.span(fit.spots.len(), basis);
        remove_all(y, basis);
        self.trial = fit;
    }

    /// Orthonormal vectors that span the responses of the last fit's touches and their derivatives.
    pub(in super::super) fn span(&self, touches: usize, basis: &mut Vec<f64>) {
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
}
