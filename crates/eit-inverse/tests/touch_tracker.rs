//! Names, births, ends and velocities of detected touches, with touches that no detector made.

#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::panic,
    reason = "a test file: a panic is a failed test"
)]

use eit_inverse::InverseError;
use eit_inverse::touch::{DetectedTouch, Touch, TouchState, TouchTracker, TrackerSettings};
use fixtures::Random;

const DT_S: f64 = 0.05;

/// Strength from which a touch is believed at once, S m^2.
const STRONG: f64 = 6e-6;
const WEAK: f64 = 0.5 * STRONG;

fn touch(x_m: f64, y_m: f64, strength_s_m2: f64) -> DetectedTouch {
    let mut position_covariance_m2 = [[0.0; 3]; 3];
    (0..2).for_each(|i| position_covariance_m2[i][i] = 1e-6);
    DetectedTouch {
        position_m: [x_m, y_m, 0.0],
        position_covariance_m2,
        strength_s_m2,
        strength_std_s_m2: 1e-7,
        peak_s: strength_s_m2 / 1.5e-4,
        worth: 5.0,
    }
}

/// A tracker and its clock.
struct Bench {
    tracker: TouchTracker,
    frame: u32,
}

impl Bench {
    fn new(change: impl Fn(&mut TrackerSettings)) -> Self {
        let mut settings = TrackerSettings::with_strong(STRONG);
        change(&mut settings);
        Self { tracker: TouchTracker::new(settings).unwrap(), frame: 0 }
    }

    fn push(&mut self, found: &[DetectedTouch]) -> Vec<Touch> {
        self.frame += 1;
        self.tracker.push(found, DT_S * f64::from(self.frame), true).unwrap().to_vec()
    }
}

/// Seventeen at places of their own.
fn seventeen() -> Vec<DetectedTouch> {
    (0..17).map(|k| touch(0.1 * f64::from(k), 0.0, WEAK)).collect()
}

#[test]
fn more_touches_than_fit_are_refused() {
    let mut bench = Bench::new(|_| ());
    bench.push(&seventeen()[..16]);
    let mut untroubled = bench.tracker.clone();
    let refused = bench.tracker.push(&seventeen(), 1.0, true).unwrap_err();
    assert_eq!(refused, InverseError::TooManyTouches { found: 17, most: 16 });
    // as before: the second frame of weak ones names as many as there may be
    let frame = &seventeen()[..16];
    let touches = bench.tracker.push(frame, 1.0, true).unwrap();
    assert_eq!(touches.len(), 8);
    assert_eq!(touches, untroubled.push(frame, 1.0, true).unwrap());
    // settings that allow more have room for more
    let mut roomy = Bench::new(|settings| settings.max_touches = 20);
    assert!(roomy.tracker.push(&seventeen(), 1.0, true).is_ok());
}

/// Touches that jump while old ones are long forgiven fill all there is room for.
#[test]
fn crowds_neither_panic_nor_exceed_the_most() {
    let mut bench = Bench::new(|settings| settings.forgiven_frames = 20);
    let mut random = Random::new(1);
    for _ in 0..400 {
        let found: Vec<DetectedTouch> = (0..random.below(17))
            .map(|_| touch(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 2.0 * WEAK))
            .collect();
        let touches = bench.push(&found);
        assert!(touches.iter().filter(|t| t.state != TouchState::End).count() <= 8);
        assert!(touches.windows(2).all(|pair| pair[0].id < pair[1].id));
    }
}

/// A clone bears touches as its original does, whether it was made before any or in between.
#[test]
fn clones_follow_as_their_originals_do() {
    let frame: Vec<DetectedTouch> =
        (0..5).map(|k| touch(0.1 * f64::from(k), 0.0, STRONG)).collect();
    let mut bench = Bench::new(|_| ());
    let mut early = bench.tracker.clone();
    assert_eq!(early.push(&frame, DT_S, true).unwrap(), bench.push(&frame));
    assert_eq!(early.touches().len(), 5);
    let mut late = bench.tracker.clone();
    let more = [&frame[..], &[touch(0.9, 0.0, STRONG)]].concat();
    assert_eq!(late.push(&more, 2.0 * DT_S, true).unwrap(), bench.push(&more));
    assert_eq!(late.touches().len(), 6);
}
