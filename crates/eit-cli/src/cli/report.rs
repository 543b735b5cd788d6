//! Arguments of `eit report`.

use clap::Args;
use std::path::PathBuf;

/// `eit report`
#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// Folder for the results.
    #[arg(long, value_name = "DIR", default_value = "report-out")]
    pub out: PathBuf,
    /// Fewer frames, pixels and movies: seconds instead of minutes, as a check.
    #[arg(long)]
    pub quick: bool,
    /// Figures of merit over noise, speed and touches instead of error against time.
    #[arg(long)]
    pub quality: bool,
    /// Touches instead of images: those without a finger and whether confidence holds what it says,
    /// position error beside its bound, moving electrodes and what taking them out of the data does,
    /// two-point discrimination, tracks, GREIT figures, latency; or the parts named, as in
    /// --touches=reliability,pairs.
    #[arg(long, conflicts_with = "quality", value_name = "PARTS", value_delimiter = ',')]
    #[arg(num_args = 0..=1, require_equals = true, default_missing_value = "all")]
    pub touches: Vec<TouchPart>,
    /// What U-nets make of images: error before and after, touches lost and invented, on scripts
    /// and fabrics that they were not trained on, and on frames like none they have seen.
    #[arg(long, conflicts_with_all = ["quality", "touches"])]
    pub denoise: bool,
    /// Only these scenes of the error-against-run-time report: paper-disc-60, paper-disc-40,
    /// paper-fabric, stiff-contact, high-contrast, general-32, single-frame; and, of which the forward
    /// problem alone is run, plate-with-hole, patches, hemisphere.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    #[arg(conflicts_with_all = ["quality", "touches", "denoise"])]
    pub scenes: Vec<String>,
    /// Only what `eit plan` promises of each scene, beside what is measured.
    #[arg(long, conflicts_with_all = ["quality", "touches", "denoise", "peers"])]
    pub plans: bool,
    /// Only the forward problem of each skin: error of the voltages over time, linear and quadratic
    /// elements on even and graded meshes.
    #[arg(long, conflicts_with_all = ["quality", "touches", "denoise", "plans"])]
    pub forward: bool,
    /// Also run NumPy, SciPy and, where installed, CHOLMOD and pyEIT on the same problems, with this
    /// Python; five minutes for each at the most.
    #[arg(long, value_name = "PYTHON", conflicts_with_all = ["quality", "touches", "denoise"])]
    pub peers: Option<PathBuf>,
    /// U-nets to compare: "default", or a file of `eit train`; more than once for more.
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
    /// Touches without a finger, and whether confidence holds what it says.
    Reliability,
    /// Position error of one touch beside its bound.
    Position,
    /// The same when electrodes move.
    Movement,
    /// What taking the movement of electrodes out of the data does to images and touches.
    Electrodes,
    /// Two-point discrimination.
    Pairs,
    /// Fingers followed over time.
    Tracks,
    /// GREIT figures of merit.
    Greit,
    /// Time from a frame to its touches.
    Latency,
}
