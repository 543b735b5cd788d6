//! Arguments of `eit learn`.

use clap::Args;
use std::path::PathBuf;

/// `eit learn`
#[derive(Debug, Args)]
pub(crate) struct LearnArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Table of the presses, a line each in the order of time, with a header: x_m, y_m and where
    /// wanted z_m, force_n, first_frame, last_frame (of the press, from 0), before_first,
    /// before_last (of the untouched skin before it), depth_m (allowed, and not used). A frame belongs to
    /// one press, and shows it: a line whose frames hold some of the untouched skin is refused.
    #[arg(long, value_name = "P.csv")]
    pub presses: PathBuf,
    /// Frames of the presses, one file or several; without it recording.file of the scene. Without
    /// first_frame in the table: one frame for each press, in order.
    #[arg(long, value_name = "F", num_args = 1..)]
    pub frames: Vec<PathBuf>,
    /// Reference: a frame number (from 0), "N..M" (mean of N to M-1), "mean", or a file; presses with
    /// before_first have their own.
    #[arg(long, value_name = "F|N|N..M|mean", allow_hyphen_values = true)]
    pub reference: Option<String>,
    /// The places are in coordinates of their own, or nobody knows which electrode is the first: fit
    /// turn, mirror, scale, shift, and whether a touch raises or lowers the conductivity. Ten presses
    /// all over the skin will do. Touches are then in the scene's coordinates.
    #[arg(long)]
    pub fit_frame: bool,
    /// An earlier file of the same skin: its presses count, too, beside new ones. With --fit-frame the
    /// new table is in the coordinates of the old one. What it brings is in the answer: the learning curve
    /// begins with the earlier file alone.
    #[arg(long, value_name = "OLD")]
    pub with: Option<PathBuf>,
    /// What was learnt; the learning curve goes beside it: F.curve.csv and F.curve.png.
    #[arg(long, value_name = "F.learned")]
    pub out: PathBuf,
}
