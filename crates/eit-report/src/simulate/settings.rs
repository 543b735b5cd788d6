//! What a sequence of ideal fingers is made of.

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
