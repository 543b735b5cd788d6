//! One-step Gauss-Newton against hand solutions, the model-space form and its own symmetries.

use crate::common::*;
use eit_inverse::{
    DifferenceData, FrameStatus, Gaussian, GaussianSettings, InverseError, Noser,
    OneStepGaussNewton, OneStepSettings, Prior, Tikhonov, metrics,
};
use fixtures::Random;
use ndarray::{Array1, Array2, ArrayView2, Axis, array};
use proptest::prelude::*;

/// `(J' W J + lambda^2 s R)^-1 J' W` with `s = trace(W^1/2 J R^-1 J' W^1/2) / m`, densely.
fn model_space(
    jacobian: &Array2<f64>,
    precision: &Array2<f64>,
    noise_std: &[f64],
    hyperparameter: f64,
) -> Array2<f64> {
    let weights: Array1<f64> = noise_std.iter().map(|e| 1.0 / (e * e)).collect();
    let transposed = jacobian.t().to_owned();
    let weighted = &transposed * &weights;
    let gram = jacobian.dot(&solve(precision.clone(), transposed));
    let scale = gram.diag().dot(&weights) / noise_std.len() as f64;
    solve(weighted.dot(jacobian) + hyperparameter.powi(2) * scale * precision, weighted)
}

#[test]
fn measurement_space_and_model_space_forms_are_equal() {
    let surface = disc(0.1, 2);
    let (areas, n) = (surface.areas_m2(), surface.areas_m2().len());
    let mut random = Random::new(1);
    let jacobian = random.normals(10, n);
    let noise_std: Vec<f64> = uniforms(&mut random, 10, 0.5).iter().map(|e| 1e-6 * e).collect();
    let mean = areas.iter().sum::<f64>() / n as f64;
    let white = Array2::from_diag(&areas.iter().map(|a| a / mean).collect::<Array1<f64>>());
    let laplace = laplace(&surface);
    let weighted = (&jacobian.t() / &Array1::from(noise_std.clone())).mapv(|w| w * w);
    let noser = Array2::from_diag(&weighted.sum_axis(Axis(1)).mapv(f64::sqrt));
    let cases: [(&dyn Prior, Array2<f64>); 3] = [
        (&Tikhonov::new(&surface), white),
        (&laplace, precision(&laplace, n)),
        (&Noser::default(), noser),
    ];
    for (prior, precision) in cases {
        for lambda in [0.01, 0.3, 10.0] {
            let inverse = one_step(&jacobian, prior, with_noise(lambda, &noise_std));
            let found = inverse.reconstruction_matrix();
            let expected = model_space(&jacobian, &precision, &noise_std, lambda);
            let error = relative_difference(&found, &expected);
            // the n x n normal matrix has rank 10 plus lambda^2 R: condition about 1e5 at 0.01
            assert!(error < 1e-9, "{} at {lambda}: {error:e}", prior.name());
        }
    }
}

#[test]
fn a_hand_solved_problem() {
    let inverse = one_step(&array![[1.0, 0.0], [0.0, 3.0]], &IDENTITY, with_lambda(0.2));
    // s = (1 + 9) / 2 = 5, lambda^2 s = 0.2
    let expected = array![[1.0 / 1.2, 0.0], [0.0, 3.0 / 9.2]];
    assert!(relative_difference(&inverse.reconstruction_matrix(), &expected) < 1e-15);
    assert!((inverse.report().scale - 5.0).abs() < 1e-14);
    assert!((inverse.report().condition - 9.0).abs() < 1e-13);
    assert!((inverse.report().degrees_of_freedom - (1.0 / 1.2 + 9.0 / 9.2)).abs() < 1e-14);
    let image = inverse.reconstruct(&[4.0, 5.0], &[3.0, 3.0]).unwrap();
    assert!(relative_difference(&image, &array![1.0 / 1.2, 6.0 / 9.2]) < 1e-15);
}

