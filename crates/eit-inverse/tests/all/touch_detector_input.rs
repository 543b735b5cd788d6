//! The touch detector on linear data of a disc: missing values, invalid input, allocations.

use crate::common::detector::{DT_S, FINGER, MEASUREMENTS, SKIN, distance_m, noisy, place, push};
use eit_inverse::touch::{DetectorModel, DetectorSettings, TouchDetector};
use fixtures::Random;

#[test]
fn missing_measurements_are_left_out() {
    let mut random = Random::new(6);
    let detector = SKIN.detector(1e-8);
    for _ in 0..4 {
        let mut used = [true; MEASUREMENTS];
        for _ in 0..15 {
            let i = random.below(MEASUREMENTS);
            (used[i], used[SKIN.reciprocal[i]]) = (false, false);
        }
        let touches = [([0.04, 0.03], FINGER), ([-0.05, -0.02], FINGER)];
        let mut frame = noisy(&mut random, &touches);
        let settings = DetectorSettings::with_least(1e-8);
        let mut never = TouchDetector::new(&SKIN.model(&used), settings).unwrap();
        push(&mut never, &frame);
        frame.iter_mut().zip(&used).filter(|(_, used)| !**used).for_each(|(v, _)| *v = f64::NAN);
        let mut missing = detector.clone();
        missing.push(&frame, |i| !used[i], DT_S).unwrap();
        let lost = used.iter().filter(|used| !**used).count();
        assert_eq!(never.rows(), missing.rows() - lost / 2);
        assert_eq!((missing.touches().len(), never.touches().len()), (2, 2));
        for (a, b) in missing.touches().iter().zip(never.touches()) {
            let off_m = distance_m(a, [b.position_m[0], b.position_m[1]]);
            let [a, b] = [a, b].map(|t| [t.strength_s_m2, t.strength_std_s_m2, t.worth]);
            // 1.3e-13: rounding for a covariance of condition 100
            let is_same = a.iter().zip(&b).all(|(a, b)| (a / b - 1.0).abs() < 1e-11);
            assert!(is_same && off_m < 1e-11, "{off_m} {a:?} {b:?}");
        }
    }
}

/// If one of two reciprocals is missing, the other stands for both, with a noise too small by sqrt 2.
#[test]
fn half_a_pair_suffices() {
    let mut random = Random::new(7);
    let at = [0.03, -0.05];
    let frame = noisy(&mut random, &[(at, FINGER)]);
    let mut detector = SKIN.detector(1e-8);
    let [whole] = push(&mut detector.clone(), &frame)[..] else { panic!() };
    let lost: Vec<_> = (0..MEASUREMENTS).filter(|&i| i < SKIN.reciprocal[i]).step_by(5).collect();
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
    for k in 0..50 {
        // more at first than ever after
        let (count, missing) = if k < 10 { (10, 40) } else { (random.below(9), random.below(30)) };
        let fingers: Vec<_> = (0..count).map(|_| (place(&mut random, 0.9), 4.0 * FINGER)).collect();
        let frame = noisy(&mut random, &fingers);
        let lost: Vec<usize> = (0..missing).map(|_| random.below(MEASUREMENTS)).collect();
        let info = allocation_counter::measure(|| {
            detector.push(&frame, |i| lost.contains(&i), DT_S).unwrap();
        });
        most = most.max(detector.touches().len());
        assert!(k < 10 || info.count_total == 0, "{k}: {info:?}");
    }
    assert!(most >= 5, "{most}");
}

#[test]
fn bad_frames_change_nothing() {
    let mut random = Random::new(9);
    let [before, frame] = [0; 2].map(|_| noisy(&mut random, &[([0.02, 0.05], FINGER)]));
    let mut detector = SKIN.detector(1e-8);
    push(&mut detector, &before);
    let mut untroubled = detector.clone();
    let mut nan = frame.clone();
    nan[17] = f64::NAN;
    let never = |_: usize| false;
    refused!(detector.push(&frame[1..], never, DT_S), WrongLength { found: 207, wanted: 208, .. });
    refused!(detector.push(&nan, never, DT_S), NonFiniteData { measurement: 17, .. });
    for dt_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let refused = detector.push(&frame, never, dt_s);
        refused!(refused, OutOfRange { quantity: "time since the last frame", .. });
    }
    assert_eq!(push(&mut detector, &frame), push(&mut untroubled, &frame));
    assert_eq!(detector.reference_v(), untroubled.reference_v());
    // a missing value may be anything
    detector.push(&nan, |i| i == 17, DT_S).unwrap();
    assert_eq!(detector.touches().len(), 1);
    // all are missing
    let [mut detector, mut untroubled] = [0; 2].map(|_| SKIN.detector(1e-8));
    let step = detector.push(&[f64::NAN; MEASUREMENTS], |_| true, DT_S).unwrap();
    assert_eq!((step.rows, detector.touches().len(), detector.places().1), (0, 0, 0));
    assert_eq!(detector.reference_v(), untroubled.reference_v());
    assert_eq!(push(&mut detector, &frame), push(&mut untroubled, &frame));
}

/// Errors name the measurement, and the element of a derivative; what belongs to unused measurements is not read.
#[test]
fn bad_models_are_refused_by_name() {
    let new = |model: &DetectorModel<'_>, least_s_m2: f64| {
        TouchDetector::new(model, DetectorSettings::with_least(least_s_m2))
    };
    let all = [true; MEASUREMENTS];
    refused!(new(&SKIN.model(&[false; MEASUREMENTS]), 1e-8), NothingUsed { measurements: 208 });
    refused!(new(&SKIN.model(&all[1..]), 1e-8), WrongLength { .. });
    let said = |model: &DetectorModel<'_>, least_s_m2: f64, wanted: &str| {
        let error = new(model, least_s_m2).err().unwrap().to_string();
        assert!(error.contains(wanted), "{error}");
    };
    for std_v in [0.0, -1e-6, f64::NAN] {
        let mut noise_std_v = SKIN.noise_std_v.clone();
        noise_std_v[40] = std_v;
        said(&DetectorModel { noise_std_v: &noise_std_v, ..SKIN.model(&all) }, 1e-8, "noise");
    }
    said(&SKIN.model(&all), 0.0, "least_s_m2");
    said(&SKIN.model(&all), f64::NAN, "least_s_m2");
    let (mut reference_v, mut used) = (SKIN.model_v.clone(), all);
    (reference_v[3], used[3]) = (f64::INFINITY, false);
    let model = DetectorModel { reference_v: &reference_v, ..SKIN.model(&all) };
    refused!(new(&model, 1e-8), NonFiniteReference { measurement: 3, .. });
    let (first, second) = (30, SKIN.reciprocal[30]);
    assert!(first < second);
    let mut broken = SKIN.jacobian.clone();
    for (row, column, bad) in
        [(first, 7, f64::NAN), (second, 400, f64::INFINITY), (second, 0, -f64::INFINITY)]
    {
        let mut jacobian = SKIN.jacobian.clone();
        (jacobian[[row, column]], broken[[row, column]], used[row]) = (bad, bad, false);
        let model = DetectorModel { jacobian: &jacobian, ..SKIN.model(&all) };
        refused!(new(&model, 1e-8), NonFiniteJacobian { measurement, element, value }
            if measurement == row && element == column && value.total_cmp(&bad).is_eq());
    }
    let (jacobian, reference_v) = (&broken, &reference_v[..]);
    assert!(new(&DetectorModel { jacobian, reference_v, ..SKIN.model(&used) }, 1e-8).is_ok());
}
