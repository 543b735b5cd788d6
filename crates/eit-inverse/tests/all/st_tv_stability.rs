//! Spatio-temporal total variation in extreme cases: the right answer or a clear error.
//!
//! Over 300 lines because it covers every kind of extreme input on one small problem.

#![allow(missing_docs, clippy::unwrap_used, reason = "a test file: a panic is a failed test")]

use crate::common;
use crate::problem::Problem;
use eit_inverse::{
    DifferenceFrames, Fidelity, Gradient, ImageSequence, InverseError, SequenceStatus, StTv,
    StTvSettings, Stop,
};
use fixtures::Random;
use ndarray::{Array2, Axis, array, concatenate};
use std::f64::consts::SQRT_2;

fn gap(target_gap: f64) -> Stop {
    Stop { target_gap, ..Default::default() }
}

fn square(rows: usize, columns: usize) -> Gradient {
    Gradient::pixels(&Array2::from_elem((rows, columns), true), 1.0).unwrap()
}

fn bounds_of(sequence: &ImageSequence) -> [f64; 2] {
    let certificate = sequence.report.certificate.unwrap();
    [certificate.lower_bound, certificate.primal]
}

fn converged(problem: &Problem, stop: &Stop) -> ImageSequence {
    let sequence = problem.solve(stop);
    problem.check(&sequence, stop).unwrap();
    assert_eq!(sequence.report.status, SequenceStatus::Converged, "{:?}", sequence.report);
    sequence
}

/// A touch that grows and moves over 4 x 5 pixels, with a Jacobian that contains the identity. Then
/// `|J x|^2 >= |x|^2`, and two sequences whose objectives are within `g` of the optimum differ by at most
/// `2 sqrt(2 g)` (strong convexity).
fn scene(frames: usize) -> Problem {
    let mut random = Random::new(11);
    let (rows, columns) = (4, 5);
    let n = rows * columns;
    let jacobian =
        concatenate(Axis(0), &[Array2::eye(n).view(), random.normals(6, n).view()]).unwrap();
    let truth = Array2::from_shape_fn((frames, n), |(t, p)| {
        let (i, j) = (p / columns, p % columns);
        if i < 2 && j >= t % 3 && j < t % 3 + 2 { 1.0 } else { 0.0 }
    });
    let mut values = truth.dot(&jacobian.t());
    values.mapv_inplace(|v| v + 0.1 * random.normal());
    Problem::new(jacobian, square(rows, columns), values).with_weights(0.2, 0.1)
}

/// Upper bound on the distance of two sequences of [`scene`] within a relative gap of their optimum.
fn strong_convexity(primal: f64, relative_gap: f64) -> f64 {
    2.0 * (2.0 * relative_gap * primal).sqrt()
}

fn distance(a: &Array2<f64>, b: &Array2<f64>) -> f64 {
    (a - b).mapv(|d| d * d).sum().sqrt()
}

#[test]
fn the_jacobians_unit_does_not_matter() {
    // J -> c J, lambda -> c lambda: x -> x / c with the same objective; then the unit of the data too
    let stop = gap(1e-6);
    let original = scene(3);
    let wanted = converged(&original, &stop);
    let [lower, upper] = bounds_of(&wanted);
    for exponent in [-12, -9, -6, -3, 3, 6, 9, 12] {
        let factor = 10_f64.powi(exponent);
        let mut scaled = original.clone().with_weights(0.2 * factor, 0.1 * factor);
        scaled.jacobian *= factor;
        let found = converged(&scaled, &stop);
        let [other_lower, other_upper] = bounds_of(&found);
        // both intervals contain the optimum
        assert!(other_lower <= upper && lower <= other_upper, "1e{exponent}");
        let error = distance(&(&found.images * factor), &wanted.images);
        assert!(error <= strong_convexity(upper, 1e-6), "1e{exponent}: {error:e}");
        // volts times c as well: x -> x, objective times c^2
        let mut scaled =
            original.clone().with_weights(0.2 * factor * factor, 0.1 * factor * factor);
        scaled.jacobian *= factor;
        scaled.values *= factor;
        let found = converged(&scaled, &stop);
        let error = distance(&found.images, &wanted.images);
        assert!(error <= strong_convexity(upper, 1e-6), "all times 1e{exponent}: {error:e}");
    }
    // with constraints x -> x / c, and the objective with it
    let (stop, original) = (gap(1e-4), scene(3).constrained(0.8));
    let [lower, upper] = bounds_of(&converged(&original, &stop));
    for exponent in [-12, -6, 6, 12] {
        let factor = 10_f64.powi(exponent);
        let mut scaled = original.clone();
        scaled.jacobian *= factor;
        let [other_lower, other_upper] = bounds_of(&converged(&scaled, &stop)).map(|b| b * factor);
        assert!(other_lower <= upper && lower <= other_upper, "1e{exponent}");
    }
}

