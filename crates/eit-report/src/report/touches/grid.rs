//! Parameters and numbers of trials of the touch figures.

/// Parameters and numbers of trials.
pub(super) struct Grid {
    pub noise_db: &'static [f64],
    /// Number of positions on a ring.
    pub places: usize,
    /// Number of trials per ring and noise level.
    pub trials: usize,
    /// Distances between two touches, metres, ascending.
    pub distances_m: &'static [f64],
    /// Number of trials per distance.
    pub pair_trials: usize,
    /// Number of frames of a tracking recording.
    pub track_frames: usize,
    /// Radii for the GREIT figures, relative to the skin's.
    pub greit_radii: &'static [f64],
    /// Number of frames for the latency measurement.
    pub latency_frames: usize,
    pub pixels: usize,
    /// Number of quiet frames used to measure the noise of ST-TV images, at least 20.
    pub quiet_frames: usize,
    /// Whether to simulate all cases of moving electrodes, and the maximum number of frames of
    /// each.
    pub all_scripts: bool,
    pub script_frames: usize,
    /// Maximum number of frames per recording for evaluating confidence.
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

/// A run with `--quick`.
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
