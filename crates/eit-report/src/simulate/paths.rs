//! Random closed paths of fingers that never meet.
//!
//! Each of n fingers has a round territory of its own. With `R` 0.8 of the skin's radius, `s` the
//! bell's standard deviation and n >= 2, the territories' centres stand on a circle of radius
//! `R - rho` at equal angles, and
//!
//! ```text
//! rho = (R sin(pi / n) - 2 s) / (1 + sin(pi / n))
//! ```
//!
//! makes neighbouring territories exactly 4 s apart; one finger has the whole circle. Inside its
//! territory a finger runs an epicycle `m + a (e^(i d u) + b e^(i k u + i w))` with random centre
//! `m`, size `a (1 + b)`, sense `d`, and 2 or 3 turns `k` of the small circle to one of the large.
//! `b <= 1/4` keeps `|dp/du| >= a / 4`: the path bends now more, now less, and has no corners.

use super::settings::SequenceSettings;
use crate::error::ReportError;
use eit_fem::fabric::Random;
use eit_mesh::SkinShape;
use eit_skin::scene::MeshSource;
use std::f64::consts::{PI, TAU};

/// Part of the skin's radius that fingers stay inside: nearer to the rim, a bell of 12 mm on a
/// skin of 0.1 m would be cut by it.
const INSIDE: f64 = 0.8;
/// Smallest distance of two fingers, standard deviations of the bell. The sum of two bells has two
/// tops from 2 on; at 4, the middle between them is at 27 % of the tops.
const APART: f64 = 4.0;
/// Most fingers.
const MOST_TOUCHES: usize = 4;
/// Most frames of a simulated sequence: more are probably a typing error.
const MOST_FRAMES: usize = 1_000_000;
/// Chords that stand for a path when its length is measured: their sum is short by less than 1e-5
/// of it, and a place between two of their ends is known to 3e-6 of the path's size.
const CHORDS: usize = 2048;

/// Places of the fingers, metres, `[frame][finger]`.
pub(super) fn positions_m(
    source: &MeshSource,
    settings: &SequenceSettings,
) -> Result<Vec<Vec<[f64; 2]>>, ReportError> {
    check(settings)?;
    let SequenceSettings { touches, frames, step_m, finger, path_seed, .. } = *settings;
    let FreeCircle { centre_m, radius_m } = free_circle(source)?;
    let reach_m = INSIDE * radius_m;
    let territory_m = territory_m(touches, reach_m, finger.sigma_m);
    if territory_m <= 0.0 {
        return Err(ReportError::input(format!(
            "{touches} fingers with a bell of {} m cannot stand {APART} standard deviations apart \
             within {reach_m} m of the skin's centre: take fewer or smaller ones",
            finger.sigma_m
        )));
    }
    if !(0.0..=territory_m).contains(&step_m) {
        return Err(ReportError::input(format!(
            "step_m is {step_m}: with {touches} touches it must be from 0 to {territory_m:.1e} m, \
             the radius that each has for itself"
        )));
    }
    let mut random = Random::named(path_seed, "paths", 0);
    let first_angle = random.between(0.0, TAU);
    let ring_m = if touches == 1 { 0.0 } else { reach_m - territory_m };
    let paths: Vec<Path> = (0..touches)
        .map(|k| {
            let (sin, cos) = (first_angle + TAU * k as f64 / touches as f64).sin_cos();
            let home = [centre_m[0] + ring_m * cos, centre_m[1] + ring_m * sin];
            Path::random(home, territory_m, &mut random)
        })
        .collect();
    let at = |frame: usize| paths.iter().map(|path| path.at(frame as f64 * step_m)).collect();
    Ok((0..frames).map(at).collect())
}

/// Rejects settings that fit no skin.
fn check(settings: &SequenceSettings) -> Result<(), ReportError> {
    let SequenceSettings { touches, frames, finger, .. } = *settings;
    let refuse = |what: String| Err(ReportError::input(what));
    if !(1..=MOST_TOUCHES).contains(&touches) {
        return refuse(format!("a touch sequence has 1 to {MOST_TOUCHES} touches, not {touches}"));
    }
    if !(1..=MOST_FRAMES).contains(&frames) {
        return refuse(format!("a touch sequence has 1 to {MOST_FRAMES} frames, not {frames}"));
    }
    if !(finger.sigma_m > 0.0 && finger.sigma_m.is_finite()) {
        return refuse(format!("finger.sigma_m is {}: it must be above zero", finger.sigma_m));
    }
    if !(finger.change > -1.0 && finger.change.is_finite()) {
        return refuse(format!(
            "finger.change is {}: a conductivity stays above zero with more than -1",
            finger.change
        ));
    }
    Ok(())
}

/// Radius of each finger's territory, metres; below zero where there is no room.
fn territory_m(touches: usize, reach_m: f64, sigma_m: f64) -> f64 {
    if touches == 1 {
        return reach_m;
    }
    let sin = (PI / touches as f64).sin();
    (reach_m * sin - 0.5 * APART * sigma_m) / (1.0 + sin)
}