#[test]
fn a_power_of_two_changes_no_bit() {
    let stop = gap(1e-3);
    let original = scene(3);
    let wanted = converged(&original, &stop);
    for factor in [2_f64.powi(-40), 2_f64.powi(40)] {
        let mut scaled = original.clone().with_weights(0.2 * factor, 0.1 * factor);
        scaled.jacobian *= factor;
        let found = converged(&scaled, &stop);
        assert_eq!(found.images * factor, wanted.images);
        assert_eq!(found.report.certificate, wanted.report.certificate);
    }
}

#[test]
fn duplicate_rows_are_a_weight_of_two_and_zero_rows_are_nothing() {
    let stop = gap(1e-6);
    let mut weighted = scene(3);
    let measurements = weighted.values.ncols();
    let mut doubled = weighted.clone();
    weighted.settings.noise_std = Some(vec![1.0 / SQRT_2; measurements]);
    doubled.jacobian =
        concatenate(Axis(0), &[doubled.jacobian.view(), doubled.jacobian.view()]).unwrap();
    doubled.values = concatenate(Axis(1), &[doubled.values.view(), doubled.values.view()]).unwrap();
    let wanted = converged(&weighted, &stop);
    let found = converged(&doubled, &stop);
    assert_eq!(doubled.solver().unwrap().rank(), weighted.solver().unwrap().rank());
    let [lower, upper] = bounds_of(&wanted);
    let [other_lower, other_upper] = bounds_of(&found);
    assert!(other_lower <= upper && lower <= other_upper);
    // the smallest singular value of the Jacobian is now the root of 2; assuming 1 is conservative
    assert!(distance(&found.images, &wanted.images) <= strong_convexity(upper, 1e-6));

    // rows of zeros with non-zero data add half the square of the data
    let mut silent = weighted.clone();
    let zero = Array2::zeros((2, silent.jacobian.ncols()));
    silent.jacobian = concatenate(Axis(0), &[silent.jacobian.view(), zero.view()]).unwrap();
    let noise = Array2::from_elem((3, 2), 0.25);
    silent.values = concatenate(Axis(1), &[silent.values.view(), noise.view()]).unwrap();
    silent.settings.noise_std = Some([vec![1.0 / SQRT_2; measurements], vec![0.5; 2]].concat());
    let added = 3.0 * 2.0 * 0.5 * (0.25_f64 / 0.5).powi(2);
    let found = converged(&silent, &stop);
    let [other_lower, other_upper] = bounds_of(&found);
    assert!(other_lower - added <= upper && lower <= other_upper - added);
    let reach = strong_convexity(other_upper, 1e-6);
    assert!(distance(&found.images, &wanted.images) <= reach);
}

#[test]
fn a_jacobian_of_rank_one() {
    let mut random = Random::new(3);
    let (left, right) = (random.normals(7, 1), random.normals(1, 12));
    let mut problem = Problem::new(left.dot(&right), square(3, 4), random.normals(4, 7));
    for (space, time) in [(0.05, 0.02), (1.0, 0.0), (0.3, 3.0)] {
        problem = problem.with_weights(space, time);
        assert_eq!(problem.solver().unwrap().rank(), 1);
        converged(&problem, &gap(1e-3));
    }
}

