//! The command line. One file, because `--help` is a single list of all commands and their arguments.

#[cfg(test)]
mod documented;
mod init;
mod learn;
mod live;
mod report;
mod shell;

pub(crate) use init::{InitArgs, ShapeArg};
pub(crate) use learn::LearnArgs;
pub(crate) use live::{
    BodyArgs, CheckArgs, ConvertArgs, DevicesArgs, EmulateArgs, LiveArgs, NetworkArgs, PageArgs,
    PublishArgs, RecordArgs, RecoverArgs, ReplayArgs, SplitArgs, WatchArgs,
};
pub(crate) use report::ReportArgs;
pub(crate) use shell::{CompletionsArgs, ManArgs};

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Electrical impedance tomography for robot skin: from frames of voltages to pressure images.
#[derive(Debug, Parser)]
#[command(
    name = "eit",
    version,
    arg_required_else_help = true,
    after_help = "A SCENE is a TOML file or the name of a built-in scene: paper-disc, stiff-contact, \
        high-contrast, general-32, single-frame, plate-with-hole, patches, hemisphere.\n\n\
        First steps:\n  \
        eit demo                               a simulated skin, from voltages to touches\n  \
        eit demo --web                         the same, live in a browser\n  \
        eit plan paper-disc                    what a scene needs and what it costs\n  \
        eit plan paper-disc --print-scene      a scene file to start from\n  \
        eit mesh paper-disc --out skin.png     draw the mesh\n  \
        eit forward paper-disc --out v.csv     voltages of the untouched skin\n  \
        eit reconstruct my.toml --frames f.csv --reference 0 --out images\n  \
        eit simulate paper-disc --out touched  frames of a touched fabric, with ground truth\n  \
        eit train paper-disc --out w.safetensors   a U-net that removes artefacts\n  \
        eit report                             compare all methods on simulated touches\n\n\
        With an instrument ([instrument] in the scene; `eit emulate` replaces the hardware):\n  \
        eit init my.toml --port /dev/ttyACM0   a scene for your skin, from its size and two presses\n  \
        eit devices                            list the serial ports of this computer\n  \
        eit check my.toml                      check every electrode\n  \
        eit live my.toml                       show touches as they happen\n  \
        eit record my.toml --out press.mcap    a recording that survives a crash\n\n\
        Options that a skin always needs can stand in eit.toml beside its scene: a table per command, such as [live] \
        with web = true (docs/SCENE.md). Options given on the command line win.\n\n\
        Exit codes: 0 success, 1 failure, 2 wrong usage or invalid input, 3 ended while the instrument was \
        silent or unplugged, 4 `eit check` found a fault."
)]
pub(crate) struct Cli {
    /// Command to run.
    #[command(subcommand)]
    pub command: Command,
    /// Print one JSON object on stdout instead of text.
    #[arg(long, global = true)]
    pub json: bool,
    /// Print no progress and no notes, only the result and errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Also print what each stage of the work does and how long it takes, on stderr.
    #[arg(short, long, global = true)]
    pub verbose: bool,
    /// When to use colours: auto is on a terminal, unless the environment sets NO_COLOR or TERM=dumb.
    #[arg(long, global = true, value_name = "WHEN", value_enum, default_value_t)]
    pub color: ColorWhen,
}

