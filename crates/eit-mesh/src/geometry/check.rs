//! Checks a polygon before meshing; every error gives the position of the problem.

use super::{RESOLUTION, cross, distance, dot, signed_area};
use crate::MeshError;

/// Sharper spikes are rejected because the elements inside them would be as sharp.
const SHARPEST_CORNER_DEG: f64 = 1.0;

/// Checks that a length of the shape is positive, finite and in range.
///
/// The range keeps squares and their products far from overflow and underflow, and covers every
/// skin that can be made.
pub(super) fn in_range(quantity: &'static str, value: f64) -> Result<f64, MeshError> {
    let is_valid = (1e-9..=1e9).contains(&value);
    MeshError::check_range(is_valid, quantity, value, "between 1e-9 m and 1e9 m").map(|()| value)
}

fn bad<T>(at: [f64; 2], problem: &'static str) -> Result<T, MeshError> {
    Err(MeshError::BadOutline { x_m: at[0], y_m: at[1], problem })
}

/// Rejects everything that is not a polygon with holes.
pub(super) fn check_polygon(
    outline: &[[f64; 2]],
    holes: &[Vec<[f64; 2]>],
) -> Result<(), MeshError> {
    let loops: Vec<&[[f64; 2]]> =
        std::iter::once(outline).chain(holes.iter().map(Vec::as_slice)).collect();
    for corners in &loops {
        if let Some(&at) = corners.iter().find(|p| p.iter().any(|x| !x.is_finite())) {
            return bad(at, "every coordinate must be finite");
        }
        if corners.len() < 3 {
            let at = corners.first().copied().unwrap_or_default();
            return bad(at, "a loop needs at least three corners");
        }
    }
    let length: f64 = sides(outline).map(|[a, b]| distance(a, b)).sum();
    in_range("length of the outline in metres", length)?;
    if let Some(&at) = outline.iter().find(|p| p.iter().any(|x| x.abs() > 1e6 * length)) {
        return bad(at, "the outline is further from the origin than a million times its length");
    }
    for corners in &loops {
        check_corners(corners, RESOLUTION * length)?;
    }
    check_clearance(&loops, RESOLUTION * length)?;
    for (index, hole) in loops.iter().enumerate().skip(1) {
        if !is_inside(hole[0], outline) {
            return bad(hole[0], "a hole must lie inside the outline");
        }
        let inside_other = loops
            .iter()
            .enumerate()
            .skip(1)
            .any(|(other, corners)| other != index && is_inside(hole[0], corners));
        if inside_other {
            return bad(hole[0], "a hole lies inside another hole");
        }
    }
    if signed_area(outline) == 0.0 {
        return bad(outline[0], "the outline encloses no area");
    }
    Ok(())
}

fn sides(corners: &[[f64; 2]]) -> impl Iterator<Item = [[f64; 2]; 2]> + '_ {
    (0..corners.len()).map(|k| [corners[k], corners[(k + 1) % corners.len()]])
}

/// Rejects repeated corners and spikes.
fn check_corners(corners: &[[f64; 2]], resolution: f64) -> Result<(), MeshError> {
    let n = corners.len();
    for k in 0..n {
        let (before, at, after) = (corners[(k + n - 1) % n], corners[k], corners[(k + 1) % n]);
        if distance(at, after) <= resolution {
            return bad(
                at,
                "two successive corners are at the same position (a loop closes automatically: \
                 omit the repeated first corner)",
            );
        }
        let back = [before[0] - at[0], before[1] - at[1]];
        let ahead = [after[0] - at[0], after[1] - at[1]];
        let angle_rad = cross(back, ahead).abs().atan2(dot(back, ahead));
        if angle_rad < SHARPEST_CORNER_DEG.to_radians() {
            return bad(at, "a spike sharper than one degree cannot be meshed: blunt it");
        }
    }
    Ok(())
}

/// Rejects sides that cross or touch, within a loop and between loops.
fn check_clearance(loops: &[&[[f64; 2]]], resolution: f64) -> Result<(), MeshError> {
    let all: Vec<(usize, usize, [[f64; 2]; 2])> = loops
        .iter()
        .enumerate()
        .flat_map(|(l, corners)| sides(corners).enumerate().map(move |(k, side)| (l, k, side)))
        .collect();
    for (i, &(loop_a, a, side_a)) in all.iter().enumerate() {
        for &(loop_b, b, side_b) in &all[i + 1..] {
            let n = loops[loop_a].len();
            let neighbours = loop_a == loop_b && (b == a + 1 || (a == 0 && b + 1 == n));
            if !neighbours && let Some(at) = meeting_point(side_a, side_b, resolution) {
                return bad(at, "two sides cross or touch here: keep them apart");
            }
        }
    }
    Ok(())
}

/// Returns a point where two segments come closer than `resolution`, if there is one.
fn meeting_point(a: [[f64; 2]; 2], b: [[f64; 2]; 2], resolution: f64) -> Option<[f64; 2]> {
    let apart = |k: usize| {
        let (a_low, a_high) = (a[0][k].min(a[1][k]), a[0][k].max(a[1][k]));
        let (b_low, b_high) = (b[0][k].min(b[1][k]), b[0][k].max(b[1][k]));
        a_low > b_high + resolution || b_low > a_high + resolution
    };
    if apart(0) || apart(1) {
        return None;
    }
    let side = |s: [[f64; 2]; 2], p: [f64; 2]| {
        cross([s[1][0] - s[0][0], s[1][1] - s[0][1]], [p[0] - s[0][0], p[1] - s[0][1]])
    };
    let (p, q) = (side(b, a[0]), side(b, a[1]));
    if p * q < 0.0 && side(a, b[0]) * side(a, b[1]) < 0.0 {
        let t = p / (p - q);
        return Some(std::array::from_fn(|k| a[0][k] + t * (a[1][k] - a[0][k])));
    }
    let line = |s: [[f64; 2]; 2]| super::piece::Piece::Line { from: s[0], to: s[1] };
    [(a, b[0]), (a, b[1]), (b, a[0]), (b, a[1])]
        .into_iter()
        .find(|&(s, end)| line(s).project(end).1 <= resolution)
        .map(|(_, end)| end)
}

/// Even-odd rule. The point must not lie on a side.
fn is_inside(point: [f64; 2], corners: &[[f64; 2]]) -> bool {
    sides(corners)
        .filter(|[a, b]| {
            (a[1] > point[1]) != (b[1] > point[1])
                && point[0] < a[0] + (point[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        })
        .count()
        % 2
        == 1
}
