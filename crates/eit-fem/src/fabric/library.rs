//! Built-in touch scripts, scaled to the play circle of a skin.

use super::contact::Tip;
use super::play_circle::PlayCircle;
use super::script::{Finger, Interpolation, Key, TouchScript};
use super::stream::Purpose;
use crate::error::FemError;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

/// Frames per second of scripts that are not the paper's.
const RATE_HZ: f64 = 10.0;
/// Frames per second of the paper's: the instrument could measure 50, but the fabric allowed about one.
const PAPER_RATE_HZ: f64 = 1.0;
/// Number of frames before the first touch, enough to measure noise to 10 %.
const QUIET: usize = 20;
/// Number of frames after the last touch.
const REST: usize = 5;
/// Force of a light touch, newton.
const FORCE_N: f64 = 1.5;
/// Time to press and time to lift, seconds.
const PRESS_S: f64 = 0.3;

/// A finger that presses, moves through the given places and lifts.
fn along(id: u32, circle: &PlayCircle, start_s: f64, end_s: f64, places: &[[f64; 2]]) -> Finger {
    let radius_m = circle.tip_m();
    let key = |time_s, position_m, force_n| Key { time_s, position_m, force_n, radius_m };
    let last = places.len() - 1;
    let span_s = end_s - start_s - 2.0 * PRESS_S;
    let mut keys = vec![key(start_s, places[0], 0.0)];
    for (k, place) in places.iter().enumerate() {
        let part = k as f64 / last.max(1) as f64;
        keys.push(key(start_s + PRESS_S + part * span_s, *place, FORCE_N));
    }
    keys.push(key(end_s, places[last], 0.0));
    Finger { id, tip: Tip::Round, interpolation: Interpolation::Linear, keys }
}

/// A finger that taps at the given places with the given forces.
fn taps(id: u32, radius_m: f64, start_s: f64, period_s: f64, places: &[([f64; 2], f64)]) -> Finger {
    let mut keys = Vec::new();
    for (k, &(position_m, force_n)) in places.iter().enumerate() {
        let from = start_s + k as f64 * period_s;
        for (part, force_n) in [(0.0, 0.0), (0.3, force_n), (0.5, force_n), (0.8, 0.0)] {
            keys.push(Key { time_s: from + part * period_s, position_m, force_n, radius_m });
        }
    }
    Finger { id, tip: Tip::Round, interpolation: Interpolation::Smooth, keys }
}

impl TouchScript {
    /// Names of the built-in scripts. The first two follow the experiments of Duan, Taurand and
    /// Soleimani (Sci. Rep. 9:8831, 2019) with their 397 and 252 frames at one frame per second; the next two are
    /// like them, ten times as fast.
    pub const BUILT_IN: [&str; 9] = [
        "paper-one-finger",
        "paper-two-fingers",
        "one-finger",
        "two-fingers",
        "random",
        "press-and-hold",
        "tapping",
        "stroking",
        "closing-in",
    ];

    /// Returns a built-in script. Only "random" uses the seed.
    ///
    /// # Errors
    /// [`FemError::UnknownScript`].
    pub fn built_in(name: &str, circle: &PlayCircle, seed: u64) -> Result<Self, FemError> {
        let frame_rate_hz = if name.starts_with("paper-") { PAPER_RATE_HZ } else { RATE_HZ };
        let start_s = QUIET as f64 / frame_rate_hz;
        let end_s = |frames: usize| (frames - REST) as f64 / frame_rate_hz;
        let (frames, fingers) = match name {
            "paper-one-finger" => {
                (397, vec![along(1, circle, start_s, end_s(397), &paper_way(circle))])
            }
            "one-finger" => (397, vec![along(1, circle, start_s, end_s(397), &one_way(circle))]),
            "paper-two-fingers" | "two-fingers" => (252, two(circle, start_s, end_s(252))),
            "random" => (300, random(circle, start_s, end_s(300), seed)),
            "press-and-hold" => {
                let place = circle.at(0.4, 0.0);
                (150, vec![along(1, circle, start_s, 9.0, &[place, place])])
            }
            "tapping" => {
                let tap = |k: usize| (circle.at(0.5, k as f64 * 2.4), 0.4 + 0.2 * k as f64);
                let places: Vec<_> = (0..8).map(tap).collect();
                (150, vec![taps(1, circle.tip_m(), start_s, 1.5, &places)])
            }
            "stroking" => {
                let ends = [circle.at(0.7, PI), circle.at(0.7, 0.0)];
                let places = [ends[0], ends[1], ends[0], ends[1]];
                (150, vec![along(1, circle, start_s, 14.0, &places)])
            }
            "closing-in" => (200, closing_in(circle, start_s, 19.0)),
            _ => {
                let known = Self::BUILT_IN.join(", ");
                return Err(FemError::UnknownScript { name: name.to_owned(), known });
            }
        };
        let (name, mut fingers) = (name.to_owned(), fingers);
        let share = circle.force_share();
        for key in fingers.iter_mut().flat_map(|finger| &mut finger.keys) {
            key.force_n *= share;
        }
        Ok(Self { name, frame_rate_hz, frames, quiet_frames: QUIET, fingers })
    }
}

