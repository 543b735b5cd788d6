//! One closed loop of an outline.

use super::piece::Piece;
use super::{distance, signed_area};
use std::f64::consts::TAU;

/// One closed loop of an outline, the skin on its left: the outer loop counter-clockwise, holes
/// clockwise.
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

    /// Whether a point lies inside the loop. It must be clear of it.
    pub(super) fn is_around(&self, point_m: [f64; 2]) -> bool {
        let crossings = self.pieces.iter().filter(|piece| match **piece {
            // an arc is a whole circle
            Piece::Arc { centre, radius, .. } => distance(centre, point_m) < radius,
            Piece::Line { from, to } => {
                (from[1] > point_m[1]) != (to[1] > point_m[1])
                    && point_m[0]
                        < from[0] + (point_m[1] - from[1]) / (to[1] - from[1]) * (to[0] - from[0])
            }
        });
        crossings.count() % 2 == 1
    }

    /// Length once around, metres.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// The point at an arc length from the start of the loop, metres; lengths beyond the end
    /// (or below zero) go around again.
    pub fn point_at(&self, arc_length_m: f64) -> [f64; 2] {
        let s = arc_length_m.rem_euclid(self.length_m);
        let piece = self.piece_at(s);
        self.pieces[piece].point_at(s - self.starts_m[piece])
    }

    /// Whether the loop is curved at an arc length from its start.
    pub(crate) fn bends_at(&self, arc_length_m: f64) -> bool {
        let piece = self.piece_at(arc_length_m.rem_euclid(self.length_m));
        matches!(self.pieces[piece], Piece::Arc { .. })
    }

    /// The nearest point of the loop: its arc length and the distance to it, metres.
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

    /// Arc lengths of the corners, metres, ascending. A full circle has none.
    pub(crate) fn corners_m(&self) -> &[f64] {
        match self.pieces[..] {
            [Piece::Arc { .. }] => &[],
            _ => &self.starts_m,
        }
    }

    /// Whether the skin's angle at a corner is above 210 degrees: less is a corner of a polygon that
    /// stands for a curve.
    pub(crate) fn points_in(&self, corner_m: f64) -> bool {
        let piece = self.piece_at(corner_m);
        let before = (piece + self.pieces.len() - 1) % self.pieces.len();
        let (Piece::Line { from: a, .. }, Piece::Line { from: b, to: c }) =
            (&self.pieces[before], &self.pieces[piece])
        else {
            return false;
        };
        let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - b[0], c[1] - b[1]]);
        // the skin is on the left: a turn to the right
        let turn_rad = (u[0] * v[1] - u[1] * v[0]).atan2(u[0] * v[0] + u[1] * v[1]);
        turn_rad < -TAU / 12.0
    }

    /// Largest edge that keeps a chord within 30 degrees of arc, so that even a coarse mesh
    /// has the shape of the skin; infinite where the loop is straight. Metres.
    pub(crate) fn largest_chord_m(&self) -> f64 {
        let chord = |piece: &Piece| match *piece {
            Piece::Line { .. } => f64::INFINITY,
            Piece::Arc { radius, .. } => radius * TAU / 12.0,
        };
        self.pieces.iter().map(chord).fold(f64::INFINITY, f64::min)
    }

    /// Index of the piece at an arc length between zero and the length.
    pub(super) fn piece_at(&self, s: f64) -> usize {
        self.starts_m.partition_point(|&start| start <= s).saturating_sub(1)
    }

    /// Outermost point seen from `origin` at an angle: its arc length.
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
