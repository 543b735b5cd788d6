//! Figures of merit of an image or an image sequence compared with the truth.
//!
//! | question | figure |
//! |---|---|
//! | how close to the truth? | [`relative_error`], [`correlation_coefficient`], [`structural_similarity`] |
//! | how well does it show one target? | [`greit_figures`], [`half_maximum_centre_m`], [`position_error_m`] |
//! | does it show several touches? | [`touch_position_errors_m`] |
//! | how smooth is a sequence, and how much is artefact? | [`rms_second_difference_m`], [`artefact_energy`] |
//!
//! All of them work on elements and on pixels, except the similarity, which needs the order of the pixels.

mod cells;
mod greit;
mod similarity;
mod touches;
mod track;

pub use cells::Cells;
pub use greit::{GreitFigures, GreitTarget, greit_figures};
pub use similarity::{structural_similarity, structural_similarity_map};
pub use touches::{Blob, TouchErrors, TouchSettings, blobs, touch_position_errors_m};
pub use track::{artefact_energy, rms_second_difference_m};

use crate::InverseError;
use crate::check::check_length;
use crate::geometry::distance_m;
use eit_mesh::Surface;

/// Returns the relative error of an image `[element]` or `[pixel]`: 0 for the truth, 1 for an image of zeros.
///
/// ```text
/// RE = |x - t| / |t|,   |x|^2 = sum over elements of area x^2
/// ```
///
/// Infinite if the truth is zero and the image is not; NaN if both are zero or a value is not finite.
///
/// # Errors
/// [`InverseError::WrongLength`].
pub fn relative_error(image: &[f64], truth: &[f64], areas_m2: &[f64]) -> Result<f64, InverseError> {
    check_length("truth", truth.len(), image.len())?;
    check_length("areas_m2", areas_m2.len(), image.len())?;
    // relative to the largest value, so that no unit underflows or overflows
    let largest = image.iter().chain(truth).fold(0.0_f64, |m, x| m.max(x.abs()));
    let (mut error, mut size) = (0.0, 0.0);
    for ((x, t), area) in image.iter().zip(truth).zip(areas_m2) {
        let (x, t) = (x / largest, t / largest);
        error += area * (x - t).powi(2);
        size += area * t.powi(2);
    }
    Ok((error / size).sqrt())
}

/// Returns the area-weighted correlation coefficient of two images `[element]`, -1 to 1.
///
/// `CC = cov(x, t) / sqrt(var(x) var(t))` with means over the skin's area. NaN if an image is constant.
///
/// # Errors
/// [`InverseError::WrongLength`].
pub fn correlation_coefficient(
    image: &[f64],
    truth: &[f64],
    areas_m2: &[f64],
) -> Result<f64, InverseError> {
    check_length("truth", truth.len(), image.len())?;
    check_length("areas_m2", areas_m2.len(), image.len())?;
    let total: f64 = areas_m2.iter().sum();
    let mean = |x: &[f64]| x.iter().zip(areas_m2).map(|(x, a)| x * a).sum::<f64>() / total;
    let (image_mean, truth_mean) = (mean(image), mean(truth));
    let [mut covariance, mut image_variance, mut truth_variance] = [0.0; 3];
    for ((x, t), a) in image.iter().zip(truth).zip(areas_m2) {
        let (x, t) = (x - image_mean, t - truth_mean);
        covariance += a * x * t;
        image_variance += a * x * x;
        truth_variance += a * t * t;
    }
    Ok(covariance / image_variance.sqrt() / truth_variance.sqrt())
}

/// Sign of the changes that are evaluated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum ChangeSign {
    /// More conductivity: positive values.
    #[default]
    Increase,
    /// Less conductivity: negative values.
    Decrease,
}

impl ChangeSign {
    /// Returns 1 for an increase and -1 for a decrease.
    pub fn factor(self) -> f64 {
        match self {
            Self::Increase => 1.0,
            Self::Decrease => -1.0,
        }
    }
}

