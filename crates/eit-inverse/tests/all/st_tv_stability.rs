//! Spatio-temporal total variation in extreme cases: the right answer or a clear error.

use crate::common;
use crate::problem::{Problem, gap, square};
use eit_inverse::{
    DifferenceFrames, Fidelity, Gradient, ImageSequence, InverseError, SequenceStatus, StTv,
    StTvSettings, Stop,
};
use fixtures::Random;
use ndarray::{Array2, Axis, array, concatenate};
use std::f64::consts::SQRT_2;

fn bounds_of(sequence: &ImageSequence) -> [f64; 2] {
    let certificate = sequence.report.certificate.unwrap();
    [certificate.lower_bound, certificate.primal]
}

/// A touch that grows and moves over 4 x 5 pixels, with a Jacobian that contains the identity. Then
/// `|J x|^2 >= |x|^2`, and two sequences whose objectives are within `g` of the optimum differ by at most
/// `2 sqrt(2 g)` (strong convexity).
fn scene(frames: usize) -> Problem {
    let mut random = Random::new(11);
    let jacobian = concatenate![Axis(0), Array2::eye(20), random.normals(6, 20)];
    let truth = Array2::from_shape_fn((frames, 20), |(t, p)| {
        let (i, j) = (p / 5, p % 5);
        if i < 2 && j >= t % 3 && j < t % 3 + 2 { 1.0 } else { 0.0 }
    });
    let values = truth.dot(&jacobian.t()) + 0.1 * random.normals(frames, 26);
    Problem::new(jacobian, square(4, 5), values).with_weights(0.2, 0.1)
}

const UNBOUNDED: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Upper bound on the distance of two sequences of [`scene`] within a relative gap of their optimum.
fn strong_convexity(primal: f64, relative_gap: f64) -> f64 {
    2.0 * (2.0 * relative_gap * primal).sqrt()
}

fn distance(a: &Array2<f64>, b: &Array2<f64>) -> f64 {
    (a - b).pow2().sum().sqrt()
}

/// Checks that two results of gaps of 1e-6 are one. The second's objective has this unit and added constant.
fn are_the_same(case: &str, wanted: &ImageSequence, found: &ImageSequence, unit: f64, added: f64) {
    let [lower, upper] = bounds_of(wanted);
    let [other_lower, other_upper] = bounds_of(found).map(|bound| bound / unit - added);
    // both intervals contain the optimum
    assert!(other_lower <= upper && lower <= other_upper, "{case}");
    let error = distance(&found.images, &wanted.images);
    assert!(error <= strong_convexity(upper + added, 1e-6), "{case}: {error:e}");
}

#[test]
fn the_jacobians_unit_does_not_matter() {
    let stop = gap(1e-6);
    let original = scene(3);
    let wanted = original.converged(&stop);
    for exponent in [-12, -9, -6, -3, 3, 6, 9, 12] {
        let factor = 10_f64.powi(exponent);
        // J -> c J, lambda -> c lambda: x -> x / c with the same objective; volts times c as well: x -> x,
        // objective times c^2
        for volts in [1.0, factor] {
            let unit = factor * volts;
            let mut scaled = original.clone().with_weights(0.2 * unit, 0.1 * unit);
            scaled.jacobian *= factor;
            scaled.values *= volts;
            let mut found = scaled.converged(&stop);
            found.images *= factor / volts;
            are_the_same(&format!("1e{exponent}, {volts:e}"), &wanted, &found, volts * volts, 0.0);
        }
    }
    // with constraints x -> x / c, and the objective with it
    let (stop, original) = (gap(1e-4), scene(3).constrained(0.8));
    let [lower, upper] = bounds_of(&original.converged(&stop));
    for exponent in [-12, -6, 6, 12] {
        let factor = 10_f64.powi(exponent);
        let mut scaled = original.clone();
        scaled.jacobian *= factor;
        let [other_lower, other_upper] = bounds_of(&scaled.converged(&stop)).map(|b| b * factor);
        assert!(other_lower <= upper && lower <= other_upper, "1e{exponent}");
    }
}

