//! Arguments of `eit init`.

use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Outline of a new skin.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ShapeArg {
    /// --radius-mm.
    Disc,
    /// --width-mm and --height-mm.
    Rectangle,
}

/// `eit init`
#[derive(Debug, Args)]
pub(crate) struct InitArgs {
    /// Scene file to write. An existing file is rejected without --force.
    #[arg(value_name = "SCENE.toml")]
    pub out: PathBuf,
    /// Outline of the skin.
    #[arg(long, value_enum)]
    pub shape: Option<ShapeArg>,
    /// Radius of a disc, millimetres.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub radius_mm: Option<f64>,
    /// Extent of a rectangle from left to right, millimetres.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub width_mm: Option<f64>,
    /// Extent of a rectangle from bottom to top, millimetres.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub height_mm: Option<f64>,
    /// Number of electrodes, equally spaced along the rim.
    #[arg(long, value_name = "N")]
    pub electrodes: Option<usize>,
    /// Length of rim that each electrode covers, millimetres [default: half of the spacing, at most 10].
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    pub electrode_width_mm: Option<f64>,
    /// Position of any one of the electrodes, counter-clockwise from the right as seen from the centre,
    /// degrees. The presses determine which electrode is the first.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true)]
    pub electrode_at_deg: f64,
    /// Port of the board: /dev/ttyACM0, COM3, tcp:host:port (`eit check` lists the serial ports). Without
    /// it, the scene gets a template: adjacent drive and measurement, and an instrument that prints lines of
    /// numbers (driver = "csv") at no port yet.
    #[arg(long, value_name = "PORT")]
    pub port: Option<String>,
    /// Baud rate of the serial line; USB devices ignore it.
    #[arg(long, value_name = "BAUD", default_value_t = 115_200)]
    pub baud: u32,
    /// How long to listen to the board, seconds.
    #[arg(long, value_name = "S", default_value_t = 3.0)]
    pub listen_s: f64,
    /// Do not ask for presses: electrode 1 is then at --electrode-at-deg, counted counter-clockwise.
    #[arg(long)]
    pub no_presses: bool,
    /// How long to wait for each press, seconds.
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    pub press_wait_s: f64,
    /// Overwrite an existing scene file.
    #[arg(long)]
    pub force: bool,
}
