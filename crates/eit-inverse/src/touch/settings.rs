//! Settings of a stream of touches.

use super::noise::FalseAlarms;
use crate::InverseError;
use crate::check::check_positive;
use crate::metrics::ChangeSign;

/// Settings of [`TouchStream`](super::TouchStream).
#[derive(Debug, Clone, PartialEq)]
pub struct TouchStreamSettings {
    /// Which changes are touches. Default: increase.
    pub sign: ChangeSign,
    /// False touches per hour that noise alone may make. Default 1.
    pub false_alarms_per_hour: f64,
    /// Images per second, hertz: turns that rate into one per image. Default 20.
    pub frame_rate_hz: f64,
    /// Touches at once, 1 to 64; the strongest are kept. Default 10.
    pub max_touches: usize,
    /// Images that must show a touch before it is reported. Default 2 ...
    pub birth_hits: usize,
    /// ... of this many, from the first that shows it; at most 32. Default 3.
    pub birth_frames: usize,
    /// Images in a row that need not show a touch before it ends. Default 3.
    pub forgiven_frames: usize,
    /// Least peak of a touch relative to the strongest of its image: what is lower may be an
    /// artefact of that one, which no noise floor knows. From 0 to 1; default 0.25.
    pub relative_floor: f64,
    /// Two tops are two touches where the lower one stands above the saddle by this part of its
    /// height (and by the noise floor). From 0 to 1; default 0.15.
    pub prominence: f64,
    /// Acceleration of touches, root mean square, m/s^2. Default 2: a finger that sets off to slide.
    pub acceleration_m_s2: f64,
    /// Velocity of touches that appear, root mean square in each coordinate, m/s. Default 0.3.
    pub velocity_std_m_s: f64,
    /// What a position errs by beyond the noise, from image to image, metres: pixels, artefacts.
    /// Default 0.5 mm.
    pub method_std_m: f64,
    /// Squared distance, in units of the joint covariance of prediction and measurement, beyond
    /// which a blob is not the touch. Default 16: one in 3000 of true pairs on a flat skin.
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
