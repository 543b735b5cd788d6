//! The adaptive reference follows drift but not touches.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test file: a panic is a failed test"
)]

use crate::common::{disc, jacobian, target};
use eit_inverse::metrics::Cells;
use eit_inverse::touch::{NoiseFloor, TouchState, TouchStream, TouchStreamSettings};
use eit_inverse::{
    AdaptiveReference, InverseError, Laplace, LaplaceSettings, OneStepGaussNewton, OneStepSettings,
    ReferenceSettings, ReferenceState,
};
use eit_mesh::Raster;
use fixtures::Random;
use ndarray::Array2;

const CHANNELS: usize = 208;
const NOISE: f64 = 1e-3;
const RATE_HZ: f64 = 20.0;

/// Voltages over two decades, as in adjacent protocols.
fn rest() -> Vec<f64> {
    (0..CHANNELS).map(|i| 0.1 * 10.0_f64.powf(2.0 * ((i * 37) % CHANNELS) as f64 / 208.0)).collect()
}

/// Relative change by a touch: 5 % in a few channels, almost none in most.
fn touch(i: usize) -> f64 {
    0.05 * (-(((i * 53) % CHANNELS) as f64 / 25.0).powi(2)).exp()
}

struct Skin {
    random: Random,
    frame: Vec<f64>,
    rest: Vec<f64>,
}

impl Skin {
    fn new(seed: u64) -> Self {
        Self { random: Random::new(seed), frame: vec![0.0; CHANNELS], rest: rest() }
    }

    /// Returns a frame with a common factor and a touch of the given strength.
    fn frame(&mut self, factor: f64, strength: f64) -> &[f64] {
        for i in 0..CHANNELS {
            let clean = self.rest[i] * factor * (1.0 + strength * touch(i));
            self.frame[i] = clean + NOISE * self.random.normal();
        }
        &self.frame
    }
}

fn start(seed: u64, settings: ReferenceSettings) -> (Skin, AdaptiveReference) {
    let mut skin = Skin::new(seed);
    let mut quiet = Array2::zeros((60, CHANNELS));
    for mut row in quiet.rows_mut() {
        row.iter_mut().zip(skin.frame(1.0, 0.0)).for_each(|(to, from)| *to = *from);
    }
    (skin, AdaptiveReference::of_quiet_frames(quiet.view(), settings).unwrap())
}

/// Largest error of the reference relative to a true factor, in units of a frame's noise.
fn error(reference: &AdaptiveReference, rest: &[f64], factor: f64) -> f64 {
    let errors = reference.reference().iter().zip(rest).map(|(v, r)| (v - factor * r) / NOISE);
    (errors.map(|e| e * e).sum::<f64>() / CHANNELS as f64).sqrt()
}

/// A drift of 1 % a minute is followed without lag: the error is that of a mean over the time constant, and
/// no frame is taken for a touch.
#[test]
fn steady_drift_is_followed_without_lag() {
    let (mut skin, mut reference) = start(1, ReferenceSettings::default());
    let mut largest = 0.0_f64;
    for k in 1..(600.0 * RATE_HZ) as usize {
        let time_s = k as f64 / RATE_HZ;
        let factor = 1.0 + 0.01 * time_s / 60.0;
        let step = reference.push(skin.frame(factor, 0.0), time_s, false).unwrap();
        assert_eq!(step.state, ReferenceState::Following, "{time_s} s, {step:?}");
        largest = largest.max(error(&reference, &skin.rest, factor));
    }
    // Until the slope is known, the largest channel lags by 1 % / min * 30 s / e = 1.8e-3 of 10 V, 18 times
    // the noise. Afterwards only the noise of the filter remains, 1.25 dt / tau of the variance.
    let last = error(&reference, &skin.rest, 1.0 + 0.01 * (600.0 - 1.0 / RATE_HZ) / 60.0);
    println!("largest {largest:.3}, last {last:.3} of the noise");
    assert!(last < 0.15, "{last}");
}

