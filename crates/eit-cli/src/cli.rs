//! The command line. Long because what `--help` says is one list: every command and its arguments.

mod init;
mod learn;
mod live;
mod report;
mod shell;

pub(crate) use init::{InitArgs, ShapeArg};
pub(crate) use learn::LearnArgs;
pub(crate) use live::{
    BodyArgs, CheckArgs, ConvertArgs, DevicesArgs, EmulateArgs, LiveArgs, NetworkArgs, PublishArgs,
    RecordArgs, RecoverArgs, ReplayArgs, WatchArgs,
};
pub(crate) use report::{ReportArgs, TouchPart};
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
        eit plan paper-disc                    what a scene needs, and what it will cost\n  \
        eit plan paper-disc --print-scene      a scene file to start from\n  \
        eit mesh paper-disc --out skin.png     look at the mesh\n  \
        eit forward paper-disc --out v.csv     voltages of the untouched skin\n  \
        eit reconstruct my.toml --frames f.csv --reference 0 --out images\n  \
        eit simulate paper-disc --out touched  frames of a touched fabric, with the truth\n  \
        eit train paper-disc --out w.safetensors   a U-net that removes artefacts\n  \
        eit report --quick                     compare every method on simulated touches\n\n\
        With an instrument ([instrument] in the scene; `eit emulate` is one without hardware):\n  \
        eit init my.toml --port /dev/ttyACM0   a scene for your skin, by asking, listening and two presses\n  \
        eit devices                            serial ports of this computer\n  \
        eit check my.toml                      is every electrode sound?\n  \
        eit live my.toml                       touches as they happen\n  \
        eit record my.toml --out press.mcap    a recording that survives a crash\n\n\
        Exit codes: 0 done, 1 failure, 2 wrong usage or bad input, 3 ended while the instrument was silent or \
        unplugged, 4 `eit check` found a fault."
)]
pub(crate) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
    /// Print one JSON object on stdout instead of text.
    #[arg(long, global = true)]
    pub json: bool,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// The paper's two experiments on a simulated fabric, from the voltages to the touches.
    ///
    /// Simulates one finger and two fingers on a stretched fabric, sends the frames through an emulated
    /// instrument on a pseudo-terminal (TCP where there is none), reads and records them by its driver,
    /// reconstructs them by total variation as they come, denoises them with the U-net, follows the
    /// touches. Writes report.html (opens by double click; needs no network), its pictures, and
    /// recordings that `eit replay` turns into the same images to the bit.
    ///
    /// A folder that holds other things than an earlier demo is refused without --force. Ctrl-C ends
    /// it: recordings and images so far are whole, and named.
    Demo(DemoArgs),
    /// Show what a scene needs, what is left out and why, with sizes and costs.
    Plan(PlanArgs),
    /// Mesh a scene's skin and report its quality.
    ///
    /// The ending of --out chooses the format: .msh (Gmsh 4.1 with named electrodes), .vtu
    /// (ParaView) or .png (picture).
    Mesh(MeshArgs),
    /// Compute the voltage of every measurement, in protocol order.
    ///
    /// Complex ones where the scene stores charge (docs/SCENE.md).
    Forward(ForwardArgs),
    /// Compute the Jacobian [measurement, element], volt per siemens.
    ///
    /// Complex where the scene stores charge (docs/SCENE.md).
    Jacobian(JacobianArgs),
    /// Fit background conductivity and contact impedances to the untouched skin.
    ///
    /// Absolute images need both (method gauss-newton-absolute), and difference images get their
    /// size from the conductivity. Says how sure each number is, what stays unexplained, and what to
    /// write into the scene. A gain of the instrument comes out as conductivity.
    ///
    /// Contacts show where driven electrodes are measured, and hardly elsewhere: then they stay near
    /// the scene's, and the answer says so.
    ///
    /// Example: eit calibrate my.toml --frames untouched.csv
    Calibrate(CalibrateArgs),
    /// Learn place and force of touches from presses at known places.
    ///
    /// Press the real skin at known places (a robot, a grid on paper, known weights), record it, and write
    /// a table with a line for each press. Held against each other on presses held out are the model
    /// alone, the model with a learnt correction of its responses, and regression from frames to places;
    /// the best is taken, and the answer says by how much. 10 presses fix turn, mirror and scale of a
    /// skin whose electrode order is unknown (--fit-frame), 25 to 100 give maps of place. With force_n in
    /// the table (three presses at least, a dozen are better) touches carry newtons. The answer holds the
    /// learning curve: the first presses in time, tested on all after them.
    ///
    /// Name the file in the scene, `learned = "skin.learned"` in its table `touch`, and every command that finds
    /// touches uses it; touches.csv then has force_n, its standard deviation, and whether a touch is
    /// unlike all that were learnt. The file belongs to the scene's skin, electrodes and protocol.
    ///
    /// Example: eit learn my.toml --presses presses.csv --frames presses.mcap --reference 0..20
    /// --out skin.learned
    #[command(verbatim_doc_comment)]
    Learn(LearnArgs),
    /// Simulate frames of a touched fabric, with the truth beside them.
    ///
    /// A script moves fingers over the scene's skin: each dents the stretched fabric, changes its
    /// conductivity (with hysteresis and relaxation) and draws the electrodes near it; the fabric is
    /// uneven and drifts; an instrument measures. The scene's fabric tables have the
    /// parameters (docs/FABRIC.md); parts with amplitude zero are left out.
    ///
    /// Built-in scripts: paper-one-finger, paper-two-fingers (the experiments of the paper), random,
    /// press-and-hold, tapping, stroking, closing-in. The script that was run is written to
    /// script.toml, as a start for one's own.
    ///
    /// Then: eit reconstruct DIR/scene.toml --out images
    Simulate(SimulateArgs),
    /// Turn recorded frames into images of the conductivity change.
    ///
    /// State the noise in the scene (noise.additive_v or noise.quiet_frames) and the method is total
    /// variation in space and time; without it one-step Gauss-Newton. `eit plan` says which and why.
    ///
    /// Writes images.npy [frame, row, column] in siemens (row 0 at the top, NaN outside the
    /// skin), sheet.png, movie.gif for a sequence, and report.json. Formats of frames: .npy,
    /// .csv, Sciospec .eit folders, GOE .get, LCT text, KHU Mark2.5 scan folders, raw serial logs.
    Reconstruct(ReconstructArgs),
    /// Train a U-net that removes the artefacts of a scene's images.
    ///
    /// Simulates touched fabrics on a finer mesh (scripts, electrode movement, noise, gains and
    /// drift drawn anew for every sequence), reconstructs them as `eit reconstruct` would, each
    /// turned or mirrored by a symmetry of the electrodes where the skin has them, and learns the
    /// true images from them. Sequences go to --base one by one; the training writes a checkpoint
    /// after every epoch. Ctrl-C ends it with the best weights so far. Run the same command again
    /// after an interruption: it goes on where it was, and ends with the same weights.
    ///
    /// Needs a program that was built with training, which is burn's: cargo install --path
    /// crates/eit-cli --features train. The default program runs what comes of it.
    ///
    /// Writes W (safetensors), W with the endings csv and png (learning curve), and checkpoint. W is
    /// not written where its images of the held-out sequences are worse than the raw ones (--force).
    Train(TrainArgs),
    /// Remove artefacts from images with a trained U-net.
    ///
    /// `eit reconstruct` does it by itself where the scene has denoise.weights = "W".
    ///
    /// Writes images.npy [frame, row, column], sheet.png, movie.gif for a sequence, report.json.
    Denoise(DenoiseArgs),
    /// Error against run time of every solver on every built-in scene, measured here and now.
    ///
    /// Simulates soft and hard fingers with a finer mesh and noise; runs the forward problem on
    /// meshes of many sizes and every inverse solver at many settings; compares what `eit plan`
    /// promised. Writes report.html (open it), report.md, report.json, tables (inverse.csv,
    /// forward.csv, plan.csv) and pictures, anew after every scene: until the last one the report says
    /// that it is incomplete, and Ctrl-C leaves what there is. Some minutes; --quick takes one.
    ///
    /// With --quality instead quality.md and quality.csv (figures of merit over noise, speed and
    /// number of touches), with --touches touches.md, with --denoise denoise.md and its pictures.
    ///
    /// Example: `eit report --scenes paper-disc-60 --peers python3`
    Report(ReportArgs),
    /// Write the first scene of a new skin: what you measured with a ruler, what its board prints, and two
    /// presses.
    ///
    /// Asks for shape, size and number of electrodes (or takes them from the flags), listens to the board
    /// and says what it hears; finds the drive and measurement pattern that fits the number of values, by
    /// reciprocity and by the untouched skin's model; asks for two presses and finds from them which
    /// electrode is the first, which way they are counted, and whether a touch raises the conductivity.
    /// Then writes a scene with comments that `eit check` and `eit live` take.
    ///
    /// What nobody knows (the sheet's conductivity, the contacts) has the values of the paper's fabric:
    /// touches do not depend on them. docs/BUILD_A_SKIN.md goes from fabric and wires to a program.
    ///
    /// Example: eit init my.toml --width-mm 120 --height-mm 80 --electrodes 16 --port /dev/ttyACM0
    Init(InitArgs),
    /// List the serial ports, or ask the scene's instrument who it is.
    ///
    /// Example: eit devices my.toml --port /dev/ttyACM0
    Devices(DevicesArgs),
    /// Check a live instrument: which electrode is at fault, and what to try.
    ///
    /// Takes frames of the untouched skin and looks for open electrodes, bad contacts, noise,
    /// saturation, lost frames, drift and a wrong order. The verdict is good, usable or faulty.
    ///
    /// Example: eit check my.toml
    Check(CheckArgs),
    /// Show touches of a live instrument as they happen.
    ///
    /// The first frames are the reference: touch nothing until it says so. After the instrument
    /// was lost and found again, a new reference is taken. --picture draws the latest image again and
    /// again. Where the scene's method is st-tv or tv, images are total variation over the last frames;
    /// otherwise one step at noise figure 1; with denoise.weights the U-net follows. Touches are found
    /// in the frames, whatever image is shown. An electrode that fails is named and left out until it
    /// recovers; --json lists such electrodes as faulty_electrodes.
    ///
    /// Example: eit live my.toml --picture now.png
    Live(LiveArgs),
    /// Join many patches of skin, each published by `eit live --zenoh`, into one list of touches.
    ///
    /// Reads names, topics and poses of the patches from BODY.toml. Prints JSON lines: touches in the robot's
    /// frame and on one clock whenever they change, and events: a patch that has fallen silent, within half a
    /// second, and its return. Publishes the same as a message of ROS 2 where the file names a topic. --json
    /// prints one object with counts and latency at the end instead. Ctrl-C ends it.
    ///
    /// Needs a program that was built with zenoh: cargo install --path crates/eit-cli --features zenoh.
    ///
    /// Example: eit body body.toml
    Body(BodyArgs),
    /// Record a live instrument (MCAP).
    ///
    /// Every second what came is written, whatever happens then: a killed recorder loses the last
    /// second at most. Ctrl-C ends it cleanly. A terminal shows the rate and the frames that were lost; the
    /// answer has the mean rate and the longest wait between two frames. Lost frames, disconnections and
    /// what the instrument says are notes of the recording. `eit reconstruct` reads it like any other file.
    ///
    /// Example: eit record my.toml --seconds 60 --out press.mcap
    Record(RecordArgs),
    /// Play a recording as if it were live: the same images to the bit, at any speed.
    ///
    /// To play it to another program over a serial line or TCP, see `eit emulate --frames`.
    ///
    /// Example: eit replay my.toml --from press.mcap --speed 1
    Replay(ReplayArgs),
    /// Write what is whole of a damaged recording as a new one.
    ///
    /// Messages of every topic with their clocks, notes, attachments and metadata; says what is missing.
    /// The damaged recording stays as it is.
    Recover(RecoverArgs),
    /// Convert recordings: MCAP, CSV, NPY; from every format that is read.
    ///
    /// From MCAP to MCAP, clocks, epochs, notes and log times go along; messages of other programs and
    /// attachments do not (`eit recover` keeps them).
    ///
    /// Example: eit convert press.mcap --out press.csv
    Convert(ConvertArgs),
    /// Be the scene's instrument, on a pseudo-terminal or TCP port, with faults if wanted.
    ///
    /// Speaks the protocol of the scene's driver from the instrument's side and sends frames of a
    /// file over and over, or the untouched skin by the scene's model, with noise.
    ///
    /// Example: `eit emulate my.toml --port ./skin --fault unplug_after_bytes=[100000]`, then
    /// `eit live my.toml --port ./skin`
    Emulate(EmulateArgs),
    /// Print completions for a shell.
    ///
    /// Example: eit completions bash > ~/.local/share/bash-completion/completions/eit
    Completions(CompletionsArgs),
    /// Write the manual pages: eit.1 and one for each command.
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
    /// Write into a folder that holds other things, too.
    #[arg(long)]
    pub force: bool,
    /// Fewer frames, pixels and nodes: seconds, as a check.
    #[arg(long)]
    pub quick: bool,
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
    /// Print the scene file itself instead, as a start for one's own.
    #[arg(long)]
    pub print_scene: bool,
}

