//! Random fingers and fabrics of a learning base: everything that a net must not rely on is drawn.

use eit_fem::fabric::{
    FabricSettings, Finger, Interpolation, Key, PlayCircle, Random, Tip, TouchScript,
};
use std::f64::consts::TAU;

/// Frames per second, as in the built-in scripts.
pub(crate) const RATE_HZ: f64 = 10.0;
/// Frames before the first touch: reference and noise.
pub(crate) const QUIET: usize = 20;
/// Fraction of the skin's radius within which fingers press.
const REACH: f64 = 0.97;
/// Radius of a tip divided by that of a usual fingertip (10 mm on the paper's skin).
const TIPS: [f64; 2] = [0.4, 2.5];
/// Range of tips that count as usual ones.
const USUAL_TIPS: [f64; 2] = [0.8, 1.25];
/// Force of a press, newton.
const FORCES_N: [f64; 2] = [0.2, 2.5];
/// Largest force over a tip's cross-section, pascal: 1 N on a tip of 4 mm. The contact model ends where a
/// finger sinks in so deep that the edge of the contact is vertical.
const MOST_PA: f64 = 2e4;
/// Time to press and to lift, seconds.
const PRESS_S: f64 = 0.3;

/// Random numbers of one attempt at a sequence.
pub(crate) fn random(seed: u64, sequence: usize, attempt: usize) -> Random {
    Random::stream(seed, (sequence as u128) << 16 | attempt as u128)
}

/// Number of fingers in a random script.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) enum Fingers {
    /// Always this many, 1 to [`MOST`].
    Always(usize),
    /// One to six, with the probabilities of [`SHARES`].
    Any,
}

/// Largest number of fingers in a script.
pub(crate) const MOST: usize = 6;
/// Fraction of the scripts with up to one, two, ... fingers.
const SHARES: [f64; MOST - 1] = [0.28, 0.56, 0.72, 0.84, 0.93];
/// Fraction of the scripts with several fingers in which the second stays beside the first.
const PAIRS: f64 = 0.4;
/// Least distance of two fingers in radii of the larger tip, from centre to centre: fingertips that
/// nearly touch.
const APART: f64 = 2.2;
/// Number of attempts to place a further finger before the script does without it.
const TRIES: usize = 40;

impl Fingers {
    fn draw(self, random: &mut Random) -> usize {
        let part = random.between(0.0, 1.0);
        match self {
            Self::Always(count) => count,
            Self::Any => SHARES.iter().filter(|bound| part >= **bound).count() + 1,
        }
    }
}

/// The fingers and tips of a random script.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hand {
    /// How many fingers touch at once.
    pub fingers: Fingers,
    /// Share of the scripts that certainly have usual tips, 0 to 1; the others have tips of any size.
    pub usual_tips: f64,
}

impl Hand {
    /// Draws the radius of the tips of a script, metres.
    fn tip_m(self, random: &mut Random, circle: &PlayCircle) -> f64 {
        // without the share nothing is drawn for it: bases made before it was known stay the same
        let is_usual = self.usual_tips > 0.0 && random.between(0.0, 1.0) < self.usual_tips;
        let [least, most] = if is_usual { USUAL_TIPS } else { TIPS };
        0.01_f64.min(0.15 * circle.radius_m) * random.log_between(least, most)
    }
}

/// Draws a script of fingers anywhere within 97 % of the radius that tap, press, rest, slide from place to
/// place and lift, each at its own times, all with tips of about the same size. They never overlap; often two
/// stay side by side.
pub(crate) fn script(
    random: &mut Random,
    circle: &PlayCircle,
    frames: usize,
    hand: Hand,
) -> TouchScript {
    let tip_m = hand.tip_m(random, circle);
    let count = hand.fingers.draw(random);
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
                _ => finger(random, circle, [id as usize, frames], tip_m),
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

/// Whether all fingers keep the distance that real ones must keep.
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

/// Draws a finger that stays beside another.
fn beside(random: &mut Random, circle: &PlayCircle, first: &Finger) -> Finger {
    // large tips find room near each other only
    let most =
        (0.8 * circle.radius_m / first.keys.first().map_or(1.0, |key| key.radius_m)).min(6.0);
    let apart = random.between(APART + 0.1, most.max(APART + 0.2));
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
        key.force_n = (key.force_n * force).min(most_n(key.radius_m));
        angle += turn * random.between(0.0, 0.3);
    }
    Finger { id: 2, keys, ..first.clone() }
}

/// Largest force on a tip, newton.
fn most_n(radius_m: f64) -> f64 {
    MOST_PA * 0.5 * TAU * radius_m * radius_m
}

