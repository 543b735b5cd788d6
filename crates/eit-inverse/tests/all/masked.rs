//! Masking measurements of one frame, compared with reconstructions built without them.

use crate::common::*;
use eit_inverse::{
    DifferenceData, FrameStatus, InverseError, OneStepGaussNewton, OneStepSettings, Reconstructor,
};
use eit_mesh::Raster;
use fixtures::Random;
use ndarray::Array2;
use proptest::prelude::*;

/// 8 electrodes, 40 measurements: noise and model voltages differ between channels, one is unused.
struct Setup {
    jacobian: Array2<f64>,
    settings: OneStepSettings,
    frame: Vec<f64>,
    reference_frame: Vec<f64>,
}

const UNUSED: usize = 17;

fn scene(hyperparameter: f64) -> Setup {
    let mut random = Random::new(4071);
    let [noise_std, model_voltages_v, reference_frame, change] =
        [0.5, 1.0, 1.0, -0.5].map(|low| uniforms(&mut random, 40, low));
    let frame = reference_frame.iter().zip(change).map(|(v, x)| v * (1.0 + 0.1 * x)).collect();
    let settings = OneStepSettings {
        hyperparameter,
        data: DifferenceData::Normalised { model_voltages_v },
        noise_std: Some(noise_std),
        used: Some((0..40).map(|i| i != UNUSED).collect()),
    };
    Setup { jacobian: jacobian(&disc(0.1, 8), 8), settings, frame, reference_frame }
}

/// Hyperparameter at which `lambda^2 s / noise_scale^2` of `built` is that of `full`.
fn same_damping(full: &OneStepGaussNewton, built: &OneStepGaussNewton) -> f64 {
    let (full, built) = (full.report(), built.report());
    let root = |scale: f64, noise: Option<f64>| scale.sqrt() / noise.unwrap_or(1.0);
    full.hyperparameter * root(full.scale, full.noise_scale) / root(built.scale, built.noise_scale)
}

/// Image of the frame without the masked measurements, whose values are overwritten first.
fn masked_image(
    map: &Reconstructor,
    frame: &[f64],
    reference: &[f64],
    masked: &[usize],
) -> Vec<f64> {
    let [mut frame, mut reference] = [frame.to_vec(), reference.to_vec()];
    masked.iter().for_each(|&i| frame[i] = f64::NAN);
    masked.iter().for_each(|&i| reference[i] = if i % 2 == 0 { 0.0 } else { f64::INFINITY });
    let (mut memory, mut image) = (map.workspace(), vec![f64::NAN; map.image_len()]);
    map.reconstruct_masked_into(&frame, &reference, masked, &mut memory, &mut image).unwrap();
    image
}

/// Sets of masked measurements: none, one, the channels of an electrode, more than half of the rank,
/// nearly all; unordered, repeated, and including the unused one.
fn sets() -> Vec<Vec<usize>> {
    let electrode = (0..40).filter(|&i| adjacent(8)[i].contains(&3)).collect();
    let many = (0..40).rev().filter(|i| i % 3 != 0).collect();
    let all_but_two = (0..40).filter(|i| ![5, 30].contains(i)).collect();
    vec![vec![], vec![9], vec![30, 2, UNUSED, 30, 2], electrode, many, all_but_two]
}

#[test]
fn a_frame_without_bad_values_is_as_if_they_were_never_measured() {
    let surface = disc(0.1, 8);
    let prior = laplace(&surface);
    let raster = Raster::new(&surface, 10).unwrap();
    for hyperparameter in [1e-3, 0.03, 1.0] {
        let Setup { jacobian, settings, frame, reference_frame } = scene(hyperparameter);
        let full = one_step(&jacobian, &prior, settings.clone());
        let on_raster = full.on_raster(raster.pixel_from_element()).unwrap();
        for masked in sets() {
            let case = format!("lambda {hyperparameter}, {} masked", masked.len());
            let used: Vec<bool> = (0..40).map(|i| i != UNUSED && !masked.contains(&i)).collect();
            let built = OneStepSettings { used: Some(used.clone()), ..settings.clone() };
            let mut built = one_step(&jacobian, &prior, built);
            built.set_hyperparameter(same_damping(&full, &built)).unwrap();
            let mut restricted = full.restricted_to(&used).unwrap();
            assert_eq!(built.report().rank, restricted.report().rank, "{case}");
            restricted.set_hyperparameter(same_damping(&full, &restricted)).unwrap();
            let expected = built.reconstruct(&frame, &reference_frame).unwrap();
            let mut broken = frame.clone();
            masked.iter().for_each(|&i| broken[i] = f64::NAN);
            let other = restricted.reconstruct(&broken, &reference_frame).unwrap();
            let image = masked_image(full.reconstructor(), &frame, &reference_frame, &masked);
            let error = relative_difference(&image, &expected);
            // rounding 1e-16 over the smallest eigenvalue of the fill, about lambda^2 / 20 (20 masked) or
            // more: 2e-9 at 1e-3 (measured: 4e-9), 2e-12 at 0.03 (7e-12); with a margin of 4, and at least
            // the rounding error of a rebuild. Of 20 random scenes 9 satisfy this and the next bound;
            // others have smaller eigenvalues and up to 7 times the error
            assert!(error < 1e-12_f64.max(1e-14 / hyperparameter.powi(2)), "{case}: {error:e}");
            // from the singular values of the kept rows: the root of that error (measured: 1e-12)
            let error = relative_difference(&other, &expected);
            assert!(error < 4e-12, "{case}, restricted: {error:e}");
            // difference data computed separately gives exactly the same image
            let map = full.reconstructor();
            let mut dv = map.difference(&frame, &reference_frame).unwrap().to_vec();
            let kept = (0..40).filter(|&i| i != UNUSED);
            let values = dv.iter_mut().zip(kept).filter(|(_, i)| masked.contains(i));
            values.for_each(|(value, _)| *value = f64::NAN);
            let (mut memory, mut again) = (map.workspace(), vec![f64::NAN; map.image_len()]);
            map.reconstruct_masked_difference_into(&dv, &masked, &mut memory, &mut again).unwrap();
            assert_eq!(again, image, "{case}");
            let pixels = masked_image(&on_raster, &frame, &reference_frame, &masked);
            let mut shown = vec![0.0; pixels.len()];
            raster.pixel_from_element().apply(&image, &mut shown).unwrap();
            // means of the same image
            assert!(relative_difference(&pixels, &shown) < 1e-12, "{case}");
        }
    }
}

