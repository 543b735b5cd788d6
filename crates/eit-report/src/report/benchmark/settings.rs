//! How a benchmark is run.

use super::roofline::Roofline;
use crate::settings::ReportSettings;
use eit_skin::StopFlag;

/// Sizes of the benchmark.
pub(super) struct Size {
    pub frames: usize,
    /// Pixels along the skin, ascending; images are judged on the last raster.
    pub pixels: &'static [usize],
    /// Gaps that iterated methods run to, one after the other, each from cold.
    pub gaps: &'static [f64],
    /// Deadline of a run; one that meets it is the last of its curve.
    pub deadline_s: f64,
    /// Most runs of a setting.
    pub runs: usize,
    /// A setting whose runs have taken this long together is not repeated.
    pub repeat_below_s: f64,
    /// Runs of a direct method and of a stream.
    pub direct_runs: usize,
    pub stream_runs: usize,
    /// Meshes of each family of the forward problem, every step finer by the root of two, and most
    /// runs on each.
    pub mesh_steps: &'static [i32],
    pub forward_runs: usize,
    /// Scales of the two meshes that stand for the truth where no series does, the finer one last.
    pub reference_scales: [f64; 2],
}

/// Gaps of a full run.
pub(super) const GAPS: [f64; 4] = [3e-1, 1e-1, 1e-2, 1e-3];

/// A full run.
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

/// With `--quick`.
pub(super) const QUICK: Size = Size {
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

/// How a benchmark is run.
pub(super) struct BenchmarkSettings<'a> {
    /// What was asked for.
    pub report: &'a ReportSettings,
    pub size: &'a Size,
    pub roofline: &'a Roofline,
    /// Set when the user interrupts.
    pub stop: &'a StopFlag,
}
