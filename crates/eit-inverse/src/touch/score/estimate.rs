//! The most probable strengths and positions of some touches, and the score of that hypothesis.
//!
//! ```text
//! y = D a + B g + noise,   g ~ N(0, I),   C = I + B B'
//! J = r' C^-1 r + ln|S + E| + ln|I + B'B| + ln|Lambda / 2 pi| - 2 ln prior,   r = y - D a
//! ```
//!
//! with everything whitened by `S + E`. The actions `B` of the touches are marginalised: `r' C^-1 r = r'r - v'v`, `v = L_B^-1
//! B'r`, `L_B L_B' = I + B'B` (Woodbury). `Lambda` is the Hessian in strengths and positions, so that `J` is the evidence with
//! both integrated (Laplace). Gauss-Newton in both at once.
//!
//! With `K` touches of `m` features: `28 K^2 m` flops for the products of all pairs, `(7 K)^3 / 3 + 3 K (7 K)^2` for the
//! marginalisation, 0.1 Mflop a step with six. Nothing depends on the number of rows.

use super::actions::{FIRST_ACTION, Features};
use super::dictionary::COLUMNS;
use super::linear::{Factor, Symmetric};
use super::model::Model;
use super::prior;
use super::settings::{MOST_TOUCHES, ScoreSettings};
use super::state::{Hypothesis, TouchState, Touches};
use super::whitened::Whitened;
use crate::touch::detector::dot;
use std::f64::consts::TAU;

/// Relative addition to the diagonal of the Hessian: rounding of its products.
const RIDGE: f64 = 1e-9;

/// Decrease of a score below which a fit has converged.
const CONVERGED: f64 = 0.01;

/// What a fit needs to know.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene<'a> {
    pub(super) model: &'a Model,
    pub(super) settings: &'a ScoreSettings,
    pub(super) dt_s: f64,
}

/// Workspace of fits.
#[derive(Debug, Clone, Default)]
pub(super) struct Estimator {
    pub(super) features: Vec<Features>,
    pub(super) cells: Vec<usize>,
    /// First of each touch's features, and their number.
    pub(super) starts: Vec<usize>,
    /// Products of all features, row by row, and with the frame.
    pub(super) normal: Vec<f64>,
    pub(super) right: Vec<f64>,
    free: Vec<usize>,
    bound: Vec<usize>,
    marginal: Symmetric,
    of_marginal: Factor,
    /// `L_B^-1` of the products of the actions with the residual, then with each free feature.
    reduced: Vec<f64>,
    hessian: Symmetric,
    of_hessian: Factor,
    gradient: Vec<f64>,
    scale: Vec<f64>,
    pub(super) work: Vec<f64>,
    /// Number of fits since the start.
    pub(super) fits: u64,
}

impl Estimator {
    /// Fits some touches in a number of steps; in the first `moving` of them none rests.
    pub(super) fn fit(
        &mut self,
        scene: &Scene<'_>,
        frame: &mut Whitened,
        touches: &Touches,
        steps: usize,
        moving: usize,
    ) -> Hypothesis {
        self.fits += 1;
        let mut touches = *touches;
        if touches.is_empty() {
            let score = frame.square + frame.log_determinant;
            return Hypothesis { touches, chi_square: frame.square, score, rows: frame.n() };
        }
        self.begin(scene, frame, &mut touches);
        let mut step = 0;
        loop {
            let [chi_square, cost, gain] = self.look(scene, frame, &touches, step < moving);
            if step < moving && gain < CONVERGED {
                step = moving;
                continue;
            }
            if step >= steps || gain < CONVERGED {
                let of_scale: f64 = self.scale.iter().map(|s| 2.0 * s.ln()).sum();
                let curvature = self.of_hessian.log_determinant()
                    - of_scale
                    - self.scale.len() as f64 * TAU.ln();
                let marginal = self.of_marginal.log_determinant();
                self.finish(&mut touches);
                let score = chi_square + frame.log_determinant + marginal + cost + curvature;
                return Hypothesis { touches, chi_square, score, rows: frame.n() };
            }
            self.step(scene, &mut touches);
            step += 1;
        }
    }

    /// Returns by how much the score would fall if none of some touches rested.
    pub(super) fn gain_of_moving(
        &mut self,
        scene: &Scene<'_>,
        frame: &mut Whitened,
        touches: &Touches,
    ) -> f64 {
        let [_, _, gain] = self.look(scene, frame, touches, true);
        gain
    }

    /// Finds the next step; returns chi^2, the cost of the priors, and by how much the score will fall.
    fn look(
        &mut self,
        scene: &Scene<'_>,
        frame: &mut Whitened,
        touches: &Touches,
        moves: bool,
    ) -> [f64; 3] {
        self.multiply(scene, frame, touches);
        let chi_square = self.marginalise(frame, touches);
        let cost = self.add_priors(scene, touches, moves);
        self.factorise_hessian();
        [chi_square, cost, self.find_step()]
    }

