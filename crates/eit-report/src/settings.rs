//! Settings of the reports.

use std::path::PathBuf;

/// Where `eit demo` writes, and how much it computes.
#[derive(Debug, Clone)]
pub struct DemoSettings {
    /// Output folder.
    pub out: PathBuf,
    /// Whether to write into a folder that contains other files.
    pub force: bool,
    /// Whether to use fewer frames, pixels and nodes, for a check that takes seconds.
    pub quick: bool,
}

/// Settings of a reconstruction with its pictures and report.
#[derive(Debug, Clone)]
pub struct ReconstructSettings {
    /// Scene file or name of a built-in scene.
    pub scene: String,
    /// Files with frames; if empty, the scene's recording.
    pub frames: Vec<PathBuf>,
    /// Reference frame, overriding the scene's.
    pub reference: Option<String>,
    /// Method, overriding the scene's.
    pub method: Option<String>,
    /// Output folder.
    pub out: PathBuf,
}

/// Settings of the report on error against run time.
#[derive(Debug, Clone, Default)]
pub struct ReportSettings {
    /// Output folder.
    pub out: PathBuf,
    /// Whether to use all frames, pixels, gaps and meshes, which takes about half an hour.
    pub full: bool,
    /// Scenes to include; if empty, all.
    pub scenes: Vec<String>,
    /// Only report the forward problem of each skin.
    pub forward: bool,
    /// Only report images: every solver on every scene, without the forward problem of the skins.
    pub images: bool,
    /// U-nets to compare: "default" or files.
    pub weights: Vec<String>,
}

/// Settings of a simulation on the fabric.
#[derive(Debug, Clone)]
pub struct SimulationFiles {
    /// Scene file or name of a built-in scene.
    pub scene: String,
    /// What to simulate.
    pub simulation: eit_skin::simulate::SimulateSettings,
    /// Output folder, or a file for the frames alone.
    pub out: PathBuf,
}

/// Settings for applying a U-net to images.
#[derive(Debug, Clone)]
pub struct DenoiseImages {
    /// Scene file or name of a built-in scene.
    pub scene: String,
    /// Images [frame, row, column].
    pub images: PathBuf,
    /// "default" or a file; `None` for the scene's.
    pub weights: Option<String>,
    /// Whether to accept weights of another skin or pixel count.
    pub any_skin: bool,
    /// True images for comparison.
    pub truth: Option<PathBuf>,
    /// Output folder.
    pub out: PathBuf,
}

/// What a solve is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Solution {
    /// The voltage of every measurement.
    Voltages,
    /// The Jacobian [measurement, element].
    Jacobian,
}

/// Settings of a solve.
#[derive(Debug, Clone)]
pub struct SolveSettings {
    /// Scene file or name of a built-in scene.
    pub scene: String,
    /// Mesh file, instead of the scene's mesh.
    pub mesh: Option<PathBuf>,
    /// One conductivity per element; `None` for the scene's background.
    pub conductivity: Option<PathBuf>,
    /// Largest rounding error relative to the largest voltage, if it is stated.
    pub accuracy: Option<f64>,
    /// What is computed.
    pub wanted: Solution,
    /// Output file.
    pub out: PathBuf,
}

/// Settings of a conversion.
#[derive(Debug, Clone)]
pub struct ConvertSettings {
    /// Recording of any format.
    pub input: PathBuf,
    /// Output file, which names its format.
    pub out: PathBuf,
    /// Scene whose protocol the values are arranged for.
    pub scene: Option<String>,
    /// Whether rows of a table alternate real and imaginary parts.
    pub complex: bool,
    /// Whether to copy what is intact of a damaged recording.
    pub recover: bool,
}
