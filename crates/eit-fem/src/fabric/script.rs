//! Touch scripts: which fingers touch the skin, where, how hard and when.

use super::contact::Tip;
use super::seat::Seat;
use crate::error::FemError;
use eit_mesh::Mesh;

/// Script of fingers that touch a skin over time.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct TouchScript {
    /// Name, used in titles.
    #[cfg_attr(feature = "serde", serde(default))]
    pub name: String,
    /// Frames per second. Frame `f` is at `f / frame_rate_hz` seconds.
    pub frame_rate_hz: f64,
    /// Length of the script in frames.
    pub frames: usize,
    /// Number of frames without touch at the start, for noise and reference. A key with a force
    /// must not lie before their end.
    #[cfg_attr(feature = "serde", serde(default))]
    pub quiet_frames: usize,
    /// Paths and forces of the fingers.
    #[cfg_attr(feature = "serde", serde(default, rename = "finger"))]
    pub fingers: Vec<Finger>,
}

/// One finger and its path.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Finger {
    /// Number of the finger in the ground truth.
    pub id: u32,
    /// Pressure profile of the fingertip.
    #[cfg_attr(feature = "serde", serde(default))]
    pub tip: Tip,
    /// Interpolation between keys.
    #[cfg_attr(feature = "serde", serde(default))]
    pub interpolation: Interpolation,
    /// Keys in ascending order of time. Before the first and after the last key the finger does not
    /// touch.
    #[cfg_attr(feature = "serde", serde(rename = "key"))]
    pub keys: Vec<Key>,
}

/// Interpolation of position, force and radius between two keys.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Interpolation {
    /// Linear in time.
    #[default]
    Linear,
    /// `3 s^2 - 2 s^3`, with zero velocity at every key.
    Smooth,
}

/// State of a finger at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Key {
    /// Time from frame 0, seconds.
    pub time_s: f64,
    /// Centre of the fingertip, metres; must be on the skin.
    pub position_m: [f64; 2],
    /// Force, newton, at least zero; zero means no contact.
    pub force_n: f64,
    /// Radius of the fingertip, metres, above zero; see [`Tip`].
    pub radius_m: f64,
}

/// A touch: one finger in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Touch {
    /// [`Finger::id`] of the finger that touches.
    pub finger: u32,
    /// Pressure profile of the fingertip.
    pub tip: Tip,
    /// Centre of the touch, metres.
    pub position_m: [f64; 2],
    /// Force, newton, above zero.
    pub force_n: f64,
    /// Radius of the fingertip, metres; see [`Tip`].
    pub radius_m: f64,
    /// Unit vector of the movement since the previous frame; zero if at rest.
    pub direction: [f64; 2],
}

impl Touch {
    /// Sets the direction of the movement from where the finger was a frame before.
    pub(super) fn turn(&mut self, before: &Self) {
        let [x, y] = [0, 1].map(|k| self.position_m[k] - before.position_m[k]);
        let step_m = x.hypot(y);
        // a step below a micrometre is rounding; the finger is at rest
        if step_m > 1e-6 {
            self.direction = [x / step_m, y / step_m];
        }
    }
}

impl Finger {
    /// Returns the touch at a time, or `None` if the finger does not touch.
    fn at(&self, time_s: f64) -> Option<Touch> {
        let next = self.keys.iter().position(|k| k.time_s >= time_s)?;
        let (from, to) = (&self.keys[next.saturating_sub(1)], &self.keys[next]);
        if time_s < from.time_s {
            return None;
        }
        let width_s = to.time_s - from.time_s;
        let s = if width_s > 0.0 { (time_s - from.time_s) / width_s } else { 1.0 };
        let s = match self.interpolation {
            Interpolation::Linear => s,
            Interpolation::Smooth => s * s * (3.0 - 2.0 * s),
        };
        let mix = |a: f64, b: f64| if s == 1.0 { b } else { a + s * (b - a) };
        let touch = Touch {
            finger: self.id,
            tip: self.tip,
            position_m: [0, 1].map(|i| mix(from.position_m[i], to.position_m[i])),
            force_n: mix(from.force_n, to.force_n),
            radius_m: mix(from.radius_m, to.radius_m),
            direction: [0.0; 2],
        };
        (touch.force_n > 0.0).then_some(touch)
    }
}