#[test]
fn small_lambda_fits_the_data_and_large_lambda_gives_no_image() {
    let mut random = Random::new(2);
    let jacobian = random.normals(20, 60);
    let frame = random.noisy(&[0.0; 20], 1.0);
    let mut inverse = one_step(&jacobian, &IDENTITY, with_lambda(1.0));
    assert_eq!(inverse.report().rank, 20);
    let residuals = [1e-6, 1e-3, 0.1, 1.0, 1e3].map(|lambda| {
        inverse.set_hyperparameter(lambda).unwrap();
        inverse.relative_residual(&frame, &[0.0; 20]).unwrap().unwrap()
    });
    assert!(residuals[0] > 0.0 && residuals.is_sorted_by(|a, b| a < b), "{residuals:?}");
    // residual / data <= lambda^2 s / d_min; s / d_min is about 5 for a 20 x 60 random matrix
    assert!(residuals[0] < 1e-10);
    inverse.set_hyperparameter(1e6).unwrap();
    let image = inverse.reconstruct(&frame, &[0.0; 20]).unwrap();
    // |RM| <= |J| / (lambda^2 s) = about 14 / 6e13
    assert!(image.iter().all(|x| x.abs() < 1e-11));
}

#[test]
fn relative_residual_is_that_of_the_image() {
    let mut random = Random::new(3);
    let jacobian = random.normals(12, 7);
    let noise_std = uniforms(&mut random, 12, 0.5);
    let [frame, reference] = [0; 2].map(|_| random.noisy(&[0.0; 12], 1.0));
    let inverse = one_step(&jacobian, &IDENTITY, with_noise(0.4, &noise_std));
    assert_eq!(inverse.report().rank, 7, "twelve measurements of seven elements");
    let image = inverse.reconstruct(&frame, &reference).unwrap();
    let dv = Array1::from(frame.clone()) - &Array1::from(reference.clone());
    let weighted = |v: &Array1<f64>| (v / &Array1::from(noise_std.clone())).mapv(|x| x * x).sum();
    let wanted = (weighted(&(&dv - &jacobian.dot(&image))) / weighted(&dv)).sqrt();
    let found = inverse.relative_residual(&frame, &reference).unwrap().unwrap();
    assert!((found - wanted).abs() < 1e-12);
    assert_eq!(inverse.relative_residual(&reference, &reference).unwrap(), None);
    // data whose squares underflow or overflow
    for unit in [1e-300, 1e290] {
        let frame = (unit * &dv).to_vec();
        let scaled = inverse.relative_residual(&frame, &[0.0; 12]).unwrap().unwrap();
        assert!((scaled - found).abs() < 1e-12, "{unit:e}: {scaled} for {found}");
    }
    let mut far = [reference.clone(), reference.clone()];
    (far[0][5], far[1][5]) = (1e308, -1e308);
    refused!(inverse.relative_residual(&far[0], &far[1]), NonFiniteData { measurement: 5, .. });
}

#[test]
fn every_prior_finds_a_target_and_rank_is_that_of_reciprocity() {
    let (fine, coarse) = (disc(0.1, 17), disc(0.1, 12));
    let truth = target(&coarse, [0.04, 0.02], 0.012, 1.0);
    let touch = target(&fine, [0.04, 0.02], 0.012, 1.0);
    let frame = jacobian(&fine, 16).dot(&Array1::from(touch)).to_vec();
    let jacobian = jacobian(&coarse, 16);
    let gaussian = Gaussian::new(&coarse, &GaussianSettings::default()).unwrap();
    let priors: [&dyn Prior; 4] =
        [&Tikhonov::new(&coarse), &Noser::default(), &laplace(&coarse), &gaussian];
    for prior in priors {
        // eigenvalues at the rounding floor are truncated: consistent data is explained
        let tiny = one_step(&jacobian, prior, with_lambda(1e-9));
        // 208 measurements, equal in pairs by reciprocity; a smooth prior has an even lower rank
        let (name, rank) = (prior.name(), tiny.report().rank);
        assert!(rank == 104 || name != "tikhonov" && rank < 104, "{name}: rank {rank}");
        let residual = tiny.relative_residual(&frame, &[0.0; 208]).unwrap().unwrap();
        // smooth priors truncate the spectrum at the rounding floor: measured 3e-6
        assert!(residual < 1e-5, "{name}: residual {residual:e}");
        let inverse = one_step(&jacobian, prior, with_lambda(0.01));
        let image = inverse.reconstruct(&frame, &[0.0; 208]).unwrap().to_vec();
        let error_m = metrics::position_error_m(&image, &coarse, [0.04, 0.02, 0.0]).unwrap();
        // a tenth of the radius: about the resolution of 16 electrodes at half the radius
        assert!(error_m < 0.01, "{name}: {error_m} m off");
        let alike = metrics::correlation_coefficient(&image, &truth, coarse.areas_m2()).unwrap();
        // measured 0.65 (Laplace) to 0.78 (NOSER): touches are blurred to the resolution of 16 electrodes
        assert!(alike > 0.6, "{name}: correlation {alike}");
    }
}