/// `eit mesh`
#[derive(Debug, Args)]
pub(crate) struct MeshArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Result: F.msh, F.vtu or F.png.
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
    /// About this many nodes, instead of the scene's density.
    #[arg(long, value_name = "N")]
    pub nodes: Option<usize>,
}

/// What `eit forward` and `eit jacobian` solve.
#[derive(Debug, Args)]
pub(crate) struct SolveArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Mesh to use instead of the scene's (Gmsh 2.2 or 4.1, electrodes as physical groups
    /// electrode_1, electrode_2, ...).
    #[arg(long, value_name = "F.msh")]
    pub mesh: Option<PathBuf>,
    /// Conductivity, one value per element of the mesh in file order, siemens (.npy or .csv);
    /// without it the scene's background. Where the scene stores charge also admittivities (complex .npy).
    #[arg(long, value_name = "F")]
    pub conductivity: Option<PathBuf>,
    /// Largest rounding error of a voltage, relative to the largest voltage, as in 1e-10: stiff
    /// contacts and high contrast cost digits in the textbook assembly, and this asks for them
    /// [default: 1e-6, or a tenth of mesh.required_accuracy]. What the mesh costs is asked for by
    /// mesh.required_accuracy in the scene.
    #[arg(long, value_name = "R")]
    pub accuracy: Option<f64>,
}

