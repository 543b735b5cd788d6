//! Arguments of `eit learn`.

use clap::Args;
use std::path::PathBuf;

/// `eit learn`
#[derive(Debug, Args)]
pub(crate) struct LearnArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Table of the presses, one per line in the order of time, with a header: x_m, y_m and optionally z_m,
    /// force_n, first_frame, last_frame (of the press, from 0), before_first, before_last (of the untouched
    /// skin before it), depth_m (allowed, but not used). Each frame belongs to one press and must show it: a
    /// line whose frames include some of the untouched skin is rejected.
    #[arg(long, value_name = "P.csv")]
    pub presses: PathBuf,
    /// Frames of the presses, in one or more files [default: recording.file of the scene]. Without
    /// first_frame in the table: one frame per press, in order.
    #[arg(long, value_name = "F", num_args = 1..)]
    pub frames: Vec<PathBuf>,
    /// Reference: a frame number (from 0), "N..M" (mean of N to M-1), "mean", or a file; presses with
    /// before_first have their own.
    #[arg(long, value_name = "F|N|N..M|mean", allow_hyphen_values = true)]
    pub reference: Option<String>,
    /// The places are in their own coordinates, or it is unknown which electrode is the first: fit rotation,
    /// reflection, scale, shift, and whether a touch raises or lowers the conductivity. Ten presses spread
    /// over the skin suffice. Touches are then in the scene's coordinates.
    #[arg(long)]
    pub fit_frame: bool,
    /// Earlier file of the same skin, whose presses are learnt together with the new ones. With --fit-frame
    /// the new table must be in the coordinates of the old one. The learning curve starts with the earlier
    /// file alone, which shows what it contributes.
    #[arg(long, value_name = "OLD")]
    pub with: Option<PathBuf>,
    /// Output file. The learning curve is written next to it: F.curve.csv and F.curve.png.
    #[arg(long, value_name = "F.learned")]
    pub out: PathBuf,
}
