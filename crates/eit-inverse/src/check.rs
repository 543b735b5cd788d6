//! Input checks shared by all modules.

use crate::InverseError;
use ndarray::ArrayView1;

/// Rejects a wrong length with an error that names both counts.
pub(crate) fn check_length(
    what: &'static str,
    found: usize,
    wanted: usize,
) -> Result<(), InverseError> {
    if found == wanted { Ok(()) } else { Err(InverseError::WrongLength { what, found, wanted }) }
}

/// Rejects a value that is not `fine`, which `must` says in words.
pub(crate) fn check_range(
    quantity: &'static str,
    value: f64,
    fine: bool,
    must: &'static str,
) -> Result<(), InverseError> {
    if fine { Ok(()) } else { Err(InverseError::OutOfRange { quantity, value, must }) }
}

/// Rejects anything but a finite number above zero.
pub(crate) fn check_positive(quantity: &'static str, value: f64) -> Result<(), InverseError> {
    check_range(quantity, value, value > 0.0 && value.is_finite(), "finite and above zero")
}

/// Rejects a value of a measurement's row of a Jacobian that is not finite.
pub(crate) fn check_finite(
    measurement: usize,
    row: ArrayView1<'_, f64>,
) -> Result<(), InverseError> {
    row.iter().enumerate().try_for_each(|(element, &value)| match value.is_finite() {
        true => Ok(()),
        false => Err(InverseError::NonFiniteJacobian { measurement, element, value }),
    })
}