    /// Sets the strengths of touches that have none, which scale what they do.
    fn begin(&mut self, scene: &Scene<'_>, frame: &mut Whitened, touches: &mut Touches) {
        let is_new: [bool; MOST_TOUCHES] =
            std::array::from_fn(|k| touches.get(k).is_some_and(|t| t.strength_m2 <= 0.0));
        for k in (0..touches.len()).filter(|k| is_new[*k]) {
            let own = frame.cell(scene.model, touches[k].spot.place);
            let mut product = frame.products(own)[0];
            for q in (0..touches.len()).filter(|q| !is_new[*q]) {
                let other = frame.cell(scene.model, touches[q].spot.place);
                let gram = frame.gram(own, other);
                let [print, ..] = touches[q].print();
                for (c, factor) in print.iter().enumerate() {
                    let product_of = if own >= other { gram[0][c] } else { gram[c][0] };
                    product -= touches[q].strength_m2 * factor * product_of;
                }
            }
            let square = frame.gram(own, own)[0][0].max(f64::MIN_POSITIVE);
            touches[k].strength_m2 = (product / square).max(0.02 * scene.settings.typical_m2);
        }
    }

    /// Computes the products of all features.
    pub(super) fn multiply(&mut self, scene: &Scene<'_>, frame: &mut Whitened, touches: &Touches) {
        self.features.clear();
        self.cells.clear();
        self.starts.clear();
        let mut count = 0;
        for touch in touches.iter() {
            let features = Features::new(touch, scene.settings);
            self.starts.push(count);
            count += features.count;
            self.features.push(features);
            self.cells.push(frame.cell(scene.model, touch.spot.place));
        }
        self.starts.push(count);
        self.normal.clear();
        self.normal.resize(count * count, 0.0);
        self.right.clear();
        for k in 0..touches.len() {
            let products = frame.products(self.cells[k]);
            let features = &self.features[k];
            self.right.extend((0..features.count).map(|f| features.times(f, products)));
        }
        for k in 0..touches.len() {
            for q in 0..=k {
                self.multiply_pair(frame, k, q, count);
            }
        }
        self.free.clear();
        self.free.extend(&self.starts[..touches.len()]);
        self.free.extend(self.starts[..touches.len()].iter().flat_map(|s| [s + 1, s + 2]));
        self.bound.clear();
        for k in 0..touches.len() {
            self.bound.extend(self.starts[k] + FIRST_ACTION..self.starts[k + 1]);
        }
    }

    fn multiply_pair(&mut self, frame: &mut Whitened, k: usize, q: usize, count: usize) {
        // the products of cells are those of the later with the earlier
        let (late, early) = if self.cells[k] >= self.cells[q] { (k, q) } else { (q, k) };
        let gram = frame.gram(self.cells[late], self.cells[early]);
        let products = self.features[late].products(&self.features[early], gram);
        for (j, row) in (self.starts[early]..self.starts[early + 1]).zip(&products) {
            for (i, product) in (self.starts[late]..self.starts[late + 1]).zip(row) {
                self.normal[i * count + j] = *product;
                self.normal[j * count + i] = *product;
            }
        }
    }

    /// Marginalises the actions, and returns the squared length of the residual.
    fn marginalise(&mut self, frame: &Whitened, touches: &Touches) -> f64 {
        let (count, k) = (self.right.len(), touches.len());
        let Self { normal, right, free, bound, marginal, of_marginal, reduced, work, .. } = self;
        let product = |i: usize, j: usize| normal[i * count + j];
        // products of the residual y - D a
        work.clear();
        work.extend((0..count).map(|i| {
            right[i] - (0..k).map(|q| touches[q].strength_m2 * product(i, free[q])).sum::<f64>()
        }));
        let square = frame.square
            - (0..k)
                .map(|q| touches[q].strength_m2 * (right[free[q]] + work[free[q]]))
                .sum::<f64>();
        let n = bound.len();
        marginal.reset(n);
        for (a, &i) in bound.iter().enumerate() {
            let column = marginal.column_mut(a);
            column.iter_mut().zip(&bound[a..]).for_each(|(m, &j)| *m = product(i, j));
            column[0] += 1.0;
        }
        of_marginal.of(marginal);
        reduced.clear();
        reduced.extend(bound.iter().map(|&i| work[i]));
        for &f in &*free {
            reduced.extend(bound.iter().map(|&i| product(i, f)));
        }
        of_marginal.solve(reduced);
        let column = |c: usize| &reduced[c * n..(c + 1) * n];
        self.hessian.reset(free.len());
        self.gradient.clear();
        for (a, &i) in free.iter().enumerate() {
            self.gradient.push(work[i] - dot(column(a + 1), column(0)));
            for (b, &j) in free.iter().enumerate().take(a + 1) {
                let product = product(i, j) - dot(column(a + 1), column(b + 1));
                self.hessian.add_at(a, b, product);
            }
        }
        square - dot(column(0), column(0))
    }

