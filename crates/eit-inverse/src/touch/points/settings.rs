//! Settings of the tracking of touches.

use crate::InverseError;
use crate::check::{check_positive, check_range};
use crate::touch::motion::Pace;

/// Settings of a [`TouchTracker`](super::TouchTracker).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields)
)]
pub struct TrackerSettings {
    /// Largest number of simultaneous touches.
    pub max_touches: usize,
    /// Strength from which a touch is reported at once, S m^2; it must also be at least four of its own
    /// standard deviations.
    pub strong_s_m2: f64,
    /// Least evidence ratio of a touch that is reported at once although another one is more than
    /// twice as strong, since the fit of the stronger one may leave a residual beside it. Default
    /// 4.5: nine in ten are true.
    pub strong_worth: f64,
    /// Evidence ratio from which a touch is reported at once however weak it is; its strength must
    /// also be at least four of its own standard deviations. Default 8.
    pub sure_worth: f64,
    /// Number of frames that must show any other touch before it is reported. Default 2.
    pub birth_frames: usize,
    /// Successive frames without a touch that are forgiven before it ends; meanwhile it is reported but not
    /// valid. Default 1.
    pub forgiven_frames: usize,
    /// Largest distance that a touch moves from one frame to the next, metres. Default 40 mm.
    pub gate_m: f64,
    /// Position error beyond the stated covariance, from bell and model, metres. Default 1 mm.
    pub method_std_m: f64,
    /// Root mean square acceleration of moving touches, m/s^2. Default 2.
    pub acceleration_m_s2: f64,
    /// Root mean square velocity of touches that begin to move, in each coordinate, m/s. Default 0.3.
    pub velocity_std_m_s: f64,
    /// Largest standard deviation of a valid position in any coordinate, metres. Default 15 mm.
    pub max_position_std_m: f64,
    /// Whether positions err alike in all frames of a rest, as those of a learnt skin: the covariance that is reported
    /// is then that of the last frame, not of the filter. Default false.
    pub errs_alike: bool,
}

impl TrackerSettings {
    /// Returns the defaults with the strength from which a touch is reported at once, S m^2.
    pub fn with_strong(strong_s_m2: f64) -> Self {
        Self {
            max_touches: 8,
            strong_s_m2,
            strong_worth: 4.5,
            sure_worth: 8.0,
            birth_frames: 2,
            forgiven_frames: 1,
            gate_m: 40e-3,
            method_std_m: 1e-3,
            acceleration_m_s2: 2.0,
            velocity_std_m_s: 0.3,
            max_position_std_m: 15e-3,
            errs_alike: false,
        }
    }

    pub(super) fn pace(&self) -> Pace {
        let Self { acceleration_m_s2, velocity_std_m_s, .. } = *self;
        Pace { acceleration_m_s2, velocity_std_m_s }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), InverseError> {
        check_positive("strong_s_m2", self.strong_s_m2)?;
        check_positive("strong_worth", self.strong_worth)?;
        check_positive("sure_worth", self.sure_worth)?;
        check_positive("gate_m", self.gate_m)?;
        check_positive("method_std_m", self.method_std_m)?;
        check_positive("acceleration_m_s2", self.acceleration_m_s2)?;
        check_positive("velocity_std_m_s", self.velocity_std_m_s)?;
        check_positive("max_position_std_m", self.max_position_std_m)?;
        for (quantity, count) in
            [("max_touches", self.max_touches), ("birth_frames", self.birth_frames)]
        {
            check_range(quantity, count as f64, (1..=64).contains(&count), "from 1 to 64")?;
        }
        Ok(())
    }
}
