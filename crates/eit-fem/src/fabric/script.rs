//! Touch scripts: which fingers touch the skin, where, how hard and when.

use super::contact::Tip;
use super::seat::Seat;
use crate::error::FemError;
use eit_mesh::{Mesh, Surface};

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
        let time_s = |frame: usize| frame as f64 / self.frame_rate_hz;
        let before = |finger: &Finger| finger.at(time_s(frame.checked_sub(1)?));
        let now = |finger: &Finger| {
            let mut touch = finger.at(time_s(frame))?;
            if let Some(before) = before(finger) {
                let [x, y] = [0, 1].map(|k| touch.position_m[k] - before.position_m[k]);
                let step_m = x.hypot(y);
                // a step below a micrometre is rounding; the finger is at rest
                if step_m > 1e-6 {
                    touch.direction = [x / step_m, y / step_m];
                }
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
        if !(rate.is_finite() && rate > 0.0) {
            let (quantity, must) = ("frame_rate_hz", "finite and above zero");
            return Err(FemError::OutOfRange { quantity, value: rate, must });
        }
        // a simulation holds all frames, 34 kB each with 64 x 64 pixels; 10 million are six days at 20 Hz
        if self.frames <= self.quiet_frames || self.frames > 10_000_000 {
            let (quantity, must) = ("frames", "more than quiet_frames, and at most 10 million");
            return Err(FemError::OutOfRange { quantity, value: self.frames as f64, must });
        }
        for finger in &self.fingers {
            self.check_keys(finger)?;
        }
        let place = SkinTest::new(mesh.surface());
        for finger in &self.fingers {
            for (k, key) in finger.keys.iter().enumerate() {
                place.check(finger.id, Some(k), key.time_s, key.position_m)?;
            }
        }
        // paths between keys may leave a non-convex skin
        for frame in 0..self.frames {
            for touch in self.touches(frame) {
                let time_s = frame as f64 / rate;
                place.check(touch.finger, None, time_s, touch.position_m)?;
            }
        }
        Ok(())
    }

    fn check_keys(&self, finger: &Finger) -> Result<(), FemError> {
        let quiet_s = self.quiet_frames as f64 / self.frame_rate_hz;
        for (k, key) in finger.keys.iter().enumerate() {
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
                return Err(FemError::BadTouch {
                    finger: finger.id,
                    key: k,
                    quantity,
                    value,
                    must,
                });
            }
            if let Some(before) = k.checked_sub(1).map(|b| finger.keys[b])
                && before.time_s >= key.time_s
            {
                let (time_s, before_s) = (key.time_s, before.time_s);
                return Err(FemError::UnsortedKeys { finger: finger.id, key: k, time_s, before_s });
            }
        }
        Ok(())
    }
}

/// Tests whether points lie on the skin, seen from +z.
struct SkinTest<'a> {
    surface: &'a Surface,
}

impl<'a> SkinTest<'a> {
    fn new(surface: &'a Surface) -> Self {
        Self { surface }
    }

    fn check(
        &self,
        finger: u32,
        key: Option<usize>,
        time_s: f64,
        position_m: [f64; 2],
    ) -> Result<(), FemError> {
        if Seat::on(self.surface, position_m).is_some() {
            return Ok(());
        }
        let place = key.map_or_else(|| "between keys".to_owned(), |k| format!("at key {k}"));
        let [x_m, y_m] = position_m;
        Err(FemError::OutsideSkin { finger, place, time_s, x_m, y_m })
    }
}