impl TouchScript {
    /// Returns all fingers that press on the skin in a frame.
    pub fn touches(&self, frame: usize) -> Vec<Touch> {
        self.touches_at(frame as f64)
    }

    /// Returns all fingers that press on the skin at a time, in frames.
    pub(super) fn touches_at(&self, time: f64) -> Vec<Touch> {
        let at = |finger: &Finger, time: f64| finger.at(time / self.frame_rate_hz);
        let now = |finger: &Finger| {
            let mut touch = at(finger, time)?;
            if let Some(before) = at(finger, time - 1.0).filter(|_| time >= 1.0) {
                touch.turn(&before);
            }
            Some(touch)
        };
        self.fingers.iter().filter_map(now).collect()
    }

    /// Rejects scripts that are invalid on this skin.
    ///
    /// # Errors
    /// [`FemError::BadTouch`], [`FemError::UnsortedKeys`] and [`FemError::OutsideSkin`], which give
    /// the finger and the key or the time; [`FemError::OutOfRange`] for the frame rate or the
    /// number of frames.
    pub fn validate(&self, mesh: &Mesh) -> Result<(), FemError> {
        let rate = self.frame_rate_hz;
        FemError::require("frame_rate_hz", rate, rate > 0.0, "finite and above zero")?;
        // a simulation holds all frames, 34 kB each with 64 x 64 pixels; 10 million are six days at 20 Hz
        let (frames, must) = (self.frames, "more than quiet_frames, and at most 10 million");
        let fits = frames > self.quiet_frames && frames <= 10_000_000;
        FemError::require("frames", frames as f64, fits, must)?;
        for finger in &self.fingers {
            self.check_keys(finger)?;
        }
        let surface = mesh.surface();
        for finger in &self.fingers {
            for (k, key) in finger.keys.iter().enumerate() {
                let place = || format!("at key {k}");
                let seat = Seat::on(surface, key.position_m);
                Seat::require(seat, finger.id, place, key.time_s, key.position_m)?;
            }
        }
        // paths between keys may leave a non-convex skin
        for frame in 0..self.frames {
            for Touch { finger, position_m, .. } in self.touches(frame) {
                let (place, time_s) = (|| "between keys".to_owned(), frame as f64 / rate);
                let seat = Seat::on(surface, position_m);
                Seat::require(seat, finger, place, time_s, position_m)?;
            }
        }
        Ok(())
    }

    fn check_keys(&self, Finger { id, keys, .. }: &Finger) -> Result<(), FemError> {
        let quiet_s = self.quiet_frames as f64 / self.frame_rate_hz;
        let finger = *id;
        for (k, key) in keys.iter().enumerate() {
            let [x, y] = key.position_m;
            let early = key.force_n > 0.0 && key.time_s < quiet_s;
            let checks = [
                ("time_s", key.time_s, key.time_s.is_finite(), "finite"),
                ("position_m[0]", x, x.is_finite(), "finite"),
                ("position_m[1]", y, y.is_finite(), "finite"),
                ("force_n", key.force_n, key.force_n >= 0.0, "at least zero"),
                ("force_n", key.force_n, key.force_n.is_finite(), "finite"),
                ("radius_m", key.radius_m, key.radius_m > 0.0, "above zero"),
                ("radius_m", key.radius_m, key.radius_m.is_finite(), "finite"),
                ("time_s", key.time_s, !early, "after the quiet frames, since the finger presses"),
            ];
            if let Some(&(quantity, value, _, must)) = checks.iter().find(|c| !c.2) {
                return Err(FemError::BadTouch { finger, key: k, quantity, value, must });
            }
            let (time_s, before_s) = (key.time_s, keys[k.saturating_sub(1)].time_s);
            if k > 0 && before_s >= time_s {
                return Err(FemError::UnsortedKeys { finger, key: k, time_s, before_s });
            }
        }
        Ok(())
    }
}
