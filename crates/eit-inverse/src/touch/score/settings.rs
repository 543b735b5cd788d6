//! Settings of the model of touch: physical quantities, each with its unit and source.

use crate::InverseError;
use crate::check::{check_positive, check_range};
use crate::metrics::ChangeSign;

/// Largest number of simultaneous touches.
pub(super) const MOST_TOUCHES: usize = 8;
/// Number of time constants with which the fabric settles.
pub(super) const SETTLING: usize = 3;

/// Settings of a [`ScoreDetector`](super::ScoreDetector).
///
/// Strengths are areas over which the conductivity is doubled, square metres.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(deny_unknown_fields, default)
)]
pub struct ScoreSettings {
    /// Which sign of change is a touch.
    pub sign: ChangeSign,
    /// Largest number of simultaneous touches, 1 to 8.
    pub max_touches: usize,
    /// Least distance between places at which responses are known, metres: the response of a finger changes over 7 mm.
    pub pitch_m: f64,
    /// Radius of the print `exp(-(d / radius)^2)`, metres: a fingertip.
    pub bell_m: f64,
    /// Strength of a typical touch: 1 N on the paper's fabric gives 25 to 50 mm^2.
    pub typical_m2: f64,
    /// Strength of the faintest touch.
    pub least_m2: f64,
    /// Touches that begin, per second and square metre: one in two seconds on a disc of 10 cm radius.
    pub born_hz_m2: f64,
    /// Touches that end, per second and touch.
    pub dies_hz: f64,
    /// Width of a finger, metres.
    pub apart_m: f64,
    /// Trembling of a resting touch, metres a frame.
    pub rest_m: f64,
    /// Change of the speed of a moving touch within a frame, metres per second: a hand.
    pub speed_m_s: f64,
    /// Part of the touches that move.
    pub moving: f64,
    /// Part of the frames after which a touch turns out to be elsewhere, ...
    pub misplaced: f64,
    /// ... and how far, metres.
    pub misplaced_m: f64,
    /// Standard deviation of the print's squared radius, relative: tips of 4 to 12 mm radius.
    pub size: f64,
    /// Standard deviation of its elongation, relative.
    pub bent: f64,
    /// Standard deviation of the ring around a print, relative: fabric drawn in from around a finger, or its strained rim.
    pub ring: f64,
    /// Pull of the fabric towards a strong touch at 15 mm, metres: the product's electrode movement, and half as much again.
    pub pull_m: f64,
    /// Drag of the fabric by a strong touch that slides, metres.
    pub drag_m: f64,
    /// Pull of electrodes in addition to the fabric's, metres: the product's electrode movement.
    pub electrode_pull_m: f64,
    /// Change of the logarithm of a contact impedance under a strong touch.
    pub press: f64,
    /// Part of the common potential that amplifiers do not reject: 50 dB, behind multiplexers at tens of kilohertz.
    pub common_mode: f64,
    /// Part of the movement and pressure of electrodes that each has by itself: a movement field known to 30 %.
    pub single: f64,
    /// Error of the model of a change, relative, ...
    pub error: f64,
    /// ... and the standard deviation of its logarithm; it is found from the frames.
    pub error_std: f64,
    /// Time over which such errors persist, seconds: a press or a slide lasts that long.
    pub error_s: f64,
    /// Time constants with which the fabric settles or creeps, seconds.
    pub settle_s: [f64; SETTLING],
    /// Standard deviation of the part of a touch by which it does, with any of them: knits settle by 0.02 to 0.15, foams creep by
    /// 0.1 to 0.3.
    pub settle: f64,
    /// Trail that a touch leaves, relative to its print: published hysteresis is 3 to 12 % of the range.
    pub trail: f64,
    /// The same around its print.
    pub trail_ring: f64,
    /// Distance over which a moving touch lays a whole trail, metres: the width of the print.
    pub trail_m: f64,
    /// Time in which a trail fades, seconds.
    pub trail_s: f64,
    /// Drift of the logarithm of a contact impedance in a minute.
    pub drift_contact: f64,
    /// Drift of the logarithm of the sheet's conductivity in a minute: one that warms by 0.6 % a minute for ten.
    pub drift_sheet: f64,
    /// Drift of the position of an electrode in a minute, metres.
    pub drift_electrode_m: f64,
    /// Time in which each row by itself drifts (a random walk) by its noise of one frame, seconds: an amplifier warms in minutes.
    pub drift_s: f64,
    /// Faults of electrodes, per second and electrode: one in ten hours of a skin.
    pub fault_hz: f64,
    /// Rate at which a faulty electrode recovers, hertz.
    pub heal_hz: f64,
    /// Drift of the gain of an electrode whose contact gets worse, per second.
    pub gain_per_s: f64,
    /// Part of a change by which reciprocal halves may differ; at least three times that of the reference.
    pub unequal: f64,
    /// 2 ln odds from which a touch is shown: 9 is 90 to 1. It is then as likely an error of the model.
    pub shown: f64,
}

