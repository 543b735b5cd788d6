//! One-step Gauss-Newton against hand solutions, the model-space form and its own symmetries.

use crate::common::{
    IDENTITY, adjacent, disc, jacobian, precision, relative_difference, solve, target,
};
use eit_inverse::{
    DifferenceData, FrameStatus, Gaussian, GaussianSettings, InverseError, Laplace,
    LaplaceSettings, Noser, OneStepGaussNewton, OneStepSettings, Prior, Tikhonov, metrics,
};
use fixtures::Random;
use ndarray::{Array1, Array2, ArrayView2, array};
use proptest::prelude::*;

fn settings(hyperparameter: f64) -> OneStepSettings {
    OneStepSettings { hyperparameter, ..Default::default() }
}

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
    let normal = weighted.dot(jacobian) + hyperparameter.powi(2) * scale * precision;
    solve(normal, weighted)
}

#[test]
fn measurement_space_and_model_space_forms_are_equal() {
    let surface = disc(0.1, 2);
    let (areas, n) = (surface.areas_m2(), surface.areas_m2().len());
    let mut random = Random::new(1);
    let jacobian = random.normals(10, n);
    let noise_std: Vec<f64> = (0..10).map(|_| 1e-6 * (0.5 + random.uniform())).collect();
    let mean = areas.iter().sum::<f64>() / n as f64;
    let white = Array2::from_diag(&areas.iter().map(|a| a / mean).collect::<Array1<f64>>());
    let laplace = Laplace::new(&surface, &LaplaceSettings::default()).unwrap();
    let smooth = precision(&laplace, n);
    let sensed: Array1<f64> = (0..n)
        .map(|e| (0..10).map(|i| (jacobian[(i, e)] / noise_std[i]).powi(2)).sum::<f64>().sqrt())
        .collect();
    let noser = Array2::from_diag(&sensed);
    let tikhonov = Tikhonov::new(&surface);
    let cases: [(&dyn Prior, &Array2<f64>); 3] =
        [(&tikhonov, &white), (&laplace, &smooth), (&Noser::default(), &noser)];
    for (prior, precision) in cases {
        for hyperparameter in [0.01, 0.3, 10.0] {
            let settings =
                OneStepSettings { noise_std: Some(noise_std.clone()), ..settings(hyperparameter) };
            let inverse = OneStepGaussNewton::new(&jacobian, prior, settings).unwrap();
            let expected = model_space(&jacobian, precision, &noise_std, hyperparameter);
            let error = relative_difference(&inverse.reconstruction_matrix(), &expected);
            // the n x n normal matrix has rank 10 plus lambda^2 R: condition about 1e5 at 0.01
            assert!(error < 1e-9, "{} at {hyperparameter}: {error:e}", prior.name());
        }
    }
}

#[test]
fn hand_solved_problems() {
    let one = OneStepGaussNewton::new(&array![[2.0]], &IDENTITY, settings(0.5)).unwrap();
    // A = 4, s = 4: RM = 2 / (4 + 0.25 * 4)
    assert!((one.reconstruction_matrix()[(0, 0)] - 0.4).abs() < 1e-15);
    let two =
        OneStepGaussNewton::new(&array![[1.0, 0.0], [0.0, 3.0]], &IDENTITY, settings(0.2)).unwrap();
    // s = (1 + 9) / 2 = 5, lambda^2 s = 0.2
    let expected = array![[1.0 / 1.2, 0.0], [0.0, 3.0 / 9.2]];
    assert!(relative_difference(&two.reconstruction_matrix(), &expected) < 1e-15);
    assert!((two.report().scale - 5.0).abs() < 1e-14);
    assert!((two.report().condition - 9.0).abs() < 1e-13);
    assert!((two.report().degrees_of_freedom - (1.0 / 1.2 + 9.0 / 9.2)).abs() < 1e-14);
    let image = two.reconstruct(&[4.0, 5.0], &[3.0, 3.0]).unwrap();
    assert!(relative_difference(&image, &array![1.0 / 1.2, 6.0 / 9.2]) < 1e-15);
}

