//! Number of iterations to a certified sequence, and validity of the certificate for difficult data.

use crate::problem::{Problem, gap, reference, square};
use eit_inverse::{Fidelity, StTvSettings, Stop, WeightStatus};
use fixtures::Random;
use ndarray::{Array2, Axis};

#[test]
fn bounds_that_bind_and_large_weights_in_time_cost_at_most_twice_the_iterations() {
    let Some((_, usual)) = reference(32) else { return };
    let lambda = usual.settings.lambda_space;
    let bounded = [-0.2, -0.1].map(|lower_s| usual.clone().within([lower_s, f64::INFINITY]));
    let in_time =
        [10.0, 30.0, 100.0].map(|factor| usual.clone().with_weights(lambda, factor * lambda));
    for target_gap in [1e-2, 1e-3] {
        let iterations = |problem: &Problem| problem.converged(&gap(target_gap)).report.iterations;
        let of_usual = iterations(&usual);
        for problem in bounded.iter().chain(&in_time) {
            let found = iterations(problem);
            assert!(found <= 2 * of_usual, "{found}, usual {of_usual}: {:?}", problem.settings);
        }
    }
}

/// Large weights in time with bounds, masked channels and a frame without any: all go through the exact step.
#[test]
fn exact_steps_in_time_are_certified_with_bounds_and_masks() {
    let Some((_, problem)) = reference(32) else { return };
    let lambda = problem.settings.lambda_space;
    let mut problem = problem.with_weights(lambda, 30.0 * lambda);
    let mut good = Array2::from_elem(problem.values.dim(), true);
    good.row_mut(7).fill(false);
    good.column_mut(3).iter_mut().skip(10).for_each(|good| *good = false);
    problem.good = Some(good);
    for lower_s in [f64::NEG_INFINITY, -0.1, 0.0] {
        problem.settings.lower_s = lower_s;
        let iterations = problem.converged(&gap(1e-3)).report.iterations;
        assert!(iterations <= 1200, "lower {lower_s}: {iterations} iterations");
    }
    // in f64
    problem.converged(&gap(1e-5));
}

/// Few channels leave most of an image free, so that it has far to go under small forces; with one, the optimum is
/// close to a constant in each frame. Measured: 436 iterations for one row, 1 350 for three rows.
#[test]
fn few_rows_are_certified_to_a_hundredth() {
    for (rows, most) in [(&[0][..], 1200), (&[0, 5, 9], 4000)] {
        let Some((_, mut problem)) = reference(32) else { return };
        problem.jacobian = problem.jacobian.select(Axis(0), rows);
        problem.values = problem.values.select(Axis(1), rows);
        let iterations = problem.converged(&gap(1e-2)).report.iterations;
        assert!(iterations <= most, "rows {rows:?}: {iterations} iterations");
    }
}

/// The reference problem in units of its noise.
fn with_noise(pixels: usize) -> Option<Problem> {
    let (known, mut problem) = reference(pixels)?;
    let noise = known.noise_norm / (known.values.len() as f64).sqrt();
    let noise_std = Some(vec![noise; problem.values.ncols()]);
    problem.settings = StTvSettings { noise_std, ..Default::default() };
    Some(problem)
}

/// Cost in iterations times frames, of which 8 are processed together, beside 24 of the solve.
#[test]
fn choosing_weights_costs_less_than_the_solve() {
    for pixels in [32, 64] {
        let Some(problem) = with_noise(pixels) else { return };
        let mut solver = problem.solver().unwrap();
        let chosen = solver.choose_weights(&problem.differences(), 1.0).unwrap();
        let solved = solver.solve(&problem.differences(), &gap(1e-3)).unwrap();
        let (trials, iterations) = (chosen.curve.len(), chosen.iterations);
        let wanted = 3 * solved.report.iterations;
        assert_eq!(chosen.status, WeightStatus::Reached, "{pixels}");
        assert!(trials <= 6, "{pixels}: {trials} trials");
        assert!(2 * iterations <= wanted, "{pixels}: {iterations} iterations, {wanted}");
    }
}

