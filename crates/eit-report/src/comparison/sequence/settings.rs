//! Settings of a sequence of fingers on a linear skin.

use eit_fem::fabric::{LinearResponse, RandomPaths, Tip};
use std::f64::consts::SQRT_2;

/// Smallest distance between two fingers, in standard deviations of the bell. The sum of two bells
/// has two maxima from 2 on; at 4, the value midway is 27 % of the maxima.
const APART: f64 = 4.0;

/// Step per frame of a slow and of a fast finger of 12 mm, metres: a sixth of the bell's standard
/// deviation, which averaging over frames hardly blurs, and a full standard deviation, which it
/// smears out. At 8 frames per second they move at 16 and 96 mm per second.
pub const SLOW_M: f64 = 0.002;
/// See [`SLOW_M`].
pub const FAST_M: f64 = 0.012;

/// Profile of the change around a finger. Both shapes contain the same total change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FingerShape {
    /// Soft: a Gaussian bell.
    Bell,
    /// Hard: a flat disc of radius `sqrt(2) sigma_m` with a sharp edge.
    Pad,
}

impl FingerShape {
    /// Both shapes.
    pub const ALL: [Self; 2] = [Self::Bell, Self::Pad];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bell => "bell",
            Self::Pad => "pad",
        }
    }

    /// Shape on the simulated fabric.
    fn tip(self) -> Tip {
        match self {
            Self::Bell => Tip::Round,
            Self::Pad => Tip::Flat,
        }
    }
}

/// The effect of a finger on the skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Finger {
    /// Soft or with a sharp edge.
    pub shape: FingerShape,
    /// Standard deviation of the bell, metres.
    pub sigma_m: f64,
    /// Relative change of the sheet conductivity at its centre; above -1.
    pub change: f64,
}

impl Default for Finger {
    /// A fingertip: a bell of 12 mm that raises the conductivity by half.
    fn default() -> Self {
        Self { shape: FingerShape::Bell, sigma_m: 0.012, change: 0.5 }
    }
}

impl Finger {
    /// Constant force, newtons: the response alone determines the change.
    pub(crate) const FORCE_N: f64 = 1.0;

    /// The response of the skin to the finger.
    pub(crate) fn response(&self) -> LinearResponse {
        LinearResponse { change_per_newton: self.change / Self::FORCE_N }
    }

    /// Its radius on the simulated fabric, metres.
    pub(crate) fn radius_m(&self) -> f64 {
        match self.shape {
            FingerShape::Bell => self.sigma_m,
            FingerShape::Pad => SQRT_2 * self.sigma_m,
        }
    }
}

/// A random sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct SequenceSettings {
    /// Fingers on the skin all the time, 1 to 4.
    pub touches: usize,
    /// Number of frames.
    pub frames: usize,
    /// Distance that every finger moves along its path per frame, metres; 0 for resting fingers.
    /// See [`SLOW_M`] and [`FAST_M`].
    pub step_m: f64,
    /// The finger; all fingers are alike.
    pub finger: Finger,
    /// Frames per second, for displays.
    pub rate_hz: f64,
    /// Seed of the paths.
    pub path_seed: u64,
    /// Noise: `20 log10(rms of the reference voltages / noise standard deviation)`, decibels, as
    /// specified by instrument makers (30 to 70 dB).
    pub noise_db: f64,
    /// Seed of the noise.
    pub noise_seed: u64,
    /// Nodes of the simulation mesh.
    pub nodes: usize,
}

impl Default for SequenceSettings {
    /// One slow finger, 60 dB, on a mesh of 7 000 nodes (3.5 times the usual 2 000).
    fn default() -> Self {
        Self {
            touches: 1,
            frames: 40,
            step_m: SLOW_M,
            finger: Finger::default(),
            rate_hz: 8.0,
            path_seed: 1,
            noise_db: 60.0,
            noise_seed: 1,
            nodes: 7000,
        }
    }
}

impl SequenceSettings {
    /// Returns the paths of the fingers.
    pub(crate) fn paths(&self) -> RandomPaths {
        RandomPaths {
            fingers: self.touches,
            frames: self.frames,
            frame_rate_hz: self.rate_hz,
            step_m: self.step_m,
            apart_m: APART * self.finger.sigma_m,
            tip: self.finger.shape.tip(),
            radius_m: self.finger.radius_m(),
            force_n: Finger::FORCE_N,
            seed: self.path_seed,
        }
    }
}
