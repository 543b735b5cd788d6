//! Settings of an adaptive reference.

use crate::InverseError;
use crate::check::check_positive;

/// Settings of [`AdaptiveReference`](crate::AdaptiveReference).
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct ReferenceSettings {
    /// Time constant of the filter, seconds. Default 30. A touch that builds up much more slowly than this
    /// is taken for drift while it is small.
    pub time_constant_s: f64,
    /// How long the reference still holds after the last sign of contact, seconds. Default 0.5.
    pub release_s: f64,
    /// Whether the common factor of all voltages is followed under contact. Default true. If false, drift
    /// under contact becomes part of the touch.
    pub common_mode: bool,
    /// How long a touch may change after contact begins before the common factor is taken to be 1, seconds.
    /// Default 1.
    pub settle_s: f64,
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self { time_constant_s: 30.0, release_s: 0.5, common_mode: true, settle_s: 1.0 }
    }
}

impl ReferenceSettings {
    /// Checks every number.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), InverseError> {
        check_positive("time_constant_s", self.time_constant_s)?;
        for (quantity, value) in [("release_s", self.release_s), ("settle_s", self.settle_s)] {
            if !(value >= 0.0 && value.is_finite()) {
                let must = "finite and at least 0";
                return Err(InverseError::OutOfRange { quantity, value, must });
            }
        }
        Ok(())
    }
}
