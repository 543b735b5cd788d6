//! Electrodes along the rim of a flat skin, before meshing.

use crate::MeshError;
use crate::geometry::Outline;

/// The direction in which electrode numbers increase around the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum Direction {
    /// Counter-clockwise, seen from +z.
    #[default]
    Counterclockwise,
    /// Clockwise, seen from +z.
    Clockwise,
}

/// Positions of the electrode centres.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Placement {
    /// Equally spaced along the outer loop (on a disc: at equal angles).
    EquallySpaced {
        /// Number of electrodes; zero for a bare skin.
        count: usize,
        /// Centre of electrode 1, seen from the centroid of the outline, degrees counter-clockwise
        /// from +x (any number of turns). If the ray meets the rim more than once, the outermost
        /// point counts.
        first_angle_deg: f64,
        /// The direction in which the numbers increase.
        direction: Direction,
    },
    /// Given centres, metres, electrode 1 first, on the outer rim or the rim of a hole. Each may be
    /// off the rim by 1e-3 of the outer rim's length (measured positions are rounded) and is moved
    /// to the nearest rim point.
    At(Vec<[f64; 2]>),
}

/// Electrodes along the rim, all of the same width; a [`PlacedElectrode`](crate::PlacedElectrode)
/// has its own.
///
/// Electrodes must not touch: they would be one conductor, and the complete electrode model assumes
/// that they are disjoint. Gaps may be as small as 1e-8 of the rim's length.
///
/// ```
/// use eit_mesh::{RimElectrodes, SkinShape};
///
/// // four electrodes of 1 cm on a disc, the first one on the +x axis
/// let electrodes = RimElectrodes::equally_spaced(4, 0.01);
/// let centres_m = electrodes.centres_m(&SkinShape::Disc { radius_m: 0.1 }.outline()?)?;
/// assert!((centres_m[1][1] - 0.1).abs() < 1e-12, "the second one is on the +y axis");
/// # Ok::<(), eit_mesh::MeshError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RimElectrodes {
    /// Length of rim covered by each electrode, metres (measured along the true outline).
    pub width_m: f64,
    /// Positions of the electrodes.
    pub placement: Placement,
}

/// Positions further from the rim than this fraction of the outer length are rejected.
pub(crate) const OFF_RIM: f64 = 1e-3;
/// Smallest width and gap, in multiples of the resolution of the outline.
pub(crate) const SMALLEST: f64 = 10.0;

/// The rim covered by one electrode: `width_m` of arc length from `start_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RimInterval {
    /// 0 is the outer loop.
    pub loop_index: usize,
    pub start_m: f64,
    pub width_m: f64,
}

impl RimElectrodes {
    /// Creates equally spaced electrodes, counter-clockwise, with electrode 1 on the +x axis.
    pub fn equally_spaced(count: usize, width_m: f64) -> Self {
        let (first_angle_deg, direction) = (0.0, Direction::Counterclockwise);
        let placement = Placement::EquallySpaced { count, first_angle_deg, direction };
        Self { width_m, placement }
    }

    /// Creates no electrodes: a bare skin.
    pub fn none() -> Self {
        Self::equally_spaced(0, 0.0)
    }

    /// Number of electrodes.
    pub fn count(&self) -> usize {
        match &self.placement {
            Placement::EquallySpaced { count, .. } => *count,
            Placement::At(positions_m) => positions_m.len(),
        }
    }

    /// Checks the electrodes against an outline.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`], [`MeshError::OverlappingElectrodes`],
    /// [`MeshError::TouchingElectrodes`], [`MeshError::OffRim`].
    pub fn validate(&self, outline: &Outline) -> Result<(), MeshError> {
        self.place(outline).map(|_| ())
    }

    /// Returns the centre of each electrode on an outline, metres, independent of the width.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`], [`MeshError::OffRim`].
    pub fn centres_m(&self, outline: &Outline) -> Result<Vec<[f64; 2]>, MeshError> {
        self.check_count()?;
        let point = |(l, s_m): (usize, f64)| outline.loops()[l].point_at(s_m);
        Ok(self.centres(outline)?.into_iter().map(point).collect())
    }

