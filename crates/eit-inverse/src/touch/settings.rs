//! Settings of a touch stream.

use super::noise::FalseAlarms;
use crate::InverseError;
use crate::check::check_positive;
use crate::metrics::ChangeSign;

/// Settings of [`TouchStream`](super::TouchStream).
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct TouchStreamSettings {
    /// Which sign of change is a touch. Default: increase.
    pub sign: ChangeSign,
    /// Accepted rate of false touches from noise alone, per hour. Default 1.
    pub false_alarms_per_hour: f64,
    /// Images per second, hertz; converts that rate into one per image. Default 20.
    pub frame_rate_hz: f64,
    /// Largest number of simultaneous touches, 1 to 64; the strongest are kept. Default 10.
    pub max_touches: usize,
    /// Number of images that must show a touch before it is reported. Default 2 ...
    pub birth_hits: usize,
    /// ... out of this many, counted from the first that shows it; at most 32. Default 3.
    pub birth_frames: usize,
    /// Successive images without a touch that are forgiven before it ends. Default 3.
    pub forgiven_frames: usize,
    /// Least peak of a touch relative to the strongest in its image, from 0 to 1. Anything lower may be an
    /// artefact of the strongest touch, which no noise floor covers. Default 0.25.
    pub relative_floor: f64,
    /// Two peaks are two touches if the lower one rises above the saddle by this fraction of its height
    /// (and by the noise floor). From 0 to 1; default 0.15.
    pub prominence: f64,
    /// Root mean square acceleration of touches, m/s^2. Default 2: a finger that starts to slide.
    pub acceleration_m_s2: f64,
    /// Root mean square velocity of new touches in each coordinate, m/s. Default 0.3.
    pub velocity_std_m_s: f64,
    /// Position error beyond the noise, from image to image (pixels, artefacts), metres. Default 0.5 mm.
    pub method_std_m: f64,
    /// Largest squared distance between touch and blob, in units of the joint covariance of prediction and
    /// measurement. Default 16, which rejects one in 3000 true pairs on a flat skin.
    pub gate: f64,
    /// Largest standard deviation of a valid position in any coordinate, metres. Default 10 mm.
    pub max_position_std_m: f64,
}

impl Default for TouchStreamSettings {
    fn default() -> Self {
        Self {
            sign: ChangeSign::Increase,
            false_alarms_per_hour: 1.0,
            frame_rate_hz: 20.0,
            max_touches: 10,
            birth_hits: 2,
            birth_frames: 3,
            forgiven_frames: 3,
            relative_floor: 0.25,
            prominence: 0.15,
            acceleration_m_s2: 2.0,
            velocity_std_m_s: 0.3,
            method_std_m: 0.5e-3,
            gate: 16.0,
            max_position_std_m: 10e-3,
        }
    }
}

impl TouchStreamSettings {
    /// Checks every number.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), InverseError> {
        self.alarms().validate()?;
        if !(1..=64).contains(&self.max_touches) {
            let (quantity, value) = ("max_touches", self.max_touches as f64);
            return Err(InverseError::OutOfRange { quantity, value, must: "from 1 to 64" });
        }
        for (quantity, value) in
            [("relative_floor", self.relative_floor), ("prominence", self.prominence)]
        {
            if !(0.0..=1.0).contains(&value) {
                return Err(InverseError::OutOfRange { quantity, value, must: "from 0 to 1" });
            }
        }
        check_positive("acceleration_m_s2", self.acceleration_m_s2)?;
        check_positive("velocity_std_m_s", self.velocity_std_m_s)?;
        check_positive("method_std_m", self.method_std_m)?;
        check_positive("gate", self.gate)?;
        check_positive("max_position_std_m", self.max_position_std_m)
    }

    pub(super) fn alarms(&self) -> FalseAlarms {
        FalseAlarms {
            per_hour: self.false_alarms_per_hour,
            frame_rate_hz: self.frame_rate_hz,
            hits: self.birth_hits,
            of: self.birth_frames,
        }
    }
}