#[test]
fn reciprocal_rows_count_as_one_measurement_of_double_weight() {
    let surface = disc(0.1, 8);
    let full = jacobian(&surface, 8);
    let first: Vec<usize> = (0..40).filter(|&i| adjacent(8)[i][0] < adjacent(8)[i][2]).collect();
    let half = full.select(Axis(0), &first);
    let prior = laplace(&surface);
    let touch = Array1::from(target(&surface, [0.03, -0.02], 0.02, 1.0));
    // merged: half as many rows with the same total weight, so s doubles; lambda^2 s must stay the same
    let root = 0.5_f64.sqrt();
    let cases = [(&full, with_lambda(0.02)), (&half, with_noise(0.02 * root, &[root; 20]))];
    let [(twice, rank), (once, other)] = cases.map(|(j, settings)| {
        let inverse = one_step(j, &prior, settings);
        let frame = j.dot(&touch).to_vec();
        let image = inverse.reconstruct(&frame, &vec![0.0; frame.len()]).unwrap();
        (image, inverse.report().rank)
    });
    assert_eq!(rank, other);
    // the filter divides by lambda^2 s = 4e-4 of the mean eigenvalue: 1e-16 / 4e-4, with a margin
    assert!(relative_difference(&twice, &once) < 1e-10);
}

#[test]
fn one_frame_many_frames_raster_and_matrix_agree() {
    let surface = disc(0.1, 6);
    let jacobian = jacobian(&surface, 8);
    let [inverse, mut changed] = [0.03, 1.0]
        .map(|lambda| one_step(&jacobian, &Tikhonov::new(&surface), with_lambda(lambda)));
    let mut random = Random::new(6);
    let frames = random.normals(5, jacobian.nrows());
    let reference = random.noisy(&[0.0; 40], 1.0);
    let images = inverse.reconstruct_frames(frames.view(), &reference).unwrap();
    let raster = eit_mesh::Raster::new(&surface, 12).unwrap();
    let pixels = inverse.on_raster(raster.pixel_from_element()).unwrap();
    let matrix = inverse.reconstruction_matrix();
    changed.set_hyperparameter(0.03).unwrap();
    assert_eq!(changed.reconstruction_matrix(), matrix);
    assert_eq!(changed.report().degrees_of_freedom, inverse.report().degrees_of_freedom);
    let mut workspace = inverse.workspace();
    let mut image = vec![0.0; images.ncols()];
    for (frame, batch) in frames.rows().into_iter().zip(images.rows()) {
        let dv = &frame - &Array1::from(reference.clone());
        let frame = frame.to_vec();
        inverse.reconstruct_into(&frame, &reference, &mut workspace, &mut image).unwrap();
        let (map, mut linear) = (inverse.reconstructor(), vec![f64::NAN; image.len()]);
        map.reconstruct_difference_into(&dv.to_vec(), &mut workspace, &mut linear).unwrap();
        assert_eq!(linear, image, "the same products of the same numbers");
        let expected = matrix.dot(&dv);
        // products of the same factors in another order
        assert!(relative_difference(&image, &expected) < 1e-12);
        assert!(relative_difference(batch, &expected) < 1e-12);
        let mut shown = vec![0.0; raster.pixel_from_element().rows()];
        raster.pixel_from_element().apply(&image, &mut shown).unwrap();
        let pixels = pixels.reconstruct(&frame, &reference).unwrap();
        assert!(relative_difference(&pixels, &shown) < 1e-12);
    }
    let map = inverse.reconstructor();
    let mut dv = map.difference(&frames.row(0).to_vec(), &reference).unwrap().to_vec();
    let mut apply = |dv: &[f64]| map.reconstruct_difference_into(dv, &mut workspace, &mut image);
    refused!(apply(&dv[1..]), WrongLength { what: "difference", .. });
    dv[7] = f64::NAN;
    refused!(apply(&dv), NonFiniteData { frame: 0, measurement: 7, .. });
    let empty = Array2::zeros((0, frames.ncols()));
    let none = inverse.reconstruct_frames(empty.view(), &reference).unwrap();
    assert_eq!(none.dim(), (0, images.ncols()));
}

