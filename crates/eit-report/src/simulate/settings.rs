//! What a sequence of fingers on a linear skin is made of.

use eit_fem::fabric::{LinearResponse, RandomPaths, Tip};
use std::f64::consts::SQRT_2;

/// Smallest distance of two fingers, standard deviations of the bell. The sum of two bells has two
/// tops from 2 on; at 4, the middle between them is at 27 % of the tops.
const APART: f64 = 4.0;

/// Steps of a slow and of a fast finger of 12 mm, metres a frame: a sixth of the bell's standard
/// deviation, which averaging over frames hardly blurs, and all of it, which it smears out. At 8
/// frames a second they are 16 and 96 mm a second.
pub(crate) const SLOW_M: f64 = 0.002;
pub(crate) const FAST_M: f64 = 0.012;

/// How the change falls off around a finger. Both shapes hold the same amount of change.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FingerShape {
    /// Soft: a Gaussian bell.
    Bell,
    /// A flat stamp of radius `sqrt(2) sigma_m` with an edge.
    Pad,
}

impl FingerShape {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Bell, Self::Pad];

    /// In tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bell => "bell",
            Self::Pad => "pad",
        }
    }

    /// On the simulated fabric.
    fn tip(self) -> Tip {
        match self {
            Self::Bell => Tip::Round,
            Self::Pad => Tip::Flat,
        }
    }
}

/// How a finger changes the skin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Finger {
    /// Soft or with an edge.
    pub shape: FingerShape,
    /// Standard deviation of the bell, metres.
    pub sigma_m: f64,
    /// Relative change of the sheet conductivity in its middle; above -1.
    pub change: f64,
}

impl Default for Finger {
    /// A fingertip: a bell of 12 mm, half as much conductivity again.
    fn default() -> Self {
        Self { shape: FingerShape::Bell, sigma_m: 0.012, change: 0.5 }
    }
}

impl Finger {
    /// Newton, always: the change is that of the response.
    pub const FORCE_N: f64 = 1.0;

    /// The response of the skin under it.
    pub fn response(&self) -> LinearResponse {
        LinearResponse { change_per_newton: self.change / Self::FORCE_N }
    }

    /// Its radius on the simulated fabric, metres.
    pub fn radius_m(&self) -> f64 {
        match self.shape {
            FingerShape::Bell => self.sigma_m,
            FingerShape::Pad => SQRT_2 * self.sigma_m,
        }
    }
}

/// A random sequence.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SequenceSettings {
    /// Fingers on the skin all the time, 1 to 4.
    pub touches: usize,
    /// Frames.
    pub frames: usize,
    /// Way of every finger from one frame to the next along its path, metres; 0: at rest.
    /// [`SLOW_M`], [`FAST_M`].
    pub step_m: f64,
    /// All fingers are alike.
    pub finger: Finger,
    /// Frames a second, for displays.
    pub rate_hz: f64,
    /// Seed of the paths.
    pub path_seed: u64,
    /// Noise: `20 log10(rms of the reference voltages / noise standard deviation)`, decibel, as
    /// makers of instruments state it (30 to 70 dB).
    pub noise_db: f64,
    /// Seed of the noise.
    pub noise_seed: u64,
    /// Nodes of the mesh that simulates.
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
    /// The paths of the fingers.
    pub fn paths(&self) -> RandomPaths {
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