#[test]
fn one_pixel_is_a_line_in_time() {
    let one = || Problem::new(array![[2.0]], square(1, 1), array![[6.0], [6.2], [-4.0]]);
    // without links each frame fits its data exactly: an optimum of zero
    let sequence = one().with_weights(1.0, 0.0).solve(&gap(1e-6));
    for (found, wanted) in sequence.images.iter().zip([3.0, 3.1, -2.0]) {
        assert!((found - wanted).abs() < 1e-5, "{}", sequence.images);
    }
    // with links the last frame is raised by lambda / J^2, and the first two are merged and lowered by
    // half of it: mean 3.05 - 0.5 lambda / 4
    let sequence = converged(&one().with_weights(1.0, 1.0), &gap(1e-8));
    for (found, wanted) in sequence.images.iter().zip([2.925, 2.925, -1.75]) {
        // 2 sqrt(2 g) / J for an objective of order 10
        assert!((found - wanted).abs() < 5e-4, "{}", sequence.images);
    }
    // a single frame of one pixel
    let mut single = one();
    single.values = array![[6.0]];
    let sequence = single.solve(&gap(1e-6));
    assert!((sequence.images[(0, 0)] - 3.0).abs() < 1e-5);
}

#[test]
fn bounds_that_leave_zero_out_have_their_optimum() {
    // one pixel, dv = 1, J = 1: half the squared distance to the bound
    for (lower_s, upper_s, nearest) in
        [(2.0, f64::INFINITY, 2.0), (f64::NEG_INFINITY, -1.0, -1.0), (2.0, 3.0, 2.0)]
    {
        for frames in [1, 3] {
            let values = Array2::ones((frames, 1));
            let mut problem = Problem::new(array![[1.0]], square(1, 1), values);
            (problem.settings.lower_s, problem.settings.upper_s) = (lower_s, upper_s);
            let stop = gap(1e-3);
            let sequence = problem.solve(&stop);
            problem.check(&sequence, &stop).unwrap();
            assert_eq!(sequence.report.status, SequenceStatus::Converged);
            let wanted = 0.5 * (nearest - 1.0_f64).powi(2) * frames as f64;
            let [lower, upper] = bounds_of(&sequence);
            // tolerance for rounding
            assert!(lower <= wanted * (1.0 + 1e-9), "{lower:e} above {wanted}");
            assert!(upper >= wanted * (1.0 - 1e-9), "{upper:e} below {wanted}");
        }
    }
}

#[test]
fn bounds_far_away_are_none() {
    let stop = gap(1e-4);
    let free = scene(3);
    let [lower, upper] = bounds_of(&converged(&free, &stop));
    for limit in [1e6, 1e30, f64::MAX] {
        let mut far = free.clone();
        (far.settings.lower_s, far.settings.upper_s) = (-limit, limit);
        let [other_lower, other_upper] = bounds_of(&converged(&far, &stop));
        assert!(other_lower <= upper && lower <= other_upper, "{limit:e}");
    }
}

#[test]
fn parts_of_a_skin_that_share_their_data_are_certified() {
    // two pixels that touch at a corner only: least squares within bounds, for any lambda_space
    let apart = Array2::from_shape_vec((2, 2), vec![true, false, false, true]).unwrap();
    let gradient = Gradient::pixels(&apart, 1.0).unwrap();
    let jacobian = array![[1.0, 0.9], [0.9, 1.0], [0.5, -0.5]];
    // J' r = 0 for r = (1, -1, -0.2) of squared norm 2.04: the data is J (1, 3) + r
    let residual = array![1.0, -1.0, -0.2];
    let values = (jacobian.dot(&array![1.0, 3.0]) + &residual).insert_axis(Axis(0));
    let optimum = 0.5 * 2.04;
    assert!(jacobian.t().dot(&residual).iter().all(|v: &f64| v.abs() < 1e-15));
    for lambda_space in [1e-3, 1.0, 1e3, 1e9, 1e30] {
        for bounds in [[f64::NEG_INFINITY, f64::INFINITY], [0.0, f64::INFINITY], [-5.0, 5.0]] {
            let mut problem = Problem::new(jacobian.clone(), gradient.clone(), values.clone())
                .with_weights(lambda_space, 0.0);
            [problem.settings.lower_s, problem.settings.upper_s] = bounds;
            for stop in [gap(1e-3), Stop { max_iterations: 0, ..gap(1e-3) }] {
                let sequence = problem.solve(&stop);
                let [lower, upper] = bounds_of(&sequence);
                // a thousand times the documented rounding error of the bound, 1e-13
                assert!(
                    lower <= optimum * (1.0 + 1e-10) && optimum * (1.0 - 1e-10) <= upper,
                    "{lower:e} {upper:e}, lambda {lambda_space:e}, {bounds:?}"
                );
            }
            converged(&problem, &gap(1e-3));
        }
    }
}

