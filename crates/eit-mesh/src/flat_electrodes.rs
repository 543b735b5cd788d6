//! Electrodes of flat skins, both rim and patch, checked against the outline and each other.

use crate::geometry::{Disc, Loop, Outline, distance};
use crate::rim_electrodes::{OFF_RIM, RimElectrodes, RimInterval, SMALLEST, check_gaps, project};
use crate::{Contact, MeshError, PlacedElectrode, SkinShape};

/// Electrodes of a flat skin at their final positions.
#[derive(Debug, Default)]
pub(crate) struct FlatElectrodes {
    /// Index of each rim electrode, and the rim it covers.
    pub rim: Vec<(usize, RimInterval)>,
    /// Index of each patch, and the disc it covers.
    pub patches: Vec<(usize, Disc)>,
}

/// Minimum distance of a patch from the rim and from other patches, as a fraction of its radius
/// (the larger radius of two patches). The outline of a patch is a polygon of the disc's area,
/// whose corners lie up to 2.3 % outside the circle when it has the fewest sides, twelve.
const PATCH_GAP: f64 = 0.05;

impl FlatElectrodes {
    /// Electrodes along the rim.
    pub(crate) fn rim(electrodes: &RimElectrodes, outline: &Outline) -> Result<Self, MeshError> {
        let rim = electrodes.place(outline)?.into_iter().enumerate().collect();
        Ok(Self { rim, patches: Vec::new() })
    }

    /// Electrodes by position, checked against the outline.
    pub(crate) fn placed(
        electrodes: &[PlacedElectrode],
        outline: &Outline,
    ) -> Result<Self, MeshError> {
        let resolution_m = outline.resolution_m();
        let (mut flat, mut centres) = (Self::default(), Vec::new());
        for (index, placed) in electrodes.iter().enumerate() {
            let electrode = index + 1;
            placed.check(electrode, SMALLEST * resolution_m)?;
            let [x, y, z] = placed.position_m;
            let tolerance_m = OFF_RIM * outline.loops()[0].length_m();
            let what = "point of the skin, which is flat at z = 0";
            placed.check_distance(electrode, z.abs(), tolerance_m, what)?;
            match placed.contact {
                Contact::Rim { width_m } => {
                    let at = project(outline, electrode, [x, y])?;
                    let (loop_index, centre_m) = at;
                    let length_m = outline.loops()[loop_index].length_m();
                    let interval = placed.interval(electrode, at, length_m, resolution_m)?;
                    flat.rim.push((index, interval));
                    centres.push((electrode, loop_index, centre_m, width_m));
                }
                Contact::Patch { radius_m } => {
                    let disc = Disc { centre_m: [x, y], radius_m };
                    check_disc(electrode, disc, outline)?;
                    flat.patches.push((index, disc));
                }
            }
        }
        check_gaps(&centres, |l| outline.loops()[l].length_m(), resolution_m)?;
        check_discs(&flat.patches)?;
        Ok(flat)
    }
}

impl PlacedElectrode {
    /// Checks electrodes against the outline of a shape, without meshing.
    ///
    /// # Errors
    /// Those of [`generate_placed`](crate::generate_placed) that concern electrodes.
    pub fn validate(electrodes: &[Self], shape: &SkinShape) -> Result<(), MeshError> {
        FlatElectrodes::placed(electrodes, &shape.outline()?).map(|_| ())
    }
}

/// Rejects a patch that does not lie entirely on the skin.
fn check_disc(electrode: usize, disc: Disc, outline: &Outline) -> Result<(), MeshError> {
    let gap = |l: &Loop| l.project(disc.centre_m).1 - disc.radius_m;
    let nearest_m = outline.loops().iter().map(gap).fold(f64::INFINITY, f64::min);
    let problem = match outline.loops_around(disc.centre_m) {
        0 => "lies outside the skin",
        2.. => "lies in a hole of the skin",
        _ if nearest_m < 0.0 => "extends beyond the rim: move it inwards or make it smaller",
        _ if nearest_m < PATCH_GAP * disc.radius_m => {
            "is closer to the rim than a twentieth of its radius: move it inwards or make it smaller"
        }
        _ => return Ok(()),
    };
    let [x, y] = disc.centre_m;
    Err(MeshError::BadPatch { electrode, position_m: [x, y, 0.0], problem })
}

/// Rejects patches that are too close to each other.
fn check_discs(patches: &[(usize, Disc)]) -> Result<(), MeshError> {
    for (k, (first, a)) in patches.iter().enumerate() {
        for (second, b) in &patches[k + 1..] {
            let apart_m = distance(a.centre_m, b.centre_m);
            let gap_m = apart_m - a.radius_m - b.radius_m;
            let least_m = PATCH_GAP * a.radius_m.max(b.radius_m);
            if gap_m < least_m {
                let (first, second) = (first + 1, second + 1);
                return Err(MeshError::OverlappingPatches { first, second, gap_m, least_m });
            }
        }
    }
    Ok(())
}
