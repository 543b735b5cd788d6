//! What is varied in the touch figures, and how often each is tried.

/// What is varied, and how often each is tried.
pub(super) struct Grid {
    pub noise_db: &'static [f64],
    /// Places of a ring.
    pub places: usize,
    /// Trials of a ring and noise level.
    pub trials: usize,
    /// Distances of two touches, metres, ascending.
    pub distances_m: &'static [f64],
    /// Trials of a distance.
    pub pair_trials: usize,
    /// Frames of a recording of fingers.
    pub track_frames: usize,
    /// Parts of the radius for the GREIT figures.
    pub greit_radii: &'static [f64],
    /// Frames of the measurement of time.
    pub latency_frames: usize,
    pub pixels: usize,
    /// Quiet frames that the noise of ST-TV images is measured on, 20 or more.
    pub quiet_frames: usize,
    /// Whether all cases of moving electrodes are simulated, and how many frames of each at most.
    pub all_scripts: bool,
    pub script_frames: usize,
    /// Frames of each recording that confidence is judged on, at most.
    pub reliability_frames: usize,
}

/// A full run.
pub(super) const FULL: Grid = Grid {
    noise_db: &[40.0, 50.0, 60.0, 70.0],
    places: 5,
    trials: 100,
    distances_m: &[
        0.008, 0.012, 0.016, 0.020, 0.026, 0.032, 0.038, 0.044, 0.052, 0.060, 0.070, 0.080, 0.095,
        0.110, 0.130,
    ],
    pair_trials: 20,
    track_frames: 300,
    greit_radii: &[0.0, 0.2, 0.4, 0.6, 0.8, 0.9],
    latency_frames: 2000,
    pixels: 64,
    quiet_frames: 60,
    all_scripts: true,
    script_frames: 400,
    reliability_frames: 400,
};

/// With `--quick`.
pub(super) const QUICK: Grid = Grid {
    noise_db: &[60.0],
    places: 2,
    trials: 4,
    distances_m: &[0.030, 0.060, 0.090],
    pair_trials: 2,
    track_frames: 90,
    greit_radii: &[0.0, 0.6],
    latency_frames: 80,
    pixels: 32,
    quiet_frames: 20,
    all_scripts: false,
    script_frames: 50,
    reliability_frames: 120,
};
