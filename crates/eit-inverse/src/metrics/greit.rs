//! The five GREIT figures of merit for an image of one target.

use super::cells::{Cells, check_place};
use super::{ChangeSign, sizes};
use crate::InverseError;
use crate::check::check_range;
use crate::geometry::distance_m;
use std::f64::consts::PI;

/// Start of the amplitude set as a fraction of the largest value (GREIT, section 2.3).
const QUARTER: f64 = 0.25;

/// True change that an image should show.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct GreitTarget<const D: usize> {
    /// Centre, metres.
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::absent::position"))]
    pub position_m: [f64; D],
    /// Integral of the change over the skin ([`Cells::integral`] of the truth), in the image's unit times
    /// square metres (S m^2 for a sheet), with its sign.
    pub amount_s_m2: f64,
}

/// Result of [`greit_figures`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
#[non_exhaustive]
pub struct GreitFigures<const D: usize> {
    /// AR, dimensionless: 1 if the image contains as much change as the truth.
    pub amplitude_response: f64,
    /// PE, metres: positive if the target in the image is closer to the skin's centre than the true one. It
    /// is blind to errors around the centre; see `centre_m` for the position itself.
    pub position_error_m: f64,
    /// RES, dimensionless, 0 to 1: root of the fraction of the skin that the amplitude set covers.
    pub resolution: f64,
    /// SD, dimensionless, 0 to 1: fraction of the amplitude set outside the circle of equal area.
    pub shape_deformation: f64,
    /// RNG, dimensionless, at least 0: change of the opposite sign outside that circle relative to the
    /// change inside; infinite if the circle contains no change of the chosen sign.
    pub ringing: f64,
    /// Centroid of the amplitude set, metres.
    #[cfg_attr(feature = "serde", serde(serialize_with = "crate::absent::position"))]
    pub centre_m: [f64; D],
}

/// Computes the GREIT figures of merit for an image of one target; `None` if no value has the sign.
///
/// With `x` the image (negated for [`ChangeSign::Decrease`]), `a` the areas, `Q` the quarter amplitude set
/// `x >= max x / 4`, `r_Q` its centroid (with equal weights), `r_0` the centroid of the skin, and `C` the
/// cells whose centre is at most `sqrt(A_Q / pi)` from `r_Q`, where `A_Q` is the area of `Q`:
///
/// ```text
/// AR  = sum a x / amount                          PE = |r_target - r_0| - |r_Q - r_0|
/// RES = sqrt(A_Q / A_skin)                        SD = sum of a over Q outside C / A_Q
/// RNG = sum of a |x| where x < 0 outside C / sum of a x inside C
/// ```
///
/// Non-finite values count as zero. Distances on a curved skin are straight lines.
///
/// Source: Adler et al., *Physiol. Meas.* 30 (2009), S35-S55, section 2.3. Two choices differ: cells are
/// weighted by area, so they need not be equal, and AR is relative to the true amount (the paper's images
/// are normalised by it beforehand). RNG has the sign of EIDORS (positive) but the circle of the paper,
/// where EIDORS takes `Q`.
///
/// # Errors
/// [`InverseError::WrongLength`]; [`InverseError::OutOfRange`] for a target whose amount is zero or not
/// finite, or whose position is not finite.
pub fn greit_figures<const D: usize>(
    values: &[f64],
    cells: &Cells<D>,
    sign: ChangeSign,
    target: &GreitTarget<D>,
) -> Result<Option<GreitFigures<D>>, InverseError> {
    cells.check("values", values)?;
    check_place("target.position_m", &target.position_m)?;
    let amount = target.amount_s_m2;
    let fine = amount != 0.0 && amount.is_finite();
    check_range("target.amount_s_m2", amount, fine, "finite and not zero")?;
    let Some((x, largest)) = sizes(values, sign) else { return Ok(None) };
    let areas = cells.areas_m2();
    let all = || 0..x.len();
    // fold from 0.0, since the empty `sum` is -0.0
    let area_of = |part: &dyn Fn(usize) -> bool| {
        all().filter(|&k| part(k)).fold(0.0, |sum, k| sum + areas[k])
    };
    let amount_of = |part: &dyn Fn(usize) -> bool| {
        all().filter(|&k| part(k)).fold(0.0, |sum, k| sum + areas[k] * x[k])
    };
    let (skin_centre, skin_m2) = cells.centre(all());
    let (centre_m, set_m2) = cells.centre(all().filter(|&k| x[k] >= QUARTER));
    let radius_m = (set_m2 / PI).sqrt();
    let in_circle = |k: usize| distance_m(cells.positions_m()[k], centre_m) <= radius_m;
    let inside = amount_of(&in_circle);
    let opposite = amount_of(&|k| x[k] < 0.0 && !in_circle(k));
    Ok(Some(GreitFigures {
        amplitude_response: amount_of(&|_| true) * (sign.factor() * largest / amount),
        position_error_m: distance_m(target.position_m, skin_centre)
            - distance_m(centre_m, skin_centre),
        resolution: (set_m2 / skin_m2).sqrt(),
        shape_deformation: area_of(&|k| x[k] >= QUARTER && !in_circle(k)) / set_m2,
        ringing: if inside > 0.0 { (0.0 - opposite) / inside } else { f64::INFINITY },
        centre_m,
    }))
}
