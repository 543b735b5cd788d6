//! The touch detector on linear data of a disc: missing values, invalid input, allocations.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

use crate::common::detector::{DT_S, FINGER, MEASUREMENTS, SKIN, distance_m, place, push, touched};
use eit_inverse::InverseError;
use eit_inverse::touch::{DetectedTouch, DetectorModel, DetectorSettings, TouchDetector};
use fixtures::Random;

/// Touches without the measurements in `lost`: from a frame that lacks them, and from a detector that never
/// had them.
fn without(lost: &[usize], frame: &[f64]) -> [Vec<DetectedTouch>; 2] {
    let settings = DetectorSettings::with_least(1e-8);
    let all = [true; MEASUREMENTS];
    let mut whole = TouchDetector::new(&SKIN.model(&all), settings.clone()).unwrap();
    let mut holed = frame.to_vec();
    lost.iter().for_each(|&i| holed[i] = f64::NAN);
    whole.push(&holed, |i| lost.contains(&i), DT_S).unwrap();
    let mut used = all;
    lost.iter().for_each(|&i| used[i] = false);
    let mut never = TouchDetector::new(&SKIN.model(&used), settings).unwrap();
    never.push(frame, |_| false, DT_S).unwrap();
    assert_eq!(never.rows(), whole.rows() - lost.len() / 2);
    [whole.touches().to_vec(), never.touches().to_vec()]
}

/// Losing a measurement and its reciprocal equals never having had them.
#[test]
fn missing_measurements_are_left_out() {
    let mut random = Random::new(6);
    let mut worst = 0.0_f64;
    for _ in 0..10 {
        let mut lost: Vec<usize> = Vec::new();
        for _ in 0..15 {
            let i = random.below(MEASUREMENTS);
            lost.extend(
                [i, SKIN.reciprocal[i]]
                    .iter()
                    .filter(|k| !lost.contains(k))
                    .copied()
                    .collect::<Vec<_>>(),
            );
        }
        let touches = [([0.04, 0.03], FINGER), ([-0.05, -0.02], FINGER)];
        let frame = random.noisy(&touched(&touches), SKIN.noise_std_v[0]);
        let [missing, never] = without(&lost, &frame);
        assert_eq!(missing.len(), never.len());
        assert_eq!(missing.len(), 2);
        for (a, b) in missing.iter().zip(&never) {
            worst = worst.max(distance_m(a, [b.position_m[0], b.position_m[1]]));
            let strength = a.strength_s_m2 / b.strength_s_m2 - 1.0;
            let std = a.strength_std_s_m2 / b.strength_std_s_m2 - 1.0;
            let worth = a.worth / b.worth - 1.0;
            worst = worst.max(strength.abs()).max(std.abs()).max(worth.abs());
        }
    }
    println!("largest difference {worst:.1e}");
    // 1.3e-13: rounding for a covariance of condition 100
    assert!(worst < 1e-11, "{worst}");
}

/// If one of two reciprocal measurements is missing, the other stands for both, with a noise too small by
/// sqrt 2. The position stays within a standard deviation.
#[test]
fn half_a_pair_suffices() {
    let mut random = Random::new(7);
    let at = [0.03, -0.05];
    let frame = random.noisy(&touched(&[(at, FINGER)]), SKIN.noise_std_v[0]);
    let mut detector = SKIN.detector(1e-8);
    let [whole] = push(&mut detector.clone(), &frame)[..] else { panic!() };
    let lost: Vec<usize> =
        (0..MEASUREMENTS).filter(|&i| i < SKIN.reciprocal[i]).step_by(5).collect();
    let step = detector.push(&frame, |i| lost.contains(&i), DT_S).unwrap();
    assert_eq!(step.rows, detector.rows());
    let [half] = detector.touches()[..] else { panic!() };
    let std_m = whole.position_covariance_m2[0][0].max(whole.position_covariance_m2[1][1]).sqrt();
    let off_m = distance_m(&half, [whole.position_m[0], whole.position_m[1]]);
    assert!(off_m < std_m, "{off_m} {std_m}");
}

/// Touches and measurements come and go: nothing is allocated once the largest numbers have occurred.
#[test]
fn push_allocates_nothing() {
    let mut random = Random::new(8);
    let mut detector = SKIN.detector(1e-8);
    let mut most = 0;
    for k in 0..80 {
        // more at first than ever after
        let (touches, missing) =
            if k < 10 { (10, 40) } else { (random.below(9), random.below(30)) };
        let fingers: Vec<_> =
            (0..touches).map(|_| (place(&mut random, 0.9), 4.0 * FINGER)).collect();
        let frame = random.noisy(&touched(&fingers), SKIN.noise_std_v[0]);
        let lost: Vec<usize> = (0..missing).map(|_| random.below(MEASUREMENTS)).collect();
        let info = allocation_counter::measure(|| {
            detector.push(&frame, |i| lost.contains(&i), DT_S).unwrap();
        });
        most = most.max(detector.touches().len());
        assert!(k < 10 || info.count_total == 0, "{k}: {info:?}");
    }
    assert!(most >= 5, "{most}");
}