/// Returns values relative to the largest of one sign, and that largest magnitude.
///
/// 1 at the largest, negative for the other sign, zero for non-finite values. `None` if no value has the
/// sign.
fn sizes(values: &[f64], sign: ChangeSign) -> Option<(Vec<f64>, f64)> {
    let size = |x: &f64| if x.is_finite() { sign.factor() * x } else { 0.0 };
    let largest = values.iter().map(size).fold(0.0, f64::max);
    (largest > 0.0).then(|| (values.iter().map(|x| size(x) / largest).collect(), largest))
}

/// Returns the centroid of the part of an image that reaches half of its largest value of one sign, metres.
///
/// ```text
/// sum over the part  |x| area position / sum over the part  |x| area,   part: |x| >= max |x| / 2
/// ```
///
/// `values`, `areas_m2` and `positions_m` (in two or three dimensions) have one entry per element or per
/// pixel. Non-finite values (pixels outside the skin) are ignored. Returns `None` if no value has the sign.
///
/// Source: the position in the GREIT figures of merit, Adler et al., *Physiol. Meas.* 30 (2009), S35-S55,
/// section 2.3. GREIT uses a quarter of the largest value, with equal weights. Half, with the value as
/// weight, depends less on what lies at the threshold.
///
/// # Errors
/// [`InverseError::WrongLength`].
pub fn half_maximum_centre_m<const D: usize>(
    values: &[f64],
    areas_m2: &[f64],
    positions_m: &[[f64; D]],
    sign: ChangeSign,
) -> Result<Option<[f64; D]>, InverseError> {
    check_length("areas_m2", areas_m2.len(), values.len())?;
    check_length("positions_m", positions_m.len(), values.len())?;
    let Some((sizes, _)) = sizes(values, sign) else { return Ok(None) };
    let (mut moment, mut total) = ([0.0; D], 0.0);
    for ((size, area), position) in sizes.iter().zip(areas_m2).zip(positions_m) {
        if *size >= 0.5 {
            let weight = size * area;
            (0..D).for_each(|k| moment[k] += weight * position[k]);
            total += weight;
        }
    }
    Ok(Some(moment.map(|x| x / total)))
}

/// Returns [`half_maximum_centre_m`] of an image `[element]` on a surface, for the sign of the largest
/// magnitude; `None` for an image of zeros.
///
/// # Errors
/// [`InverseError::WrongLength`].
pub fn half_amplitude_centre_m(
    image: &[f64],
    surface: &Surface,
) -> Result<Option<[f64; 3]>, InverseError> {
    let Some(peak) = peak(image, surface)? else { return Ok(None) };
    let sign = if image[peak] > 0.0 { ChangeSign::Increase } else { ChangeSign::Decrease };
    half_maximum_centre_m(image, surface.areas_m2(), &surface.centroids(), sign)
}

/// Returns the distance of [`half_amplitude_centre_m`] from the true position, metres; infinite for an
/// image of zeros.
///
/// # Errors
/// [`InverseError::WrongLength`].
pub fn position_error_m(
    image: &[f64],
    surface: &Surface,
    truth_m: [f64; 3],
) -> Result<f64, InverseError> {
    let centre = half_amplitude_centre_m(image, surface)?;
    Ok(centre.map_or(f64::INFINITY, |c| distance_m(c, truth_m)))
}

/// Returns the element of largest magnitude, ignoring non-finite values.
fn peak(image: &[f64], surface: &Surface) -> Result<Option<usize>, InverseError> {
    check_length("image", image.len(), surface.triangles().len())?;
    let finite = (0..image.len()).filter(|&e| image[e].is_finite());
    let largest = finite.max_by(|&a, &b| image[a].abs().total_cmp(&image[b].abs()));
    Ok(largest.filter(|&e| image[e] != 0.0))
}