/// The chosen weight is the largest that explains the data, to a fifth: checked by accurate solves.
#[test]
fn chosen_weights_explain_the_data_and_larger_ones_do_not() {
    for (pixels, first) in [(32, 0), (32, 9), (64, 5)] {
        let Some(mut problem) = with_noise(pixels) else { return };
        problem.values = problem.values.select(Axis(0), &Vec::from_iter(first..first + 8));
        let mut solver = problem.solver().unwrap();
        let chosen = solver.choose_weights(&problem.differences(), 1.0).unwrap();
        assert_eq!(chosen.status, WeightStatus::Reached);
        let residual = |factor: f64| {
            let mut solver = problem.solver().unwrap();
            let [space, time] = [chosen.lambda_space, chosen.lambda_time].map(|w| factor * w);
            solver.set_weights(space, time, Fidelity::Penalised).unwrap();
            let report = solver.solve(&problem.differences(), &gap(1e-3)).unwrap().report;
            let square: f64 = report.residual.iter().map(|r| r * r).sum();
            (square / problem.values.len() as f64).sqrt()
        };
        let [below, above] = [1.0 / 1.2, 1.2].map(residual);
        assert!(below < 1.0 && above > 1.0, "{pixels}, from {first}: {below} to {above}");
    }
}

#[test]
fn data_beyond_the_model_is_at_the_lower_edge() {
    let Some(mut problem) = with_noise(32) else { return };
    let (frames, channels) = problem.values.dim();
    let noise = problem.settings.noise_std.as_ref().unwrap()[0];
    problem.values += &(5.0 * noise * Random::new(8).normals(frames, channels));
    let mut solver = problem.solver().unwrap();
    let chosen = solver.choose_weights(&problem.differences(), 1.0).unwrap();
    assert_eq!(chosen.status, WeightStatus::AtLowerEdge);
    assert!(chosen.residual > 2.0, "{}", chosen.residual);
    let ordered = chosen.curve.is_sorted_by(|a, b| a.lambda_space < b.lambda_space);
    assert!(ordered, "{:?}", chosen.curve);
}

/// Normal rows that fall by so many decades, on a square.
fn graded(random: &mut Random, rows: usize, side: usize, decades: f64) -> Array2<f64> {
    let scale = |i: usize| 10_f64.powf(-decades * i as f64 / (rows - 1) as f64);
    Array2::from_shape_fn((rows, side * side), |(i, _)| scale(i) * random.normal())
}

/// Rows from 1 to 1e-8 and weights down to 1e-14, as with distant electrodes and little noise, and masked
/// channels: the bound must not exceed the objective of any image, computed from the remaining raw rows. A
/// Gram matrix of these rows would square their condition number.
#[test]
fn bounds_of_graded_rows_hold_with_masked_channels() {
    let mut random = Random::new(21);
    let side = 6;
    let truth = Array2::from_shape_fn((2, side * side), |(t, p)| f64::from(p % side < 2 + t));
    for seed in 0..6 {
        let jacobian = graded(&mut random, 12, side, 8.0);
        let values = truth.dot(&jacobian.t());
        let whole = Problem::new(jacobian, square(side, side), values);
        for masked in [&[0][..], &[3, 7], &[0, 1, 2], &[11]] {
            let kept: Vec<usize> = (0..12).filter(|i| !masked.contains(i)).collect();
            for lambda in [1e-6, 1e-10, 1e-14] {
                let mut problem = whole.clone().with_weights(lambda, 0.5 * lambda);
                let mut cut = problem.clone();
                cut.jacobian = whole.jacobian.select(Axis(0), &kept);
                cut.values = whole.values.select(Axis(1), &kept);
                problem.good = Some(Array2::from_shape_fn((2, 12), |(_, i)| kept.contains(&i)));
                let stop = Stop { max_iterations: 3000, ..gap(1e-6) };
                let (own, other) = (problem.solve(&stop), cut.solve(&stop));
                let bound = own.report.certificate.unwrap().lower_bound;
                // rounding of residuals, which are differences of values as large as the data
                let value = |images| problem.objective(images) + problem.rounding(images);
                let images = [&own.images, &other.images, &truth];
                let least = images.into_iter().map(value).fold(f64::INFINITY, f64::min);
                let case = format!("seed {seed}, masked {masked:?}, lambda {lambda:e}");
                assert!(bound <= least * (1.0 + 1e-9), "{case}: {bound:e} above {least:e}");
            }
        }
    }
}

/// A problem beyond the precision of `f32` continues in `f64`, instead of reaching the cap without a bound.
#[test]
fn an_ill_conditioned_sequence_is_certified_to_a_hundredth() {
    let side = 6;
    let jacobian = graded(&mut Random::new(5), 20, side, 6.0);
    let is_touched = |t: usize, p: usize| p % side < 2 + t && p / side < 4;
    let truth = Array2::from_shape_fn((3, side * side), |(t, p)| f64::from(is_touched(t, p)));
    let values = truth.dot(&jacobian.t());
    let problem = Problem::new(jacobian, square(side, side), values);
    for lambda in [1e-8, 1e-10] {
        problem.clone().with_weights(lambda, 0.5 * lambda).converged(&gap(1e-2));
    }
}
