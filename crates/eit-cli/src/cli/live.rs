//! Arguments of the commands for live instruments.

use clap::Args;
use std::path::PathBuf;

/// `eit check`
#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    /// Scene file or built-in scene [default: none, to list the serial ports].
    pub scene: Option<String>,
    /// Port instead of the scene's: /dev/ttyACM0, COM3 or tcp:host:port.
    #[arg(long, value_name = "P", requires = "scene")]
    pub port: Option<String>,
    /// Only identify the instrument: name, serial number, values per frame, rate and unit.
    #[arg(long, requires = "scene")]
    pub identify: bool,
    /// Number of frames to take, at least 8.
    #[arg(long, value_name = "N", default_value_t = 100, requires = "scene")]
    pub frames: usize,
    /// Maximum waiting time, seconds; fewer frames suffice from 8 on.
    #[arg(long, value_name = "S", default_value_t = 30.0, requires = "scene")]
    pub seconds: f64,
}

/// Arguments of `eit live` shared with `eit replay`.
#[derive(Debug, Args)]
pub(crate) struct WatchArgs {
    /// Number of frames at the start of each epoch that form the reference and show the noise. While they change as if
    /// something touched the skin, further ones are taken. Default: 40; in a replay those of the recorded reference, else
    /// as many as reference = "0..N" of the scene's recording says.
    #[arg(long, value_name = "N")]
    pub reference_frames: Option<usize>,
    /// Stop after N frames, not counting the reference.
    #[arg(long, value_name = "N")]
    pub frames: Option<u64>,
    /// Picture of the latest image, redrawn up to five times per second: F.png.
    #[arg(long, value_name = "F.png")]
    pub picture: Option<PathBuf>,
    /// Folder for images.npy [frame, row, column] and touches.csv of all frames; with a U-net also raw.npy,
    /// the images before it. Frames are numbered from 0 after the reference, whose time time_s counts, too.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Where else touches are published.
    #[command(flatten)]
    pub publish: PublishArgs,
}

/// Arguments for publishing touches to other programs.
#[derive(Debug, Args)]
pub(crate) struct PublishArgs {
    /// Write touches to stdout as JSON lines, one object per frame as soon as its touches are found, and
    /// nothing else; text goes to stderr (docs/JSON_LINES.md). No images are made unless --picture, --out,
    /// --web, --zenoh or --foxglove needs them.
    #[arg(long)]
    pub json_lines: bool,
    /// If the reader of stdout is behind, write only the newest frame; otherwise lines wait for up to four seconds.
    #[arg(long, requires = "json_lines")]
    pub latest: bool,
    /// Send the same lines by UDP, one per datagram; can be repeated.
    #[arg(long, value_name = "HOST:PORT")]
    pub udp: Vec<String>,
    /// Options of the live page.
    #[command(flatten)]
    pub page: PageArgs,
    /// Publishers behind cargo features.
    #[command(flatten)]
    pub network: NetworkArgs,
}

/// Options of the live page.
#[derive(Debug, Args)]
pub(crate) struct PageArgs {
    /// Serve a page that shows the skin in a browser, and print its address; an address other than this
    /// computer's requires a token [default: 127.0.0.1:8484; port 0: any free port].
    #[arg(
        long,
        value_name = "HOST:PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "127.0.0.1:8484"
    )]
    pub web: Option<String>,
}

/// ROS 2 by zenoh, and Foxglove.
#[derive(Debug, Args)]
#[cfg_attr(not(feature = "zenoh"), allow(dead_code, reason = "refused whatever they are"))]
pub(crate) struct NetworkArgs {
    /// Publish as a node of ROS 2 by zenoh (rmw_zenoh): topics KEY/touches, KEY/markers, KEY/image, KEY/map and /diagnostics, with KEY
    /// such as skin/left_arm. Needs a build with --features zenoh (docs/BODY.md).
    #[arg(long, value_name = "KEY")]
    pub zenoh: Option<String>,
    /// Where zenoh connects and listens.
    #[command(flatten)]
    pub session: SessionArgs,
    /// Publish every frame instead of changes and ten heartbeats a second.
    #[arg(long, requires = "zenoh")]
    pub zenoh_every_frame: bool,
    /// Name of the skin's coordinate frame in ROS 2 and Foxglove.
    #[arg(long, value_name = "NAME", default_value = "skin")]
    pub frame_id: String,
    /// Domain of ROS 2 [default: ROS_DOMAIN_ID, else 0].
    #[arg(long, value_name = "N", requires = "zenoh")]
    pub ros_domain: Option<u32>,
    /// Serve Foxglove; whoever reaches the address can watch. Needs a build with --features foxglove
    /// [default: 127.0.0.1:8765; port 0: any free port].
    #[arg(
        long,
        value_name = "HOST:PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "127.0.0.1:8765"
    )]
    pub foxglove: Option<String>,
    /// Record what Foxglove is shown: F.mcap, which must not exist.
    #[arg(long, value_name = "F.mcap")]
    pub foxglove_record: Option<PathBuf>,
}

/// The zenoh session of `--zenoh`.
#[derive(Debug, Args)]
#[cfg_attr(not(feature = "zenoh"), allow(dead_code, reason = "refused whatever they are"))]
pub(crate) struct SessionArgs {
    /// Endpoint that zenoh connects to, repeatable [default: tcp/localhost:7447, the router of rmw_zenoh].
    #[arg(long, value_name = "ENDPOINT", requires = "zenoh")]
    pub zenoh_connect: Vec<String>,
    /// Endpoint that zenoh listens at, repeatable [default: any free port of this computer].
    #[arg(long, value_name = "ENDPOINT", requires = "zenoh")]
    pub zenoh_listen: Vec<String>,
    /// Configuration file of zenoh; endpoints given here replace its own.
    #[arg(long, value_name = "F.json5", requires = "zenoh")]
    pub zenoh_config: Option<PathBuf>,
}