fn finger(
    random: &mut Random,
    circle: &PlayCircle,
    [id, frames]: [usize; 2],
    tip_m: f64,
) -> Finger {
    let mut keys: Vec<Key> = Vec::new();
    let end_s = frames as f64 / RATE_HZ;
    let mut now_s = QUIET as f64 / RATE_HZ + random.between(0.0, 0.8);
    let interpolation = [Interpolation::Linear, Interpolation::Smooth][random.below(2)];
    while now_s + 2.0 * PRESS_S < end_s {
        let radius_m = tip_m * random.between(0.85, 1.15);
        let force_n = random.log_between(FORCES_N[0], FORCES_N[1]).min(most_n(radius_m));
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
    Finger { id: id as u32, tip: Tip::Round, interpolation, keys }
}

/// Fraction of the fabrics whose rim does not move at all.
const RIGID: f64 = 0.15;
/// Fraction of the fabrics with the scene's foundation, within 25 %.
const SAME_FOUNDATION: f64 = 0.4;
/// Stiffness of other foundations relative to the scene's: from almost nothing beneath the fabric to dense
/// foam.
const FOUNDATIONS: [f64; 2] = [1.0, 40.0];
/// Fraction of the sequences with about the scene's noise.
const SAME_NOISE: f64 = 0.5;
/// Other noise, decibel below the root mean square of the voltages.
const NOISE_DB: [f64; 2] = [48.0, 88.0];
/// Fraction of the sequences that lack measurements, half of them all those of one electrode.
const LACKING: f64 = 0.12;
/// Largest fraction of single measurements that such a sequence lacks.
const MOST_LACKING: f64 = 0.06;

/// Draws a variation of the scene's fabric: electrodes that move more, less or not at all, and another
/// foundation, weave, gain, noise and drift. `rms_v` is the root mean square of the untouched skin's voltages.
pub(crate) fn fabric(random: &mut Random, scene: &FabricSettings, rms_v: f64) -> FabricSettings {
    let mut fabric = scene.clone();
    match random.uniform() < RIGID {
        true => (fabric.rim.compliance, fabric.rim.contact_gain) = (0.0, 0.0),
        false => {
            fabric.rim.compliance = (scene.rim.compliance * random.between(0.2, 1.36)).min(0.95);
            fabric.rim.contact_gain *= random.between(0.0, 2.0);
        }
    }
    fabric.membrane.foundation_pa_per_m *= match random.uniform() < SAME_FOUNDATION {
        true => random.log_between(0.8, 1.25),
        false => random.log_between(FOUNDATIONS[0], FOUNDATIONS[1]),
    };
    fabric.membrane.friction *= random.between(0.2, 1.5);
    fabric.piezo.strain_gain *= random.between(0.7, 1.3);
    fabric.piezo.hysteresis = (scene.piezo.hysteresis * random.between(0.0, 2.0)).min(0.5);
    fabric.weave.amplitude *= random.between(0.2, 1.5);
    let drift = random.log_between(0.3, 3.0);
    fabric.drift.conductivity *= drift;
    fabric.drift.contact *= drift;
    fabric.instrument.noise_v = match random.uniform() < SAME_NOISE {
        true => {
            let noise = random.log_between(0.5, 10.0);
            scene.instrument.noise_v.map(|v| noise * v)
        }
        false => {
            let below = random.between(NOISE_DB[0], NOISE_DB[1]);
            [rms_v * 10.0_f64.powf(-below / 20.0); 2]
        }
    };
    fabric.instrument.gain_error *= random.log_between(0.3, 3.0);
    fabric
}

/// Draws the measurements that a sequence lacks from its first touch on, as indices of the protocol: none, all
/// that use one electrode, or some. `electrodes` are those that each measurement uses.
pub(crate) fn lacking(random: &mut Random, electrodes: &[Vec<u32>], count: usize) -> Vec<usize> {
    if random.uniform() >= LACKING {
        return Vec::new();
    }
    let all = 0..electrodes.len();
    if random.below(2) == 0 {
        let lost = random.below(count) as u32;
        return all.filter(|&i| electrodes[i].contains(&lost)).collect();
    }
    let part = random.between(0.0, MOST_LACKING);
    all.filter(|_| random.uniform() < part).collect()
}

/// Version of the constants above, recorded in the recipe of a base; increase it when they change.
pub(crate) const RECIPE: &str = "scripts 3, fabrics 2";

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of 200 scripts have a tip that is not within 25 % of 10 mm, and 15 % more from press to press.
    fn unusual(usual_tips: f64) -> usize {
        let circle = PlayCircle { centre_m: [0.0; 2], radius_m: 0.1 };
        let hand = Hand { fingers: Fingers::Any, usual_tips };
        let range = 0.01 * 0.85 * USUAL_TIPS[0]..=0.01 * 1.15 * USUAL_TIPS[1];
        let is_unusual = |seed: &u64| {
            let fingers = script(&mut random(*seed, 0, 0), &circle, 60, hand).fingers;
            let mut keys = fingers.iter().flat_map(|finger| &finger.keys);
            keys.any(|key| !range.contains(&key.radius_m))
        };
        (0..200).filter(is_unusual).count()
    }

    /// All tips are usual with a share of one; with a half there are about half as many others as without.
    #[test]
    fn the_share_of_usual_tips_is_kept() {
        let [all, half, none] = [1.0, 0.5, 0.0].map(unusual);
        assert_eq!(all, 0);
        // four standard deviations of 200 draws: 28
        assert!(none > 100 && half.abs_diff(none / 2) < 28, "{half} of {none}");
    }
}