#[test]
fn a_power_of_two_changes_no_bit() {
    let wanted = scene(3).converged(&gap(1e-3));
    for factor in [2_f64.powi(-40), 2_f64.powi(40)] {
        let mut scaled = scene(3).with_weights(0.2 * factor, 0.1 * factor);
        scaled.jacobian *= factor;
        let found = scaled.converged(&gap(1e-3));
        assert_eq!(found.images * factor, wanted.images);
        assert_eq!(found.report.certificate, wanted.report.certificate);
    }
}

/// Duplicate rows weigh two; rows of zeros add half their squared data; masked and unused channels are missing.
#[test]
fn problems_that_say_the_same_have_the_same_optimum() {
    let plain = scene(3);
    let (measurements, unknowns) = plain.jacobian.dim();
    let mut weighted = plain.clone();
    weighted.settings.noise_std = Some(vec![1.0 / SQRT_2; measurements]);
    let mut doubled = plain.clone();
    doubled.jacobian = concatenate![Axis(0), plain.jacobian, plain.jacobian];
    doubled.values = concatenate![Axis(1), plain.values, plain.values];
    assert_eq!(doubled.solver().unwrap().rank(), weighted.solver().unwrap().rank());
    let mut silent = weighted.clone();
    silent.jacobian = concatenate![Axis(0), plain.jacobian, Array2::zeros((2, unknowns))];
    silent.values = concatenate![Axis(1), plain.values, Array2::from_elem((3, 2), 0.25)];
    silent.settings.noise_std = Some([vec![1.0 / SQRT_2; measurements], vec![0.5; 2]].concat());
    let added = 3.0 * 2.0 * 0.5 * (0.25_f64 / 0.5).powi(2);
    // row 22 is one of the extra rows: the others still contain the identity
    let kept: Vec<usize> = (0..26).filter(|&i| i != 22).collect();
    let mut missing = plain.clone();
    missing.jacobian = plain.jacobian.select(Axis(0), &kept);
    missing.values = plain.values.select(Axis(1), &kept);
    let [mut masked, mut unused] = [plain.clone(), plain.clone()];
    masked.good = Some(Array2::from_shape_fn((3, 26), |(_, i)| i != 22));
    masked.values.column_mut(22).fill(f64::NAN);
    unused.settings.used = Some((0..26).map(|i| i != 22).collect());
    unused.values.column_mut(22).fill(0.0);
    let mut cases = vec![
        // the smallest singular value of the Jacobian is now the root of 2; assuming 1 is conservative
        ("doubled".to_owned(), &weighted, doubled, 0.0),
        ("silent".to_owned(), &weighted, silent, added),
        ("masked".to_owned(), &missing, masked, 0.0),
        ("unused".to_owned(), &missing, unused, 0.0),
    ];
    for limit in [1e6, 1e30, f64::MAX] {
        let mut far = plain.clone();
        (far.settings.lower_s, far.settings.upper_s) = (-limit, limit);
        cases.push((format!("bounds {limit:e}"), &plain, far, 0.0));
    }
    for (case, wanted, found, added) in cases {
        let [wanted, found] = [wanted, &found].map(|problem| problem.converged(&gap(1e-6)));
        are_the_same(&case, &wanted, &found, 1.0, added);
    }
}

