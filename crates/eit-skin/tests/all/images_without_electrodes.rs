//! Images continue without an electrode that fails during a recording.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test file: a panic is a failed test"
)]

use crate::common;
use crate::common::Recording;
use crate::common::script::{Drawn, FIRST_S, distance_m};
use eit_skin::eit_fem::fabric::Random;
use eit_skin::{FittedFrames, Progress};
use std::f64::consts::TAU;

/// Electrode that breaks, from 0, ...
const BROKEN: usize = 5;
/// ... and the frame from which it is broken: 3 s after the quiet ones.
const BROKEN_FROM: usize = 100;

const SEEDS: [u64; 3] = [71, 81, 91];

/// Lighter fingers are still moving down or up, newton.
const FULL_N: f64 = 0.7;

/// Closer than this to the electrode, an image only shows what the others see from afar, metres.
const BLIND_M: f64 = 60e-3;

/// The image of a frame with a finger that presses.
struct Peak {
    /// Distance from the finger to the largest value of the one-step image, metres.
    error_m: f64,
    /// Distance from the finger to the broken electrode, metres.
    to_broken_m: f64,
}

fn peaks(recording: &Recording, fitted: &FittedFrames) -> Vec<Peak> {
    let mut progress = Progress::silent();
    let imaging = fitted.one_step(&mut progress).unwrap();
    let images = imaging.images(&fitted.frames, &mut progress).unwrap();
    // the first of 16 electrodes is at +y, the others follow counter-clockwise
    let (sin, cos) = (TAU * (0.25 + BROKEN as f64 / 16.0)).sin_cos();
    let broken = [0.1 * cos, 0.1 * sin];
    let full = recording.truth.iter().filter(|touch| touch.force_n >= FULL_N);
    full.map(|touch| {
        let image = images.frame(touch.frame).unwrap();
        let values = image.indexed_iter().filter(|(_, v)| v.is_finite());
        let ((row, column), _) = values.max_by(|a, b| a.1.total_cmp(b.1)).unwrap();
        Peak {
            error_m: distance_m(imaging.raster.centre_m(row, column), touch.position_m),
            to_broken_m: distance_m(broken, touch.position_m),
        }
    })
    .collect()
}

fn worst_m<'a>(peaks: impl IntoIterator<Item = &'a Peak>) -> f64 {
    peaks.into_iter().map(|peak| peak.error_m).fold(0.0, f64::max)
}

/// One finger presses six times after an electrode has opened. Without the values that the touch finder
/// excludes, images show the finger; with all values they show the electrode.
#[test]
fn images_go_on_without_an_open_electrode() {
    let (mut healthy, mut with, mut without) = (Vec::new(), Vec::new(), Vec::new());
    for seed in SEEDS {
        let mut drawn = Drawn::new(seed, 1);
        drawn.next_s = FIRST_S + 3.5;
        (0..6).for_each(|_| _ = drawn.press(0.8..2.0));
        let mut recording = Recording::simulate(&drawn.script(), seed);
        healthy.extend(peaks(&recording, &recording.fitted()));
        let end = recording.values.nrows();
        recording.open(BROKEN, BROKEN_FROM..end, &mut Random::new(seed));
        let mut fitted = recording.fitted();
        with.extend(peaks(&recording, &fitted));
        let before = fitted.frames.good.clone();
        recording.touches().leave_out(&mut fitted.frames);
        let good = &fitted.frames.good;
        // nothing before the fault, and soon after it all measurements of the electrode
        assert!(good.rows().into_iter().take(BROKEN_FROM).zip(before.rows()).all(|(a, b)| a == b));
        let lost = common::measurements_of(BROKEN);
        assert!(lost.iter().all(|&i| before[[BROKEN_FROM + 5, i]] && !good[[BROKEN_FROM + 5, i]]));
        without.extend(peaks(&recording, &fitted));
    }
    let of_all = [&healthy, &without].map(worst_m);
    let is_far = |peak: &&Peak| peak.to_broken_m > BLIND_M;
    let far_m = worst_m(without.iter().filter(is_far));
    let with = with.iter().filter(is_far);
    let nearest_m = with.map(|peak| peak.error_m).fold(f64::INFINITY, f64::min);
    println!(
        "worst {of_all:?} m healthy and without, {far_m} m far from it; with {nearest_m} m at best"
    );
    // error of one-step images near a rim, a tenth of the radius, plus a pixel; measured 12 mm
    assert!(of_all[0] < 15e-3 && far_m < 15e-3, "{of_all:?} {far_m}");
    // next to the missing electrode the peak is drawn inward: measured 27 mm
    assert!(of_all[1] < 35e-3, "{of_all:?}");
    // the measurements of the open electrode are brighter than any finger, and next to it
    assert!(nearest_m > 35e-3, "{nearest_m}");
}