/// When to use colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub(crate) enum ColorWhen {
    /// On a terminal, unless the environment says otherwise.
    #[default]
    Auto,
    /// Use colours everywhere.
    Always,
    /// Use no colours.
    Never,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Run the paper's two experiments on a simulated fabric, from voltages to touches.
    ///
    /// Simulates one finger and two fingers on a stretched fabric, sends the frames through an emulated
    /// instrument on a pseudo-terminal (or TCP if there is none), reads and records them with its driver,
    /// reconstructs them by total variation as they arrive, denoises them with the U-net, and tracks the
    /// touches. Writes report.html (opens in any browser, without network), its pictures, and recordings from
    /// which `eit replay` reproduces the images bit for bit.
    ///
    /// With --web, a page shows the touches as they happen, and repeats both experiments once the report is written,
    /// until Ctrl-C.
    ///
    /// A folder with files other than those of an earlier demo is rejected without --force. Ctrl-C stops the
    /// demo: the recordings and images made so far are complete, and listed.
    Demo(DemoArgs),
    /// Show what a scene needs, what is omitted and why, with sizes and costs.
    Plan(PlanArgs),
    /// Mesh a scene's skin and report the mesh quality.
    ///
    /// The file name extension of --out selects the format: .msh (Gmsh 4.1 with named electrodes), .vtu
    /// (ParaView) or .png (picture).
    Mesh(MeshArgs),
    /// Compute the voltage of every measurement, in protocol order.
    ///
    /// The voltages are complex if capacitances of the scene carry current (docs/SCENE.md).
    Forward(ForwardArgs),
    /// Compute the Jacobian [measurement, element], volt per siemens.
    ///
    /// The Jacobian is complex if capacitances of the scene carry current (docs/SCENE.md).
    Jacobian(JacobianArgs),
    /// Fit background conductivity and contact impedances to the untouched skin.
    ///
    /// Absolute images need both (method gauss-newton-absolute), and difference images are scaled by the
    /// conductivity. Reports the uncertainty of each value, the unexplained part of the frame, and what to
    /// write into the scene. A gain of the instrument shows up as conductivity.
    ///
    /// Contact impedances can be determined if driven electrodes are measured, and hardly otherwise; they
    /// then stay near the scene's values, and the output says so.
    ///
    /// Example: eit calibrate my.toml --frames untouched.csv
    Calibrate(CalibrateArgs),
    /// Learn position and force of touches from presses at known places
    ///
    /// With --live, the program asks for presses at places of its choice, notices when they are held, stores them
    /// and ends when the error no longer falls; --force-n states the force of the weights you use. Or press the
    /// skin at known places yourself (a robot, a grid on paper, known weights), record it, and write a table with
    /// one line per press. Three methods are compared on held-out presses: the model alone, the model with a
    /// learnt correction of its responses, and regression from frames to positions. The
    /// best one is used, and the output states all errors. 10 presses determine rotation, reflection and
    /// scale of a skin with unknown electrode order (--fit-frame); 25 to 100 give position maps. With
    /// force_n in the table (at least three presses, better a dozen) touches have a force in newtons. The
    /// output includes the learning curve: the first presses are learnt, all later ones tested.
    ///
    /// Name the file in the scene, `learned = "skin.learned"` in its table `touch`, and every command that
    /// finds touches uses it; touches.csv then has force_n, its standard deviation, and whether a touch is
    /// unlike all presses that were learnt. The file only applies to the scene's skin, electrodes and
    /// protocol.
    ///
    /// --with adds the presses of an earlier file; a few new ones then show what has drifted since.
    ///
    /// Examples: eit learn my.toml --live --force-n 0.5,1,2 --out skin.learned
    /// eit learn my.toml --presses presses.csv --frames presses.mcap --reference 0..20 --out skin.learned
    #[command(verbatim_doc_comment)]
    Learn(LearnArgs),
    /// Simulate frames of a touched fabric, with ground truth.
    ///
    /// A script moves fingers over the scene's skin. Each finger dents the stretched fabric, changes its
    /// conductivity (with hysteresis and relaxation) and pulls on nearby electrodes; the fabric is uneven and
    /// drifts; an instrument measures. The scene's fabric tables contain the parameters (docs/FABRIC.md);
    /// effects with amplitude zero are omitted.
    ///
    /// Built-in scripts: paper-one-finger, paper-two-fingers (the experiments of the paper), random,
    /// press-and-hold, tapping, stroking, closing-in. The script used is written to script.toml, as a
    /// template for your own.
    ///
    /// Continue with: eit reconstruct DIR/scene.toml --out images
    Simulate(SimulateArgs),
    /// Reconstruct images of the conductivity change from recorded frames.
    ///
    /// If the scene states the noise (noise.additive_v or noise.quiet_frames), the default method is total
    /// variation in space and time, otherwise one-step Gauss-Newton. `eit plan` shows which, and why.
    ///
    /// Writes images.npy [frame, row, column] in siemens (row 0 at the top, NaN outside the skin), touches.csv
    /// (a row for each touch in each frame; docs/METHODS.md), sheet.png, movie.gif for a sequence, and
    /// report.json. Formats of frames: recordings (.mcap), .npy, .csv, Sciospec .eit folders, GOE .get, LCT
    /// text, KHU Mark2.5 scan folders, raw serial logs.
    Reconstruct(ReconstructArgs),
    /// Make a learning base for a U-net: simulated sequences with their raw and true images
    ///
    /// Simulates touched fabrics on a finer mesh and reconstructs them as `eit reconstruct` would.
    /// Every sequence has its own random fingers (one to six, with tips of 4 to 25 mm, up to 97 % of the
    /// radius), foundation, rim, weave, drift, gain, noise (from 48 dB below the voltages down to that of
    /// the scene's instrument) and missing measurements. Continues after an interruption.
    ///
    /// Sequences depend only on --seed and their number, so any scheduler can divide the work with
    /// --shard, for example a Slurm job array:
    ///
    ///   sbatch --array=1-64 --cpus-per-task=1 --wrap \
    ///     'eit base paper-disc --out base --threads 1 --shard $SLURM_ARRAY_TASK_ID/64'
    ///   eit base paper-disc --out base      (merges the parts, makes what is missing)
    ///
    /// Then: eit train paper-disc --base base --out w.safetensors
    #[command(verbatim_doc_comment)]
    Base(BaseArgs),
    /// Train a U-net that removes the artefacts of a scene's images.
    ///
    /// First completes the learning base (see `eit base`). If the skin's electrodes are symmetric, sequences are
    /// also rotated and mirrored. The progress bar shows the remaining time. A checkpoint is written after every
    /// epoch: after an interruption, run the same command again, and it continues to the same weights. Ctrl-C ends
    /// training with the best weights so far.
    ///
    /// Training uses burn and needs a build with it: cargo install --path crates/eit-cli --features train. The
    /// default build runs trained nets.
    ///
    /// Writes the weights W (safetensors), their learning curve (W with the extensions csv and png) and a
    /// checkpoint. W is not written if it makes the held-out images worse than the raw ones, unless --force is
    /// given.
    Train(TrainArgs),
    /// Remove artefacts from images with a trained U-net.
    ///
    /// `eit reconstruct` does this itself if the scene has denoise.weights = "W".
    ///
    /// Writes images.npy [frame, row, column], sheet.png, movie.gif for a sequence, and report.json.
    Denoise(DenoiseArgs),
    /// Measure error against run time of every solver on every built-in scene.
    ///
    /// Simulates soft and hard fingers with a finer mesh and noise; solves the forward problem on meshes of
    /// many sizes and runs every inverse solver at many settings. Writes report.html (open it), report.md,
    /// report.json, tables (inverse.csv, forward.csv) and pictures, again after every scene: until the last
    /// one the report says that it is incomplete, and Ctrl-C keeps what exists. Takes two minutes (five on a
    /// busy computer), and half an hour with --full.
    ///
    /// Example: `eit report --scenes paper-disc-60`
    Report(ReportArgs),
    /// Write the first scene of a new skin, from its measured size, the board's output and two presses.
    ///
    /// Asks for shape, size and number of electrodes (unless given by flags), listens to the board and
    /// reports what it receives; finds the drive and measurement patterns that match the number of values, by
    /// reciprocity and the model of the untouched skin; asks for two presses and derives from them which
    /// electrode is the first, in which direction they are counted, and whether a touch raises the
    /// conductivity. Then writes a commented scene for `eit check` and `eit live`.
    ///
    /// Unknown quantities (the sheet's conductivity, the contact impedances) are those of the paper's fabric:
    /// touches do not depend on them. docs/BUILD_A_SKIN.md leads from fabric and wires to a program.
    ///
    /// Example: eit init my.toml --width-mm 120 --height-mm 80 --electrodes 16 --port /dev/ttyACM0
    Init(InitArgs),
    /// List the serial ports, or identify the scene's instrument.
    ///
    /// Example: eit devices my.toml --port /dev/ttyACM0
    Devices(DevicesArgs),
    /// Check a live instrument: which electrode is faulty, and what to try.
    ///
    /// Takes frames of the untouched skin and looks for open electrodes, bad contacts, noise, saturation,
    /// lost frames, drift and a wrong order. The verdict is good, usable or faulty.
    ///
    /// Example: eit check my.toml
    Check(CheckArgs),
    /// Show touches of a live instrument as they happen.
    ///
    /// The first frames are the reference: do not touch the skin until it has been taken. A new reference is
    /// taken when a lost instrument is found again. --picture redraws the latest image continuously. If the
    /// scene's method is st-tv or tv, images are made by total variation coupled to the image before, otherwise in
    /// one step at noise figure 1; with denoise.weights the U-net follows. Touches are found in the frames,
    /// independently of the images. A faulty electrode is named and excluded until it recovers; --json lists
    /// such electrodes as faulty_electrodes.
    ///
    /// Example: eit live my.toml --picture now.png
    Live(LiveArgs),
    /// Join many patches of skin, each published by `eit live --zenoh`, into one list of touches.
    ///
    /// Reads names, topics and poses of the patches from BODY.toml. Prints JSON lines: touches in the robot's
    /// frame and on one clock whenever they change, and an event when a patch falls silent (within half a second)
    /// or returns. If the file names a topic, also publishes the list as a ROS 2 message. With --json, prints
    /// one object with counts and latency at the end instead. Ctrl-C ends it.
    ///
    /// Needs a program that was built with zenoh: cargo install --path crates/eit-cli --features zenoh.
    ///
    /// Example: eit body body.toml
    Body(BodyArgs),
    /// Record a live instrument (MCAP).
    ///
    /// Data is written to the file every second, so a killed recorder loses at most the last second. Ctrl-C
    /// ends the recording cleanly. A terminal shows the rate and the number of lost frames; the final output
    /// contains the mean rate while frames came, the longest interval between two frames, and the time without
    /// data. Lost frames, disconnections, a rate below nine tenths of the stated one and notices of the
    /// instrument become notes in the recording. --split-mb and --split-s write a long recording in parts.
    /// `eit reconstruct` reads it like any other file.
    ///
    /// Example: eit record my.toml --seconds 60 --out press.mcap
    Record(RecordArgs),
    /// Play a recording as if it were live: the same images bit for bit, at any speed.
    ///
    /// To play it to another program over a serial line or TCP, see `eit emulate --frames`.
    ///
    /// Example: eit replay my.toml --from press.mcap --speed 1
    Replay(ReplayArgs),
    /// Write the intact parts of a damaged recording to a new one.
    ///
    /// Keeps messages of every topic with their clocks, notes, attachments and metadata, and reports what is
    /// missing. The damaged recording is not changed.
    Recover(RecoverArgs),
    /// Convert recordings of any supported format to MCAP, CSV or NPY.
    ///
    /// From MCAP to MCAP, clocks, epochs, notes and log times are kept; messages of other programs and
    /// attachments are not (`eit recover` keeps them).
    ///
    /// Example: eit convert press.mcap --out press.csv
    Convert(ConvertArgs),
    /// Emulate the scene's instrument on a pseudo-terminal or TCP port, optionally with faults.
    ///
    /// Speaks the protocol of the scene's driver as the instrument, and sends the frames of a file in a loop
    /// or, without a file, simulated frames of the untouched skin, with noise.
    ///
    /// Example: `eit emulate my.toml --port ./skin --fault unplug_after_bytes=[100000]`, then
    /// `eit live my.toml --port ./skin`
    Emulate(EmulateArgs),
    /// Print completions for a shell.
    ///
    /// Example: eit completions bash > ~/.local/share/bash-completion/completions/eit
    Completions(CompletionsArgs),
    /// Write the manual pages: eit.1 and one per command.
    ///
    /// Example: eit man --out ~/.local/share/man/man1
    Man(ManArgs),
}

