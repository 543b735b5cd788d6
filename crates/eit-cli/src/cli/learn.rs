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
    /// line whose frames include some of the untouched skin is rejected. With --live, the table to write
    /// [default: OUT with the ending presses.csv]; its frames go to a recording beside it, ending in mcap.
    #[arg(long, value_name = "P.csv", required_unless_present = "live")]
    pub presses: Option<PathBuf>,
    /// Frames of the presses, in one or more files [default: recording.file of the scene]. Without
    /// first_frame in the table: one frame per press, in order.
    #[arg(long, value_name = "F", num_args = 1..)]
    pub frames: Vec<PathBuf>,
    /// Reference: a frame number (from 0), "N..M" (mean of N to M-1), "mean", or a file; presses with
    /// before_first have their own.
    #[arg(long, value_name = "F|N|N..M|mean", allow_hyphen_values = true)]
    pub reference: Option<String>,
    /// The places are a robot's own, in metres, or it is unknown which electrode is the first: the middle of the
    /// presses, spread over the whole skin, is taken as that of the scene's skin, and rotation and reflection of the
    /// model are fitted. Touches are then in the robot's coordinates, shifted by what is printed.
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
    /// Collects the presses now, with the scene's instrument.
    #[command(flatten)]
    pub live: LiveLearnArgs,
}

/// `eit learn --live`
#[derive(Debug, Args)]
pub(crate) struct LiveLearnArgs {
    /// Collect the presses now: asks for a press at a place (in words, and on a terminal in a small drawing),
    /// notices by itself when it is held and when it is released, and shows how the error falls. Ends when 15 more
    /// presses have not reduced the error by 5 % (from 25 presses on), after --number presses, or with Ctrl-C; all
    /// presses so far are then learnt. Every frame and press is on the disk before the next one is asked for.
    #[arg(long, conflicts_with_all = ["frames", "reference"])]
    pub live: bool,
    /// Port of the instrument, instead of the scene's.
    #[arg(long, value_name = "PORT", requires = "live")]
    pub port: Option<String>,
    /// Largest number of presses, including earlier ones with --append.
    #[arg(long, value_name = "N", default_value_t = 100, requires = "live")]
    pub number: usize,
    /// Collect all of --number presses, even if the error no longer falls.
    #[arg(long, requires = "live")]
    pub all: bool,
    /// Known force of the presses, newtons: a weight on a tip (0.102 kg weigh 1 N). Several are used in turn:
    /// --force-n 0.5,1,2. Without it, no force is learnt, but the column force_n of the table can be filled in by
    /// hand, and learnt with --presses and --frames.
    #[arg(long, value_name = "N", value_delimiter = ',', requires = "live")]
    pub force_n: Vec<f64>,
    /// After each press, read its force in newtons from standard input, one line each, as a scale showed it; an
    /// empty line if unknown.
    #[arg(long, requires = "live", conflicts_with = "force_n")]
    pub ask_force: bool,
    /// How long a press must be held, seconds.
    #[arg(long, value_name = "S", default_value_t = 0.5, requires = "live")]
    pub hold_s: f64,
    /// Continue the table and the recording of an earlier run. Without it, existing files are rejected.
    #[arg(long, requires = "live")]
    pub append: bool,
}
