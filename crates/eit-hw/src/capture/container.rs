//! The MCAP container: how it begins, and its errors.

use crate::error::{HwError, Place};

/// First bytes of an MCAP file, such as a recording of ours.
pub const MAGIC: &[u8] = crate::readers::MCAP_MAGIC;

/// What the container says, as an error of this crate.
pub(super) fn container_error(place: Place, what: &impl ToString) -> HwError {
    let what = what.to_string().replace(char::is_control, "?");
    HwError::Container { place, what, mend: "record it anew" }
}