    /// Adds the priors to gradient and Hessian, and returns their cost.
    fn add_priors(&mut self, scene: &Scene<'_>, touches: &Touches, moves: bool) -> f64 {
        let (s, count, mut cost) = (scene.settings, touches.len(), 0.0);
        for (k, touch) in touches.iter().enumerate() {
            let strength = prior::of_strength(touch.strength_m2, s);
            self.gradient[k] += strength.pull;
            self.hessian.add_at(k, k, strength.precision);
            let place = prior::of_place(touch, &scene.model.grid, s, scene.dt_s, moves);
            let i = count + 2 * k;
            for a in 0..2 {
                self.gradient[i + a] += place.pull[a];
                (0..=a).for_each(|b| {
                    self.hessian.add_at(i + a, i + b, place.precision[a][b]);
                });
            }
            let pairs: f64 = touches[..k].iter().map(|other| prior::of_pair(touch, other, s)).sum();
            cost += strength.cost + place.cost + pairs;
        }
        cost
    }

    /// Factorises the Hessian in units of its diagonal.
    fn factorise_hessian(&mut self) {
        let Self { hessian, scale, of_hessian, .. } = self;
        scale.clear();
        scale.extend((0..hessian.n()).map(|i| hessian.get(i, i).max(1e-12).sqrt().recip()));
        for j in 0..hessian.n() {
            let column = hessian.column_mut(j).iter_mut().zip(&scale[j..]);
            column.for_each(|(h, scale_i)| *h *= scale_i * scale[j]);
        }
        hessian.add_diagonal(RIDGE);
        of_hessian.of(hessian);
    }

    /// Replaces the gradient by a step of Gauss-Newton, and returns by how much the score will fall.
    fn find_step(&mut self) -> f64 {
        let Self { gradient, scale, of_hessian, .. } = self;
        gradient.iter_mut().zip(&*scale).for_each(|(g, s)| *g *= s);
        of_hessian.solve(gradient);
        let gain = dot(gradient, gradient);
        of_hessian.solve_transposed(gradient);
        gradient.iter_mut().zip(&*scale).for_each(|(g, s)| *g *= s);
        gain
    }

    /// Moves touches by the step that was found, at most to the next place.
    fn step(&self, scene: &Scene<'_>, touches: &mut Touches) {
        let gradient = &self.gradient;
        let count = touches.len();
        for (k, touch) in touches.iter_mut().enumerate() {
            let way = [gradient[count + 2 * k], gradient[count + 2 * k + 1]];
            let part = (scene.model.grid.pitch_m / (way[0].hypot(way[1]) + 1e-12)).min(1.0);
            touch.spot = scene.model.grid.moved(&touch.spot, way.map(|w| part * w));
            let a = touch.strength_m2;
            let most = 4.0 * a + 0.05 * scene.settings.typical_m2;
            touch.strength_m2 = (a + gradient[k]).clamp(0.3 * a, most);
        }
    }

    /// Sets covariances and responses of the touches.
    fn finish(&mut self, touches: &mut Touches) {
        let count = touches.len();
        let n = self.bound.len();
        let gamma = &mut self.reduced[..n];
        self.of_marginal.solve_transposed(gamma);
        let Self { hessian, of_hessian, scale, work, .. } = self;
        of_hessian.invert(hessian, work);
        let entry = |i: usize, j: usize| hessian.get(i, j) * scale[i] * scale[j];
        for (k, touch) in touches.iter_mut().enumerate() {
            let place = count + 2 * k;
            touch.strength_variance = entry(k, k);
            touch.covariance_m2 = [0, 1].map(|i| [0, 1].map(|j| entry(place + i, place + j)));
        }
        let mut first = 0;
        for (k, touch) in touches.iter_mut().enumerate() {
            touch.response = [0.0; COLUMNS];
            for (c, factor) in self.features[k].of(0) {
                touch.response[c] += touch.strength_m2 * factor;
            }
            for feature in FIRST_ACTION..self.features[k].count {
                let share = gamma[first];
                first += 1;
                self.features[k].of(feature).for_each(|(c, f)| touch.response[c] += share * f);
            }
        }
    }
}

/// What is left of a frame after touches and all that they do.
pub(super) fn residual(
    scene: &Scene<'_>,
    frame: &mut Whitened,
    touches: &[TouchState],
    out: &mut Vec<f64>,
) {
    out.clear();
    out.extend_from_slice(&frame.data);
    for touch in touches {
        let cell = frame.cell(scene.model, touch.spot.place);
        for (c, factor) in touch.response.iter().enumerate().filter(|(_, f)| **f != 0.0) {
            out.iter_mut().zip(frame.column_of(cell, c)).for_each(|(o, w)| *o -= factor * w);
        }
    }
}