#[test]
fn a_jacobian_of_rank_one() {
    let mut random = Random::new(3);
    let (left, right) = (random.normals(7, 1), random.normals(1, 12));
    let problem = Problem::new(left.dot(&right), square(3, 4), random.normals(4, 7));
    assert_eq!(problem.solver().unwrap().rank(), 1);
    for (space, time) in [(0.05, 0.02), (1.0, 0.0), (0.3, 3.0)] {
        problem.clone().with_weights(space, time).converged(&gap(1e-3));
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
    // links raise the last frame by lambda / J^2, and merge and lower the first two: 3.05 - 0.5 lambda / 4
    let sequence = one().with_weights(1.0, 1.0).converged(&gap(1e-8));
    for (found, wanted) in sequence.images.iter().zip([2.925, 2.925, -1.75]) {
        // 2 sqrt(2 g) / J for an objective of order 10
        assert!((found - wanted).abs() < 5e-4, "{}", sequence.images);
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
    let problem = Problem::new(jacobian, gradient, values);
    for lambda_space in [1e-3, 1.0, 1e3, 1e9, 1e30] {
        for bounds in [UNBOUNDED, [0.0, f64::INFINITY], [-5.0, 5.0], [0.5, 5.0]] {
            let problem = problem.clone().with_weights(lambda_space, 0.0).within(bounds);
            let capped = problem.solve(&Stop { max_iterations: 0, ..gap(1e-3) });
            for sequence in [problem.converged(&gap(1e-3)), capped] {
                let [lower, upper] = bounds_of(&sequence);
                // a thousand times the documented rounding error of the bound, 1e-13
                let is_in = lower <= optimum * (1.0 + 1e-10) && optimum * (1.0 - 1e-10) <= upper;
                assert!(is_in, "{lower:e} {upper:e}, {lambda_space:e}, {bounds:?}");
            }
        }
    }
}

#[test]
fn a_part_that_no_channel_sees_is_certified() {
    // two parts of two pixels, the second without sensitivity
    let gradient = Gradient::pixels(&Array2::from_shape_fn((2, 3), |(_, j)| j != 1), 1.0).unwrap();
    let jacobian = array![[1.0, 0.0, 0.3, 0.0], [0.2, 0.0, 1.0, 0.0]];
    let problem = Problem::new(jacobian, gradient, array![[1.0, -1.0], [0.5, 2.0]]);
    for bounds in [UNBOUNDED, [0.0, f64::INFINITY], [-1.0, 3.0]] {
        problem.clone().with_weights(0.1, 0.05).within(bounds).converged(&gap(1e-3));
    }
}

#[test]
fn a_thousand_frames() {
    let problem = scene(1000);
    let constrained = problem.clone().constrained(0.8);
    for (problem, target_gap) in [(&problem, 1e-2), (&problem, 1e-3), (&constrained, 1e-2)] {
        assert_eq!(problem.converged(&gap(target_gap)).images.dim(), (1000, 20));
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
    let residuals = problem.residuals(&sequence.images);
    assert!(residuals.iter().all(|r| *r <= 1e-6 * root), "{:?}", sequence.report);
    assert!(distance(&sequence.images, &truth) <= 1e-5 * root);
    assert_eq!(sequence.report.status, SequenceStatus::Converged, "{:?}", sequence.report);
    let wanted = problem.objective(&truth);
    let [lower, upper] = bounds_of(&sequence);
    // as above
    assert!(lower <= wanted * (1.0 + 1e-5) && upper >= wanted * (1.0 - 1e-5), "{lower} {upper}");
}

#[test]
fn a_delta_that_no_image_within_bounds_meets_is_an_error() {
    // frame 1: the duplicates are 3 apart, so every image is 3 / sqrt(2) away from them
    let jacobian = array![[1.0, 0.0], [1.0, 0.0], [0.5, 1.0]];
    let free = Problem::new(jacobian, square(1, 2), array![[1.0, 1.0, 2.0], [0.0, 3.0, 2.0]]);
    let deltas = [0.0, 1.0, 3.0 / SQRT_2 - 1e-6];
    // frame 1: its first value is 3 below what a change of 0 gives
    let bounded = Problem::new(Array2::eye(2), square(1, 2), array![[1.0, 1.0], [-3.0, 1.0]]);
    let bounded = bounded.within([0.0, f64::INFINITY]);
    for (problem, smallest, deltas) in
        [(free, 3.0 / SQRT_2, deltas), (bounded, 3.0, [0.1, 2.0, 2.999])]
    {
        let constrained = |delta: f64| problem.clone().constrained(delta);
        for delta in deltas {
            let error = constrained(delta).try_solve(&gap(1e-3)).unwrap_err();
            let is_bounded = problem.settings.lower_s == 0.0;
            let (InverseError::DeltaTooSmall { frame: 1, delta: named, least }
            | InverseError::DeltaTooSmallWithinBounds { frame: 1, delta: named, least, .. }) =
                error
            else {
                panic!("{error}")
            };
            assert!((named - delta).abs().max((least - smallest).abs()) < 1e-9, "{named} {least}");
            let said = error.to_string();
            let names_bounds = said.contains("between 0e0 and") == is_bounded;
            assert!(said.starts_with("frame 1: delta is") && names_bounds, "{said}");
        }
        constrained(smallest + 0.1).converged(&gap(1e-3));
    }
}

#[test]
fn images_that_miss_their_constraints_are_returned_with_their_residuals() {
    let problem = scene(3).constrained(0.5).within([0.0, f64::INFINITY]);
    let sequence = problem.solve(&Stop { max_iterations: 2, ..gap(1e-3) });
    assert_eq!(sequence.report.status, SequenceStatus::IterationCap);
    assert!(sequence.report.certificate.unwrap().primal.is_infinite());
    let wanted = problem.residuals(&sequence.images);
    for (found, wanted) in sequence.report.residual.iter().zip(&wanted) {
        // the same norm from raw data
        assert!((found / wanted - 1.0).abs() < 1e-9, "{found} {wanted}");
    }
}

#[test]
fn the_zero_sequence_needs_no_iteration() {
    let problem = scene(3);
    let mut still = problem.clone();
    still.values.fill(0.0);
    let largest = (0..3).map(|t| problem.whitened(t).pow2().sum().sqrt()).fold(0.0, f64::max);
    for problem in [
        still.clone(),
        still.clone().constrained(0.0),
        still.constrained(1.0),
        problem.clone().constrained(largest * 1.000_001),
    ] {
        let sequence = problem.converged(&gap(1e-3));
        assert_eq!(sequence.images, Array2::<f64>::zeros((3, 20)));
        assert_eq!(sequence.report.iterations, 0);
        assert_eq!(bounds_of(&sequence), [0.0, 0.0]);
    }
    // for a smaller delta it is infeasible
    let sequence = problem.constrained(largest * 0.5).solve(&gap(1e-3));
    assert!(sequence.images.iter().any(|x| *x != 0.0));
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
        let sequence = problem.clone().with_weights(lambda, lambda).converged(&gap(1e-6));
        // tolerance: a gap of 1e-6 for a constant with a power of about 1e2
        let images = sequence.images;
        assert!(images.iter().all(|x| (x - mean).abs() < 2e-3), "{lambda:e}: {images}");
        let sequence = problem.clone().with_weights(lambda, 0.0).converged(&gap(1e-6));
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
        let sequence = problem.clone().with_weights(lambda, lambda).converged(&gap(1e-6));
        let reach = strong_convexity(bounds_of(&sequence)[1], 1e-6) + 100.0 * lambda;
        let error = distance(&sequence.images.t().to_owned(), &wanted);
        assert!(error <= reach, "{lambda:e}: {error:e}");
    }
}

#[test]
fn a_frame_without_any_channel_follows_its_neighbours() {
    let mut problem = scene(3);
    problem.values.row_mut(1).fill(f64::NAN);
    problem.good = Some(Array2::from_shape_fn((3, 26), |(t, _)| t != 1));
    // without links nothing determines the frame: any constant is optimal
    let unlinked = problem.clone().with_weights(0.2, 0.0);
    for problem in [problem.clone(), problem.clone().constrained(0.8), unlinked] {
        assert_eq!(problem.converged(&gap(1e-3)).report.residual[1], 0.0);
    }

    // a sequence of such frames only
    problem.good = Some(Array2::from_elem((3, 26), false));
    assert_eq!(bounds_of(&problem.converged(&gap(1e-3))), [0.0, 0.0]);
}

#[test]
fn settings_out_of_range_are_refused() {
    let good = scene(1);
    let with = |change: &dyn Fn(&mut StTvSettings)| {
        let mut problem = good.clone();
        change(&mut problem.settings);
        problem.solver()
    };
    for value in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused!(with(&|s| s.lambda_space = value), OutOfRange { quantity: "lambda_space", .. });
        refused!(good.try_solve(&gap(value)), OutOfRange { quantity: "target_gap", .. });
        let of = |i| if i == 4 { value } else { 1.0 };
        let noise = with(&|s| s.noise_std = Some((0..26).map(of).collect()));
        refused!(noise, MeasurementOutOfRange { measurement: 4, .. });
        if value != 0.0 {
            let time = with(&|s| s.lambda_time = value);
            refused!(time, OutOfRange { quantity: "lambda_time", .. });
            let delta = with(&|s| s.fidelity = Fidelity::Constrained { delta: value });
            refused!(delta, OutOfRange { quantity: "delta", .. });
        }
    }
    for value in [f64::NAN, f64::INFINITY] {
        refused!(with(&|s| s.lower_s = value), OutOfRange { quantity: "lower_s", .. });
    }
    for bounds in [(0.0, f64::NAN), (0.0, 0.0), (1.0, -1.0), (0.0, f64::NEG_INFINITY)] {
        let bounded = with(&|s| (s.lower_s, s.upper_s) = bounds);
        refused!(bounded, OutOfRange { quantity: "upper_s", .. });
    }
    let noise = with(&|s| s.noise_std = Some(vec![1.0; 25]));
    refused!(noise, WrongLength { found: 25, wanted: 26, .. });
    let used = with(&|s| s.used = Some(vec![true; 27]));
    refused!(used, WrongLength { found: 27, wanted: 26, .. });
    refused!(with(&|s| s.used = Some(vec![false; 26])), NothingUsed { measurements: 26 });
    // the same with set_weights, which changes nothing on an error
    let mut solver = good.solver().unwrap();
    for (space, time, delta) in [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, f64::NAN)] {
        assert!(solver.set_weights(space, time, Fidelity::Constrained { delta }).is_err());
        assert_eq!(solver.settings(), &good.settings);
    }
}

