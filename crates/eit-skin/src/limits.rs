//! Limits of what fits in memory, and of what rounding may cost.

use crate::error::SkinError;
use eit_fem::SolveReport;

/// Maximum size of an array, bytes.
pub(crate) const MOST_BYTES: f64 = 8e9;
/// Loss above which to warn, and loss above which to reject the voltages.
pub(crate) const WARN_LOSS: f64 = 1e-6;
const REFUSE_LOSS: f64 = 0.1;

/// Rejects voltages that rounding may have made meaningless; warns if it may have cost digits.
///
/// # Errors
///
/// An expected loss above a tenth of the largest voltage.
pub fn rounding_warning(report: &SolveReport) -> Result<Option<String>, SkinError> {
    warning_of_loss(report.expected_loss)
}

/// [`rounding_warning`] for an expected loss.
pub(crate) fn warning_of_loss(loss: f64) -> Result<Option<String>, SkinError> {
    if loss.is_nan() || loss > REFUSE_LOSS {
        let decades = (loss / (1000.0 * f64::EPSILON)).log10();
        return Err(SkinError::NoCertainDigit { decades });
    }
    Ok((loss > WARN_LOSS).then(|| {
        format!(
            "rounding may have cost up to {loss:.0e} of the largest voltage (a cautious estimate)"
        )
    }))
}

/// Rejects a number of images of `pixels` x `pixels` that do not fit in memory. Call it before creating a
/// raster, which takes some 1.8 GB for 4096 pixels.
///
/// # Errors
///
/// Images of more than 8 GB in total.
pub fn check_images(count: usize, pixels: usize) -> Result<(), SkinError> {
    let bytes = 8.0 * count as f64 * (pixels as f64).powi(2);
    if bytes > MOST_BYTES {
        return Err(SkinError::TooLarge {
            what: format!("{count} images of {pixels} x {pixels} pixels"),
            gigabytes: 1e-9 * bytes,
            advice: "use fewer [reconstruction] pixels or fewer frames",
        });
    }
    Ok(())
}

/// Rejects a Jacobian on `pixels` x `pixels`, as total variation needs it, that does not fit in memory. Call
/// it before creating a raster.
///
/// # Errors
///
/// A Jacobian of more than 8 GB.
pub fn check_pixel_jacobian(measurements: usize, pixels: usize) -> Result<(), SkinError> {
    let bytes = 8.0 * measurements as f64 * (pixels as f64).powi(2);
    if bytes > MOST_BYTES {
        return Err(SkinError::TooLarge {
            what: format!("{measurements} measurements on {pixels} x {pixels} pixels"),
            gigabytes: 1e-9 * bytes,
            advice: "use fewer [reconstruction] pixels, or method = \"gauss-newton\"",
        });
    }
    Ok(())
}