/// `eit demo`
#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// Folder for the results.
    #[arg(long, value_name = "DIR", default_value = "demo-out")]
    pub out: PathBuf,
    /// Write into a folder even if it contains other files.
    #[arg(long)]
    pub force: bool,
    /// Use fewer frames, pixels and nodes, for a check that takes seconds.
    #[arg(long)]
    pub quick: bool,
    /// Options of the live page.
    #[command(flatten)]
    pub page: PageArgs,
    /// Publish the experiments while they run; once the second begins, the rest of the first is not published.
    #[command(flatten)]
    pub network: NetworkArgs,
}

/// `eit plan`
#[derive(Debug, Args)]
pub(crate) struct PlanArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Plan for this method instead of the scene's; the names are those of `eit reconstruct`.
    #[arg(long, value_name = "METHOD")]
    pub method: Option<String>,
    /// Print the scene file itself, as a template for your own.
    #[arg(long)]
    pub print_scene: bool,
}

/// `eit mesh`
#[derive(Debug, Args)]
pub(crate) struct MeshArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Output file: F.msh, F.vtu or F.png.
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// Approximate number of nodes, instead of the scene's density.
    #[arg(long, value_name = "N")]
    pub nodes: Option<usize>,
}

/// Arguments shared by `eit forward` and `eit jacobian`.
#[derive(Debug, Args)]
pub(crate) struct SolveArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Mesh to use instead of the scene's (Gmsh 2.2 or 4.1, with electrodes as physical groups electrode_1,
    /// electrode_2, ...).
    #[arg(long, value_name = "F.msh")]
    pub mesh: Option<PathBuf>,
    /// Conductivity, one value per element of the mesh in file order, siemens (.npy or .csv) [default: the
    /// scene's background]. For scenes with capacitances also admittivities (complex .npy).
    #[arg(long, value_name = "F")]
    pub conductivity: Option<PathBuf>,
    /// Largest rounding error of a voltage, relative to the largest voltage, such as 1e-10: stiff contacts
    /// and high contrast cost digits in textbook assembly, and a smaller value recovers them [default: 1e-6,
    /// or a tenth of mesh.required_accuracy]. For the discretisation error, set mesh.required_accuracy in the
    /// scene.
    #[arg(long, value_name = "R")]
    pub accuracy: Option<f64>,
}