#[test]
fn a_part_that_no_channel_sees_is_certified() {
    // two parts of two pixels, the second without sensitivity
    let mask = Array2::from_shape_fn((2, 3), |(_, j)| j != 1);
    let gradient = Gradient::pixels(&mask, 1.0).unwrap();
    let jacobian = array![[1.0, 0.0, 0.3, 0.0], [0.2, 0.0, 1.0, 0.0]];
    let values = array![[1.0, -1.0], [0.5, 2.0]];
    for bounds in [[f64::NEG_INFINITY, f64::INFINITY], [0.0, f64::INFINITY], [-1.0, 3.0]] {
        let mut problem = Problem::new(jacobian.clone(), gradient.clone(), values.clone())
            .with_weights(0.1, 0.05);
        [problem.settings.lower_s, problem.settings.upper_s] = bounds;
        converged(&problem, &gap(1e-3));
    }
}

#[test]
fn a_thousand_frames() {
    let problem = scene(1000);
    for (stop, constrained) in [(gap(1e-2), false), (gap(1e-3), false), (gap(1e-2), true)] {
        let problem = if constrained { problem.clone().constrained(0.8) } else { problem.clone() };
        let sequence = converged(&problem, &stop);
        assert_eq!(sequence.images.dim(), (1000, 20));
    }
}

#[test]
fn delta_zero_is_solved_where_the_data_is_consistent() {
    // 20 unknowns, 26 rows, no noise: only one image fits
    let mut problem = scene(2);
    let truth = Array2::from_shape_fn((2, 20), |(t, p)| if p % 7 < 3 + t { 1.0 } else { -0.5 });
    problem.values = truth.dot(&problem.jacobian.t());
    let problem = problem.constrained(0.0);
    let sequence = problem.solve(&gap(1e-3));
    // delta is satisfied to the rounding of the data
    let root = (2.0 * problem.size()).sqrt();
    assert!(
        problem.residuals(&sequence.images).iter().all(|r| *r <= 1e-6 * root),
        "{:?}",
        sequence.report
    );
    assert!(distance(&sequence.images, &truth) <= 1e-5 * root);
    assert_eq!(sequence.report.status, SequenceStatus::Converged, "{:?}", sequence.report);
    let wanted = problem.objective(&truth).variation;
    let [lower, upper] = bounds_of(&sequence);
    // as above
    assert!(lower <= wanted * (1.0 + 1e-5) && upper >= wanted * (1.0 - 1e-5), "{lower} {upper}");
}

#[test]
fn a_delta_below_what_duplicates_disagree_by_is_an_error() {
    let constrained = |delta: f64| {
        // frame 1: the duplicates are 3 apart, so every image is 3 / sqrt(2) away from them
        let values = array![[1.0, 1.0, 2.0], [0.0, 3.0, 2.0]];
        let jacobian = array![[1.0, 0.0], [1.0, 0.0], [0.5, 1.0]];
        Problem::new(jacobian, square(1, 2), values).constrained(delta)
    };
    for delta in [0.0, 1.0, 3.0 / SQRT_2 - 1e-6] {
        let error = constrained(delta).try_solve(&gap(1e-3)).unwrap_err();
        let InverseError::DeltaTooSmall { frame: 1, delta: named, least } = error else {
            panic!("{error}");
        };
        assert_eq!(named, delta);
        assert!((least - 3.0 / SQRT_2).abs() < 1e-9, "{least}");
        assert!(error.to_string().starts_with("frame 1: delta is"), "{error}");
    }
    converged(&constrained(3.0 / SQRT_2 + 0.1), &gap(1e-3));
}

#[test]
fn a_delta_that_no_image_within_bounds_meets_is_an_error() {
    let constrained = |delta: f64| {
        // frame 1: its first value is 3 below what a change of 0 gives
        let values = array![[1.0, 1.0], [-3.0, 1.0]];
        let jacobian = array![[1.0, 0.0], [0.0, 1.0]];
        let mut problem = Problem::new(jacobian, square(1, 2), values).constrained(delta);
        problem.settings.lower_s = 0.0;
        problem
    };
    for delta in [0.1, 2.0, 2.999] {
        let error = constrained(delta).try_solve(&gap(1e-3)).unwrap_err();
        let InverseError::DeltaTooSmallWithinBounds { frame: 1, delta: named, least, .. } = error
        else {
            panic!("{error}");
        };
        assert!((named - delta).abs() < 1e-12 && (least - 3.0).abs() < 1e-9, "{named} {least}");
        let said = error.to_string();
        assert!(
            said.starts_with("frame 1: delta is") && said.contains("between 0e0 and"),
            "{said}"
        );
    }
    converged(&constrained(3.1), &gap(1e-3));
}