    /// Returns the validated rim interval of each electrode, electrode 1 first.
    pub(crate) fn place(&self, outline: &Outline) -> Result<Vec<RimInterval>, MeshError> {
        if self.count() == 0 {
            return Ok(Vec::new());
        }
        let least_m = SMALLEST * outline.resolution_m();
        let (quantity, width_m) = ("electrode width_m", self.width_m);
        let check = |is_valid, must| MeshError::check_range(is_valid, quantity, width_m, must);
        check(width_m.is_finite() && width_m > 0.0, "positive and finite")?;
        check(width_m >= least_m, "at least 1e-8 of the rim's length")?;
        self.check_count()?;
        let centres = self.centres(outline)?;
        for &(loop_index, _) in &centres {
            let is_shorter = width_m <= outline.loops()[loop_index].length_m() - least_m;
            check(is_shorter, "shorter than the rim that the electrode lies on")?;
        }
        let numbered: Vec<_> =
            (1..).zip(&centres).map(|(k, &(l, centre_m))| (k, l, centre_m, self.width_m)).collect();
        check_gaps(&numbered, |l| outline.loops()[l].length_m(), outline.resolution_m())?;
        let interval = |&(loop_index, centre_m): &(usize, f64)| {
            let length_m = outline.loops()[loop_index].length_m();
            let start_m = (centre_m - 0.5 * self.width_m).rem_euclid(length_m);
            RimInterval { loop_index, start_m, width_m: self.width_m }
        };
        Ok(centres.iter().map(interval).collect())
    }

    /// Limits the count to a million, far beyond any skin, to bound memory use.
    fn check_count(&self) -> Result<(), MeshError> {
        let (count, must) = (self.count(), "at most 1000000");
        MeshError::check_range(count <= 1_000_000, "electrode count", count as f64, must)
    }

    /// Returns loop and arc length of each centre.
    fn centres(&self, outline: &Outline) -> Result<Vec<(usize, f64)>, MeshError> {
        let length_m = outline.loops()[0].length_m();
        match &self.placement {
            Placement::EquallySpaced { count, first_angle_deg, direction } => {
                let first_m = outline.arc_length_at_angle(*first_angle_deg)?;
                let sense = match direction {
                    Direction::Counterclockwise => 1.0,
                    Direction::Clockwise => -1.0,
                };
                let step_m = sense * length_m / *count as f64;
                let centre = |k| (0, (first_m + k as f64 * step_m).rem_euclid(length_m));
                Ok((0..*count).map(centre).collect())
            }
            Placement::At(positions_m) => {
                (1..).zip(positions_m).map(|(k, &at)| project(outline, k, at)).collect()
            }
        }
    }
}

/// Returns loop and arc length of the rim point nearest to a position.
pub(crate) fn project(
    outline: &Outline,
    electrode: usize,
    position_m: [f64; 2],
) -> Result<(usize, f64), MeshError> {
    let tolerance_m = OFF_RIM * outline.loops()[0].length_m();
    let projected = outline.loops().iter().map(|l| l.project(position_m));
    let (loop_index, (s_m, distance_m)) = projected
        .enumerate()
        .min_by(|a, b| a.1.1.total_cmp(&b.1.1))
        .unwrap_or((0, (0.0, f64::NAN)));
    // also rejects NaN
    if distance_m <= tolerance_m {
        return Ok((loop_index, s_m));
    }
    Err(MeshError::OffRim { electrode, position_m, distance_m, tolerance_m })
}

/// Rejects electrodes (number, loop, centre and width) that overlap or touch their neighbour on the
/// same loop.
pub(crate) fn check_gaps(
    electrodes: &[(usize, usize, f64, f64)],
    length_of: impl Fn(usize) -> f64,
    resolution_m: f64,
) -> Result<(), MeshError> {
    let least_m = SMALLEST * resolution_m;
    let mut sorted = electrodes.to_vec();
    sorted.sort_by(|a, b| a.1.cmp(&b.1).then(a.2.total_cmp(&b.2)));
    for on_loop in sorted.chunk_by(|a, b| a.1 == b.1).filter(|on_loop| on_loop.len() > 1) {
        for (k, &(number, loop_index, s_m, own_m)) in on_loop.iter().enumerate() {
            let (next, _, next_m, other_m) = on_loop[(k + 1) % on_loop.len()];
            let around_m = if k + 1 < on_loop.len() { 0.0 } else { length_of(loop_index) };
            let distance_m = next_m - s_m + around_m;
            let (first, second) = (number.min(next), number.max(next));
            let width_m = 0.5 * (own_m + other_m);
            let gap_m = distance_m - width_m;
            // a zero gap that rounding of the positions made slightly negative still counts as
            // touching
            if gap_m < -resolution_m {
                let overlap_m = -gap_m;
                return Err(MeshError::OverlappingElectrodes {
                    first,
                    second,
                    overlap_m,
                    distance_m,
                    width_m,
                });
            }
            if gap_m < least_m {
                let gap_m = gap_m.max(0.0);
                return Err(MeshError::TouchingElectrodes { first, second, gap_m, least_m });
            }
        }
    }
    Ok(())
}
