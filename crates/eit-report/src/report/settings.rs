//! Settings of a benchmark.

use super::roofline::Roofline;
use crate::settings::ReportSettings;
use eit_skin::StopFlag;

/// Sizes of a benchmark.
pub(super) struct Size {
    pub frames: usize,
    /// Numbers of pixels across the skin, ascending; images are evaluated on the last raster.
    pub pixels: &'static [usize],
    /// Target gaps of iterative methods, each run from a cold start.
    pub gaps: &'static [f64],
    /// Time limit of a run; a run that reaches it is the last of its curve.
    pub deadline_s: f64,
    /// Maximum number of runs of a setting.
    pub runs: usize,
    /// A setting whose runs have taken this long in total is not repeated.
    pub repeat_below_s: f64,
    /// Number of runs of a direct method and of a stream.
    pub direct_runs: usize,
    pub stream_runs: usize,
    /// Refinement steps of each family of meshes for the forward problem, each finer by a factor of
    /// the square root of two, and the maximum number of runs on each mesh.
    pub mesh_steps: &'static [i32],
    pub forward_runs: usize,
    /// Scales of the two reference meshes used where no series exists, the finer one last.
    pub reference_scales: [f64; 2],
}

/// Gaps of a run with `--full`.
pub(super) const GAPS: [f64; 4] = [3e-1, 1e-1, 1e-2, 1e-3];

/// A run with `--full`.
pub(super) const FULL: Size = Size {
    frames: 20,
    pixels: &[16, 32, 64],
    gaps: &GAPS,
    deadline_s: 20.0,
    runs: 3,
    repeat_below_s: 6.0,
    direct_runs: 15,
    stream_runs: 2,
    mesh_steps: &[0, 1, 2, 3, 4, 5, 6, 7],
    forward_runs: 9,
    reference_scales: [1.5, 1.0],
};

/// The usual run, about two minutes.
pub(super) const SHORT: Size = Size {
    frames: 6,
    pixels: &[16, 32],
    gaps: &[1e-1, 1e-2],
    deadline_s: 2.0,
    runs: 2,
    repeat_below_s: 0.1,
    direct_runs: 3,
    stream_runs: 1,
    mesh_steps: &[0, 2],
    forward_runs: 3,
    reference_scales: [3.0, 2.0],
};

pub(super) struct BenchmarkSettings<'a> {
    pub report: &'a ReportSettings,
    pub size: &'a Size,
    pub roofline: &'a Roofline,
    /// Set when the user interrupts.
    pub stop: &'a StopFlag,
}