/// `eit forward`
#[derive(Debug, Args)]
pub(crate) struct ForwardArgs {
    #[command(flatten)]
    pub solve: SolveArgs,
    /// Output file: F.npy or F.csv, one value per measurement, volt; complex values as complex128, in CSV as
    /// alternating real and imaginary parts.
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
}

/// `eit jacobian`
#[derive(Debug, Args)]
pub(crate) struct JacobianArgs {
    #[command(flatten)]
    pub solve: SolveArgs,
    /// Output file: F.npy.
    #[arg(long, value_name = "F.npy")]
    pub out: PathBuf,
}

/// `eit calibrate`
#[derive(Debug, Args)]
pub(crate) struct CalibrateArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Frames of the untouched skin, in one or more files; their mean is fitted [default: the reference of
    /// the scene's recording].
    #[arg(long, value_name = "F", num_args = 1..)]
    pub frames: Vec<PathBuf>,
    /// Which of the frames to use: a frame number (from 0), "N..M" (mean of N to M-1), "mean", or a file.
    #[arg(long, value_name = "F|N|N..M|mean", allow_hyphen_values = true)]
    pub reference: Option<String>,
    /// Fit one factor for all contact impedances of the scene instead of each impedance.
    #[arg(long)]
    pub one_contact: bool,
    /// Also use measurements on current-carrying electrodes, if the instrument provides them.
    #[arg(long)]
    pub use_driven_electrodes: bool,
}

