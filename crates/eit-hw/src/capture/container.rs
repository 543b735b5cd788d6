//! The MCAP container: its magic bytes and its errors.

use crate::error::{HwError, Place};

/// Magic bytes at the start of every MCAP file, including recordings made by this crate.
pub const MAGIC: &[u8] = crate::readers::MCAP_MAGIC;

/// Converts an error of the container to one of this crate.
pub(super) fn container_error(place: Place, what: &impl ToString) -> HwError {
    let what = what.to_string().replace(char::is_control, "?");
    HwError::Container { place, what, mend: "record it again" }
}