proptest! {
    #![proptest_config(fixtures::cases(64))]

    /// The right image, or an error that states the expected loss of accuracy; never a wrong image.
    #[test]
    fn any_set_is_right_or_refused(seed in any::<u64>(), m in 2_usize..30, n in 1_usize..30,
                                   rank in 1_usize..30, power in -9.0..2.0_f64, part in 0.0..1.0) {
        let mut random = Random::new(seed);
        let jacobian = random.normals(m, rank).dot(&random.normals(rank, n));
        let full = one_step(&jacobian, &IDENTITY, with_lambda(10_f64.powf(power)));
        let mut masked: Vec<usize> = (0..m).filter(|_| random.uniform() < part).collect();
        if masked.len() == m {
            masked.pop();
        }
        let used: Vec<bool> = (0..m).map(|i| !masked.contains(&i)).collect();
        let mut built = full.restricted_to(&used).unwrap();
        built.set_hyperparameter(same_damping(&full, &built)).unwrap();
        let reference = vec![0.0; m];
        let frame = random.noisy(&reference, 1.0);
        let (mut memory, mut image) = (full.workspace(), vec![f64::NAN; n]);
        let map = full.reconstructor();
        match map.reconstruct_masked_into(&frame, &reference, &masked, &mut memory, &mut image) {
            Ok(_) => {
                let expected = built.reconstruct(&frame, &reference).unwrap();
                let error = relative_difference(&image, &expected);
                // estimates up to 1e-6 are accepted and correct within a factor of ten (worst of 20 000
                // cases: 9e-6; with 20 of 21 masked the error may be larger)
                prop_assert!(error < 1e-4, "{error:e}");
                prop_assert!(power < -3.0 || error < 1e-7, "{error:e}");
            }
            Err(error) => {
                // only for lambda^2 below 1e-8, which no rule chooses for noisy data
                let refused = matches!(
                    error,
                    InverseError::MaskedDominates { expected_error, .. } if expected_error > 1e-6
                );
                prop_assert!(refused && power < -4.0, "{}", error);
            }
        }
    }
}

#[test]
fn a_workspace_serves_sets_of_every_size_in_any_order() {
    let Setup { jacobian, settings, frame, reference_frame: reference } = scene(0.03);
    let full = one_step(&jacobian, &IDENTITY, settings);
    let map = full.reconstructor();
    let (mut memory, mut image) = (map.workspace(), vec![0.0; map.image_len()]);
    for masked in sets().iter().chain(sets().iter().rev()) {
        map.reconstruct_masked_into(&frame, &reference, masked, &mut memory, &mut image).unwrap();
        assert_eq!(image, masked_image(map, &frame, &reference, masked));
    }
    map.reconstruct_into(&frame, &reference, &mut memory, &mut image).unwrap();
    assert_eq!(image, map.reconstruct(&frame, &reference).unwrap().to_vec());
}

#[test]
fn wrong_sets_are_named() {
    let Setup { jacobian, settings, frame, reference_frame } = scene(0.03);
    let full = one_step(&jacobian, &IDENTITY, settings);
    let map = full.reconstructor();
    let mut workspace = map.workspace();
    let mut with = |frame: &[f64], masked: &[usize], length: usize| {
        let mut image = vec![0.0; length];
        map.reconstruct_masked_into(frame, &reference_frame, masked, &mut workspace, &mut image)
    };
    let length = map.image_len();
    let unknown = with(&frame, &[3, 40], length);
    refused!(unknown, UnknownMeasurement { measurement: 40, measurements: 40 });
    let all: Vec<usize> = (0..40).collect();
    refused!(with(&frame, &all, length), NothingUsed { measurements: 40 });
    let mut broken = frame.clone();
    broken[4] = f64::NAN;
    refused!(with(&broken, &[3], length), NonFiniteData { frame: 0, measurement: 4, .. });
    assert_eq!(with(&broken, &[4], length), Ok(FrameStatus::Computed));
    refused!(with(&frame, &[], 3), WrongLength { what: "image", found: 3, .. });
}
