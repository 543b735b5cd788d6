//! Electrodes along the rim of a flat skin, before meshing.

use crate::MeshError;
use crate::geometry::Outline;

/// The sense in which electrode numbers run around the skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Direction {
    /// Seen from +z.
    #[default]
    Counterclockwise,
    /// Seen from +z.
    Clockwise,
}

/// Where the centres of the electrodes lie.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Placement {
    /// Equal steps of rim length on the outer loop (on a disc: equal angles).
    EquallySpaced {
        /// Number of electrodes; zero gives a bare skin.
        count: usize,
        /// Centre of electrode 1 seen from the centroid of the outline, degrees
        /// counter-clockwise from +x (any number of turns). Where the ray meets the rim more
        /// than once, the outermost point is meant.
        first_angle_deg: f64,
        /// The sense in which the numbers run.
        direction: Direction,
    },
    /// Given centres, metres, electrode 1 first; on the outer rim or on the rim of a hole. Each
    /// may be off the rim by 1e-3 of the outer rim's length (measured positions are rounded) and
    /// is moved to the nearest rim point.
    At(Vec<[f64; 2]>),
}

/// Electrodes along the rim, all of one width.
///
/// Electrodes keep a gap: touching electrodes would be one conductor, and the complete electrode
/// model takes them as disjoint. The gap may be as small as 1e-8 of the rim's length.
#[derive(Debug, Clone, PartialEq)]
pub struct RimElectrodes {
    /// Length of rim that each covers, metres (measured along the true outline).
    pub width_m: f64,
    /// Where they lie.
    pub placement: Placement,
}

/// Positions further off than this fraction of the outer length are not on the rim.
const OFF_RIM: f64 = 1e-3;
/// Smallest width and gap, in units of the outline's resolution.
const SMALLEST: f64 = 10.0;

/// The rim that one electrode covers: from `start_m` over `width_m` of arc length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RimInterval {
    /// 0 is the outer loop.
    pub loop_index: usize,
    pub start_m: f64,
    pub width_m: f64,
}

impl RimElectrodes {
    /// Equally spaced electrodes, electrode 1 on the +x axis, counter-clockwise.
    pub fn equally_spaced(count: usize, width_m: f64) -> Self {
        let (first_angle_deg, direction) = (0.0, Direction::Counterclockwise);
        let placement = Placement::EquallySpaced { count, first_angle_deg, direction };
        Self { width_m, placement }
    }

    /// No electrodes: a bare skin.
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

    /// The rim each electrode covers, checked, electrode 1 first.
    pub(crate) fn place(&self, outline: &Outline) -> Result<Vec<RimInterval>, MeshError> {
        if self.count() == 0 {
            return Ok(Vec::new());
        }
        let least_m = SMALLEST * outline.resolution_m();
        let out_of_range = |must| {
            Err(MeshError::OutOfRange { quantity: "electrode width_m", value: self.width_m, must })
        };
        if !(self.width_m.is_finite() && self.width_m > 0.0) {
            return out_of_range("positive and finite");
        }
        if self.width_m < least_m {
            return out_of_range("at least 1e-8 of the rim's length");
        }
        // a million electrodes is far beyond any skin and keeps all that follows in memory
        if self.count() > 1_000_000 {
            let (quantity, value) = ("electrode count", self.count() as f64);
            return Err(MeshError::OutOfRange { quantity, value, must: "at most 1000000" });
        }
        let centres = self.centres(outline)?;
        for &(loop_index, _) in &centres {
            if self.width_m > outline.loops()[loop_index].length_m() - least_m {
                return out_of_range("shorter than the rim that the electrode lies on");
            }
        }
        self.check_gaps(outline, &centres, least_m)?;
        let interval = |&(loop_index, centre_m): &(usize, f64)| {
            let length_m = outline.loops()[loop_index].length_m();
            let start_m = (centre_m - 0.5 * self.width_m).rem_euclid(length_m);
            RimInterval { loop_index, start_m, width_m: self.width_m }
        };
        Ok(centres.iter().map(interval).collect())
    }

    /// Loop and arc length of each centre.
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
                let tolerance_m = OFF_RIM * length_m;
                let project = |(index, &position_m): (usize, &[f64; 2])| {
                    let projected = outline.loops().iter().map(|l| l.project(position_m));
                    let (loop_index, (s_m, distance_m)) = projected
                        .enumerate()
                        .min_by(|a, b| a.1.1.total_cmp(&b.1.1))
                        .unwrap_or((0, (0.0, f64::NAN)));
                    // also refuses NaN
                    if distance_m <= tolerance_m {
                        return Ok((loop_index, s_m));
                    }
                    let electrode = index + 1;
                    Err(MeshError::OffRim { electrode, position_m, distance_m, tolerance_m })
                };
                positions_m.iter().enumerate().map(project).collect()
            }
        }
    }

    /// Refuses electrodes that overlap or touch their neighbour on the same loop.
    fn check_gaps(
        &self,
        outline: &Outline,
        centres: &[(usize, f64)],
        least_m: f64,
    ) -> Result<(), MeshError> {
        for (index, l) in outline.loops().iter().enumerate() {
            let mut on_loop: Vec<(f64, usize)> = centres
                .iter()
                .enumerate()
                .filter(|(_, c)| c.0 == index)
                .map(|(k, c)| (c.1, k + 1))
                .collect();
            on_loop.sort_by(|a, b| a.0.total_cmp(&b.0));
            if on_loop.len() < 2 {
                continue;
            }
            for (k, &(s_m, number)) in on_loop.iter().enumerate() {
                let (next_m, next) = on_loop[(k + 1) % on_loop.len()];
                let distance_m =
                    if k + 1 < on_loop.len() { next_m - s_m } else { next_m - s_m + l.length_m() };
                let (first, second) = (number.min(next), number.max(next));
                let (width_m, gap_m) = (self.width_m, distance_m - self.width_m);
                // what rounding of the positions leaves of an exact zero is still "touching"
                if gap_m < -outline.resolution_m() {
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
}
