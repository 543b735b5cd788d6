//! Electrodes along the rim of a flat skin, before meshing.

use crate::geometry::Outline;
use crate::{Contact, MeshError, PlacedElectrode};

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

/// Electrodes along the rim, all of one width; [`PlacedElectrode`]s have each its own.
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
pub(crate) const SMALLEST: f64 = 10.0;

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

    /// Centre of each electrode on an outline, metres, whatever the width.
    ///
    /// # Errors
    /// [`MeshError::OutOfRange`], [`MeshError::OffRim`].
    pub fn centres_m(&self, outline: &Outline) -> Result<Vec<[f64; 2]>, MeshError> {
        self.check_count()?;
        let point = |(l, s_m): (usize, f64)| outline.loops()[l].point_at(s_m);
        Ok(self.centres(outline)?.into_iter().map(point).collect())
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
        self.check_count()?;
        let centres = self.centres(outline)?;
        for &(loop_index, _) in &centres {
            if self.width_m > outline.loops()[loop_index].length_m() - least_m {
                return out_of_range("shorter than the rim that the electrode lies on");
            }
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

    /// A million electrodes is far beyond any skin and keeps all that follows in memory.
    fn check_count(&self) -> Result<(), MeshError> {
        if self.count() <= 1_000_000 {
            return Ok(());
        }
        let (quantity, value) = ("electrode count", self.count() as f64);
        Err(MeshError::OutOfRange { quantity, value, must: "at most 1000000" })
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
                (1..).zip(positions_m).map(|(k, &at)| project(outline, k, at)).collect()
            }
        }
    }
}

/// Loop and arc length of the rim point nearest to a position.
fn project(
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
    // also refuses NaN
    if distance_m <= tolerance_m {
        return Ok((loop_index, s_m));
    }
    Err(MeshError::OffRim { electrode, position_m, distance_m, tolerance_m })
}

/// Refuses electrodes (number, loop, centre and width) that overlap or touch their neighbour on
/// the same loop.
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
            // what rounding of the positions leaves of an exact zero is still "touching"
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

/// Electrodes of a flat skin where they will be meshed.
#[derive(Debug, Default)]
pub(crate) struct FlatElectrodes {
    /// Index of each rim electrode, and the rim it covers.
    pub rim: Vec<(usize, RimInterval)>,
    /// The patches.
    pub patches: Vec<Disc>,
}

/// A round patch of a flat skin.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Disc {
    /// Index of the electrode.
    pub electrode: usize,
    pub centre_m: [f64; 2],
    pub radius_m: f64,
}

/// A patch keeps this fraction of its radius (the larger one's) from the rim and from other
/// patches. Its outline is a polygon of the disc's area, whose corners stand out by up to 2.3 %
/// where it has the fewest, twelve.
const PATCH_GAP: f64 = 0.05;

impl FlatElectrodes {
    /// Electrodes along the rim.
    pub fn rim(electrodes: &RimElectrodes, outline: &Outline) -> Result<Self, MeshError> {
        let rim = electrodes.place(outline)?.into_iter().enumerate().collect();
        Ok(Self { rim, patches: Vec::new() })
    }

    /// Electrodes by position, checked against the outline.
    pub fn placed(electrodes: &[PlacedElectrode], outline: &Outline) -> Result<Self, MeshError> {
        let resolution_m = outline.resolution_m();
        let (mut flat, mut centres) = (Self::default(), Vec::new());
        for (index, placed) in electrodes.iter().enumerate() {
            let (electrode, position_m) = (index + 1, placed.position_m);
            placed.check(electrode, SMALLEST * resolution_m)?;
            let [x, y, z] = position_m;
            let tolerance_m = OFF_RIM * outline.loops()[0].length_m();
            if z.abs() > tolerance_m {
                let (distance_m, what) = (z.abs(), "point of the skin, which is flat at z = 0");
                return Err(MeshError::OffSurface {
                    electrode,
                    position_m,
                    distance_m,
                    tolerance_m,
                    what,
                });
            }
            match placed.contact {
                Contact::Rim { width_m } => {
                    let (loop_index, centre_m) = project(outline, electrode, [x, y])?;
                    let length_m = outline.loops()[loop_index].length_m();
                    if width_m > length_m - SMALLEST * resolution_m {
                        let (quantity, value) = ("width_m", width_m);
                        let must = "shorter than the rim that the electrode lies on";
                        return Err(MeshError::ElectrodeSize { electrode, quantity, value, must });
                    }
                    let start_m = (centre_m - 0.5 * width_m).rem_euclid(length_m);
                    flat.rim.push((index, RimInterval { loop_index, start_m, width_m }));
                    centres.push((electrode, loop_index, centre_m, width_m));
                }
                Contact::Patch { radius_m } => {
                    let disc = Disc { electrode: index, centre_m: [x, y], radius_m };
                    check_disc(disc, outline)?;
                    flat.patches.push(disc);
                }
            }
        }
        check_gaps(&centres, |l| outline.loops()[l].length_m(), resolution_m)?;
        check_discs(&flat.patches)?;
        Ok(flat)
    }
}

/// Refuses a patch that is not on the skin whole.
fn check_disc(disc: Disc, outline: &Outline) -> Result<(), MeshError> {
    let gap = |l: &crate::geometry::Loop| l.project(disc.centre_m).1 - disc.radius_m;
    let nearest_m = outline.loops().iter().map(gap).fold(f64::INFINITY, f64::min);
    let problem = match outline.loops_around(disc.centre_m) {
        0 => "lies outside of the skin",
        2.. => "lies in a hole of the skin",
        _ if nearest_m < 0.0 => "runs over the rim: move it inwards or make it smaller",
        _ if nearest_m < PATCH_GAP * disc.radius_m => {
            "is nearer to the rim than a twentieth of its radius: move it inwards or make it smaller"
        }
        _ => return Ok(()),
    };
    let ([x, y], electrode) = (disc.centre_m, disc.electrode + 1);
    Err(MeshError::BadPatch { electrode, position_m: [x, y, 0.0], problem })
}

/// Refuses patches too near to each other.
fn check_discs(discs: &[Disc]) -> Result<(), MeshError> {
    for (k, a) in discs.iter().enumerate() {
        for b in &discs[k + 1..] {
            let apart_m = crate::geometry::distance(a.centre_m, b.centre_m);
            let gap_m = apart_m - a.radius_m - b.radius_m;
            let least_m = PATCH_GAP * a.radius_m.max(b.radius_m);
            if gap_m < least_m {
                let (first, second) = (a.electrode + 1, b.electrode + 1);
                return Err(MeshError::OverlappingPatches { first, second, gap_m, least_m });
            }
        }
    }
    Ok(())
}
