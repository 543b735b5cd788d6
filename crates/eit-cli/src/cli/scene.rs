//! Arguments of the commands that need a scene but no instrument.

use clap::Args;
use std::path::PathBuf;

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
    /// Output file: F.npy, for voltages also F.csv. Voltages are one value per measurement, volt; complex values are
    /// complex128, in CSV alternating real and imaginary parts.
    #[arg(long, value_name = "F")]
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
    #[arg(long, value_name = "NAME|F.toml", default_value = "one-finger")]
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
