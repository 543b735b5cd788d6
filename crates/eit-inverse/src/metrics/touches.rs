//! Several touches in one image: blobs, and the distance of each true touch from its blob.

use super::cells::{Cells, check_place};
use super::{ChangeSign, sizes};
use crate::InverseError;
use crate::assign::Assignment;
use crate::check::check_range;
use crate::geometry::distance_m;

/// A connected part of an image.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct Blob<const D: usize> {
    /// Centroid with the weights `|x| area`, metres.
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::absent::position"))]
    pub centre_m: [f64; D],
    /// Largest `|x|`, in the image's unit.
    pub peak: f64,
    /// Area, square metres.
    pub area_m2: f64,
}

/// Returns the connected parts where an image reaches `level` times its largest value of one sign, ordered
/// by decreasing peak.
///
/// Cells are connected across sides ([`Cells`]). A single blob at level 1/2 has the centre of
/// [`half_maximum_centre_m`](super::half_maximum_centre_m). Non-finite values are ignored. The result is
/// empty if no value has the sign.
///
/// # Errors
/// [`InverseError::WrongLength`]; [`InverseError::OutOfRange`] unless `level` is above zero and at most 1.
pub fn blobs<const D: usize>(
    values: &[f64],
    cells: &Cells<D>,
    sign: ChangeSign,
    level: f64,
) -> Result<Vec<Blob<D>>, InverseError> {
    cells.check("values", values)?;
    check_range("level", level, level > 0.0 && level <= 1.0, "above zero and at most 1")?;
    let Some((x, largest)) = sizes(values, sign) else { return Ok(Vec::new()) };
    let blob = |part: Vec<usize>| {
        let (centre_m, _) = cells.weighted_centre(part.iter().map(|&k| (k, x[k])));
        let area_m2 = part.iter().map(|&k| cells.areas_m2()[k]).sum();
        Blob { centre_m, peak: largest * x[part[0]], area_m2 }
    };
    Ok(connected(&x, cells, level).into_iter().map(blob).collect())
}

/// Returns the connected parts of the cells with `x >= level`, highest peak first, each with its cells from
/// the highest down.
fn connected<const D: usize>(x: &[f64], cells: &Cells<D>, level: f64) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..x.len()).filter(|&k| x[k] >= level).collect();
    order.sort_unstable_by(|&a, &b| x[b].total_cmp(&x[a]).then(a.cmp(&b)));
    let mut part_of = vec![usize::MAX; x.len()];
    let mut parts: Vec<Vec<usize>> = Vec::new();
    for &cell in &order {
        if part_of[cell] == usize::MAX {
            part_of[cell] = parts.len();
            let mut edge = vec![cell];
            while let Some(at) = edge.pop() {
                for next in cells.neighbours(at).filter(|&k| x[k] >= level) {
                    if part_of[next] == usize::MAX {
                        part_of[next] = parts.len();
                        edge.push(next);
                    }
                }
            }
            parts.push(Vec::new());
        }
        parts[part_of[cell]].push(cell);
    }
    parts
}

/// Settings of [`touch_position_errors_m`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct TouchSettings {
    /// Which sign of change is a touch. Default: increase.
    pub sign: ChangeSign,
    /// Threshold of a blob relative to the image's largest value, above 0 and at most 1. Default 1/2. A
    /// touch weaker than this beside a stronger one is missed.
    pub level: f64,
    /// Largest distance of a blob from its touch, metres; a blob farther away counts as extra and the touch
    /// as missed. Default: infinite.
    #[cfg_attr(feature = "serde", serde(deserialize_with = "crate::absent::infinite"))]
    pub within_m: f64,
}

impl Default for TouchSettings {
    fn default() -> Self {
        Self { sign: ChangeSign::Increase, level: 0.5, within_m: f64::INFINITY }
    }
}

/// Result of [`touch_position_errors_m`].
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct TouchErrors<const D: usize> {
    /// Distance of each true touch from its blob, metres, `[touch]`; `None` if missed.
    pub errors_m: Vec<Option<f64>>,
    /// Centre of that blob, metres, `[touch]`.
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::absent::positions"))]
    pub centres_m: Vec<Option<[f64; D]>>,
    /// True touches without a blob.
    pub missed: usize,
    /// Blobs without a true touch.
    pub extra: usize,
}

/// Compares the blobs of an image with the true touches.
///
/// Blobs ([`blobs`]) and touches are paired one to one, at most [`within_m`](TouchSettings::within_m)
/// apart: as many pairs as possible, and among those pairings one with the smallest sum of distances. The
/// pairing is exact. Among equal pairings the choice is arbitrary but always the same.
/// Without true touches every blob is extra.
///
/// This is a figure of merit for known truth and not a tracker: it knows the number of touches.
///
/// # Errors
/// [`InverseError::WrongLength`]; [`InverseError::OutOfRange`] for invalid settings or non-finite positions.
pub fn touch_position_errors_m<const D: usize>(
    values: &[f64],
    cells: &Cells<D>,
    touches_m: &[[f64; D]],
    settings: &TouchSettings,
) -> Result<TouchErrors<D>, InverseError> {
    let count = touches_m.len();
    touches_m.iter().try_for_each(|touch| check_place("touches_m", touch))?;
    check_range("within_m", settings.within_m, settings.within_m >= 0.0, "at least 0")?;
    let blobs = blobs(values, cells, settings.sign, settings.level)?;
    let distances: Vec<Vec<f64>> = blobs
        .iter()
        .map(|blob| touches_m.iter().map(|&touch| distance_m(blob.centre_m, touch)).collect())
        .collect();
    let blob_of_touch = assign(&distances, count, settings.within_m);
    let pairs = blob_of_touch.iter().enumerate();
    let errors_m = pairs.map(|(touch, blob)| blob.map(|blob| distances[blob][touch])).collect();
    let centres_m = blob_of_touch.iter().map(|blob| blob.map(|b| blobs[b].centre_m)).collect();
    let found = blob_of_touch.iter().flatten().count();
    let (missed, extra) = (count - found, blobs.len() - found);
    Ok(TouchErrors { errors_m, centres_m, missed, extra })
}

/// Returns the blob of each touch; `distances` is `[blob][touch]`.
fn assign(distances: &[Vec<f64>], touches: usize, within_m: f64) -> Vec<Option<usize>> {
    let blobs = distances.len();
    let is_near = |d: f64| d <= within_m && d.is_finite();
    let near = distances.iter().flatten().copied().filter(|&d| is_near(d));
    let largest = near.fold(f64::MIN_POSITIVE, f64::max);
    // pairs cost at most 1: a touch without a blob costs more than all of them, one with a blob too far away even more
    let alone = touches as f64 + 1.0;
    let cost = |touch: usize, blob: usize| match distances.get(blob) {
        Some(row) if is_near(row[touch]) => row[touch] / largest,
        Some(_) => 2.0 * alone,
        None => alone,
    };
    let columns = blobs + touches;
    let mut assignment = Assignment::new(touches, columns);
    let found = assignment.solve(touches, columns, cost);
    found.iter().map(|&blob| Some(blob).filter(|&blob| blob < blobs)).collect()
}