#[test]
fn jacobians_and_frames_that_do_not_fit_are_refused() {
    let good = scene(2);
    let new = |jacobian: &Array2<f64>, gradient: &Gradient| {
        StTv::new(jacobian, gradient, StTvSettings::default())
    };
    refused!(new(&good.jacobian, &square(3, 3)), WrongLength { found: 20, wanted: 9, .. });
    refused!(new(&Array2::zeros((0, 20)), &good.gradient), NothingUsed { measurements: 0 });
    refused!(new(&Array2::zeros((3, 20)), &good.gradient), NoSensitivity { .. });
    let mut problem = good.clone();
    problem.jacobian[(7, 3)] = f64::NAN;
    refused!(problem.solver(), NonFiniteJacobian { measurement: 7, element: 3, .. });
    // an unused row is never read
    problem.settings.used = Some((0..26).map(|i| i != 7).collect());
    assert!(problem.solver().is_ok());

    for poison in [f64::NAN, f64::INFINITY] {
        let mut problem = good.clone();
        problem.values[(1, 17)] = poison;
        refused!(problem.try_solve(&gap(1e-3)), NonFiniteData { frame: 1, measurement: 17, .. });
    }
    for (values, flags, wanted) in [
        ((0, 26), None, "frames"),
        ((2, 25), None, "columns of differences"),
        ((2, 26), Some((1, 26)), "rows of good"),
        ((2, 26), Some((2, 27)), "columns of good"),
    ] {
        let (values, flags) = (Array2::zeros(values), flags.map(|s| Array2::from_elem(s, true)));
        let good_frames = flags.as_ref().map(|flags| flags.view());
        let frames = DifferenceFrames { values: values.view(), good: good_frames };
        let result = good.solver().unwrap().solve(&frames, &gap(1e-3));
        refused!(result, WrongLength { what, .. } if what == wanted);
    }
}
