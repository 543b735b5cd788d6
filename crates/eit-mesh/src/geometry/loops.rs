//! One closed loop of an outline.

use super::piece::Piece;
use super::{cross, distance, dot, signed_area};
use std::f64::consts::TAU;

/// Chosen so that the corners of a regular polygonal hole with eight or more sides do not count:
/// near such a corner the potential varies as the power 0.78 of the distance, almost as at a smooth
/// rim.
const REACHES_IN_DEG: f64 = 50.0;

/// One closed loop of an outline, with the skin on its left: the outer loop runs counter-clockwise,
/// holes run clockwise.
#[derive(Debug, Clone, PartialEq)]
pub struct Loop {
    pub(super) pieces: Vec<Piece>,
    /// Arc length at which each piece starts.
    pub(super) starts_m: Vec<f64>,
    length_m: f64,
}

impl Loop {
    pub(super) fn new(pieces: Vec<Piece>) -> Self {
        let mut length_m = 0.0;
        let mut starts_m = Vec::with_capacity(pieces.len());
        for piece in &pieces {
            starts_m.push(length_m);
            length_m += piece.length();
        }
        Self { pieces, starts_m, length_m }
    }

    pub(super) fn polygon(corners: &[[f64; 2]], counterclockwise: bool) -> Self {
        let mut corners = corners.to_vec();
        if (signed_area(&corners) > 0.0) != counterclockwise {
            corners.reverse();
        }
        let next = corners.iter().cycle().skip(1);
        Self::new(corners.iter().zip(next).map(|(&from, &to)| Piece::Line { from, to }).collect())
    }

    /// Whether a point lies inside the loop. The point must not lie on the loop.
    pub(super) fn is_around(&self, point_m: [f64; 2]) -> bool {
        let crossings = self.pieces.iter().filter(|piece| match **piece {
            // an arc is always a full circle
            Piece::Arc { centre, radius, .. } => distance(centre, point_m) < radius,
            Piece::Line { from, to } => {
                (from[1] > point_m[1]) != (to[1] > point_m[1])
                    && point_m[0]
                        < from[0] + (point_m[1] - from[1]) / (to[1] - from[1]) * (to[0] - from[0])
            }
        });
        crossings.count() % 2 == 1
    }

    /// Length of the loop, metres.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Returns the point at an arc length (metres) from the start of the loop; lengths below zero
    /// or beyond the end wrap around.
    pub(crate) fn point_at(&self, arc_length_m: f64) -> [f64; 2] {
        let s = arc_length_m.rem_euclid(self.length_m);
        let piece = self.piece_at(s);
        self.pieces[piece].point_at(s - self.starts_m[piece])
    }

    /// Whether the loop is curved at the given arc length.
    pub(crate) fn bends_at(&self, arc_length_m: f64) -> bool {
        let piece = self.piece_at(arc_length_m.rem_euclid(self.length_m));
        matches!(self.pieces[piece], Piece::Arc { .. })
    }

    /// Returns the arc length of the nearest point of the loop and the distance to it, metres.
    pub fn project(&self, point_m: [f64; 2]) -> (f64, f64) {
        let mut nearest = (0.0, f64::INFINITY);
        for (piece, start) in self.pieces.iter().zip(&self.starts_m) {
            let (s, off) = piece.project(point_m);
            if off < nearest.1 {
                nearest = (start + s, off);
            }
        }
        nearest
    }

    /// Arc lengths of the corners, metres, in ascending order. A full circle has none.
    pub(crate) fn corners_m(&self) -> &[f64] {
        match self.pieces[..] {
            [Piece::Arc { .. }] => &[],
            _ => &self.starts_m,
        }
    }

    /// Whether the corner with this index ([`Loop::corners_m`]) is re-entrant, so that the current
    /// density is unbounded there: the angle of the skin exceeds 180 degrees by at least
    /// [`REACHES_IN_DEG`].
    pub(crate) fn reaches_in(&self, corner: usize) -> bool {
        let count = self.pieces.len();
        let (before, after) = (self.pieces[(corner + count - 1) % count], self.pieces[corner]);
        let (Piece::Line { from: a, to: b }, Piece::Line { from: c, to: d }) = (before, after)
        else {
            return false;
        };
        let (way, next) = ([b[0] - a[0], b[1] - a[1]], [d[0] - c[0], d[1] - c[1]]);
        // the skin is on the left
        let right_turn_rad = (-cross(way, next)).atan2(dot(way, next));
        right_turn_rad >= REACHES_IN_DEG.to_radians()
    }

    /// Longest edge whose chord spans at most 30 degrees of arc, so that even a coarse mesh has the
    /// shape of the skin; infinite if the loop is straight. Metres.
    pub(crate) fn largest_chord_m(&self) -> f64 {
        let chord = |piece: &Piece| match *piece {
            Piece::Line { .. } => f64::INFINITY,
            Piece::Arc { radius, .. } => radius * TAU / 12.0,
        };
        self.pieces.iter().map(chord).fold(f64::INFINITY, f64::min)
    }

    /// Index of the piece at an arc length between zero and the length of the loop.
    pub(super) fn piece_at(&self, s: f64) -> usize {
        self.starts_m.partition_point(|&start| start <= s).saturating_sub(1)
    }

    /// Arc length of the outermost point at an angle, seen from `origin`.
    pub(super) fn outermost_at(&self, origin: [f64; 2], angle_rad: f64) -> Option<f64> {
        let along = [angle_rad.cos(), angle_rad.sin()];
        self.pieces
            .iter()
            .zip(&self.starts_m)
            .filter_map(|(piece, start)| {
                piece.outermost_hit(origin, along).map(|(s, reach)| (start + s, reach))
            })
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(s, _)| s)
    }
}
