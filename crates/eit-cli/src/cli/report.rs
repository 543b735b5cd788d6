//! Arguments of `eit report`.

use clap::Args;
use std::path::PathBuf;

/// `eit report`
#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// Folder for the results.
    #[arg(long, value_name = "DIR", default_value = "report-out")]
    pub out: PathBuf,
    /// Use fewer frames, pixels, gaps and meshes, for a check that takes about two minutes.
    #[arg(long)]
    pub quick: bool,
    /// Report figures of merit against noise, speed and touches, instead of error against time.
    #[arg(long)]
    pub quality: bool,
    /// Report on touches instead of images: touches without a finger and reliability of the confidence,
    /// position error compared with its bound, moving electrodes and the effect of removing movement from the
    /// data, two-point discrimination, tracks, GREIT figures, latency; or only the parts named, as in
    /// --touches=reliability,pairs.
    #[arg(long, conflicts_with = "quality", value_name = "PARTS", value_delimiter = ',')]
    #[arg(num_args = 0..=1, require_equals = true, default_missing_value = "all")]
    pub touches: Vec<TouchPart>,
    /// Report on U-nets: error before and after, touches lost and invented, on scripts and fabrics outside
    /// the training set, and on frames unlike any of it.
    #[arg(long, conflicts_with_all = ["quality", "touches"])]
    pub denoise: bool,
    /// Only run these scenes of the error-against-run-time report: paper-disc-60, paper-disc-40,
    /// paper-fabric, stiff-contact, high-contrast, general-32, single-frame; and, for the forward problem
    /// only, plate-with-hole, patches, hemisphere.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    #[arg(conflicts_with_all = ["quality", "touches", "denoise"])]
    pub scenes: Vec<String>,
    /// Only compare the predictions of `eit plan` for each scene with measurements.
    #[arg(long, conflicts_with_all = ["quality", "touches", "denoise", "peers"])]
    pub plans: bool,
    /// Only solve the forward problem of each skin: error of the voltages against time, with linear and
    /// quadratic elements on even and graded meshes.
    #[arg(long, conflicts_with_all = ["quality", "touches", "denoise", "plans"])]
    pub forward: bool,
    /// Only measure images: every solver on every scene, without the forward problems.
    #[arg(long, conflicts_with_all = ["quality", "touches", "denoise", "plans", "forward"])]
    pub images: bool,
    /// Also run NumPy, SciPy and, if installed, CHOLMOD and pyEIT on the same problems, with this Python; at
    /// most five minutes each.
    #[arg(long, value_name = "PYTHON", conflicts_with_all = ["quality", "touches", "denoise"])]
    pub peers: Option<PathBuf>,
    /// U-nets to compare: "default", or a file written by `eit train`; can be repeated.
    #[arg(long, value_name = "W", default_value = "default")]
    pub weights: Vec<String>,
    /// Method of the raw images for --denoise [default: st-tv].
    #[arg(long, requires = "denoise", value_name = "METHOD")]
    pub method: Option<String>,
    /// Added to the seed of every sequence of --denoise: fresh noise, weave and drift.
    #[arg(long, requires = "denoise", value_name = "N", default_value_t = 0)]
    pub seed: u64,
}

/// Parts of `eit report --touches`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum TouchPart {
    /// Every part.
    All,
    /// Touches without a finger, and reliability of the confidence.
    Reliability,
    /// Position error of one touch compared with its bound.
    Position,
    /// The same with moving electrodes.
    Movement,
    /// Effect of removing electrode movement from the data on images and touches.
    Electrodes,
    /// Two-point discrimination.
    Pairs,
    /// Tracking of fingers over time.
    Tracks,
    /// GREIT figures of merit.
    Greit,
    /// Time from a frame to its touches.
    Latency,
}
