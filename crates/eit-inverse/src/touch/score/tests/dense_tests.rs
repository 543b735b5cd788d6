//! Scores, marginalisation and filter against dense closed forms.

use super::{Skin, touch_at};
use crate::touch::score::actions::{FIRST_ACTION, Features};
use crate::touch::score::estimate::{Estimator, Scene};
use crate::touch::score::linear::Symmetric;
use crate::touch::score::model::Model;
use crate::touch::score::state::Touches;
use crate::touch::score::whitened::Whitened;
use crate::touch::score::{ScoreSettings, background, prior};
use faer::Mat;
use faer::linalg::solvers::Solve;
use fixtures::Random;
use std::f64::consts::TAU;

/// A random covariance and frame of a skin's rows.
fn whitened(model: &Model) -> (Whitened, Mat<f64>, Vec<f64>) {
    let (n, mut random) = (model.n, Random::new(5));
    let mut base = Symmetric::zeros(n);
    let factors: Vec<f64> = (0..n * 8).map(|_| random.normal()).collect();
    base.add_product(1.0, &factors);
    base.add_diagonal(1.0);
    let y: Vec<f64> = (0..n).map(|_| 20.0 * random.normal()).collect();
    let mut frame = Whitened::default();
    frame.set(&base, &Symmetric::zeros(n), &y, |_| true);
    (frame, Mat::from_fn(n, n, |i, j| base.get(i, j)), y)
}

fn log_determinant(matrix: &Mat<f64>) -> f64 {
    let factor = matrix.llt(faer::Side::Lower).unwrap();
    (0..matrix.nrows()).map(|i| 2.0 * factor.L()[(i, i)].ln()).sum()
}

/// Without a step, the score of two touches is that of a dense normal density with the actions in its covariance
/// (Woodbury), the Hessian's determinant and the priors.
#[test]
fn a_score_is_that_of_a_dense_density() {
    let skin = Skin::new();
    let settings = ScoreSettings::default();
    let model = skin.known(&settings);
    let scene = Scene { model: &model, settings: &settings, dt_s: 0.05 };
    let (mut frame, covariance, y) = whitened(&model);
    let list =
        [touch_at(&model.grid, [0.07, 0.1], 2e-5), touch_at(&model.grid, [0.13, 0.08], 4e-5)];
    let touches = list.iter().fold(Touches::none(), |touches, t| touches.with(*t));
    let found = Estimator::default().fit(&scene, &mut frame, &touches, 0, 0);

    let n = model.n;
    let (mut dense, mut left) = (covariance, y);
    let mut free = Mat::<f64>::zeros(n, 6);
    for (k, touch) in list.iter().enumerate() {
        let features = Features::new(touch, &settings);
        for f in 0..features.count {
            let mut column = vec![0.0; n];
            features.add_rows(f, 1.0, model.dictionary.of(touch.spot.place), &mut column);
            let column = Mat::from_fn(n, 1, |i, _| column[i]);
            if f >= FIRST_ACTION {
                dense += &column * column.transpose();
            } else {
                let at = if f == 0 { k } else { 2 + 2 * k + f - 1 };
                (0..n).for_each(|i| free[(i, at)] = column[(i, 0)]);
            }
            if f == 0 {
                (0..n).for_each(|i| left[i] -= touch.strength_m2 * column[(i, 0)]);
            }
        }
    }
    let left = Mat::from_fn(n, 1, |i, _| left[i]);
    let solver = dense.llt(faer::Side::Lower).unwrap();
    let chi_square = (left.transpose() * solver.solve(&left))[(0, 0)];
    let mut hessian = free.transpose() * solver.solve(&free);
    let mut cost = prior::of_pair(&list[0], &list[1], &settings);
    for (k, touch) in list.iter().enumerate() {
        let strength = prior::of_strength(touch.strength_m2, &settings);
        let place = prior::of_place(touch, &model.grid, &settings, 0.05, false);
        hessian[(k, k)] += strength.precision;
        (0..2).for_each(|a| hessian[(2 + 2 * k + a, 2 + 2 * k + a)] += place.precision[a][a]);
        cost += strength.cost + place.cost;
    }
    let curvature = log_determinant(&hessian) - 6.0 * TAU.ln();
    let score = chi_square + log_determinant(&dense) + curvature + cost;
    // the ridge of 1e-9 on the Hessian, and rounding
    assert!(
        (found.chi_square - chi_square).abs() < 1e-8 * chi_square,
        "{} {chi_square}",
        found.chi_square
    );
    assert!((found.score - score).abs() < 1e-6 * score.abs(), "{} {score}", found.score);
}

/// A frame without touches updates the reference, the shares of settling and their covariances as dense Kalman filters;
/// missing rows say nothing.
#[test]
fn the_reference_is_a_kalman_filter() {
    let skin = Skin::new();
    let settings = ScoreSettings::default();
    let model = skin.known(&settings);
    let scene = Scene { model: &model, settings: &settings, dt_s: 0.05 };
    let (n, mut random) = (model.n, Random::new(7));
    let mut background = background::Background::new(&model, &settings);
    background.advance(&settings, 3.0);
    let before = Mat::from_fn(n, n, |i, j| background.covariance.get(i, j));
    let y: Vec<f64> = (0..n).map(|_| random.normal()).collect();
    for settled in &mut background.settled {
        settled.iter_mut().for_each(|s| *s = 5.0 * random.normal());
    }
    let settled = Mat::from_fn(n, 3, |i, k| background.settled[k][i]);
    let mut total = Symmetric::default();
    background.sum(&model, &mut total);
    let mut frame = Whitened::default();
    frame.set(&total, &Symmetric::zeros(n), &y, |row| row % 5 != 0);
    background.learn(&scene, &frame, 1.0, &mut Touches::none(), &y);

    let present: Vec<usize> = (0..n).filter(|row| row % 5 != 0).collect();
    let sum = Mat::from_fn(present.len(), present.len(), |a, b| total.get(present[a], present[b]));
    let gain = Mat::from_fn(present.len(), n, |a, i| before[(present[a], i)]);
    let solved = sum.llt(faer::Side::Lower).unwrap().solve(&gain);
    let frame_y = Mat::from_fn(present.len(), 1, |a, _| y[present[a]]);
    let reference = solved.transpose() * &frame_y;
    let after = &before - gain.transpose() * &solved;
    // shares are subtracted: their columns are -settled
    let columns = Mat::from_fn(present.len(), 3, |a, k| -settled[(present[a], k)]);
    let variance = settings.settle * settings.settle / 3.0;
    let solved = sum.llt(faer::Side::Lower).unwrap().solve(&columns);
    let shares = faer::Scale(variance) * (solved.transpose() * &frame_y);
    let known = faer::Scale(variance * variance) * (columns.transpose() * &solved);
    for k in 0..3 {
        assert!((background.shares[k] - shares[(k, 0)]).abs() < 1e-9, "{k}");
        for l in 0..3 {
            let prior = if k == l { variance } else { 0.0 };
            let wanted = prior - known[(k, l)];
            let least = if k == l { settings.trail * settings.trail } else { wanted };
            let own = background.share_covariance[k][l];
            assert!((own - wanted.max(least)).abs() < 1e-9, "{k} {l}");
        }
    }
    for i in 0..n {
        assert!((background.reference[i] - reference[(i, 0)]).abs() < 1e-9, "{i}");
        for j in 0..=i {
            let own = background.covariance.get(i, j);
            assert!((own - after[(i, j)]).abs() < 1e-9 * (1.0 + before[(i, i)]), "{i} {j}");
        }
    }
}