/// A touch held for ten minutes at a drift of 0.1 % a minute keeps its strength.
#[test]
fn a_held_touch_does_not_fade() {
    for (drift_per_s, common_mode, tolerance) in
        // without drift: the noise of a mean over 8 s; with drift, 1.2 % in all, a quarter of the touch's 5
        // %: a fiftieth of the touch may be left
        [(0.0, true, 0.01), (0.0, false, 0.01), (0.001 / 60.0, true, 0.02)]
    {
        let settings = ReferenceSettings { common_mode, ..Default::default() };
        let (mut skin, mut reference) = start(2, settings);
        let (begin_s, end_s) = (120.0, 720.0);
        let mut k = 0;
        let mut strength_of =
            |from_s: f64, to_s: f64, skin: &mut Skin, reference: &mut AdaptiveReference| {
                let (mut sum, mut count) = (0.0, 0.0);
                while (k as f64) < to_s * RATE_HZ {
                    k += 1;
                    let time_s = k as f64 / RATE_HZ;
                    let factor = 1.0 + drift_per_s * time_s;
                    let pressed = time_s >= begin_s && time_s < end_s;
                    let frame = skin.frame(factor, f64::from(u8::from(pressed)));
                    // the tracker reports it one frame later and for two frames longer
                    let touched = time_s >= begin_s + 0.06 && time_s < end_s + 0.11;
                    let step = reference.push(frame, time_s, touched).unwrap();
                    if pressed {
                        assert_ne!(step.state, ReferenceState::Following, "{time_s} s");
                    }
                    if time_s >= from_s {
                        // least squares on the touch's pattern
                        let (mut top, mut bottom) = (0.0, 0.0);
                        for i in 0..CHANNELS {
                            let pattern = factor * skin.rest[i] * touch(i);
                            top += pattern * (skin.frame[i] - reference.reference()[i]);
                            bottom += pattern * pattern;
                        }
                        sum += top / bottom;
                        count += 1.0;
                    }
                }
                sum / count
            };
        let before = strength_of(110.0, 119.0, &mut skin, &mut reference);
        let first = strength_of(122.0, 130.0, &mut skin, &mut reference);
        let last = strength_of(710.0, 719.0, &mut skin, &mut reference);
        let after = strength_of(780.0, 790.0, &mut skin, &mut reference);
        println!(
            "drift {drift_per_s:.1e}/s common {common_mode}: before {before:.4} first {first:.4} last {last:.4} after {after:.4}"
        );
        assert!(before.abs() < tolerance, "{before}");
        assert!((first - 1.0).abs() < tolerance, "{first}");
        assert!((last - 1.0).abs() < tolerance, "{last}");
        assert!(after.abs() < tolerance, "{after}");
    }
}

/// A frame beyond the noise is not drift, even before the tracker reports a touch; nor is the same frame
/// repeated. The rezero command adopts it at once.
#[test]
fn rezero_is_immediate_and_nothing_else_is() {
    let (mut skin, mut reference) = start(3, ReferenceSettings::default());
    for k in 1..2000 {
        let step = reference.push(skin.frame(1.0, 1.0), k as f64 / RATE_HZ, false).unwrap();
        assert_eq!(step.state, ReferenceState::Disturbed);
        assert!(step.held_s > (k as f64 - 1.5) / RATE_HZ || k < 3);
    }
    reference.rezero();
    let frame = skin.frame(1.0, 1.0).to_vec();
    let step = reference.push(&frame, 2000.0 / RATE_HZ, true).unwrap();
    assert_eq!(step.state, ReferenceState::Zeroed);
    assert_eq!(reference.reference(), frame);
}

/// The whole chain from frames to touches under a thermal drift of 1 % a minute in all voltages: no touch
/// in five minutes of rest, one during a press of two minutes, none afterwards. Its position agrees with
/// that without drift to a millimetre.
#[test]
fn thermal_drift_is_no_touch_and_does_not_move_one() {
    let place = |drift_per_s: f64| -> [f64; 2] {
        let surface = disc(0.1, 12);
        let jacobian = jacobian(&surface, 0.1, 16);
        // voltages are homogeneous of degree -1 in the conductivity, here 1 S: v = -J 1
        let rest: Vec<f64> = jacobian.rows().into_iter().map(|row| -row.sum()).collect();
        let change =
            jacobian.dot(&ndarray::Array1::from(target(&surface, [0.04, 0.02], 0.015, 0.3)));
        let rms = (rest.iter().map(|v| v * v).sum::<f64>() / rest.len() as f64).sqrt();
        let noise = 1e-3 * rms;
        let prior = Laplace::new(&surface, &LaplaceSettings::default()).unwrap();
        let inverse =
            OneStepGaussNewton::new(&jacobian, &prior, OneStepSettings::default()).unwrap();
        let raster = Raster::new(&surface, 24).unwrap();
        let to_pixels = inverse.on_raster(raster.pixel_from_element()).unwrap();
        let floor = NoiseFloor::of_reconstruction(&to_pixels, &[noise; CHANNELS]).unwrap();
        let cells = Cells::of_raster_on(&raster, &surface).unwrap();
        let mut stream = TouchStream::new(cells, floor, TouchStreamSettings::default()).unwrap();
        let mut reference =
            AdaptiveReference::with_noise(&rest, &[noise; CHANNELS], ReferenceSettings::default())
                .unwrap();
        let mut random = Random::new(12);
        let (mut workspace, mut image) = (to_pixels.workspace(), vec![0.0; to_pixels.image_len()]);
        let (mut frame, mut touched, mut begun) = (rest.clone(), false, 0);
        let (mut sum, mut count) = ([0.0; 2], 0.0);
        for k in 1..(480.0 * RATE_HZ) as usize {
            let time_s = k as f64 / RATE_HZ;
            let factor = 1.0 + drift_per_s * time_s;
            let pressed = (300.0..420.0).contains(&time_s);
            let strength = f64::from(u8::from(pressed));
            for i in 0..CHANNELS {
                frame[i] = factor * (rest[i] + strength * change[i]) + noise * random.normal();
            }
            reference.push(&frame, time_s, touched).unwrap();
            to_pixels
                .reconstruct_into(&frame, reference.reference(), &mut workspace, &mut image)
                .unwrap();
            let touches = stream.push(&image, time_s).unwrap();
            touched = touches.iter().any(|touch| touch.state != TouchState::End);
            begun += touches.iter().filter(|t| t.state == TouchState::Begin).count();
            if !pressed && !(420.0..421.0).contains(&time_s) {
                assert!(!touched, "{time_s} s: {touches:?}");
            }
            if (301.0..420.0).contains(&time_s) {
                assert_eq!(touches.len(), 1, "{time_s} s");
                (0..2).for_each(|axis| sum[axis] += touches[0].position_m[axis]);
                count += 1.0;
            }
        }
        assert_eq!(begun, 1);
        sum.map(|x| x / count)
    };
    let (still, drifting) = (place(0.0), place(0.01 / 60.0));
    let moved = (still[0] - drifting[0]).hypot(still[1] - drifting[1]);
    println!("drift moves the touch by {:.3} mm", 1e3 * moved);
    assert!(moved < 1e-3, "{moved}");
}