#[test]
fn images_that_miss_their_constraints_are_returned_with_their_residuals() {
    let mut problem = scene(3).constrained(0.5);
    problem.settings.lower_s = 0.0;
    let stop = Stop { max_iterations: 2, ..gap(1e-3) };
    let sequence = problem.solve(&stop);
    assert_eq!(sequence.report.status, SequenceStatus::IterationCap);
    assert!(sequence.report.certificate.unwrap().primal.is_infinite());
    let wanted = problem.residuals(&sequence.images);
    for (found, wanted) in sequence.report.residual.iter().zip(&wanted) {
        // the same norm from raw data
        assert!((found / wanted - 1.0).abs() < 1e-9, "{found} {wanted}");
    }
}

#[test]
fn a_delta_above_the_data_needs_no_iteration() {
    let problem = scene(3);
    let norms = (0..3).map(|t| problem.whitened(t).mapv(|v| v * v).sum().sqrt());
    let largest = norms.fold(0.0, f64::max);
    let sequence = problem.clone().constrained(largest * 1.000_001).solve(&gap(1e-3));
    assert_eq!(sequence.images, Array2::<f64>::zeros((3, 20)));
    assert_eq!(
        (sequence.report.iterations, sequence.report.status),
        (0, SequenceStatus::Converged)
    );
    assert_eq!(bounds_of(&sequence), [0.0, 0.0]);
    // for a slightly smaller delta the zero sequence is infeasible
    let sequence = problem.constrained(largest * 0.5).solve(&gap(1e-3));
    assert!(sequence.images.iter().any(|x| *x != 0.0));
}

#[test]
fn without_links_every_frame_is_on_its_own() {
    let stop = gap(1e-6);
    let together = scene(4).with_weights(0.2, 0.0);
    let sequence = converged(&together, &stop);
    let [lower, upper] = bounds_of(&sequence);
    let mut sums = [0.0, 0.0];
    for t in 0..4 {
        let mut alone = together.clone();
        alone.values = together.values.select(Axis(0), &[t]);
        // a time term has no effect on a single frame
        let alone = alone.with_weights(0.2, if t % 2 == 0 { 0.0 } else { 7.0 });
        let one = converged(&alone, &stop);
        sums.iter_mut().zip(bounds_of(&one)).for_each(|(sum, b)| *sum += b);
        let error = distance(&one.images, &sequence.images.select(Axis(0), &[t]));
        assert!(error <= strong_convexity(upper, 1e-6), "frame {t}: {error:e}");
    }
    assert!(lower <= sums[1] && sums[0] <= upper, "[{lower}, {upper}] {sums:?}");
}

#[test]
fn huge_weights_leave_a_constant() {
    let problem = scene(3);
    let column = problem.jacobian.sum_axis(Axis(1));
    let power = column.dot(&column);
    // least-squares constants of all frames together and of each frame
    let constants: Vec<f64> =
        problem.values.rows().into_iter().map(|row| row.dot(&column) / power).collect();
    let mean = constants.iter().sum::<f64>() / 3.0;
    for lambda in [1e3, 1e8, 1e15, 1e30] {
        let sequence = converged(&problem.clone().with_weights(lambda, lambda), &gap(1e-6));
        // tolerance: a gap of 1e-6 for a constant with a power of about 1e2
        assert!(
            sequence.images.iter().all(|x| (x - mean).abs() < 2e-3),
            "{lambda:e}: {}",
            sequence.images
        );
        let sequence = converged(&problem.clone().with_weights(lambda, 0.0), &gap(1e-6));
        for (row, constant) in sequence.images.rows().into_iter().zip(&constants) {
            assert!(row.iter().all(|x| (x - constant).abs() < 2e-3), "{lambda:e}: {row}");
        }
    }
}