/// `eit simulate`
#[derive(Debug, Args)]
pub(crate) struct SimulateArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Built-in touch script, or a file: F.toml.
    #[arg(long, value_name = "NAME|F.toml", default_value = "paper-one-finger")]
    pub script: String,
    /// Seed of all random quantities: fabric, drift, noise, the script "random".
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Only simulate the first N frames of the script.
    #[arg(long, value_name = "N")]
    pub frames: Option<usize>,
    /// Approximate number of nodes of the simulation mesh [default: 7000; images are made on one of 2000]. A
    /// mesh file is used unchanged.
    #[arg(long, value_name = "N")]
    pub nodes: Option<usize>,
    /// Number of threads [default: all]; the result does not depend on it.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Folder for frames, truth, pictures and a scene for their reconstruction; or F.npy or F.csv for the
    /// frames alone.
    #[arg(long, value_name = "DIR|F")]
    pub out: PathBuf,
}

/// `eit reconstruct`
#[derive(Debug, Args)]
pub(crate) struct ReconstructArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Frames, in one or more files [default: recording.file of the scene].
    #[arg(long, value_name = "F", num_args = 1..)]
    pub frames: Vec<PathBuf>,
    /// Reference: a frame number (from 0), "mean", "N..M" (mean of N to M-1), or a file.
    #[arg(long, value_name = "F|N|N..M|mean", allow_hyphen_values = true)]
    pub reference: Option<String>,
    /// Method, instead of the scene's or the one chosen for the scene:
    /// st-tv (total variation in space and time), tv (frame by frame),
    /// gauss-newton (one-step difference), time-prior (the same with a prior in time),
    /// gauss-newton-absolute (iterative, non-linear model).
    #[arg(long, value_name = "METHOD", verbatim_doc_comment)]
    pub method: Option<String>,
    /// Folder for the results.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// `eit train`