impl Default for ScoreSettings {
    fn default() -> Self {
        Self {
            sign: ChangeSign::default(),
            max_touches: MOST_TOUCHES,
            pitch_m: 4e-3,
            bell_m: 7e-3,
            typical_m2: 30e-6,
            least_m2: 1.5e-6,
            born_hz_m2: 16.0,
            dies_hz: 1.0,
            apart_m: 18e-3,
            rest_m: 0.3e-3,
            speed_m_s: 0.15,
            moving: 0.3,
            misplaced: 1e-3,
            misplaced_m: 15e-3,
            size: 0.8,
            bent: 0.4,
            ring: 0.5,
            pull_m: 0.3e-3,
            drag_m: 0.5e-3,
            electrode_pull_m: 0.2e-3,
            press: 0.3,
            common_mode: 3e-3,
            single: 0.3,
            error: 0.02,
            error_std: 0.7,
            error_s: 20.0,
            settle_s: [0.5, 2.0, 10.0],
            settle: 0.15,
            trail: 0.02,
            trail_ring: 0.03,
            trail_m: 12e-3,
            trail_s: 5.0,
            drift_contact: 0.02,
            drift_sheet: 0.02,
            drift_electrode_m: 2e-5,
            drift_s: 200.0,
            fault_hz: 2e-6,
            heal_hz: 0.1,
            gain_per_s: 0.02,
            unequal: 0.01,
            shown: 9.0,
        }
    }
}

impl ScoreSettings {
    /// Rejects invalid settings.
    ///
    /// # Errors
    ///
    /// A value out of its range; the error names it.
    pub fn validate(&self) -> Result<(), InverseError> {
        let most = MOST_TOUCHES as f64;
        let count = self.max_touches as f64;
        check_range("max_touches", count, (1.0..=most).contains(&count), "1 to 8")?;
        self.above_zero().into_iter().try_for_each(|(name, value)| check_positive(name, value))?;
        for (name, value) in self.not_negative() {
            check_range(
                name,
                value,
                value >= 0.0 && value.is_finite(),
                "finite and not below zero",
            )?;
        }
        for (name, value) in [("moving", self.moving), ("misplaced", self.misplaced)] {
            check_range(name, value, value > 0.0 && value < 1.0, "between 0 and 1")?;
        }
        Ok(())
    }

    fn above_zero(&self) -> [(&'static str, f64); 22] {
        [
            ("pitch_m", self.pitch_m),
            ("bell_m", self.bell_m),
            ("typical_m2", self.typical_m2),
            ("least_m2", self.least_m2),
            ("born_hz_m2", self.born_hz_m2),
            ("dies_hz", self.dies_hz),
            ("apart_m", self.apart_m),
            ("rest_m", self.rest_m),
            ("speed_m_s", self.speed_m_s),
            ("misplaced_m", self.misplaced_m),
            ("error", self.error),
            ("error_std", self.error_std),
            ("error_s", self.error_s),
            ("settle_s", self.settle_s[0]),
            ("settle_s", self.settle_s[1]),
            ("settle_s", self.settle_s[2]),
            ("trail", self.trail),
            ("trail_m", self.trail_m),
            ("trail_s", self.trail_s),
            ("drift_s", self.drift_s),
            ("fault_hz", self.fault_hz),
            ("heal_hz", self.heal_hz),
        ]
    }

    fn not_negative(&self) -> [(&'static str, f64); 17] {
        [
            ("size", self.size),
            ("bent", self.bent),
            ("ring", self.ring),
            ("pull_m", self.pull_m),
            ("drag_m", self.drag_m),
            ("electrode_pull_m", self.electrode_pull_m),
            ("press", self.press),
            ("common_mode", self.common_mode),
            ("single", self.single),
            ("settle", self.settle),
            ("trail_ring", self.trail_ring),
            ("drift_contact", self.drift_contact),
            ("drift_sheet", self.drift_sheet),
            ("drift_electrode_m", self.drift_electrode_m),
            ("gain_per_s", self.gain_per_s),
            ("unequal", self.unequal),
            ("shown", self.shown),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_settings_are_named() {
        assert_eq!(ScoreSettings::default().validate(), Ok(()));
        let refused = [
            ("max_touches", ScoreSettings { max_touches: 9, ..Default::default() }),
            ("bell_m", ScoreSettings { bell_m: 0.0, ..Default::default() }),
            ("settle_s", ScoreSettings { settle_s: [f64::NAN; 3], ..Default::default() }),
            ("ring", ScoreSettings { ring: -0.1, ..Default::default() }),
            ("moving", ScoreSettings { moving: 1.0, ..Default::default() }),
        ];
        for (name, settings) in refused {
            match settings.validate() {
                Err(InverseError::OutOfRange { quantity, .. }) => assert_eq!(quantity, name),
                other => panic!("{name}: {other:?}"),
            }
        }
    }
}