/// Places of one turn of `share` of the play circle, anticlockwise from `first_rad`, in steps of 5 degrees.
fn turn(circle: &PlayCircle, share: f64, first_rad: f64) -> impl Iterator<Item = [f64; 2]> {
    (0..=72).map(move |k| circle.at(share, first_rad + TAU * f64::from(k) / 72.0))
}

/// The way of the paper's finger: anticlockwise near the rim until snapshot 13 of 21, which are evenly spaced, then
/// towards the top left and through the centre. That the way at the rim is one turn, from the lower right, is assumed.
fn paper_way(circle: &PlayCircle) -> Vec<[f64; 2]> {
    let (rim, lower_right_rad) = (0.8, -FRAC_PI_4);
    // all steps take the same time: 72 at the rim are 12 of the 20 intervals between snapshots, 48 across are 8
    let across = (1..=48).map(|k| circle.at(rim * (1.0 - f64::from(k) / 24.0), lower_right_rad));
    turn(circle, rim, lower_right_rad).chain(across).collect()
}

/// One turn anticlockwise near the rim, starting at the top, then to the centre.
fn one_way(circle: &PlayCircle) -> Vec<[f64; 2]> {
    // the path to the centre has about the same speed
    let home = (1..=12).map(|k| circle.at(0.8 * (1.0 - f64::from(k) / 12.0), FRAC_PI_2));
    turn(circle, 0.8, FRAC_PI_2).chain(home).collect()
}

/// Two fingers opposite each other, one turn clockwise.
fn two(circle: &PlayCircle, start_s: f64, end_s: f64) -> Vec<Finger> {
    let finger = |id: u32, first: f64| {
        let places: Vec<[f64; 2]> =
            (0..=72).map(|k| circle.at(0.6, first - TAU * f64::from(k) / 72.0)).collect();
        along(id, circle, start_s, end_s, &places)
    };
    vec![finger(1, PI), finger(2, 0.0)]
}

/// Two fingers that approach until the fingertips nearly touch, wait and part.
fn closing_in(circle: &PlayCircle, start_s: f64, end_s: f64) -> Vec<Finger> {
    let near = 1.2 * circle.tip_m() / circle.radius_m;
    let finger = |id: u32, angle: f64| {
        let places = [0.6, near, near, 0.6].map(|part| circle.at(part, angle));
        along(id, circle, start_s, end_s, &places)
    };
    vec![finger(1, PI), finger(2, 0.0)]
}

/// Three fingers that press and lift at random, each within a third of the circle, so they never
/// meet.
fn random(circle: &PlayCircle, start_s: f64, end_s: f64, seed: u64) -> Vec<Finger> {
    let turn = Purpose::Script.stream(seed, 0).between(0.0, TAU);
    let finger = |id: u32| {
        let mut random = Purpose::Script.stream(seed, id as usize);
        let middle = turn + TAU * f64::from(id) / 3.0;
        let mut place =
            || circle.at(random.between(0.35, 0.75), middle + random.between(-0.7, 0.7));
        let places: Vec<[f64; 2]> = (0..16).map(|_| place()).collect();
        let mut keys = Vec::new();
        let mut now_s = start_s + random.between(0.0, 3.0);
        for pair in places.chunks_exact(2) {
            let (stay_s, force_n) = (random.between(1.0, 4.0), random.between(0.5, 2.0));
            if now_s + stay_s + 2.0 * PRESS_S > end_s {
                break;
            }
            let radius_m = circle.tip_m() * random.between(0.8, 1.2);
            let times = [0.0, PRESS_S, PRESS_S + stay_s, 2.0 * PRESS_S + stay_s];
            for (k, time_s) in times.into_iter().enumerate() {
                let force_n = if k == 1 || k == 2 { force_n } else { 0.0 };
                keys.push(Key {
                    time_s: now_s + time_s,
                    position_m: pair[k / 2],
                    force_n,
                    radius_m,
                });
            }
            now_s += times[3] + random.between(0.3, 2.0);
        }
        Finger { id, tip: Tip::Round, interpolation: Interpolation::Linear, keys }
    };
    (1..=3).map(finger).collect()
}