/// The largest circle around the centroid of a skin that meets no rim.
struct FreeCircle {
    /// Metres.
    centre_m: [f64; 2],
    /// Distance to the nearest rim, metres.
    radius_m: f64,
}

/// The circle that fingers move in. From the outline alone, so that no mesh moves the fingers.
fn free_circle(source: &MeshSource) -> Result<FreeCircle, ReportError> {
    let MeshSource::Generated { shape, .. } = source else {
        return Err(ReportError::input(
            "a touch sequence needs a flat skin with an outline: disc, rectangle or polygon, not a mesh \
             file",
        ));
    };
    if let SkinShape::Hemisphere { .. } = shape {
        return Err(ReportError::input("a touch sequence needs a flat skin, not a hemisphere"));
    }
    let outline = shape.outline()?;
    let centre_m = outline.centre_m();
    let rims = outline.loops().iter();
    let radius_m = rims.map(|rim| rim.project(centre_m).1).fold(f64::INFINITY, f64::min);
    // turns of the rim around the centre: 1 inside, 0 outside or in a hole (which turns back)
    let turns: f64 = outline.loops().iter().map(|rim| turns(rim, centre_m, radius_m)).sum();
    if turns < 0.5 {
        return Err(ReportError::input(format!(
            "a touch sequence plays around the centroid of the outline, but ({}, {}) m is not on the \
             skin",
            centre_m[0], centre_m[1]
        )));
    }
    Ok(FreeCircle { centre_m, radius_m })
}

/// Times that a loop, at least `radius_m` away, goes around a point.
fn turns(rim: &eit_mesh::Loop, middle: [f64; 2], radius_m: f64) -> f64 {
    // chords shorter than the distance cannot pass on the other side of the point
    let chords = (2.0 * rim.length_m() / radius_m).clamp(3.0, 1e6).ceil();
    let from_middle = |k: usize| {
        let [x, y] = rim.point_at(k as f64 * rim.length_m() / chords);
        [x - middle[0], y - middle[1]]
    };
    let angle = |k: usize| {
        let (p, q) = (from_middle(k), from_middle(k + 1));
        (p[0] * q[1] - p[1] * q[0]).atan2(p[0] * q[0] + p[1] * q[1])
    };
    (0..chords as usize).map(angle).sum::<f64>() / TAU
}

/// An epicycle; see the module.
struct Path {
    middle: [f64; 2],
    large_m: f64,
    small_m: f64,
    sense: f64,
    turns: f64,
    phase: f64,
    /// Parameter at arc length 0.
    start: f64,
    /// Arc length at each of `CHORDS + 1` equal steps of the parameter, from 0.
    lengths_m: Vec<f64>,
}

impl Path {
    fn random(home: [f64; 2], territory_m: f64, random: &mut Random) -> Self {
        let size_m = territory_m * random.between(0.6, 0.95);
        let share = random.between(0.05, 0.25);
        let (sin, cos) = random.between(0.0, TAU).sin_cos();
        // equally likely everywhere that the size leaves free
        let off_m = (territory_m - size_m) * random.between(0.0, 1.0).sqrt();
        let mut sign = || if random.between(0.0, 1.0) < 0.5 { -1.0 } else { 1.0 };
        let (sense, turn_sense) = (sign(), sign());
        let large_m = size_m / (1.0 + share);
        let mut path = Self {
            middle: [home[0] + off_m * cos, home[1] + off_m * sin],
            large_m,
            small_m: share * large_m,
            sense,
            turns: turn_sense * random.between(2.0, 4.0).floor(),
            phase: random.between(0.0, TAU),
            start: random.between(0.0, TAU),
            lengths_m: vec![0.0],
        };
        let mut length_m = 0.0;
        for k in 0..CHORDS {
            let (p, q) = (path.point(path.parameter(k as f64)), path.parameter((k + 1) as f64));
            let q = path.point(q);
            length_m += (q[0] - p[0]).hypot(q[1] - p[1]);
            path.lengths_m.push(length_m);
        }
        path
    }

    fn parameter(&self, chord: f64) -> f64 {
        self.start + TAU * chord / CHORDS as f64
    }

    fn point(&self, u: f64) -> [f64; 2] {
        let (large_sin, large_cos) = (self.sense * u).sin_cos();
        let (small_sin, small_cos) = (self.turns * u + self.phase).sin_cos();
        [
            self.middle[0] + self.large_m * large_cos + self.small_m * small_cos,
            self.middle[1] + self.large_m * large_sin + self.small_m * small_sin,
        ]
    }

    /// The point at an arc length, going around again after the end; always on the path.
    fn at(&self, length_m: f64) -> [f64; 2] {
        let along = length_m.rem_euclid(self.lengths_m[CHORDS]);
        let k = self.lengths_m.partition_point(|l| *l <= along).clamp(1, CHORDS);
        let (before, after) = (self.lengths_m[k - 1], self.lengths_m[k]);
        let part = (along - before) / (after - before);
        self.point(self.parameter((k - 1) as f64 + part))
    }
}
