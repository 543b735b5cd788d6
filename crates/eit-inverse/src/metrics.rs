//! Figures of merit of an image against the truth.

use crate::InverseError;
use crate::data::check_length;
use crate::prior::distance_m;
use eit_mesh::Surface;

/// Area-weighted correlation coefficient of two images `[element]`, -1 to 1.
///
/// `CC = cov(x, t) / sqrt(var(x) var(t))` with means over the skin's area. NaN where an image is
/// constant.
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

/// Centre of gravity of the part of an image `[element]` above half of its largest amplitude,
/// metres, weighted by area; the sign of the largest amplitude decides which sign counts. `None`
/// for an image that is zero.
///
/// Source: after the figures of merit of GREIT, Adler et al., *Physiol. Meas.* 30 (2009), S35-S55,
/// whose set begins at a quarter of the largest value.
///
/// # Errors
/// [`InverseError::WrongLength`].
pub fn half_amplitude_centre_m(
    image: &[f64],
    surface: &Surface,
) -> Result<Option<[f64; 3]>, InverseError> {
    let Some(peak) = peak(image, surface)? else { return Ok(None) };
    let sign = image[peak].signum();
    let threshold = 0.5 * image[peak].abs();
    let mut moment = [0.0; 3];
    let mut total = 0.0;
    for ((x, area), c) in image.iter().zip(surface.areas_m2()).zip(surface.centroids()) {
        if sign * x >= threshold {
            (0..3).for_each(|k| moment[k] += area * c[k]);
            total += area;
        }
    }
    Ok(Some(moment.map(|x| x / total)))
}

/// Centroid of the element of largest amplitude, metres; `None` for an image that is zero.
///
/// # Errors
/// [`InverseError::WrongLength`].
pub fn peak_position_m(image: &[f64], surface: &Surface) -> Result<Option<[f64; 3]>, InverseError> {
    Ok(peak(image, surface)?.map(|e| surface.centroids()[e]))
}

/// Distance of [`half_amplitude_centre_m`] to the true position, metres; infinite for an image
/// that is zero.
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

/// Element of largest amplitude.
fn peak(image: &[f64], surface: &Surface) -> Result<Option<usize>, InverseError> {
    check_length("image", image.len(), surface.triangles().len())?;
    let largest = (0..image.len()).max_by(|&a, &b| image[a].abs().total_cmp(&image[b].abs()));
    Ok(largest.filter(|&e| image[e] != 0.0))
}