#[test]
fn tiny_weights_leave_least_squares() {
    let problem = scene(2);
    // x = (J'J)^-1 J' dv
    let normal = problem.jacobian.t().dot(&problem.jacobian);
    let wanted = common::solve(normal, problem.jacobian.t().dot(&problem.values.t()));
    for lambda in [1e-6, 1e-12, 1e-30, f64::MIN_POSITIVE] {
        let stop = gap(1e-6);
        let sequence = converged(&problem.clone().with_weights(lambda, lambda), &stop);
        let reach = strong_convexity(bounds_of(&sequence)[1], 1e-6) + 100.0 * lambda;
        let error = distance(&sequence.images.t().to_owned(), &wanted);
        assert!(error <= reach, "{lambda:e}: {error:e}");
    }
}

#[test]
fn a_masked_channel_equals_a_missing_row() {
    let stop = gap(1e-6);
    let mut masked = scene(3);
    let mut missing = masked.clone();
    // row 22 is one of the extra rows: the others still contain the identity
    let kept: Vec<usize> = (0..26).filter(|&i| i != 22).collect();
    missing.jacobian = missing.jacobian.select(Axis(0), &kept);
    missing.values = missing.values.select(Axis(1), &kept);
    masked.good = Some(Array2::from_shape_fn((3, 26), |(_, i)| i != 22));
    masked.values.column_mut(22).fill(f64::NAN);
    let mut unused = masked.clone();
    unused.good = None;
    unused.settings.used = Some((0..26).map(|i| i != 22).collect());
    unused.values.column_mut(22).fill(0.0);
    let wanted = converged(&missing, &stop);
    let [lower, upper] = bounds_of(&wanted);
    for problem in [masked, unused] {
        let found = converged(&problem, &stop);
        let [other_lower, other_upper] = bounds_of(&found);
        assert!(other_lower <= upper && lower <= other_upper);
        let error = distance(&found.images, &wanted.images);
        assert!(error <= strong_convexity(upper, 1e-6), "{error:e}");
    }
}

#[test]
fn a_frame_without_any_channel_follows_its_neighbours() {
    let mut problem = scene(3);
    problem.values.row_mut(1).fill(f64::NAN);
    problem.good = Some(Array2::from_shape_fn((3, 26), |(t, _)| t != 1));
    for problem in [problem.clone(), problem.clone().constrained(0.8)] {
        let sequence = converged(&problem, &gap(1e-3));
        assert_eq!(sequence.report.residual[1], 0.0);
    }
    // without links nothing determines the frame: any constant is optimal
    let sequence = converged(&problem.clone().with_weights(0.2, 0.0), &gap(1e-3));
    assert_eq!(sequence.report.residual[1], 0.0);
    // a sequence of such frames only
    problem.good = Some(Array2::from_elem((3, 26), false));
    let sequence = converged(&problem, &gap(1e-3));
    assert_eq!(bounds_of(&sequence), [0.0, 0.0]);
}

