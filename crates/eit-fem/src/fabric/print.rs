//! Prints of fingers: an ellipse of the round contact's area whose axes change with the force, and which rolls and turns.
//!
//! With `x` along the long axis and `q` the ratio of the axes, a place `(x, y)` has the pressure and strain that the round
//! dent has at the distance `hypot(x / sqrt(q), y sqrt(q))`. That map keeps areas, so the force and the integral of the
//! response stay the same.

use super::script::Touch;
use super::settings::Print;
use super::stream::Purpose;
use std::f64::consts::{PI, TAU};

/// An elliptic print at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ellipse {
    pub centre_m: [f64; 2],
    /// Unit vector along the long axis.
    pub axis: [f64; 2],
    /// Square root of the ratio of its axes.
    pub stretch: f64,
}

impl Print {
    /// Print of a touch.
    pub(super) fn at(&self, touch: &Touch, time_s: f64, seed: u64) -> Ellipse {
        let mut random = Purpose::Print.stream(seed, touch.finger as usize);
        let (mean, phase) = (random.between(0.0, PI), random.between(0.0, TAU));
        let (sin, cos) = (TAU * time_s / self.roll_s + phase).sin_cos();
        let (y, x) = (mean + (self.roll_deg * cos).to_radians()).sin_cos();
        let [x_m, y_m] = touch.position_m;
        let soft = if self.squash_n > 0.0 { (-touch.force_n / self.squash_n).exp() } else { 0.0 };
        Ellipse {
            centre_m: [x_m - self.roll_m * sin * y, y_m + self.roll_m * sin * x],
            axis: [x, y],
            stretch: (1.0 + (self.ratio - 1.0) * (1.0 - soft)).sqrt(),
        }
    }
}
