//! Figures of merit of image sequences: smoothness of a track, and fraction of an image that is artefact.

use super::cells::{Cells, check_place};
use crate::InverseError;
use crate::check::check_range;
use crate::geometry::distance_m;

/// Returns the root mean square second difference of a track, metres (per frame squared):
///
/// ```text
/// sqrt(mean over k of |p[k + 1] - 2 p[k] + p[k - 1]|^2)
/// ```
///
/// `track_m` is one position per frame, metres; `None` in frames where the touch was missed. Only frames
/// with both neighbours present count; the result is `None` if there are none. It is zero for steady motion
/// on a line; `r angle^2` (nearly) for steps of `angle` on a circle of radius `r`; `sqrt(6) s` times the
/// root of the number of coordinates for independent errors of standard deviation `s` in each coordinate.
/// Compare with the same figure of the true track.
///
/// A non-finite position makes the result infinite or NaN.
pub fn rms_second_difference_m<const D: usize>(track_m: &[Option<[f64; D]>]) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0_usize);
    for three in track_m.windows(3) {
        if let [Some(before), Some(here), Some(after)] = *three {
            sum += (0..D).map(|k| (after[k] - 2.0 * here[k] + before[k]).powi(2)).sum::<f64>();
            count += 1;
        }
    }
    (count > 0).then(|| (sum / count as f64).sqrt())
}

/// Returns the fraction of an image's energy farther than `distance_from_touch_m` from every touch, 0 to 1:
///
/// ```text
/// sum over cells farther than distance_from_touch_m of  area x^2  /  sum over all cells of  area x^2
/// ```
///
/// Both signs count. Non-finite values count as zero; the result is `None` for an image of zeros. Without
/// touches everything is artefact: 1.
///
/// # Errors
/// [`InverseError::WrongLength`]; [`InverseError::OutOfRange`] for a distance that is negative or NaN, or
/// non-finite positions.
pub fn artefact_energy<const D: usize>(
    values: &[f64],
    cells: &Cells<D>,
    touches_m: &[[f64; D]],
    distance_from_touch_m: f64,
) -> Result<Option<f64>, InverseError> {
    cells.check("values", values)?;
    touches_m.iter().try_for_each(|touch| check_place("touches_m", touch))?;
    let (away, fine) = (distance_from_touch_m, distance_from_touch_m >= 0.0);
    check_range("distance_from_touch_m", away, fine, "at least 0")?;
    let largest = values.iter().filter(|x| x.is_finite()).fold(0.0_f64, |m, x| m.max(x.abs()));
    if largest == 0.0 {
        return Ok(None);
    }
    let (mut far, mut all) = (0.0, 0.0);
    let places = cells.areas_m2().iter().zip(cells.positions_m());
    for (value, (area, &place)) in values.iter().zip(places) {
        if value.is_finite() {
            // relative to the largest, so that no unit underflows or overflows
            let energy = area * (value / largest).powi(2);
            all += energy;
            if touches_m.iter().all(|&touch| distance_m(place, touch) > distance_from_touch_m) {
                far += energy;
            }
        }
    }
    Ok(Some(far / all))
}
