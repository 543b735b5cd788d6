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

/// Rejects anything but a finite number above zero.
pub(crate) fn check_positive(quantity: &'static str, value: f64) -> Result<(), InverseError> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(InverseError::OutOfRange { quantity, value, must: "finite and above zero" })
    }
}