/// `eit forward`
#[derive(Debug, Args)]
pub(crate) struct ForwardArgs {
    #[command(flatten)]
    pub solve: SolveArgs,
    /// Result: F.npy or F.csv, one value per measurement, volt; complex ones as complex128, in CSV as
    /// alternating real and imaginary parts.
    #[arg(long, value_name = "F")]
    pub out: PathBuf,
}

/// `eit jacobian`
#[derive(Debug, Args)]
pub(crate) struct JacobianArgs {
    #[command(flatten)]
    pub solve: SolveArgs,
    /// Result: F.npy.
    #[arg(long, value_name = "F.npy")]
    pub out: PathBuf,
}

/// `eit calibrate`
#[derive(Debug, Args)]
pub(crate) struct CalibrateArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Frames of the untouched skin, one file or several: their mean is fitted. Without it the
    /// reference of the scene's recording.
    #[arg(long, value_name = "F", num_args = 1..)]
    pub frames: Vec<PathBuf>,
    /// Which of the frames: a frame number (from 0), "N..M" (mean of N to M-1), "mean", or a file.
    #[arg(long, value_name = "F|N|N..M|mean", allow_hyphen_values = true)]
    pub reference: Option<String>,
    /// One factor for all contacts of the scene instead of one impedance each.
    #[arg(long)]
    pub one_contact: bool,
    /// Use measurements on current-carrying electrodes too, where the instrument gives them.
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
    /// Seed of everything random: fabric, drift, noise, the script "random".
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Only the first N frames of the script.
    #[arg(long, value_name = "N")]
    pub frames: Option<usize>,
    /// About this many nodes in the mesh that simulates [default: 7000; images are made on one of
    /// 2000]. A mesh file is taken as it is.
    #[arg(long, value_name = "N")]
    pub nodes: Option<usize>,
    /// Threads [default: all]; the result does not depend on them.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Folder for frames, truth, pictures and a scene to reconstruct with; or F.npy or F.csv for
    /// the frames alone.
    #[arg(long, value_name = "DIR|F")]
    pub out: PathBuf,
}

