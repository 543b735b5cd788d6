//! Unknown relation between the coordinates of a press table and the model's skin: rotation, mirror, scale,
//! shift, and the sign of a touch's change.
//!
//! Each press is located with the model alone, at the candidate whose response is most similar to its
//! frame. One similarity transform then maps these positions to the table's, robust against presses that
//! the model misplaces. It minimises the sum of distances by iteratively reweighted least squares; each
//! step uses the similarity of Umeyama, *IEEE PAMI* 13 (1991), 376-380, in the plane.

use super::choose::{LEAST_PRESSES, quantile};
use super::presses::Presses;
use super::response_map::unit_rows;
use crate::InverseError;
use crate::check::check_length;
use ndarray::Array2;

/// Iterations of the reweighted fit.
const STEPS: usize = 40;

/// Transform from the coordinates of a press table to those of the model's skin, in the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pose {
    /// Counter-clockwise rotation, radians, applied after the mirror.
    pub turn_rad: f64,
    /// Whether y is reversed first.
    pub is_mirrored: bool,
    /// Model metres per metre of the table.
    pub scale: f64,
    /// Shift, added last, metres of the model.
    pub shift_m: [f64; 2],
}

/// A fitted pose and its errors.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub struct PoseFit {
    /// Pose relative to the parent frame.
    pub pose: Pose,
    /// Sign of the conductivity change under a touch, 1 or -1.
    pub sign: f64,
    /// Median distance of presses from where the model alone places them, metres of the table.
    pub median_m: f64,
    /// Mean of these distances, metres of the table.
    pub mean_m: f64,
}

impl Pose {
    /// The identity.
    pub const SAME: Self =
        Self { turn_rad: 0.0, is_mirrored: false, scale: 1.0, shift_m: [0.0; 2] };

    /// Maps a position of the table to the model's skin, metres; z is unchanged.
    pub fn to_model(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.turn_rad.sin_cos();
        let y = if self.is_mirrored { -y } else { y };
        let [a, b] = self.shift_m;
        [self.scale * (cos * x - sin * y) + a, self.scale * (sin * x + cos * y) + b, z]
    }

    /// Maps a position on the model's skin to the coordinates of the table; z is unchanged.
    pub fn to_table(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let (sin, cos) = self.turn_rad.sin_cos();
        let (x, y) = ((x - self.shift_m[0]) / self.scale, (y - self.shift_m[1]) / self.scale);
        let (x, y) = (cos * x + sin * y, cos * y - sin * x);
        [x, if self.is_mirrored { -y } else { y }, z]
    }

    /// Finds pose and sign from presses in the table's coordinates and the model's responses at candidates,
    /// `[candidate, channel]`.
    ///
    /// # Errors
    /// Fewer than four presses, mismatched lengths, or all presses at one position.
    pub fn fit(
        presses: &Presses,
        candidates_m: &[[f64; 3]],
        at_candidates: &Array2<f64>,
    ) -> Result<PoseFit, InverseError> {
        presses.validate(LEAST_PRESSES)?;
        check_length("channels of the model", at_candidates.ncols(), presses.frames.ncols())?;
        check_length("model responses", at_candidates.nrows(), candidates_m.len())?;
        let alike = unit_rows(&presses.frames).0.dot(&unit_rows(at_candidates).0.t());
        let table: Vec<[f64; 2]> = presses.places_m.iter().map(|p| [p[0], p[1]]).collect();
        let mut best: Option<PoseFit> = None;
        for sign in [1.0, -1.0] {
            let on_model: Vec<[f64; 2]> = alike
                .rows()
                .into_iter()
                .map(|row| {
                    let most = |a: &(usize, &f64), b: &(usize, &f64)| {
                        (sign * a.1).total_cmp(&(sign * b.1))
                    };
                    let at = row.iter().enumerate().max_by(most).map_or(0, |(c, _)| c);
                    [candidates_m[at][0], candidates_m[at][1]]
                })
                .collect();
            for is_mirrored in [false, true] {
                let Some(fit) = similarity(&table, &on_model, is_mirrored, sign) else { continue };
                if best.is_none_or(|old| fit.mean_m < old.mean_m) {
                    best = Some(fit);
                }
            }
        }
        best.ok_or(InverseError::PressesAtOnePlace { presses: table.len() })
    }
}

/// Fits the similarity from the model to the table with the least sum of distances in the table.
fn similarity(
    table: &[[f64; 2]],
    on_model: &[[f64; 2]],
    is_mirrored: bool,
    sign: f64,
) -> Option<PoseFit> {
    // mirror the table's coordinates, as the pose does
    let table: Vec<[f64; 2]> =
        table.iter().map(|[x, y]| [*x, if is_mirrored { -y } else { *y }]).collect();
    let mut weights = vec![1.0; table.len()];
    let mut found = None;
    for _ in 0..STEPS {
        let (turn, scale, from, to) = weighted(on_model, &table, &weights)?;
        let (sin, cos) = turn.sin_cos();
        let carry = |p: &[f64; 2]| {
            let [x, y] = [p[0] - from[0], p[1] - from[1]];
            [to[0] + scale * (cos * x - sin * y), to[1] + scale * (sin * x + cos * y)]
        };
        let errors: Vec<f64> = on_model
            .iter()
            .map(carry)
            .zip(&table)
            .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
            .collect();
        let floor = (0.1 * quantile(&errors, 0.5)).max(f64::MIN_POSITIVE);
        weights.iter_mut().zip(&errors).for_each(|(w, e)| *w = e.max(floor).recip());
        found = Some((turn, scale, from, to, errors));
    }
    let (turn, scale, from, to, errors) = found?;
    // invert: from the table to the model
    let (turn_rad, scale) = (-turn, scale.recip());
    let (sin, cos) = turn_rad.sin_cos();
    let shift_m = [
        from[0] - scale * (cos * to[0] - sin * to[1]),
        from[1] - scale * (sin * to[0] + cos * to[1]),
    ];
    let pose = Pose { turn_rad, is_mirrored, scale, shift_m };
    let mean_m = errors.iter().sum::<f64>() / errors.len() as f64;
    let is_finite = scale.is_finite() && scale > 0.0 && mean_m.is_finite();
    is_finite.then(|| PoseFit { pose, sign, median_m: quantile(&errors, 0.5), mean_m })
}

/// Weighted least squares: returns rotation, scale and the two centroids.
fn weighted(
    from: &[[f64; 2]],
    to: &[[f64; 2]],
    weights: &[f64],
) -> Option<(f64, f64, [f64; 2], [f64; 2])> {
    let sum: f64 = weights.iter().sum();
    let middle = |points: &[[f64; 2]]| {
        [0, 1].map(|k| points.iter().zip(weights).map(|(p, w)| w * p[k]).sum::<f64>() / sum)
    };
    let (a, b) = (middle(from), middle(to));
    let (mut along, mut across, mut square) = (0.0, 0.0, 0.0);
    for ((p, q), w) in from.iter().zip(to).zip(weights) {
        let [px, py, qx, qy] = [p[0] - a[0], p[1] - a[1], q[0] - b[0], q[1] - b[1]];
        along += w * (px * qx + py * qy);
        across += w * (px * qy - py * qx);
        square += w * (px * px + py * py);
    }
    (square > 0.0).then(|| (across.atan2(along), along.hypot(across) / square, a, b))
}
