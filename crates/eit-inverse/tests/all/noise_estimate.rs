//! Noise of quiet frames: rounding by converters, channels that float or are stuck.

use eit_inverse::{noise_std_of_quiet_frames, smallest_step};
use fixtures::Random;
use ndarray::{Array2, Axis, Slice, array};

const FRAMES: usize = 50;
const CHANNELS: usize = 208;

/// One step of the converter, volts.
const STEP_V: f64 = 1e-5;

/// Frames of constant voltages up to 0.2 V with white noise.
fn frames(random: &mut Random, std_v: f64) -> Array2<f64> {
    let mean_v: Vec<f64> = (0..CHANNELS).map(|_| random.between(-0.2, 0.2)).collect();
    Array2::from_shape_fn((FRAMES, CHANNELS), |(_, i)| mean_v[i] + std_v * random.normal())
}

fn rounded(mut frames: Array2<f64>, step_v: f64) -> Array2<f64> {
    frames.mapv_inplace(|v| step_v * (v / step_v).round());
    frames
}

#[test]
fn smallest_step_is_over_time_within_a_channel() {
    let frames = array![[0.0, 5.0, 5.1], [0.0, 5.5, 5.1], [2.0, 5.5, 5.1]];
    assert_eq!(smallest_step(frames.view()), 0.5);
    assert_eq!(smallest_step(frames.slice_axis(Axis(0), Slice::from(..1))), 0.0);
    assert_eq!(smallest_step(frames.slice_axis(Axis(1), Slice::from(2..))), 0.0);
    assert_eq!(smallest_step(Array2::<f64>::zeros((0, 3)).view()), 0.0);
}

/// Noise of a twentieth of a step: most channels never change, and in some, one step is the only event.
#[test]
fn no_channel_has_less_noise_than_its_rounding() {
    let mut random = Random::new(1);
    let quiet = rounded(frames(&mut random, 0.05 * STEP_V), STEP_V);
    let still = |i: &usize| quiet.column(*i).iter().all(|v| *v == quiet[(0, *i)]);
    let count = (0..CHANNELS).filter(still).count();
    assert!((CHANNELS / 2..CHANNELS).contains(&count), "{count}");
    // whole multiples of a step are exact up to the rounding of doubles, 0.2 V / 1e-5 V * 2e-16
    assert!((smallest_step(quiet.view()) / STEP_V - 1.0).abs() < 1e-10);
    let rounding_v = STEP_V / 12.0_f64.sqrt();
    let std_v = noise_std_of_quiet_frames(quiet.view()).unwrap();
    assert_eq!(std_v.len(), CHANNELS);
    for (i, std_v) in std_v.iter().enumerate() {
        assert!(*std_v > (1.0 - 1e-10) * rounding_v, "{i}: {std_v:e}");
        // where nothing changes, no more than that either
        assert!(!still(&i) || *std_v < (1.0 + 1e-10) * rounding_v, "{i}: {std_v:e}");
    }
}

/// Noise of five steps; then 10 bits, which hide all noise, but the step shows between channels.
#[test]
fn noise_above_rounding_is_as_measured_and_equal_frames_have_their_rounding() {
    let quiet = rounded(frames(&mut Random::new(2), 5.0 * STEP_V), STEP_V);
    let std_v = noise_std_of_quiet_frames(quiet.view()).unwrap();
    let mean = std_v.iter().sum::<f64>() / CHANNELS as f64 / (5.0 * STEP_V);
    // 49 differences are off by 12 %, a mean over 208 channels by 1 %; rounding adds 1 / 300 to the variance
    assert!((mean - 1.0).abs() < 0.04, "{mean}");
    assert!(std_v.iter().all(|e| (0.4..1.7).contains(&(e / (5.0 * STEP_V)))));

    let step_v = 0.4 / 1024.0;
    let quiet = rounded(frames(&mut Random::new(3), 0.0), step_v);
    let std_v = noise_std_of_quiet_frames(quiet.view()).unwrap();
    let rounding_v = step_v / 12.0_f64.sqrt();
    // 208 of 1024 values: some are adjacent
    assert!(std_v.iter().all(|e| (e / rounding_v - 1.0).abs() < 1e-10), "{:e}", std_v[0]);
}

/// Floating electrodes make a few channels a thousand times noisier. The others are measured as if those
/// were absent, and a stuck channel gets a tenth of the others' noise, not of theirs.
#[test]
fn floating_channels_do_not_raise_the_floor_of_the_others() {
    let std_v = 1e-6;
    let mut quiet = frames(&mut Random::new(4), std_v);
    quiet.column_mut(100).fill(0.1);
    let without = noise_std_of_quiet_frames(quiet.view()).unwrap();
    let floating = [3, 17, 50, 51, 120, 207];
    let mut random = Random::new(5);
    for i in floating {
        quiet.column_mut(i).iter_mut().for_each(|v| *v += 1e3 * std_v * random.normal());
    }
    let with = noise_std_of_quiet_frames(quiet.view()).unwrap();
    for i in (0..CHANNELS).filter(|i| !floating.contains(i) && *i != 100) {
        assert_eq!(with[i], without[i], "{i}");
    }
    for i in floating {
        // 49 differences: 12 %; five times that is allowed
        assert!((with[i] / (1e3 * std_v) - 1.0).abs() < 0.6, "{i}: {:e}", with[i]);
    }
    // a median of 208 channels of 12 % each, shifted by six ranks
    assert!((with[100] / (0.1 * std_v) - 1.0).abs() < 0.06, "{:e}", with[100]);
}

#[test]
fn bad_frames_are_refused_by_name() {
    let quiet = frames(&mut Random::new(6), 1e-6);
    let of = |frames: &Array2<f64>| noise_std_of_quiet_frames(frames.view());
    let two = quiet.slice_axis(Axis(0), Slice::from(..2)).to_owned();
    refused!(of(&two), WrongLength { found: 2, wanted: 3, .. });
    let mut nan = quiet.clone();
    nan[(7, 11)] = f64::NAN;
    refused!(of(&nan), NonFiniteData { frame: 7, measurement: 11, .. });
    // nothing changes, and the values do not show a step
    for value in [0.0, 0.3] {
        refused!(of(&Array2::from_elem((FRAMES, CHANNELS), value)), OutOfRange { .. });
    }
}