#[test]
fn normalised_data_with_the_noise_of_its_model_voltages_is_plain_data() {
    let jacobian = jacobian(&disc(0.1, 6), 8);
    let mut random = Random::new(7);
    let [noise_std_v, mut model_voltages_v, dv] =
        [0.5, 0.2, -0.5].map(|low| uniforms(&mut random, 40, low));
    model_voltages_v[3] = -model_voltages_v[3];
    let frame: Vec<f64> = model_voltages_v.iter().zip(&dv).map(|(v, d)| v + d).collect();
    let reference = model_voltages_v.clone();
    let with = |noise_std, data| {
        let settings = OneStepSettings { noise_std, data, ..with_lambda(0.05) };
        one_step(&jacobian, &Noser::default(), settings)
    };
    let normalised = DifferenceData::Normalised { model_voltages_v };
    let [plain, normalised] = [DifferenceData::Plain, normalised]
        .map(|data| with(Some(data.noise_std(&noise_std_v).unwrap()), data));
    // dv / v0, J / v0 and e / |v0|: the v0 cancel, except in the unit given by the largest noise_std
    let [a, b] = [&plain, &normalised].map(|i| i.reconstruct(&frame, &reference).unwrap());
    // lambda^2 s is 2.5e-3 of the mean eigenvalue; 1e-16 over it, with a margin
    assert!(relative_difference(&a, &b) < 1e-12);
    let [a, b] =
        [&plain, &normalised].map(|i| i.report().scale / i.report().noise_scale.unwrap().powi(2));
    assert!((b / a - 1.0).abs() < 1e-13);
    let largest = noise_std_v.iter().copied().fold(0.0, f64::max);
    assert_eq!(plain.report().noise_scale, Some(largest));
    assert_eq!(with(None, DifferenceData::Plain).report().noise_scale, None);
    let short = DifferenceData::Normalised { model_voltages_v: vec![1.0; 3] }.noise_std(&[1.0; 2]);
    refused!(short, WrongLength { what: "noise_std_v", found: 2, wanted: 3 });
}

