//! What a caller states of a reference that adapts.

use crate::InverseError;
use crate::check::check_positive;

/// Settings of [`AdaptiveReference`](crate::AdaptiveReference).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceSettings {
    /// Time constant of the filter, seconds. Default 30. A touch that takes much longer than this
    /// to come is taken for drift while it is small.
    pub time_constant_s: f64,
    /// How long after the last sign of contact the reference still stands, seconds. Default 0.5.
    pub release_s: f64,
    /// Whether the factor that all voltages have in common is followed under contact. Default true.
    /// Off: what drifts under contact becomes part of the touch.
    pub common_mode: bool,
    /// How long after contact begins the touch may change before that factor is taken to be 1,
    /// seconds. Default 1.
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
                let must = "finite and zero or above";
                return Err(InverseError::OutOfRange { quantity, value, must });
            }
        }
        Ok(())
    }
}
