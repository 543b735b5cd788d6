//! Figures of merit of image sequences: how smoothly a track runs, how much of an image is no touch.

use super::cells::{Cells, check_place};
use crate::InverseError;
use crate::geometry::distance_m;

/// Root mean square second difference of a track, metres (per frame squared):
///
/// ```text
/// sqrt(mean over k of |p[k + 1] - 2 p[k] + p[k - 1]|^2)
/// ```
///
/// `track_m` is one place per frame, metres; `None` in frames where the touch was missed. Only
/// frames whose two neighbours are there count; the result is `None` where there are none. Zero
/// for steady motion on a line; `r angle^2` (nearly) for steps of `angle` on a circle of radius
/// `r`; `sqrt(6) s` for independent errors of standard deviation `s` in each coordinate, times
/// the root of the number of coordinates. Compare with the same figure of the true track.
///
/// A place that is not finite makes the result infinite or NaN.
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

/// Part of an image's energy that lies farther than `distance_m` from every touch, 0 to 1:
///
/// ```text
/// sum over cells farther than distance_m of  area x^2  /  sum over all cells of  area x^2
/// ```
///
/// Both signs count. Values that are not finite count as zero; `None` for an image that is zero.
/// Without touches all of it is artefact: 1.
///
/// # Errors
/// [`InverseError::WrongLength`]; [`InverseError::OutOfRange`] for a distance below zero or NaN,
/// or places that are not finite.
pub fn artefact_energy<const D: usize>(
    values: &[f64],
    cells: &Cells<D>,
    touches_m: &[[f64; D]],
    distance_from_touch_m: f64,
) -> Result<Option<f64>, InverseError> {
    cells.check("values", values)?;
    touches_m.iter().try_for_each(|touch| check_place("touches_m", touch))?;
    if distance_from_touch_m.is_nan() || distance_from_touch_m < 0.0 {
        let (quantity, must) = ("distance_from_touch_m", "zero or above");
        return Err(InverseError::OutOfRange { quantity, value: distance_from_touch_m, must });
    }
    let largest = values.iter().filter(|x| x.is_finite()).fold(0.0_f64, |m, x| m.max(x.abs()));
    if largest == 0.0 {
        return Ok(None);
    }
    let (mut far, mut all) = (0.0, 0.0);
    let places = cells.areas_m2().iter().zip(cells.positions_m());
    for (value, (area, &place)) in values.iter().zip(places) {
        if value.is_finite() {
            // relative to the largest, so that no unit under- or overflows
            let energy = area * (value / largest).powi(2);
            all += energy;
            if touches_m.iter().all(|&touch| distance_m(place, touch) > distance_from_touch_m) {
                far += energy;
            }
        }
    }
    Ok(Some(far / all))
}
