//! Number of iterations to a certified sequence, and validity of the certificate for difficult data.

#![allow(missing_docs, clippy::unwrap_used, reason = "a test file: a panic is a failed test")]

mod common;
#[path = "common/problem.rs"]
mod problem;

use eit_inverse::{Gradient, ImageSequence, SequenceStatus, Stop};
use fixtures::Random;
use ndarray::{Array2, Axis};
use problem::Problem;

fn gap(target_gap: f64) -> Stop {
    Stop { target_gap, ..Default::default() }
}

/// Reference problem with its temporal weight multiplied by a factor.
fn reference(pixels: usize, in_time: f64) -> Option<Problem> {
    let reference = fixtures::st_tv::load(pixels).unwrap()?;
    let gradient = Gradient::pixels(&reference.mask, 1.0).unwrap();
    let weights = (reference.lambda, in_time * reference.lambda);
    Some(
        Problem::new(reference.jacobian, gradient, reference.values)
            .with_weights(weights.0, weights.1),
    )
}

fn converged(problem: &Problem, stop: &Stop) -> ImageSequence {
    let sequence = problem.solve(stop);
    problem.check(&sequence, stop).unwrap();
    assert_eq!(sequence.report.status, SequenceStatus::Converged, "{:?}", sequence.report);
    sequence
}

/// Measured: 258 and 418 iterations. A uniform step size took 1 225 at 64 x 64.
#[test]
fn the_references_are_certified_to_a_thousandth_within_500_iterations() {
    for (pixels, most) in [(32, 350), (64, 500)] {
        let Some(problem) = reference(pixels, 1.0) else { return };
        let sequence = converged(&problem, &gap(1e-3));
        let iterations = sequence.report.iterations;
        println!("{pixels}: {iterations} iterations");
        assert!(iterations <= most, "{pixels}: {iterations} iterations");
    }
}

/// The image without bounds reaches -0.3. Measured: 213 iterations, and 219 without bounds.
#[test]
fn bounds_that_bind_cost_no_more_than_twice_the_iterations() {
    let Some(mut problem) = reference(32, 1.0) else { return };
    let free = converged(&problem, &gap(1e-3)).report.iterations;
    for lower_s in [-0.2, -0.1] {
        problem.settings.lower_s = lower_s;
        let bounded = converged(&problem, &gap(1e-3)).report.iterations;
        println!("lower {lower_s}: {bounded} iterations, {free} without");
        assert!(bounded <= 2 * free, "lower {lower_s}: {bounded} iterations, {free} without");
    }
}

/// Measured: 457 iterations to 1e-2, 1 350 to 1e-3: more than with equal weights, but below the cap.
#[test]
fn a_large_weight_in_time_is_certified() {
    let Some(problem) = reference(32, 30.0) else { return };
    for (target_gap, most) in [(1e-2, 900), (1e-3, 2700)] {
        let sequence = converged(&problem, &gap(target_gap));
        let iterations = sequence.report.iterations;
        println!("30 times in time to {target_gap}: {iterations} iterations");
        assert!(iterations <= most, "{iterations} iterations to {target_gap}");
    }
}

/// Rows from 1 to 1e-8 and weights down to 1e-14, as with distant electrodes and little noise, and masked
/// channels: the bound must not exceed the objective of any image, computed from the remaining raw rows. A
/// Gram matrix of these rows would square their condition number.
#[test]
fn bounds_of_graded_rows_hold_with_masked_channels() {
    let mut random = Random::new(21);
    let (measurements, side, frames) = (12, 6, 2);
    let gradient = Gradient::pixels(&Array2::from_elem((side, side), true), 1.0).unwrap();
    for seed in 0..6 {
        let jacobian = Array2::from_shape_fn((measurements, side * side), |(i, _)| {
            10_f64.powf(-8.0 * i as f64 / (measurements - 1) as f64) * random.normal()
        });
        let truth = Array2::from_shape_fn((frames, side * side), |(t, p)| {
            f64::from(u8::from(p % side < 2 + t))
        });
        let values = truth.dot(&jacobian.t());
        for masked in [vec![0], vec![3, 7], vec![0, 1, 2], vec![11]] {
            let good = Array2::from_shape_fn(values.dim(), |(_, i)| !masked.contains(&i));
            let kept: Vec<usize> = (0..measurements).filter(|i| !masked.contains(i)).collect();
            for lambda in [1e-6, 1e-10, 1e-14] {
                let mut problem = Problem::new(jacobian.clone(), gradient.clone(), values.clone())
                    .with_weights(lambda, 0.5 * lambda);
                problem.good = Some(good.clone());
                let cut = Problem::new(
                    jacobian.select(Axis(0), &kept),
                    gradient.clone(),
                    values.select(Axis(1), &kept),
                )
                .with_weights(lambda, 0.5 * lambda);
                let stop = Stop { target_gap: 1e-6, max_iterations: 3000, ..Default::default() };
                let (own, other) = (problem.solve(&stop), cut.solve(&stop));
                let bound = own.report.certificate.unwrap().lower_bound;
                let mut least = f64::INFINITY;
                for images in [&own.images, &other.images, &truth] {
                    let found = problem.objective(images);
                    // rounding of residuals, which are differences of values as large as the data
                    let value = found.data + found.variation + problem.rounding(images);
                    least = least.min(value);
                }
                assert!(
                    bound <= least * (1.0 + 1e-9),
                    "seed {seed}, masked {masked:?}, lambda {lambda:e}: {bound:e} above {least:e}"
                );
            }
        }
    }
}

/// A problem beyond the precision of `f32` continues in `f64`, instead of reaching the cap without a bound.
#[test]
fn an_ill_conditioned_sequence_is_certified_to_a_hundredth() {
    let mut random = Random::new(5);
    let side = 6;
    let gradient = Gradient::pixels(&Array2::from_elem((side, side), true), 1.0).unwrap();
    let jacobian = Array2::from_shape_fn((20, side * side), |(i, _)| {
        10_f64.powf(-6.0 * i as f64 / 19.0) * random.normal()
    });
    let truth = Array2::from_shape_fn((3, side * side), |(t, p)| {
        f64::from(u8::from(p % side < 2 + t && p / side < 4))
    });
    let values = truth.dot(&jacobian.t());
    for lambda in [1e-8, 1e-10] {
        let problem = Problem::new(jacobian.clone(), gradient.clone(), values.clone())
            .with_weights(lambda, 0.5 * lambda);
        let stop = gap(1e-2);
        let sequence = problem.solve(&stop);
        problem.check(&sequence, &stop).unwrap();
        let report = &sequence.report;
        println!("lambda {lambda:e}: {:?}, {} iterations", report.status, report.iterations);
        assert_eq!(report.status, SequenceStatus::Converged, "{lambda:e}: {report:?}");
    }
}