#[test]
fn small_lambda_fits_the_data_and_large_lambda_gives_no_image() {
    let mut random = Random::new(2);
    let jacobian = random.normals(20, 60);
    let frame: Vec<f64> = (0..20).map(|_| random.normal()).collect();
    let reference = vec![0.0; 20];
    let mut inverse = OneStepGaussNewton::new(&jacobian, &IDENTITY, settings(1.0)).unwrap();
    assert_eq!(inverse.report().rank, 20);
    let mut last = 0.0;
    for hyperparameter in [1e-6, 1e-3, 0.1, 1.0, 1e3] {
        inverse.set_hyperparameter(hyperparameter).unwrap();
        let residual = inverse.relative_residual(&frame, &reference).unwrap().unwrap();
        assert!(residual > last, "the residual grows with lambda");
        last = residual;
    }
    inverse.set_hyperparameter(1e-6).unwrap();
    // residual / data <= lambda^2 s / d_min; s / d_min is about 5 for a 20 x 60 random matrix
    assert!(inverse.relative_residual(&frame, &reference).unwrap().unwrap() < 1e-10);
    inverse.set_hyperparameter(1e6).unwrap();
    let image = inverse.reconstruct(&frame, &reference).unwrap();
    // |RM| <= |J| / (lambda^2 s) = about 14 / 6e13
    assert!(image.iter().all(|x| x.abs() < 1e-11));
}

#[test]
fn relative_residual_is_that_of_the_image() {
    let mut random = Random::new(3);
    let jacobian = random.normals(12, 7);
    let noise_std: Vec<f64> = (0..12).map(|_| 0.5 + random.uniform()).collect();
    let [frame, reference] = [0; 2].map(|_| (0..12).map(|_| random.normal()).collect::<Vec<f64>>());
    let settings = OneStepSettings { noise_std: Some(noise_std.clone()), ..settings(0.4) };
    let inverse = OneStepGaussNewton::new(&jacobian, &IDENTITY, settings).unwrap();
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
    let frame = jacobian(&fine, 0.1, 16).dot(&Array1::from(touch)).to_vec();
    let jacobian = jacobian(&coarse, 0.1, 16);
    let priors: [&dyn Prior; 4] = [
        &Tikhonov::new(&coarse),
        &Noser::default(),
        &Laplace::new(&coarse, &LaplaceSettings::default()).unwrap(),
        &Gaussian::new(&coarse, &GaussianSettings::default()).unwrap(),
    ];
    for prior in priors {
        // eigenvalues at the rounding floor are truncated: consistent data is explained
        let tiny = OneStepGaussNewton::new(&jacobian, prior, settings(1e-9)).unwrap();
        // 208 measurements, equal in pairs by reciprocity; a smooth prior has an even lower rank
        let (name, rank) = (prior.name(), tiny.report().rank);
        assert!(rank == 104 || name != "tikhonov" && rank < 104, "{name}: rank {rank}");
        let residual = tiny.relative_residual(&frame, &[0.0; 208]).unwrap().unwrap();
        // smooth priors truncate the spectrum at the rounding floor: measured 3e-6
        assert!(residual < 1e-5, "{name}: residual {residual:e}");
        let inverse = OneStepGaussNewton::new(&jacobian, prior, settings(0.01)).unwrap();
        let image = inverse.reconstruct(&frame, &[0.0; 208]).unwrap().to_vec();
        let error_m = metrics::position_error_m(&image, &coarse, [0.04, 0.02, 0.0]).unwrap();
        // a tenth of the radius: about the resolution of 16 electrodes at half the radius
        assert!(error_m < 0.01, "{name}: {error_m} m off");
        let correlation =
            metrics::correlation_coefficient(&image, &truth, coarse.areas_m2()).unwrap();
        // measured 0.65 (Laplace) to 0.78 (NOSER): touches are blurred to the resolution of 16 electrodes
        assert!(correlation > 0.6, "{name}: correlation {correlation}");
    }
}

