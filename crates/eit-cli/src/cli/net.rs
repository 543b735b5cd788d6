//! Arguments of `eit net`.

use clap::{Args, Subcommand};
use std::path::PathBuf;

/// `eit net`
#[derive(Debug, Subcommand)]
pub(crate) enum NetCommand {
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
    ///     'eit net base paper-disc --out base --threads 1 --shard $SLURM_ARRAY_TASK_ID/64'
    ///   eit net base paper-disc --out base      (merges the parts, makes what is missing)
    ///
    /// Then: eit net train paper-disc --base base --out w.safetensors
    #[command(verbatim_doc_comment)]
    Base(BaseArgs),
    /// Train a U-net that removes the artefacts of a scene's images.
    ///
    /// First completes the learning base (see `eit net base`). If the skin's electrodes are symmetric, sequences are
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
    /// For nets that take the raw image alone (--images 1 of `eit net train`); other nets also need the frames.
    ///
    /// Writes images.npy [frame, row, column], sheet.png, movie.gif for a sequence, and report.json.
    Apply(ApplyArgs),
}

/// `eit net train`
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
    /// takes the raw image alone (`eit net apply`), and is much less accurate.
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
#[derive(Debug, Clone, Args)]
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
    /// As in the paper: train on N pairs of --recording and, once it has no more, of a turned or mirrored copy. Frames
    /// without a touch do not count; nothing is held out or augmented.
    #[arg(long, value_name = "N", requires = "recording", conflicts_with = "sequences")]
    pub pairs: Option<usize>,
    /// Simulate this built-in script on the scene's own fabric, with another seed for each sequence,
    /// instead of random touches on random fabrics.
    #[arg(long, value_name = "NAME", conflicts_with = "recording")]
    pub script: Option<String>,
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

/// `eit net base`
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
    /// folder, or in several whose files are then copied into one; `eit net base` or `eit net train` without
    /// --shard merges them. The bytes do not depend on the number of parts.
    #[arg(long, value_name = "I/N")]
    pub shard: Option<eit_denoise::Part>,
}

/// `eit net apply`
#[derive(Debug, Args)]
pub(crate) struct ApplyArgs {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Images of this scene: images.npy of `eit reconstruct`, [frame, row, column].
    #[arg(long, value_name = "F.npy")]
    pub images: PathBuf,
    /// "default" (for the built-in scene), or a file written by `eit net train` [default: the scene's].
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