/// `eit reconstruct`
#[derive(Debug, Args)]
pub(crate) struct ReconstructArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Frames, one file or several; without it recording.file of the scene.
    #[arg(long, value_name = "F", num_args = 1..)]
    pub frames: Vec<PathBuf>,
    /// Reference: a frame number (from 0), "mean", "N..M" (mean of N to M-1), or a file.
    #[arg(long, value_name = "F|N|N..M|mean", allow_hyphen_values = true)]
    pub reference: Option<String>,
    /// Method instead of the scene's, or of the one that the scene calls for:
    /// st-tv (total variation in space and time), tv (frame by frame),
    /// gauss-newton (one-step difference), time-prior (the same with a prior in time),
    /// kalman (smoother), gauss-newton-absolute (iterated on the non-linear model).
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
    /// The weights: W.safetensors.
    #[arg(long, value_name = "W")]
    pub out: PathBuf,
    /// Folder of the learning base [default: W with the ending base]. One that is complete is only
    /// read.
    #[arg(long, value_name = "DIR")]
    pub base: Option<PathBuf>,
    /// Sequences to simulate, or recordings, turned by the skin's symmetries again and again until
    /// there are so many; every sixth, at least one, is held out.
    #[arg(long, value_name = "N", default_value_t = 240)]
    pub sequences: usize,
    /// Frames of a simulated sequence, 20 quiet ones included.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub frames: usize,
    /// Learn from this recording of the real skin instead of simulated touches; more than once for
    /// more. Nobody knows its truth: wanted images are the raw ones after the rule of Duan, Taurand
    /// and Soleimani (2019), which takes out the ring along the rim, what is below 55 % of the
    /// largest value, and blobs of fewer than 15 pixels. Reference and noise as in the scene. Held
    /// out is the last recording of six, or the last sixth of one that stands alone.
    #[arg(long, value_name = "F")]
    pub recording: Vec<PathBuf>,
    /// Fingers of every sequence, 1 to 4 [default: one to four, two most often].
    #[arg(long, value_name = "N")]
    pub fingers: Option<usize>,
    /// Method of the raw images: st-tv, tv or gauss-newton [default: the scene's, or st-tv].
    #[arg(long, value_name = "METHOD")]
    pub method: Option<String>,
    /// Seed of everything random.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Last frames that the net sees.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub history: usize,
    /// Channels of the net's first level; its cost grows with the square.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub width: usize,
    /// Times that the net halves the pixels.
    #[arg(long, value_name = "N", default_value_t = 3)]
    pub depth: usize,
    /// Epochs at most.
    #[arg(long, value_name = "N", default_value_t = 12)]
    pub epochs: usize,
    /// Examples of a step.
    #[arg(long, value_name = "N", default_value_t = 16)]
    pub batch: usize,
    /// Rate of the first epoch; falls to a hundredth.
    #[arg(long, value_name = "R", default_value_t = 2e-3)]
    pub rate: f64,
    /// Stop after so many epochs without a smaller error on the held-out sequences; 0: never.
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub patience: usize,
    /// Threads [default: all]; the result does not depend on them.
    #[arg(long, value_name = "N")]
    pub threads: Option<usize>,
    /// Where burn computes: flex (the processor), cuda or wgpu (a graphics processor). The last two
    /// need a program that was built with --features of that name; they have not been run.
    #[arg(long, value_name = "DEVICE", default_value_t)]
    pub device: eit_denoise::TrainDevice,
    /// Write the weights although their images of the held-out sequences are worse than the raw ones.
    #[arg(long)]
    pub force: bool,
}

/// `eit denoise`
#[derive(Debug, Args)]
pub(crate) struct DenoiseArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Images of this scene: images.npy of `eit reconstruct`, [frame, row, column].
    #[arg(long, value_name = "F.npy")]
    pub images: PathBuf,
    /// "default" (of the built-in scene), or a file of `eit train` [default: the scene's].
    #[arg(long, value_name = "W")]
    pub weights: Option<String>,
    /// Take the weights although they were trained for another skin or other pixels.
    #[arg(long)]
    pub any_skin: bool,
    /// True images (truth_conductivity.npy of `eit simulate`): reports how much nearer they are.
    #[arg(long, value_name = "F.npy")]
    pub truth: Option<PathBuf>,
    /// Folder for the results.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}
