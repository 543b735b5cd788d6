//! Random closed paths for fingers that never meet.
//!
//! Each of n fingers has its own circular territory. Let `R` be 0.8 of the play circle's radius and
//! `d` the smallest distance between two fingers. For n >= 2, the centres of the territories lie at
//! equal angles on a circle of radius `R - rho`, and the territories' radius
//!
//! ```text
//! rho = (R sin(pi / n) - d / 2) / (1 + sin(pi / n))
//! ```
//!
//! puts neighbouring territories exactly `d` apart. A single finger has the whole circle of radius
//! `R`. Within its territory a finger follows an epicycle `m + a (e^(i s u) + b e^(i k u + i w))`
//! with random centre `m`, size `a (1 + b)`, sense `s`, and `k` (2 or 3) turns of the small circle
//! per turn of the large one. `b <= 1/4` ensures `|dp/du| >= a / 4`, so the path varies in
//! curvature but has no corners.

use super::contact::Tip;
use super::play_circle::PlayCircle;
use super::script::{Finger, Interpolation, Key, TouchScript};
use crate::error::FemError;
use eit_core::Random;
use std::f64::consts::{PI, TAU};

/// Fraction of the play circle's radius that fingers stay within. Nearer to the rim, the rim would
/// cut off a bell of 12 mm on a skin of 0.1 m.
const INSIDE: f64 = 0.8;
/// Number of chords that approximate a path for its arc length. Their sum is too short by less than
/// a fraction 1e-5, and interpolated positions are accurate to 3e-6 of the path's size.
const CHORDS: usize = 2048;

/// Fingers on random closed paths. All move by the same path length per frame and press all the
/// time.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RandomPaths {
    /// Number of fingers, 1 to 4; all have the same tip and force.
    pub fingers: usize,
    /// Number of frames. A shorter script equals the start of a longer one.
    pub frames: usize,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Path length that every finger moves per frame, metres; 0: at rest.
    pub step_m: f64,
    /// Smallest distance between two fingers, metres.
    pub apart_m: f64,
    /// Shape of the fingers.
    pub tip: Tip,
    /// Radius of the fingertips, metres; see [`Tip`].
    pub radius_m: f64,
    /// Force of each finger, newton.
    pub force_n: f64,
    /// Seed; equal seeds give equal paths.
    pub seed: u64,
}

impl RandomPaths {
    /// Returns the script, with fingers numbered from 1. All positions lie within 0.8 of the
    /// circle's radius, and fingers are at least `apart_m` apart.
    ///
    /// # Errors
    /// [`FemError::OutOfRange`] for an invalid number of fingers or frames, or an invalid
    /// `apart_m`; [`FemError::NoRoom`] if the fingers do not fit into the circle;
    /// [`FemError::StepTooLong`].
    pub fn script(&self, circle: &PlayCircle) -> Result<TouchScript, FemError> {
        let (reach_m, territory_m) = self.room(circle)?;
        let mut random = Random::named(self.seed, "paths", 0);
        let first_angle = random.between(0.0, TAU);
        let ring_m = if self.fingers == 1 { 0.0 } else { reach_m - territory_m };
        let fingers = (0..self.fingers).map(|k| {
            let (sin, cos) = (first_angle + TAU * k as f64 / self.fingers as f64).sin_cos();
            let [x, y] = circle.centre_m;
            let home = [x + ring_m * cos, y + ring_m * sin];
            self.finger(k as u32 + 1, &Path::random(home, territory_m, &mut random))
        });
        Ok(TouchScript {
            name: "random-paths".to_owned(),
            frame_rate_hz: self.frame_rate_hz,
            frames: self.frames,
            quiet_frames: 0,
            fingers: fingers.collect(),
        })
    }

    /// Radius of the circle that contains all fingers, and of each finger's territory, metres.
    fn room(&self, circle: &PlayCircle) -> Result<(f64, f64), FemError> {
        let Self { fingers, frames, step_m, apart_m, .. } = *self;
        let few = (1..=4).contains(&fingers);
        FemError::require("fingers", fingers as f64, few, "from 1 to 4")?;
        // more are probably a typing error
        let some = (1..=1_000_000).contains(&frames);
        FemError::require("frames", frames as f64, some, "from 1 to 1000000")?;
        FemError::require("apart_m", apart_m, apart_m >= 0.0, "finite and at least zero")?;
        let reach_m = INSIDE * circle.radius_m;
        let territory_m = match fingers {
            1 => reach_m,
            _ => {
                let sin = (PI / fingers as f64).sin();
                (reach_m * sin - 0.5 * apart_m) / (1.0 + sin)
            }
        };
        if territory_m <= 0.0 {
            return Err(FemError::NoRoom { fingers, apart_m, reach_m });
        }
        if !(0.0..=territory_m).contains(&step_m) {
            return Err(FemError::StepTooLong { step_m, fingers, most_m: territory_m });
        }
        Ok((reach_m, territory_m))
    }

    /// Creates a finger with a key at every frame.
    fn finger(&self, id: u32, path: &Path) -> Finger {
        let key = |frame: usize| Key {
            time_s: frame as f64 / self.frame_rate_hz,
            position_m: path.at(frame as f64 * self.step_m),
            force_n: self.force_n,
            radius_m: self.radius_m,
        };
        let keys = (0..self.frames).map(key).collect();
        Finger { id, tip: self.tip, interpolation: Interpolation::Linear, keys }
    }
}

/// An epicycle; see the module documentation.
struct Path {
    middle: [f64; 2],
    large_m: f64,
    small_m: f64,
    sense: f64,
    turns: f64,
    phase: f64,
    /// Parameter at arc length 0.
    start: f64,
    /// Arc length at `CHORDS + 1` equally spaced values of the parameter, from 0.
    lengths_m: Vec<f64>,
}

impl Path {
    fn random(home: [f64; 2], territory_m: f64, random: &mut Random) -> Self {
        let size_m = territory_m * random.between(0.6, 0.95);
        let share = random.between(0.05, 0.25);
        let (sin, cos) = random.between(0.0, TAU).sin_cos();
        // uniformly distributed over the area that the size leaves free
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
            let [p, q] = [k, k + 1].map(|k| path.point(path.parameter(k as f64)));
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

    /// Returns the point at an arc length, wrapping around at the end. It lies on the path exactly.
    fn at(&self, length_m: f64) -> [f64; 2] {
        let along = length_m.rem_euclid(self.lengths_m[CHORDS]);
        let k = self.lengths_m.partition_point(|l| *l <= along).clamp(1, CHORDS);
        let (before, after) = (self.lengths_m[k - 1], self.lengths_m[k]);
        let part = (along - before) / (after - before);
        self.point(self.parameter((k - 1) as f64 + part))
    }
}
