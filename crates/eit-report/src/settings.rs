//! What is asked of the reports.

use std::path::PathBuf;

/// Settings of the demo.
#[derive(Debug, Clone)]
pub struct DemoSettings {
    /// Folder for the results.
    pub out: PathBuf,
    /// Write into a folder that holds other things, too.
    pub force: bool,
    /// Fewer frames, pixels and nodes: seconds, as a check.
    pub quick: bool,
}

/// Settings of a reconstruction with its pictures and report.
#[derive(Debug, Clone)]
pub struct ReconstructSettings {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Files of frames; empty: the scene's recording.
    pub frames: Vec<PathBuf>,
    /// Reference frame instead of the scene's.
    pub reference: Option<String>,
    /// Method instead of the scene's.
    pub method: Option<String>,
    /// Folder for the results.
    pub out: PathBuf,
}

/// Which report, and how large.
#[derive(Debug, Clone, Default)]
pub struct ReportSettings {
    /// Folder for the results.
    pub out: PathBuf,
    /// Fewer frames, pixels and movies.
    pub quick: bool,
    /// Figures of merit over noise, speed and touches instead of error against time.
    pub quality: bool,
    /// Touches instead of images: these parts.
    pub touches: Vec<TouchPart>,
    /// What U-nets make of images.
    pub denoise: bool,
    /// Only these scenes; empty: all.
    pub scenes: Vec<String>,
    /// Only what a plan promises of each scene, beside what is measured.
    pub plans: bool,
    /// Only the forward problem of each skin.
    pub forward: bool,
    /// A Python that runs the peers.
    pub peers: Option<PathBuf>,
    /// U-nets to compare: "default" or files.
    pub weights: Vec<String>,
    /// Method of the raw images of U-nets.
    pub method: Option<String>,
    /// Added to the seed of every sequence that U-nets are compared on.
    pub seed: u64,
}

/// Parts of the report on touches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TouchPart {
    /// Every part.
    All,
    /// Touches without a finger, and whether confidence holds what it says.
    Reliability,
    /// Position error of one touch beside its bound.
    Position,
    /// The same when electrodes move.
    Movement,
    /// What taking the movement of electrodes out of the data does to images and touches.
    Electrodes,
    /// Two-point discrimination.
    Pairs,
    /// Fingers followed over time.
    Tracks,
    /// GREIT figures of merit.
    Greit,
    /// Time from a frame to its touches.
    Latency,
}

/// Settings of a simulation on the fabric.
#[derive(Debug, Clone)]
pub struct SimulateSettings {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Built-in touch script, or a file.
    pub script: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Only the first frames of the script.
    pub frames: Option<usize>,
    /// Nodes of the mesh that simulates.
    pub nodes: Option<usize>,
    /// Threads; `None`: all. The result does not depend on them.
    pub threads: Option<usize>,
    /// Folder for everything, or a file for the frames alone.
    pub out: PathBuf,
}

/// Settings of images through a U-net.
#[derive(Debug, Clone)]
pub struct DenoiseImages {
    /// Scene file or built-in scene.
    pub scene: String,
    /// Images [frame, row, column].
    pub images: PathBuf,
    /// "default" or a file; `None`: the scene's.
    pub weights: Option<String>,
    /// Take weights of another skin or other pixels.
    pub any_skin: bool,
    /// True images to compare with.
    pub truth: Option<PathBuf>,
    /// Folder for the results.
    pub out: PathBuf,
}