#[test]
fn reciprocal_rows_count_as_one_measurement_of_double_weight() {
    let surface = disc(0.1, 8);
    let full = jacobian(&surface, 0.1, 8);
    let first: Vec<usize> = (0..40).filter(|&i| adjacent(8)[i][0] < adjacent(8)[i][2]).collect();
    let half = full.select(ndarray::Axis(0), &first);
    let prior = Laplace::new(&surface, &LaplaceSettings::default()).unwrap();
    let touch = Array1::from(target(&surface, [0.03, -0.02], 0.02, 1.0));
    // merged: half as many rows with the same total weight, so s doubles; lambda^2 s must stay the same
    let merged = OneStepSettings {
        noise_std: Some(vec![0.5_f64.sqrt(); 20]),
        ..settings(0.02 * 0.5_f64.sqrt())
    };
    let [(twice, rank), (once, other)] =
        [(&full, settings(0.02)), (&half, merged)].map(|(j, s)| {
            let inverse = OneStepGaussNewton::new(j, &prior, s).unwrap();
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
    let jacobian = jacobian(&surface, 0.1, 8);
    let inverse =
        OneStepGaussNewton::new(&jacobian, &Tikhonov::new(&surface), settings(0.03)).unwrap();
    let mut random = Random::new(6);
    let frames = random.normals(5, jacobian.nrows());
    let reference: Vec<f64> = (0..jacobian.nrows()).map(|_| random.normal()).collect();
    let images = inverse.reconstruct_frames(frames.view(), &reference).unwrap();
    let raster = eit_mesh::Raster::new(&surface, 12).unwrap();
    let pixels = inverse.on_raster(raster.pixel_from_element()).unwrap();
    let matrix = inverse.reconstruction_matrix();
    let mut changed =
        OneStepGaussNewton::new(&jacobian, &Tikhonov::new(&surface), settings(1.0)).unwrap();
    changed.set_hyperparameter(0.03).unwrap();
    assert_eq!(changed.reconstruction_matrix(), matrix);
    assert_eq!(changed.report().degrees_of_freedom, inverse.report().degrees_of_freedom);
    let mut workspace = inverse.workspace();
    let mut image = vec![0.0; images.ncols()];
    for (frame, batch) in frames.rows().into_iter().zip(images.rows()) {
        let dv = &frame - &Array1::from(reference.clone());
        let frame = frame.to_vec();
        inverse.reconstruct_into(&frame, &reference, &mut workspace, &mut image).unwrap();
        let mut linear = vec![f64::NAN; image.len()];
        inverse
            .reconstructor()
            .reconstruct_difference_into(&dv.to_vec(), &mut workspace, &mut linear)
            .unwrap();
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
    let jacobian = jacobian(&disc(0.1, 6), 0.1, 8);
    let mut random = Random::new(7);
    let mut draw = |low: f64| (0..40).map(|_| low + random.uniform()).collect::<Vec<f64>>();
    let (noise_std_v, mut model_voltages_v, dv) = (draw(0.5), draw(0.2), draw(-0.5));
    model_voltages_v[3] = -model_voltages_v[3];
    let frame: Vec<f64> = model_voltages_v.iter().zip(&dv).map(|(v, d)| v + d).collect();
    let reference = model_voltages_v.clone();
    let with = |noise_std, data| {
        let settings = OneStepSettings { noise_std, data, ..settings(0.05) };
        OneStepGaussNewton::new(&jacobian, &Noser::default(), settings).unwrap()
    };
    let normalised = DifferenceData::Normalised { model_voltages_v };
    let [plain, normalised] = [DifferenceData::Plain, normalised]
        .map(|data| with(Some(data.noise_std(&noise_std_v).unwrap()), data));
    // dv / v0, J / v0 and e / |v0|: the v0 cancel, except in the unit given by the largest noise_std
    let [a, b] = [&plain, &normalised].map(|i| i.reconstruct(&frame, &reference).unwrap());
    // lambda^2 s is 2.5e-3 of the mean eigenvalue; 1e-16 over it, with a margin
    assert!(relative_difference(&a, &b) < 1e-12);
    let absolute =
        |i: &OneStepGaussNewton| i.report().scale / i.report().noise_scale.unwrap().powi(2);
    assert!((absolute(&normalised) / absolute(&plain) - 1.0).abs() < 1e-13);
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
    let noise = |values: &[f64]| {
        new(OneStepSettings { noise_std: Some(values.to_vec()), ..Default::default() })
    };
    refused!(noise(&[1.0]), WrongLength { what: "noise_std", found: 1, wanted: 3 });
    refused!(noise(&[1.0, -1.0, 1.0]), MeasurementOutOfRange { measurement: 1, value: -1.0, .. });
    let data = DifferenceData::Normalised { model_voltages_v: vec![1.0, 1.0, 0.0] };
    let zero = new(OneStepSettings { data, ..Default::default() });
    refused!(zero, ZeroReference { measurement: 2, .. });
    for hyperparameter in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused!(new(settings(hyperparameter)), OutOfRange { .. });
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
    let negative = OneStepGaussNewton::new(&Array2::eye(2), &Negative, settings(0.1));
    refused!(negative, BadCovariance { prior: "negative", .. });
}

proptest! {
    #![proptest_config(fixtures::cases(32))]

    /// Normalised data is independent of channel gains, drive current and channel signs.
    #[test]
    fn normalised_data_is_free_of_gain(seed in any::<u64>()) {
        let mut random = Random::new(seed);
        let (m, n) = (8, 11);
        let jacobian = random.normals(m, n);
        let model_voltages_v: Vec<f64> = (0..m).map(|_| 0.2 + random.uniform()).collect();
        let data = DifferenceData::Normalised { model_voltages_v };
        let inverse = OneStepGaussNewton::new(
            &jacobian, &IDENTITY, OneStepSettings { data, ..settings(0.1) }).unwrap();
        let [frame, reference] =
            [0; 2].map(|_| (0..m).map(|_| 1.0 + 0.3 * random.uniform()).collect::<Vec<f64>>());
        let gains: Vec<f64> = (0..m).map(|_| {
            let sign = if random.uniform() < 0.5 { -1.0 } else { 1.0 };
            sign * 10_f64.powf(6.0 * random.uniform() - 3.0)
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

    /// Lambda is independent of the units of current, conductivity and noise.
    #[test]
    fn lambda_is_free_of_units(seed in any::<u64>(), unit in -9.0..9.0_f64,
                               noise in -9.0..9.0_f64) {
        let mut random = Random::new(seed);
        let jacobian = random.normals(7, 12);
        let frame: Vec<f64> = (0..7).map(|_| random.normal()).collect();
        let (unit, noise) = (10_f64.powf(unit), 10_f64.powf(noise));
        let reference = [0.0; 7];
        let base = OneStepGaussNewton::new(&jacobian, &IDENTITY, settings(0.1)).unwrap();
        let settings = OneStepSettings { noise_std: Some(vec![noise; 7]), ..settings(0.1) };
        let scaled = OneStepGaussNewton::new(&(&jacobian * unit), &IDENTITY, settings).unwrap();
        let expected = base.reconstruct(&frame, &reference).unwrap() / unit;
        let image = scaled.reconstruct(&frame, &reference).unwrap();
        prop_assert!(relative_difference(&image, &expected) < 1e-11);
    }

    /// Any finite data gives a finite image, for any rank of the Jacobian.
    #[test]
    fn any_rank_gives_a_finite_image(seed in any::<u64>(), m in 1_usize..12, n in 1_usize..12,
                                     rank in 1_usize..5, power in -12.0..3.0_f64) {
        let mut random = Random::new(seed);
        let jacobian = random.normals(m, rank).dot(&random.normals(rank, n));
        let inverse =
            OneStepGaussNewton::new(&jacobian, &Noser::default(), settings(10_f64.powf(power))).unwrap();
        prop_assert!(inverse.report().rank <= rank.min(m).min(n));
        let frame: Vec<f64> = (0..m).map(|_| random.normal()).collect();
        let image = inverse.reconstruct(&frame, &vec![0.0; m]).unwrap();
        prop_assert!(image.iter().all(|x| x.is_finite()));
        let residual = inverse.relative_residual(&frame, &vec![0.0; m]).unwrap().unwrap();
        prop_assert!((0.0..=1.0 + 1e-12).contains(&residual));
    }
}

/// Compared with the batch, which always multiplies: exactly equal, except for the sign of a zero.
#[test]
fn a_frame_that_equals_its_reference_is_zero_without_a_product() {
    let surface = disc(0.1, 6);
    let jacobian = jacobian(&surface, 0.1, 8);
    let mut random = Random::new(16);
    let count = jacobian.nrows();
    let reference: Vec<f64> = (0..count).map(|_| 1.0 + random.uniform()).collect();
    let mut used = vec![true; count];
    used[3] = false;
    let normalised = DifferenceData::Normalised { model_voltages_v: reference.clone() };
    for data in [DifferenceData::Plain, normalised] {
        let settings = OneStepSettings { data, used: Some(used.clone()), ..settings(0.03) };
        let map = OneStepGaussNewton::new(&jacobian, &Tikhonov::new(&surface), settings).unwrap();
        let map = map.reconstructor();
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
        let batch = ArrayView2::from_shape((1, count), &reference).unwrap();
        let batch = map.reconstruct_frames(batch, &reference).unwrap();
        assert_eq!(image, batch.row(0).to_vec());
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
