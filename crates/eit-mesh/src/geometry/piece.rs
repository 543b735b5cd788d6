//! The pieces of a loop, measured by arc length.

use super::{RESOLUTION, cross, distance, dot};
use std::f64::consts::TAU;

/// A straight line or a circular arc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Piece {
    Line { from: [f64; 2], to: [f64; 2] },
    Arc { centre: [f64; 2], radius: f64, from_rad: f64, sweep_rad: f64 },
}

impl Piece {
    pub(super) fn length(&self) -> f64 {
        match *self {
            Self::Line { from, to } => distance(from, to),
            Self::Arc { radius, sweep_rad, .. } => radius * sweep_rad.abs(),
        }
    }

    /// Returns the point at an arc length from the start of the piece.
    pub(super) fn point_at(&self, arc_length: f64) -> [f64; 2] {
        match *self {
            Self::Line { from, to } => {
                let t = arc_length / distance(from, to);
                [from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])]
            }
            Self::Arc { centre, radius, from_rad, sweep_rad } => {
                let (sin, cos) = (from_rad + sweep_rad.signum() * arc_length / radius).sin_cos();
                [centre[0] + radius * cos, centre[1] + radius * sin]
            }
        }
    }

    /// Arc length of the nearest point of the piece, and the distance to it.
    pub(super) fn project(&self, point: [f64; 2]) -> (f64, f64) {
        let arc_length = match *self {
            Self::Line { from, to } => {
                let along = [to[0] - from[0], to[1] - from[1]];
                let to_point = [point[0] - from[0], point[1] - from[1]];
                let squared = along[0] * along[0] + along[1] * along[1];
                let t = (along[0] * to_point[0] + along[1] * to_point[1]) / squared;
                t.clamp(0.0, 1.0) * squared.sqrt()
            }
            Self::Arc { centre, radius, from_rad, sweep_rad } => {
                let angle = (point[1] - centre[1]).atan2(point[0] - centre[0]);
                let turned = (sweep_rad.signum() * (angle - from_rad)).rem_euclid(TAU);
                let sweep = sweep_rad.abs();
                // outside the arc, use the nearer of its two ends
                let beyond = 0.5 * (TAU + sweep);
                radius
                    * if turned <= sweep {
                        turned
                    } else if turned < beyond {
                        sweep
                    } else {
                        0.0
                    }
            }
        };
        (arc_length, distance(self.point_at(arc_length), point))
    }

    /// Arc length of the outermost point on the ray from `origin` along the unit vector `along`,
    /// and its distance from `origin`.
    pub(super) fn outermost_hit(&self, origin: [f64; 2], along: [f64; 2]) -> Option<(f64, f64)> {
        let start = match *self {
            Self::Line { from, .. } => from,
            Self::Arc { centre, .. } => centre,
        };
        let to_start = [start[0] - origin[0], start[1] - origin[1]];
        let reach = match *self {
            Self::Line { from, to } => {
                let side = [to[0] - from[0], to[1] - from[1]];
                cross(to_start, side) / cross(along, side)
            }
            Self::Arc { radius, .. } => {
                let (ahead, aside) = (dot(to_start, along), cross(along, to_start));
                ahead + (radius * radius - aside * aside).sqrt()
            }
        };
        let point = [origin[0] + reach * along[0], origin[1] + reach * along[1]];
        let (arc_length, off) = self.project(point);
        // a ray through a corner may miss both sides by rounding; NaN (parallel) is not a hit
        (reach >= 0.0 && off <= RESOLUTION * self.length()).then_some((arc_length, reach))
    }
}