#[derive(Debug, Args)]
#[cfg_attr(not(feature = "train"), allow(dead_code, reason = "refused whatever they are"))]
pub(crate) struct TrainArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Output file: W.safetensors.
    #[arg(long, value_name = "W")]
    pub out: PathBuf,
    /// Folder of the learning base [default: W with the extension base]. A complete base is only read.
    #[arg(long, value_name = "DIR")]
    pub base: Option<PathBuf>,
    #[command(flatten)]
    pub pairs: PairsArgs,
    /// Start from these weights instead of random ones: "default" (shipped), or a file written by this
    /// command. They may be those of another skin.
    #[arg(long, value_name = "W", conflicts_with_all = ["history", "images", "fold", "width", "depth"])]
    pub from: Option<String>,
    /// Number of frames that the net takes, including the current one.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub history: usize,
    /// Images per frame that the net takes. 2: the touches that were detected, drawn as bells, and the raw image,
    /// with the signal-to-noise ratio and the strength of the touches; 3 and 4: one-step images as well. With 1 it
    /// takes the raw image alone (`eit denoise`), and is much less accurate.
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub images: usize,
    /// Side of the blocks of pixels that become channels, 1 or 2: with 2 the net runs on a quarter of the
    /// pixels.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub fold: usize,
    /// Channels of the net's first level; the cost grows with their square.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub width: usize,
    /// How often the net halves rows and columns.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub depth: usize,
    /// Largest number of epochs. 0 (only with --from) keeps the net and only measures the limit beyond which
    /// its images are rejected.
    #[arg(long, value_name = "N", default_value_t = 12)]
    pub epochs: usize,
    /// Examples per step.
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub batch: usize,
    /// Learning rate of the first epoch; falls to a hundredth.
    #[arg(long, value_name = "R", default_value_t = 2e-3)]
    pub rate: f64,
    /// Stop after this many epochs without a smaller error on the held-out sequences; 0: never.
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub patience: usize,
    /// Device: flex (the processor), cuda or wgpu (a graphics processor). The last two need a build with the
    /// feature of that name; an H100 trained small nets about as fast as 16 processor cores.
    #[arg(long, value_name = "DEVICE", default_value_t)]
    pub device: eit_denoise::TrainDevice,
    /// Write the weights even if they make the held-out images worse than the raw ones.
    #[arg(long)]
    pub force: bool,
}

