//! Whitened Jacobian and its product with a prior covariance, the starting point of every method in
//! measurement space.

use crate::check::check_length;
use crate::data::Channels;
use crate::{InverseError, Prior};
use ndarray::{ArrayRef2, ArrayView2};

/// `W^1/2 J` of the used measurements, row-major; rows divided by model voltages if normalised.
pub(crate) fn weighted_rows(
    jacobian: &ArrayRef2<f64>,
    channels: &Channels,
) -> Result<Vec<f64>, InverseError> {
    let mut weighted = Vec::with_capacity(channels.used.len() * jacobian.ncols());
    for (k, &measurement) in channels.used.iter().enumerate() {
        let factor = channels.row_factor(k);
        for (element, &value) in jacobian.row(measurement).iter().enumerate() {
            let entry = factor * value;
            if !entry.is_finite() {
                return Err(InverseError::NonFiniteJacobian { measurement, element, value });
            }
            weighted.push(entry);
        }
    }
    Ok(weighted)
}

/// `W^1/2 J P`, row-major, from row-major rows of `elements` entries.
pub(crate) fn covariance_times(
    prior: &dyn Prior,
    weighted: &[f64],
    elements: usize,
) -> Result<Vec<f64>, InverseError> {
    let what = "J P of the prior";
    let rows = weighted.len() / elements;
    let view = ArrayView2::from_shape((rows, elements), weighted).map_err(|_| {
        InverseError::WrongLength { what, found: weighted.len(), wanted: rows * elements }
    })?;
    let product = prior.covariance_times(view)?;
    check_length("rows of J P of the prior", product.nrows(), rows)?;
    check_length("columns of J P of the prior", product.ncols(), elements)?;
    Ok(product.iter().copied().collect())
}
