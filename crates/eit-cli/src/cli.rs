//! The command line: what `--help` shows. One file for each group of commands.

mod init;
mod learn;
mod live;
mod net;
mod report;
mod scene;
mod shell;
#[cfg(test)]
mod tests;

pub(crate) use init::{InitArgs, ShapeArg};
pub(crate) use learn::LearnArgs;
pub(crate) use live::{
    BodyArgs, CheckArgs, ConvertArgs, EmulateArgs, LiveArgs, NetworkArgs, PageArgs, PublishArgs,
    RecordArgs, ReplayArgs, SplitArgs, WatchArgs,
};
#[cfg(feature = "train")]
pub(crate) use net::TrainArgs;
pub(crate) use net::{ApplyArgs, BaseArgs, NetCommand, PairsArgs};
pub(crate) use report::ReportArgs;
pub(crate) use scene::{
    CalibrateArgs, MeshArgs, PlanArgs, ReconstructArgs, SimulateArgs, SolveArgs,
};
pub(crate) use shell::{CompletionsArgs, ManArgs};

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;

/// Electrical impedance tomography for robot skin: from frames of voltages to pressure images.
#[derive(Debug, Parser)]
#[command(
    name = "eit",
    version,
    arg_required_else_help = true,
    after_help = include_str!("cli/help.txt").trim_ascii_end()
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
    /// Run two experiments on a simulated fabric, from voltages to touches; with --paper, those of the paper.
    ///
    /// Simulates one finger and two fingers on a stretched fabric, ten times as fast as in the paper, sends the frames through an emulated
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
    Forward(SolveArgs),
    /// Compute the Jacobian [measurement, element], volt per siemens.
    ///
    /// The Jacobian is complex if capacitances of the scene carry current (docs/SCENE.md).
    Jacobian(SolveArgs),
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
    /// Built-in scripts: paper-one-finger, paper-two-fingers (the experiments of the paper, one frame per second),
    /// one-finger, two-fingers (like them, ten times as fast), random, press-and-hold, tapping, stroking,
    /// closing-in. The script used is written to script.toml, as a template for your own.
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
    /// report.json. Formats of frames: recordings (.mcap), .npy, .npz, .mat, .csv, Sciospec .eit folders, GOE
    /// .get, LCT text, KHU Mark2.5 scan folders, raw serial logs.
    Reconstruct(ReconstructArgs),
    /// Make a learning base for a U-net, train the net, and apply it to images.
    ///
    /// A U-net removes the artefacts of images that electrode movement and the linear model leave. `eit reconstruct`
    /// and `eit live` apply the net that the scene names in its table "denoise".
    #[command(subcommand)]
    Net(NetCommand),
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
    /// Unknown quantities (the sheet's conductivity, the contact impedances) are those assumed for paper-disc:
    /// touches do not depend on them. docs/BUILD_A_SKIN.md leads from fabric and wires to a program.
    ///
    /// Example: eit init my.toml --width-mm 120 --height-mm 80 --electrodes 16 --port /dev/ttyACM0
    Init(InitArgs),
    /// Find faulty electrodes of a live instrument and say what to try; without a scene, list the serial ports
    ///
    /// Takes frames of the untouched skin and looks for open electrodes, bad contacts, noise, saturation,
    /// lost frames, drift and a wrong order. The verdict is good, usable or faulty. With --identify, the instrument
    /// only says what it is.
    ///
    /// Examples: eit check
    /// eit check my.toml
    /// eit check my.toml --identify --port /dev/ttyACM0
    #[command(verbatim_doc_comment)]
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
    /// Convert recordings of any supported format to MCAP, CSV or NPY, and rescue damaged ones
    ///
    /// From MCAP to MCAP, clocks, epochs, notes and log times are kept; messages of other programs and
    /// attachments are not. With --recover they are: everything intact in a damaged recording is copied unchanged,
    /// and what is missing is reported. The input is never changed.
    ///
    /// Examples: eit convert press.mcap --out press.csv
    /// eit convert damaged.mcap --out whole.mcap --recover
    #[command(verbatim_doc_comment)]
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
    #[command(hide = true)]
    Completions(CompletionsArgs),
    /// Write the manual pages: eit.1 and one per command.
    ///
    /// Example: eit man --out ~/.local/share/man/man1
    #[command(hide = true)]
    Man(ManArgs),
}

/// `eit demo`
#[derive(Debug, Args)]
pub(crate) struct DemoArgs {
    /// Folder for the results [default: demo-out; paper-out with --paper].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Write into a folder even if it contains other files.
    #[arg(long)]
    pub force: bool,
    /// Use fewer frames, pixels and nodes, for a check that takes seconds.
    #[arg(long)]
    pub quick: bool,
    /// Make a page laid out like the paper's figures instead: its experiments at one frame per second, images by its
    /// equation (7), the nets of its two trainings on both experiments, and pressures; two minutes.
    #[arg(long, conflicts_with_all = ["web", "NetworkArgs"])]
    pub paper: bool,
    /// Options of the live page.
    #[command(flatten)]
    pub page: PageArgs,
    /// Publish the experiments while they run; once the second begins, the rest of the first is not published.
    #[command(flatten)]
    pub network: NetworkArgs,
}