/// `eit body`
#[derive(Debug, Args)]
#[cfg_attr(not(feature = "zenoh"), allow(dead_code, reason = "refused whatever they are"))]
pub(crate) struct BodyArgs {
    /// The body: names, topics and poses of its patches (docs/BODY.md).
    #[arg(value_name = "BODY.toml")]
    pub body: PathBuf,
    /// Also show the body in Foxglove; whoever reaches the address can watch. Needs a build with --features foxglove
    /// [default: 127.0.0.1:8765; port 0: any free port].
    #[arg(
        long,
        value_name = "HOST:PORT",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "127.0.0.1:8765"
    )]
    pub foxglove: Option<String>,
    /// Stop after this many seconds.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
}

/// `eit live`
#[derive(Debug, Args)]
pub(crate) struct LiveArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Port instead of the scene's.
    #[arg(long, value_name = "P")]
    pub port: Option<String>,
    /// What is shown and stored.
    #[command(flatten)]
    pub watch: WatchArgs,
    /// Stop after this many seconds.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// Also record to F.mcap.
    #[arg(long, value_name = "F.mcap")]
    pub record: Option<PathBuf>,
    /// How the recording is split.
    #[command(flatten)]
    pub split: SplitArgs,
}

/// Splitting of a recording into parts.
#[derive(Clone, Copy, Debug, Args)]
pub(crate) struct SplitArgs {
    /// Split the recording into parts of about N megabytes, F.00001.mcap, F.00002.mcap and so on, which every
    /// command reads as one under the name F.mcap.
    #[arg(long, value_name = "N")]
    pub split_mb: Option<f64>,
    /// Split it into parts of S seconds.
    #[arg(long, value_name = "S")]
    pub split_s: Option<f64>,
}

/// `eit record`
#[derive(Debug, Args)]
pub(crate) struct RecordArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Port instead of the scene's.
    #[arg(long, value_name = "P")]
    pub port: Option<String>,
    /// Output file: F.mcap.
    #[arg(long, value_name = "F.mcap")]
    pub out: PathBuf,
    /// Stop after this many frames.
    #[arg(long, value_name = "N")]
    pub frames: Option<u64>,
    /// Stop after this many seconds.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// Append to a recording, even if a crash truncated it.
    #[arg(long)]
    pub append: bool,
    /// How the recording is split.
    #[command(flatten)]
    pub split: SplitArgs,
    /// Flush to the disk every second, so that the recording also survives a power cut.
    #[arg(long)]
    pub sync: bool,
    /// Note to store at its beginning.
    #[arg(long, value_name = "TEXT")]
    pub note: Option<String>,
}

/// `eit replay`
#[derive(Debug, Args)]
pub(crate) struct ReplayArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Recording to play: F.mcap; `eit convert` makes one of other formats.
    #[arg(long, value_name = "F.mcap")]
    pub from: PathBuf,
    /// How the skin is watched.
    #[command(flatten)]
    pub watch: WatchArgs,
    /// Speed relative to real time [default: as fast as possible].
    #[arg(long, value_name = "X", conflicts_with = "step")]
    pub speed: Option<f64>,
    /// Show one frame per line on stdin: press Enter.
    #[arg(long)]
    pub step: bool,
}

/// `eit convert`
#[derive(Debug, Args)]
pub(crate) struct ConvertArgs {
    /// Recording of any supported format.
    pub input: PathBuf,
    /// Output file: F.mcap, F.csv or F.npy; one frame per row.
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Reorder the values to this scene's protocol; tables are read as its section "recording" says.
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<String>,
    /// Rows of the table alternate real and imaginary parts.
    #[arg(long)]
    pub complex: bool,
    /// Copy everything intact of a damaged MCAP recording to F.mcap: messages of every topic with their clocks,
    /// notes, attachments and metadata.
    #[arg(long, conflicts_with_all = ["scene", "complex"])]
    pub recover: bool,
}

/// `eit emulate`
#[derive(Debug, Args)]
pub(crate) struct EmulateArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Where to listen: a path that does not exist yet (a pseudo-terminal), or tcp:127.0.0.1:PORT (0: a free
    /// port, which is printed).
    #[arg(long, value_name = "P")]
    pub port: String,
    /// Frames in the scene's protocol: frames.npy of `eit simulate`, a recording, or any supported format.
    #[arg(long, value_name = "F")]
    pub frames: Option<PathBuf>,
    /// Frame rate of a board that sends frames by itself, hertz [default: 20]; other drivers receive the
    /// host's rate.
    #[arg(long, value_name = "R")]
    pub rate_hz: Option<f64>,
    /// Time from the first to the last drive of a scan as a share of the time between frames, 0 to 1: as the drives
    /// take turns, their values lie between those of two frames of --frames.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub scan_share: f64,
    /// Serial number.
    #[arg(long, value_name = "TEXT", default_value = "1")]
    pub serial: String,
    /// Fault to simulate; can be repeated: drop_byte, flip_bit, insert_byte, pause (probability per byte),
    /// pause_s, unplug_after_bytes=[N, ...], unplugged_s, spared_bytes, line_baud.
    #[arg(long, value_name = "KEY=VALUE")]
    pub fault: Vec<String>,
    /// Seed of noise and faults.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Stop after this many seconds.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
}