#[test]
fn push_allocates_nothing() {
    let (mut skin, mut reference) = start(4, ReferenceSettings::default());
    let mut time_s = 0.0;
    for (strength, touched) in [(0.0, false), (1.0, false), (1.0, true), (0.0, false)] {
        for _ in 0..50 {
            time_s += 1.0 / RATE_HZ;
            let frame = skin.frame(1.0, strength).to_vec();
            let info = allocation_counter::measure(|| {
                reference.push(&frame, time_s, touched).unwrap();
            });
            assert_eq!(info.count_total, 0);
        }
    }
}

#[test]
fn bad_input_is_refused_by_name() {
    let few = Array2::from_elem((19, 3), 1.0);
    let new = |frames: &Array2<f64>| {
        AdaptiveReference::of_quiet_frames(frames.view(), ReferenceSettings::default()).err()
    };
    assert_eq!(new(&few), Some(InverseError::TooFewQuietFrames { found: 19, needed: 20 }));
    let none = Array2::zeros((0, 3));
    assert_eq!(new(&none), Some(InverseError::TooFewQuietFrames { found: 0, needed: 20 }));
    let mut nan = Random::new(1).normals(30, 3);
    nan[(7, 2)] = f64::NAN;
    assert!(matches!(
        new(&nan),
        Some(InverseError::NonFiniteData { frame: 7, measurement: 2, .. })
    ));
    assert!(matches!(new(&Array2::ones((30, 3))), Some(InverseError::NoiseUnknown { .. })));
    for settings in [
        ReferenceSettings { time_constant_s: 0.0, ..Default::default() },
        ReferenceSettings { release_s: -1.0, ..Default::default() },
        ReferenceSettings { settle_s: f64::NAN, ..Default::default() },
    ] {
        let made = AdaptiveReference::with_noise(&[1.0; 3], &[1.0; 3], settings);
        assert!(matches!(made, Err(InverseError::OutOfRange { .. })));
    }
    let with = |reference: &[f64], noise: &[f64]| {
        AdaptiveReference::with_noise(reference, noise, ReferenceSettings::default())
    };
    assert!(matches!(
        with(&[1.0, f64::INFINITY], &[1.0; 2]),
        Err(InverseError::NonFiniteReference { measurement: 1, .. })
    ));
    assert!(matches!(
        with(&[1.0; 2], &[1.0, 0.0]),
        Err(InverseError::MeasurementOutOfRange { measurement: 1, .. })
    ));
    assert!(matches!(with(&[1.0; 2], &[1.0; 3]), Err(InverseError::WrongLength { .. })));
    let mut reference = with(&[1.0; 3], &[0.1; 3]).unwrap();
    reference.push(&[1.0; 3], 5.0, false).unwrap();
    let before = reference.reference().to_vec();
    for time_s in [5.0, 4.0, f64::NAN] {
        let wrong = reference.push(&[1.0; 3], time_s, false);
        assert!(matches!(wrong, Err(InverseError::TimeOrder { frame: 1, before_s: 5.0, .. })));
    }
    assert!(matches!(
        reference.push(&[1.0, f64::NAN, 1.0], 6.0, false),
        Err(InverseError::NonFiniteData { frame: 1, measurement: 1, .. })
    ));
    assert!(matches!(reference.push(&[1.0; 2], 6.0, false), Err(InverseError::WrongLength { .. })));
    assert_eq!(reference.reference(), before);
}