/// Contents of a learning base.
#[derive(Debug, Args)]
pub(crate) struct PairsArgs {
    /// Number of sequences to simulate; with --recording, recordings are rotated and mirrored by the skin's
    /// symmetries until there are this many. Every sixth, and at least one, is held out.
    #[arg(long, value_name = "N", default_value_t = 600)]
    pub sequences: usize,
    /// Frames of a simulated sequence, including 20 quiet ones.
    #[arg(long, value_name = "N", default_value_t = 60)]
    pub frames: usize,
    /// Learn from this recording of the real skin instead of simulated touches; can be repeated. The true
    /// image is unknown: wanted images are the raw ones after the rule of Duan, Taurand
    /// and Soleimani (2019), which removes the ring along the rim, values below 55 % of the
    /// largest, and blobs of fewer than 15 pixels. Reference and noise as in the scene. The
    /// last sixth of the recordings is held out, at least one, or the last sixth of a single one.
    #[arg(long, value_name = "F")]
    pub recording: Vec<PathBuf>,
    /// Simulate this built-in script on the scene's own fabric, with another seed for each sequence,
    /// instead of random touches on random fabrics.
    #[arg(long, value_name = "NAME", conflicts_with = "recording")]
    pub script: Option<String>,
    /// Wanted images of simulated sequences: truth, or rule (the rule of the paper, see --recording).
    #[arg(long, value_name = "KIND", default_value = "truth", value_parser = ["truth", "rule"])]
    pub wanted: String,
    /// Fingers of every sequence, 1 to 6 [default: one to six, fewer more often].
    #[arg(long, value_name = "N")]
    pub fingers: Option<usize>,
    /// Share of the sequences, 0 to 1, whose tips are within 25 % of a usual fingertip's, 10 mm on the paper's
    /// skin; tips of the others are anything from 4 to 25 mm.
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub usual_tips: f64,
    /// Method of the raw images: st-tv, tv or gauss-newton [default: the scene's, or st-tv].
    #[arg(long, value_name = "METHOD")]
    pub method: Option<String>,
    /// Seed of all random quantities.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Number of threads [default: all]; the result does not depend on it.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
}

/// `eit base`
#[derive(Debug, Args)]
pub(crate) struct BaseArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Folder of the learning base.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    #[command(flatten)]
    pub pairs: PairsArgs,
    /// Make only part I of N: every N-th sequence. Processes on any machines may make the parts in one
    /// folder, or in several whose files are then copied into one; `eit base` or `eit train` without
    /// --shard merges them. The bytes do not depend on the number of parts.
    #[arg(long, value_name = "I/N")]
    pub shard: Option<eit_denoise::Part>,
}

/// `eit denoise`
#[derive(Debug, Args)]
pub(crate) struct DenoiseArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Images of this scene: images.npy of `eit reconstruct`, [frame, row, column].
    #[arg(long, value_name = "F.npy")]
    pub images: PathBuf,
    /// "default" (for the built-in scene), or a file written by `eit train` [default: the scene's].
    #[arg(long, value_name = "W")]
    pub weights: Option<String>,
    /// Use the weights even if they were trained for another skin or pixel count.
    #[arg(long)]
    pub any_skin: bool,
    /// True images (truth_conductivity.npy of `eit simulate`), to report how much the error decreases.
    #[arg(long, value_name = "F.npy")]
    pub truth: Option<PathBuf>,
    /// Folder for the results.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}
