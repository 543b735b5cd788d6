//! Arguments of `eit report`.

use clap::Args;
use std::path::PathBuf;

/// `eit report`
#[derive(Debug, Args)]
pub(crate) struct ReportArgs {
    /// Folder for the results.
    #[arg(long, value_name = "DIR", default_value = "report-out")]
    pub out: PathBuf,
    /// Use more frames, pixels, gaps and meshes, which takes about half an hour instead of two minutes.
    #[arg(long)]
    pub full: bool,
    /// Only run these scenes: paper-disc-60, paper-disc-40, paper-fabric, stiff-contact, high-contrast,
    /// general-32, single-frame; and, for the forward problem only, plate-with-hole, patches, hemisphere.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Only solve the forward problem of each skin: error of the voltages against time, with linear and
    /// quadratic elements on even and graded meshes.
    #[arg(long)]
    pub forward: bool,
    /// Only measure images: every solver on every scene, without the forward problems.
    #[arg(long, conflicts_with = "forward")]
    pub images: bool,
    /// U-nets to compare: "default", or a file written by `eit net train`; can be repeated.
    #[arg(long, value_name = "W", default_value = "default")]
    pub weights: Vec<String>,
}
