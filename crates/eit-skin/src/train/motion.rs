//! Fingers and fabrics of a learning base: everything that a net should not rely on is drawn anew.

use eit_fem::fabric::{
    FabricSettings, Finger, Interpolation, Key, PlayCircle, Random, Tip, TouchScript,
};
use std::f64::consts::TAU;

/// Frames a second, as in the built-in scripts.
const RATE_HZ: f64 = 10.0;
/// Frames before the first touch: reference and noise.
pub const QUIET: usize = 20;
/// Part of the radius up to which fingers press.
const REACH: f64 = 0.9;
/// Time to press and to lift, seconds.
const PRESS_S: f64 = 0.3;

/// Random numbers of one sequence and attempt.
pub fn random(seed: u64, sequence: usize, attempt: usize) -> Random {
    Random::stream(seed, (sequence as u128) << 16 | attempt as u128)
}

/// How many fingers a drawn script has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fingers {
    /// Always so many, 1 to [`MOST`].
    Always(usize),
    /// One in 35 % of the scripts, two in 40 %, three in 15 %, four in 10 %.
    Any,
}

/// Fingers of a script.
pub const MOST: usize = 4;
/// Part of the scripts with several fingers in which the second stays beside the first.
const PAIRS: f64 = 0.4;
/// Least distance of two fingers in radii of the larger tip, from centre to centre: fingertips that
/// nearly touch.
const APART: f64 = 2.2;
/// Fingers that are drawn before a script goes without one that finds no room.
const TRIES: usize = 40;

impl Fingers {
    fn draw(self, random: &mut Random) -> usize {
        let part = random.between(0.0, 1.0);
        match self {
            Self::Always(count) => count,
            Self::Any => [0.35, 0.75, 0.9].iter().filter(|bound| part >= **bound).count() + 1,
        }
    }
}

/// Fingers anywhere up to 90 % of the radius that tap, press, rest, slide from place to place and
/// lift, each at times of its own. They never overlap; often two stay side by side.
pub fn script(
    random: &mut Random,
    circle: &PlayCircle,
    frames: usize,
    fingers: Fingers,
) -> TouchScript {
    let count = fingers.draw(random);
    let mut script = TouchScript {
        name: "training".to_owned(),
        frame_rate_hz: RATE_HZ,
        frames,
        quiet_frames: QUIET,
        fingers: Vec::new(),
    };
    let pair = count > 1 && random.between(0.0, 1.0) < PAIRS;
    for id in 1..=count as u32 {
        for _ in 0..TRIES {
            let finger = match script.fingers.first() {
                Some(first) if pair && id == 2 => beside(random, circle, first),
                _ => finger(random, circle, id, frames),
            };
            script.fingers.push(finger);
            if are_apart(&script) {
                break;
            }
            script.fingers.pop();
        }
    }
    script
}

/// Whether no two fingers come nearer to each other than fingers can.
fn are_apart(script: &TouchScript) -> bool {
    (0..script.frames).all(|frame| {
        let touches = script.touches(frame);
        touches.iter().enumerate().all(|(k, a)| {
            touches[..k].iter().all(|b| {
                let [dx, dy] = [0, 1].map(|i| a.position_m[i] - b.position_m[i]);
                dx.hypot(dy) >= APART * a.radius_m.max(b.radius_m)
            })
        })
    })
}

/// A finger that follows another at its side.
fn beside(random: &mut Random, circle: &PlayCircle, first: &Finger) -> Finger {
    let apart = random.between(APART + 0.1, 6.0);
    let (mut angle, turn) = (random.between(0.0, TAU), random.between(-1.0, 1.0));
    let force = random.log_between(0.5, 2.0);
    let mut keys = first.keys.clone();
    for key in &mut keys {
        let distance_m = apart * key.radius_m;
        let place = [
            key.position_m[0] + distance_m * angle.cos(),
            key.position_m[1] + distance_m * angle.sin(),
        ];
        // along the rim where the place is off the skin
        let off = [place[0] - circle.centre_m[0], place[1] - circle.centre_m[1]];
        let inside = (REACH * circle.radius_m / off[0].hypot(off[1])).min(1.0);
        key.position_m = [0, 1].map(|i| circle.centre_m[i] + inside * off[i]);
        key.force_n *= force;
        angle += turn * random.between(0.0, 0.3);
    }
    Finger { id: 2, keys, ..first.clone() }
}

fn finger(random: &mut Random, circle: &PlayCircle, id: u32, frames: usize) -> Finger {
    let mut keys: Vec<Key> = Vec::new();
    let end_s = frames as f64 / RATE_HZ;
    let mut now_s = QUIET as f64 / RATE_HZ + random.between(0.0, 0.8);
    let interpolation = [Interpolation::Linear, Interpolation::Smooth][random.below(2)];
    while now_s + 2.0 * PRESS_S < end_s {
        let tip = 0.01_f64.min(0.15 * circle.radius_m);
        let (radius_m, force_n) = (tip * random.between(0.6, 1.3), random.log_between(0.2, 2.5));
        // a tap every third time
        let places = match random.below(3) {
            0 => 0,
            _ => 1 + random.below(4),
        };
        let last = keys.last().map(|key| key.position_m);
        for k in 0..=places {
            // equal areas are equally likely; a tap may come back to its place
            let again = k == 0 && random.below(3) == 0;
            let position_m = match last.filter(|_| again) {
                Some(last) => last,
                None => {
                    let r = random.between(0.0, REACH * REACH).sqrt() * circle.radius_m;
                    let angle = random.between(0.0, TAU);
                    [circle.centre_m[0] + r * angle.cos(), circle.centre_m[1] + r * angle.sin()]
                }
            };
            let mut key =
                |time_s, force_n| keys.push(Key { time_s, position_m, force_n, radius_m });
            if k == 0 {
                key(now_s, 0.0);
                now_s += PRESS_S;
            }
            key(now_s, force_n);
            now_s += random.between(0.02, 0.6);
            key(now_s, force_n);
            if k == places {
                now_s += PRESS_S;
                key(now_s, 0.0);
            } else {
                now_s += random.between(0.4, 2.5);
            }
        }
        now_s += random.between(0.1, 1.5);
    }
    Finger { id, tip: Tip::Round, interpolation, keys }
}

/// The scene's fabric with electrodes that give way more or less, and another weave, gain, noise
/// and drift.
pub fn fabric(random: &mut Random, scene: &FabricSettings) -> FabricSettings {
    let mut fabric = scene.clone();
    fabric.rim.compliance = (scene.rim.compliance * random.between(0.3, 1.3)).min(0.95);
    fabric.rim.contact_gain *= random.between(0.0, 2.0);
    fabric.membrane.friction *= random.between(0.2, 1.5);
    fabric.piezo.strain_gain *= random.between(0.7, 1.3);
    fabric.piezo.hysteresis = (scene.piezo.hysteresis * random.between(0.0, 2.0)).min(0.5);
    fabric.weave.amplitude *= random.between(0.2, 1.5);
    let drift = random.log_between(0.3, 3.0);
    fabric.drift.conductivity *= drift;
    fabric.drift.contact *= drift;
    let noise = random.log_between(0.5, 10.0);
    fabric.instrument.noise_v = scene.instrument.noise_v.map(|v| noise * v);
    fabric.instrument.gain_error *= random.log_between(0.3, 3.0);
    fabric
}

/// What the numbers above mean for a base: changes when they change.
pub const RECIPE: &str = "scripts 2, fabrics 1";