#[test]
fn no_change_is_the_zero_sequence() {
    let mut problem = scene(3);
    problem.values.fill(0.0);
    for problem in [problem.clone(), problem.clone().constrained(0.0), problem.constrained(1.0)] {
        let sequence = converged(&problem, &gap(1e-3));
        assert_eq!(sequence.images, Array2::<f64>::zeros((3, 20)));
        assert_eq!(sequence.report.iterations, 0);
        assert_eq!(bounds_of(&sequence), [0.0, 0.0]);
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let good = scene(1);
    let refused = |change: &dyn Fn(&mut StTvSettings)| {
        let mut problem = good.clone();
        change(&mut problem.settings);
        problem.solver().unwrap_err()
    };
    let bad = [0.0, -1.0, f64::NAN, f64::INFINITY];
    let out_of_range = |error: &InverseError, name: &str| matches!(error, InverseError::OutOfRange { quantity, .. } if *quantity == name);
    for value in bad {
        let error = refused(&|s| s.lambda_space = value);
        assert!(out_of_range(&error, "lambda_space"), "{error}");
    }
    for value in &bad[1..] {
        let error = refused(&|s| s.lambda_time = *value);
        assert!(out_of_range(&error, "lambda_time"), "{error}");
        let error = refused(&|s| s.fidelity = Fidelity::Constrained { delta: *value });
        assert!(out_of_range(&error, "delta"), "{error}");
    }
    for value in [f64::NAN, f64::INFINITY] {
        let error = refused(&|s| s.lower_s = value);
        assert!(out_of_range(&error, "lower_s"), "{error}");
    }
    for (lower, upper) in [(0.0, f64::NAN), (0.0, 0.0), (1.0, -1.0), (0.0, f64::NEG_INFINITY)] {
        let error = refused(&|s| (s.lower_s, s.upper_s) = (lower, upper));
        assert!(out_of_range(&error, "upper_s"), "{error}");
    }
    for value in bad {
        let error = refused(&|s| {
            s.noise_std = Some((0..26).map(|i| if i == 4 { value } else { 1.0 }).collect());
        });
        let named = matches!(error, InverseError::MeasurementOutOfRange { measurement: 4, .. });
        assert!(named, "{error}");
    }
    let error = refused(&|s| s.noise_std = Some(vec![1.0; 25]));
    assert!(matches!(error, InverseError::WrongLength { found: 25, wanted: 26, .. }), "{error}");
    let error = refused(&|s| s.used = Some(vec![true; 27]));
    assert!(matches!(error, InverseError::WrongLength { found: 27, wanted: 26, .. }), "{error}");
    let error = refused(&|s| s.used = Some(vec![false; 26]));
    assert!(matches!(error, InverseError::NothingUsed { measurements: 26 }), "{error}");
    // the same with set_weights, which changes nothing on an error
    let mut solver = good.solver().unwrap();
    for (space, time, delta) in [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, f64::NAN)] {
        let fidelity = Fidelity::Constrained { delta };
        assert!(solver.set_weights(space, time, fidelity).is_err());
        assert_eq!(solver.settings(), &good.settings);
    }
    for target_gap in bad {
        let error = good.try_solve(&gap(target_gap)).unwrap_err();
        assert!(out_of_range(&error, "target_gap"), "{error}");
    }
}

#[test]
fn jacobians_and_frames_that_do_not_fit_are_refused() {
    let good = scene(2);
    let settings = StTvSettings::default;
    let error = StTv::new(&good.jacobian, &square(3, 3), settings()).unwrap_err();
    assert!(matches!(error, InverseError::WrongLength { found: 20, wanted: 9, .. }), "{error}");
    for rows in [0, 3] {
        let error = StTv::new(&Array2::zeros((rows, 20)), &good.gradient, settings()).unwrap_err();
        let empty = InverseError::EmptyJacobian { measurements: 0, elements: 20 };
        match rows {
            0 => assert!(
                error == empty || matches!(error, InverseError::NothingUsed { measurements: 0 }),
                "{error}"
            ),
            _ => assert!(matches!(error, InverseError::NoSensitivity { .. }), "{error}"),
        }
    }
    let mut problem = good.clone();
    problem.jacobian[(7, 3)] = f64::NAN;
    let error = problem.solver().unwrap_err();
    let named = matches!(error, InverseError::NonFiniteJacobian { measurement: 7, element: 3, .. });
    assert!(named, "{error}");
    // an unused row is never read
    problem.settings.used = Some((0..26).map(|i| i != 7).collect());
    assert!(problem.solver().is_ok());

    for poison in [f64::NAN, f64::INFINITY] {
        let mut problem = good.clone();
        problem.values[(1, 17)] = poison;
        let error = problem.try_solve(&gap(1e-3)).unwrap_err();
        let named = matches!(error, InverseError::NonFiniteData { frame: 1, measurement: 17, .. });
        assert!(named, "{error}");
    }
    let solver = good.solver().unwrap();
    let refused = |values: Array2<f64>, flags: Option<Array2<bool>>| {
        let frames =
            DifferenceFrames { values: values.view(), good: flags.as_ref().map(|f| f.view()) };
        solver.solve(&frames, &gap(1e-3)).unwrap_err()
    };
    let wrong = |error: &InverseError, what: &str| matches!(error, InverseError::WrongLength { what: named, .. } if *named == what);
    let error = refused(Array2::zeros((0, 26)), None);
    assert!(wrong(&error, "frames"), "{error}");
    let error = refused(Array2::zeros((2, 25)), None);
    assert!(wrong(&error, "columns of differences"), "{error}");
    let error = refused(Array2::zeros((2, 26)), Some(Array2::from_elem((1, 26), true)));
    assert!(wrong(&error, "rows of good"), "{error}");
    let error = refused(Array2::zeros((2, 26)), Some(Array2::from_elem((2, 27), true)));
    assert!(wrong(&error, "columns of good"), "{error}");
}