#[test]
fn wrong_input_is_named() {
    let jacobian = array![[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]];
    let with = |jacobian: &Array2<f64>, prior: &dyn Prior| {
        OneStepGaussNewton::new(jacobian, prior, OneStepSettings::default())
    };
    let new = |settings| OneStepGaussNewton::new(&jacobian, &IDENTITY, settings);
    let noise = |values: &[f64]| new(with_noise(0.03, values));
    refused!(noise(&[1.0]), WrongLength { what: "noise_std", found: 1, wanted: 3 });
    refused!(noise(&[1.0, -1.0, 1.0]), MeasurementOutOfRange { measurement: 1, value: -1.0, .. });
    let data = DifferenceData::Normalised { model_voltages_v: vec![1.0, 1.0, 0.0] };
    let zero = new(OneStepSettings { data, ..Default::default() });
    refused!(zero, ZeroReference { measurement: 2, .. });
    for lambda in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused!(new(with_lambda(lambda)), OutOfRange { .. });
    }
    refused!(with(&Array2::zeros((3, 2)), &IDENTITY), NoSensitivity { measurements: 3 });
    let none = with(&Array2::zeros((0, 2)), &IDENTITY);
    refused!(none, EmptyJacobian { measurements: 0, elements: 2 });
    let mut broken = jacobian.clone();
    broken[(1, 0)] = f64::INFINITY;
    refused!(with(&broken, &IDENTITY), NonFiniteJacobian { measurement: 1, element: 0, .. });
    let other = with(&jacobian, &Tikhonov::new(&disc(1.0, 1)));
    refused!(other, WrongLength { what: "Jacobian columns", found: 2, wanted: 6 });
    let steep = with(&jacobian, &Noser { exponent: 2.0 });
    refused!(steep, OutOfRange { quantity: "NOSER exponent", value: 2.0, .. });

    let inverse = with(&jacobian, &IDENTITY).unwrap();
    let short = inverse.reconstruct(&[0.0; 2], &[0.0; 3]);
    refused!(short, WrongLength { what: "frame", found: 2, wanted: 3 });
    let long = inverse.reconstruct(&[0.0; 3], &[0.0; 4]);
    refused!(long, WrongLength { what: "reference frame", found: 4, wanted: 3 });
    let mut frames = Array2::zeros((4, 3));
    frames[(2, 1)] = f64::INFINITY;
    let bad = inverse.reconstruct_frames(frames.view(), &[0.0; 3]);
    refused!(bad, NonFiniteData { frame: 2, measurement: 1, value: f64::INFINITY });
    let bad = inverse.reconstruct(&[0.0; 3], &[0.0, 0.0, f64::NEG_INFINITY]);
    refused!(bad, NonFiniteReference { measurement: 2, .. });
    let part = inverse.restricted_to(&[true, false, true]).unwrap();
    refused!(part.restricted_to(&[true; 3]), NotAvailable { measurement: 1 });
    refused!(inverse.restricted_to(&[false; 3]), NothingUsed { measurements: 3 });
}

#[test]
fn an_indefinite_prior_is_refused() {
    struct Negative;
    impl Prior for Negative {
        fn name(&self) -> &'static str {
            "negative"
        }
        fn covariance_times(&self, j: ArrayView2<'_, f64>) -> Result<Array2<f64>, InverseError> {
            Ok(&j * &array![2.0, -1.0])
        }
    }
    let negative = OneStepGaussNewton::new(&Array2::eye(2), &Negative, with_lambda(0.1));
    refused!(negative, BadCovariance { prior: "negative", .. });
}

proptest! {
    #![proptest_config(fixtures::cases(32))]

    #[test]
    fn normalised_data_is_free_of_gain(seed in any::<u64>()) {
        let mut random = Random::new(seed);
        let (m, n) = (8, 11);
        let jacobian = random.normals(m, n);
        let data = DifferenceData::Normalised { model_voltages_v: uniforms(&mut random, m, 0.2) };
        let inverse =
            one_step(&jacobian, &IDENTITY, OneStepSettings { data, ..with_lambda(0.1) });
        let [frame, reference] =
            [0; 2].map(|_| (0..m).map(|_| random.between(1.0, 1.3)).collect::<Vec<f64>>());
        let gains: Vec<f64> = (0..m).map(|_| {
            let sign = if random.uniform() < 0.5 { -1.0 } else { 1.0 };
            sign * 10_f64.powf(random.between(-3.0, 3.0))
        }).collect();
        let seen = |x: &[f64]| x.iter().zip(&gains).map(|(x, g)| x * g).collect::<Vec<f64>>();
        let plain = inverse.reconstruct(&frame, &reference).unwrap();
        let gained = inverse.reconstruct(&seen(&frame), &seen(&reference)).unwrap();
        // dv loses at most one digit in the difference of values of order one
        prop_assert!(relative_difference(&gained, &plain) < 1e-12);
        let mut zero = reference.clone();
        zero[3] = 0.0;
        refused!(inverse.reconstruct(&frame, &zero), ZeroReference { measurement: 3, .. });
    }

    #[test]
    fn lambda_is_free_of_units(seed in any::<u64>(), unit in -9.0..9.0_f64,
                               noise in -9.0..9.0_f64) {
        let mut random = Random::new(seed);
        let jacobian = random.normals(7, 12);
        let frame = random.noisy(&[0.0; 7], 1.0);
        let (unit, noise) = (10_f64.powf(unit), 10_f64.powf(noise));
        let base = one_step(&jacobian, &IDENTITY, with_lambda(0.1));
        let scaled = one_step(&(&jacobian * unit), &IDENTITY, with_noise(0.1, &[noise; 7]));
        let expected = base.reconstruct(&frame, &[0.0; 7]).unwrap() / unit;
        let image = scaled.reconstruct(&frame, &[0.0; 7]).unwrap();
        prop_assert!(relative_difference(&image, &expected) < 1e-11);
    }

    #[test]
    fn any_rank_gives_a_finite_image(seed in any::<u64>(), m in 1_usize..12, n in 1_usize..12,
                                     rank in 1_usize..5, power in -12.0..3.0_f64) {
        let mut random = Random::new(seed);
        let jacobian = random.normals(m, rank).dot(&random.normals(rank, n));
        let inverse = one_step(&jacobian, &Noser::default(), with_lambda(10_f64.powf(power)));
        prop_assert!(inverse.report().rank <= rank.min(m).min(n));
        let zero = vec![0.0; m];
        let frame = random.noisy(&zero, 1.0);
        let image = inverse.reconstruct(&frame, &zero).unwrap();
        prop_assert!(image.iter().all(|x| x.is_finite()));
        let residual = inverse.relative_residual(&frame, &zero).unwrap().unwrap();
        prop_assert!((0.0..=1.0 + 1e-12).contains(&residual));
    }
}

