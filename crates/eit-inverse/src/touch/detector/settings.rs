//! Settings of a touch detector.

use crate::InverseError;
use crate::check::check_positive;
use crate::metrics::ChangeSign;

/// Settings of [`TouchDetector`](super::TouchDetector).
///
/// The defaults were tuned on simulated presses of the paper's skin and tested on other seeds, skins and
/// faults (`docs/validation/touches.md`). A strength is the integral of the conductivity change over the
/// touch, S m^2.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields)
)]
pub struct DetectorSettings {
    /// Which sign of change is a touch. Default: increase.
    pub sign: ChangeSign,
    /// Spacing of the candidate positions, metres. Default 5 mm. There are never more than 2 000 positions.
    pub spacing_m: f64,
    /// Radius of the bell `exp(-(d / radius)^2)`, which also has a faint tail, metres. Default 7 mm.
    pub radius_m: f64,
    /// Largest number of simultaneous touches, 1 to 16. Default 8.
    pub max_touches: usize,
    /// Least distance between two touches, metres. Default 25 mm.
    pub apart_m: f64,
    /// Least strength of a touch, S m^2.
    pub least_s_m2: f64,
    /// Least strength as a fraction of the strongest touch of the frame. Default 0.15.
    pub least_share: f64,
    /// Least strength as a fraction of the strongest recent touch anywhere. Default 0.04.
    pub least_share_of_late: f64,
    /// Least strength of a new touch as a fraction of the strongest recent touch within 20 mm. Default 0.12.
    pub least_share_of_here: f64,
    /// Time constant with which recent strengths fade, seconds. Default 2.
    pub late_s: f64,
    /// Least decrease of chi^2 by a new touch, in units of the noise with all nuisance parameters. Default 36:
    /// noise alone exceeds it at one of some hundred independent positions once in about four million frames.
    pub least_gain: f64,
    /// Least evidence ratio of a new touch, see
    /// [`DetectedTouch::worth`](super::DetectedTouch::worth). Default 1.8.
    pub least_ratio: f64,
    /// Least decrease of chi^2 by a touch that the previous frame showed too. Default 9.
    pub least_gain_of_known: f64,
    /// Least evidence ratio of a touch that the previous frame showed too. Default 1.25.
    pub least_ratio_of_known: f64,
    /// Time constant with which the reference follows what touches do not explain, while nothing touches
    /// the skin, seconds. Default 1.
    pub idle_s: f64,
    /// The same time constant while something touches the skin, seconds. Default 5.
    pub touched_s: f64,
    /// Time constants with which the fabric settles after a change of load, seconds. Default 0.5 and 10.
    pub settling_s: [f64; 2],
    /// Largest fraction of a touch that settling can take. Default 0.15.
    pub settling_share: f64,
    /// Largest fraction of a touch that hysteresis can leave behind. Default 0.05.
    pub trail_share: f64,
    /// Number of separate trails, 0 to 8; the oldest are merged. Default 4.
    pub trails: usize,
    /// Length of a trail in widths of the bell, where a press counts as one. Default 4.
    pub trail_widths: f64,
}

impl DetectorSettings {
    /// Returns the defaults with the given least strength of a touch, S m^2.
    pub fn with_least(least_s_m2: f64) -> Self {
        Self {
            sign: ChangeSign::Increase,
            spacing_m: 5e-3,
            radius_m: 7e-3,
            max_touches: 8,
            apart_m: 25e-3,
            least_s_m2,
            least_share: 0.15,
            least_share_of_late: 0.04,
            least_share_of_here: 0.12,
            late_s: 2.0,
            least_gain: 36.0,
            least_ratio: 1.8,
            least_gain_of_known: 9.0,
            least_ratio_of_known: 1.25,
            idle_s: 1.0,
            touched_s: 5.0,
            settling_s: [0.5, 10.0],
            settling_share: 0.15,
            trail_share: 0.05,
            trails: 4,
            trail_widths: 4.0,
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// [`InverseError::OutOfRange`].
    pub fn validate(&self) -> Result<(), InverseError> {
        let positive = [
            ("spacing_m", self.spacing_m),
            ("radius_m", self.radius_m),
            ("apart_m", self.apart_m),
            ("least_s_m2", self.least_s_m2),
            ("late_s", self.late_s),
            ("least_gain", self.least_gain),
            ("least_gain_of_known", self.least_gain_of_known),
            ("trail_widths", self.trail_widths),
            ("idle_s", self.idle_s),
            ("touched_s", self.touched_s),
            ("settling_s", self.settling_s[0]),
            ("settling_s", self.settling_s[1]),
        ];
        positive.into_iter().try_for_each(|(quantity, value)| check_positive(quantity, value))?;
        let shares = [
            ("least_share", self.least_share),
            ("least_share_of_late", self.least_share_of_late),
            ("least_share_of_here", self.least_share_of_here),
            ("settling_share", self.settling_share),
            ("trail_share", self.trail_share),
        ];
        for (quantity, value) in shares {
            if !(0.0..1.0).contains(&value) {
                let must = "at least 0 and below 1";
                return Err(InverseError::OutOfRange { quantity, value, must });
            }
        }
        let ratios = [
            ("least_ratio", self.least_ratio),
            ("least_ratio_of_known", self.least_ratio_of_known),
        ];
        for (quantity, value) in ratios {
            if !(value >= 1.0 && value.is_finite()) {
                return Err(InverseError::OutOfRange {
                    quantity,
                    value,
                    must: "finite, at least 1",
                });
            }
        }
        if self.trails > 8 {
            let (quantity, value) = ("trails", self.trails as f64);
            return Err(InverseError::OutOfRange { quantity, value, must: "from 0 to 8" });
        }
        if !(1..=16).contains(&self.max_touches) {
            let (quantity, value) = ("max_touches", self.max_touches as f64);
            return Err(InverseError::OutOfRange { quantity, value, must: "from 1 to 16" });
        }
        Ok(())
    }
}
