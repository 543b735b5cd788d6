//! Input checks shared by all modules.

use crate::InverseError;

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