/// Invalid values in a frame are named in the error, and the detector is unchanged.
#[test]
fn bad_frames_change_nothing() {
    let mut random = Random::new(9);
    let noisy = |random: &mut Random| {
        random.noisy(&touched(&[([0.02, 0.05], FINGER)]), SKIN.noise_std_v[0])
    };
    let mut detector = SKIN.detector(1e-8);
    push(&mut detector, &noisy(&mut random));
    let mut untroubled = detector.clone();
    let frame = noisy(&mut random);
    let mut nan = frame.clone();
    nan[17] = f64::NAN;
    let never = |_: usize| false;
    assert!(matches!(
        detector.push(&frame[1..], never, DT_S),
        Err(InverseError::WrongLength { found: 207, wanted: 208, .. })
    ));
    assert!(matches!(
        detector.push(&nan, never, DT_S),
        Err(InverseError::NonFiniteData { measurement: 17, .. })
    ));
    for dt_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let error = detector.push(&frame, never, dt_s).unwrap_err();
        assert!(matches!(error, InverseError::OutOfRange { .. }), "{error}");
        assert!(error.to_string().contains("time since the last frame"), "{error}");
    }
    assert_eq!(push(&mut detector, &frame), push(&mut untroubled, &frame));
    assert_eq!(detector.reference_v(), untroubled.reference_v());
    // a missing value may be anything
    detector.push(&nan, |i| i == 17, DT_S).unwrap();
    assert_eq!(detector.touches().len(), 1);
}

/// A frame with all values missing shows no touch, and the next frame works as usual.
#[test]
fn an_empty_frame_shows_nothing() {
    let mut random = Random::new(10);
    let frame = random.noisy(&touched(&[([0.02, 0.05], FINGER)]), SKIN.noise_std_v[0]);
    let mut detector = SKIN.detector(1e-8);
    let reference = detector.reference_v().to_vec();
    let step = detector.push(&[f64::NAN; MEASUREMENTS], |_| true, DT_S).unwrap();
    assert_eq!((step.rows, detector.touches().len(), detector.places().1), (0, 0, 0));
    assert_eq!(detector.reference_v(), reference);
    assert_eq!(push(&mut detector, &frame), push(&mut SKIN.detector(1e-8), &frame));
}

#[test]
fn bad_models_are_refused_by_name() {
    let settings = || DetectorSettings::with_least(1e-8);
    let all = [true; MEASUREMENTS];
    let refused = |model: &DetectorModel<'_>| TouchDetector::new(model, settings()).err().unwrap();
    assert!(matches!(
        refused(&SKIN.model(&[false; MEASUREMENTS])),
        InverseError::NothingUsed { measurements: 208 }
    ));
    assert!(matches!(refused(&SKIN.model(&all[1..])), InverseError::WrongLength { .. }));
    for std_v in [0.0, -1e-6, f64::NAN] {
        let mut noise_std_v = SKIN.noise_std_v.clone();
        noise_std_v[40] = std_v;
        let error = refused(&DetectorModel { noise_std_v: &noise_std_v, ..SKIN.model(&all) });
        assert!(error.to_string().contains("noise"), "{std_v}: {error}");
    }
    let mut reference_v = SKIN.model_v.clone();
    reference_v[3] = f64::INFINITY;
    assert!(matches!(
        refused(&DetectorModel { reference_v: &reference_v, ..SKIN.model(&all) }),
        InverseError::NonFiniteReference { measurement: 3, .. }
    ));
    // references of unused measurements are not read
    let mut used = all;
    used[3] = false;
    let model = DetectorModel { reference_v: &reference_v, ..SKIN.model(&used) };
    assert!(TouchDetector::new(&model, settings()).is_ok());
    for least_s_m2 in [0.0, f64::NAN] {
        let settings = DetectorSettings::with_least(least_s_m2);
        let error = TouchDetector::new(&SKIN.model(&all), settings).err().unwrap();
        assert!(error.to_string().contains("least_s_m2"), "{error}");
    }
}

/// Non-finite values of either measurement of a pair, or of the unknowns: the error names measurement and
/// element. Unused values are not read.
#[test]
fn derivatives_that_are_no_numbers_are_named() {
    let settings = || DetectorSettings::with_least(1e-8);
    let all = [true; MEASUREMENTS];
    let first = 30;
    let second = SKIN.reciprocal[first];
    assert!(first < second);
    for (row, column, bad) in
        [(first, 7, f64::NAN), (second, 400, f64::INFINITY), (second, 0, -f64::INFINITY)]
    {
        let mut jacobian = SKIN.jacobian.clone();
        jacobian[[row, column]] = bad;
        let model = DetectorModel { jacobian: &jacobian, ..SKIN.model(&all) };
        match TouchDetector::new(&model, settings()).err().unwrap() {
            InverseError::NonFiniteJacobian { measurement, element, value } => {
                assert_eq!((measurement, element), (row, column));
                assert!(value.total_cmp(&bad).is_eq());
            }
            error => panic!("{error}"),
        }
        let mut used = all;
        used[row] = false;
        let model = DetectorModel { jacobian: &jacobian, ..SKIN.model(&used) };
        assert!(TouchDetector::new(&model, settings()).is_ok());
    }
}