/// Compared with the batch, which always multiplies: exactly equal, except for the sign of a zero.
#[test]
fn a_frame_that_equals_its_reference_is_zero_without_a_product() {
    let surface = disc(0.1, 6);
    let jacobian = jacobian(&surface, 8);
    let reference = uniforms(&mut Random::new(16), 40, 1.0);
    let used: Vec<bool> = (0..40).map(|i| i != 3).collect();
    let normalised = DifferenceData::Normalised { model_voltages_v: reference.clone() };
    for data in [DifferenceData::Plain, normalised] {
        let settings = OneStepSettings { data, used: Some(used.clone()), ..with_lambda(0.03) };
        let inverse = one_step(&jacobian, &Tikhonov::new(&surface), settings);
        let map = inverse.reconstructor();
        let mut memory = map.workspace();
        let mut image = vec![f64::NAN; map.image_len()];
        let mut one = |frame: &[f64], bad: &[usize]| {
            let status = match bad {
                [] => map.reconstruct_into(frame, &reference, &mut memory, &mut image),
                _ => map.reconstruct_masked_into(frame, &reference, bad, &mut memory, &mut image),
            };
            status.map(|status| (status, image.clone()))
        };
        // an unused measurement may differ
        let mut frame = reference.clone();
        frame[3] = f64::NAN;
        let (status, image) = one(&frame, &[]).unwrap();
        assert_eq!(status, FrameStatus::Unchanged);
        let batch = ArrayView2::from_shape((1, 40), &reference).unwrap();
        assert_eq!(image, map.reconstruct_frames(batch, &reference).unwrap().row(0).to_vec());
        // one bit of one measurement is a change, unless it is masked in this frame
        frame[5] = f64::from_bits(frame[5].to_bits() + 1);
        let (status, image) = one(&frame, &[]).unwrap();
        assert_eq!(status, FrameStatus::Computed);
        assert!(image.iter().any(|x| *x != 0.0));
        let (status, image) = one(&frame, &[5]).unwrap();
        assert_eq!(status, FrameStatus::Unchanged);
        assert!(image.iter().all(|x| *x == 0.0));
        assert_eq!(one(&frame, &[7]).unwrap().0, FrameStatus::Computed);
        // equal to the reference except for a NaN
        frame.copy_from_slice(&reference);
        frame[5] = f64::NAN;
        refused!(one(&frame, &[]), NonFiniteData { measurement: 5, .. });
    }
}
