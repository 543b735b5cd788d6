//! `eit demo --paper`: the experiments of Duan, Taurand and Soleimani (Sci. Rep. 9:8831, 2019) as they are printed, on
//! the simulated fabric: 397 and 252 frames at one frame per second, images by their equation (7), the learning bases
//! of their trainings 1 and 2, and each net on both experiments; beside them the same frames by this program's
//! defaults, with their errors, and pressures.

mod figures;
mod images;
mod page;
mod phantom;
mod pressed;

pub(super) use self::images::squared_error;

use self::images::Imaged;
use super::folder::DemoFolder;
use super::{NUMBERS, REPORT};
use crate::Answer;
use crate::error::ReportError;
use crate::output::{OutFolder, io, write_npy};
use crate::settings::DemoSettings;
use eit_denoise::Weights;
use eit_picture::SkinDrawing;
use eit_skin::scene::Scene;
use eit_skin::simulate::{SimulateSettings, SimulatedRecording};
use eit_skin::{MeshOverride, Progress, Skin, StopFlag};
use serde_json::json;
use std::time::Instant;

/// Seed of fabric, drift and noise in every figure.
const SEED: u64 = 1;
/// Number of snapshots of each experiment in the paper's figures.
const SNAPSHOTS: usize = 21;
/// Number of frames, 20 of which are quiet, and of nodes of a check that takes seconds.
const QUICK_FRAMES: usize = 45;
const QUICK_NODES: usize = 3000;
/// Forces and places learnt from presses.
const LEARNED: &str = "presses.learned";
/// What the scene says beside the skin, for images by the paper's equations.
const EQUATION_7: &str = "[reconstruction]\nmethod = \"st-tv\"\npixels = 64\n\
     difference = \"plain\"    # as in the paper\n\
     delta = \"paper\"         # equation (7): equal weights, a radius for each frame\n\n\
     [recording]\nreference = \"0..20\"\nframe_rate_hz = 1.0     # the fabric allowed about one\n\n\
     [noise]\nquiet_frames = \"0..20\"\n";

/// One of the paper's two experiments, and the training on its recording.
#[derive(Debug, Clone, Copy)]
struct Experiment {
    name: &'static str,
    folder: &'static str,
    script: &'static str,
    /// Number of frames that the paper recorded, and of the pairs that it trained on.
    frames: usize,
    pairs: usize,
}

const EXPERIMENTS: [Experiment; 2] = [
    Experiment {
        name: "one finger",
        folder: "one-finger",
        script: "paper-one-finger",
        frames: 397,
        pairs: 439,
    },
    Experiment {
        name: "two fingers",
        folder: "two-fingers",
        script: "paper-two-fingers",
        frames: 252,
        pairs: 273,
    },
];

/// An experiment with everything that the page shows of it.
struct Shown {
    experiment: Experiment,
    recording: SimulatedRecording,
    /// Images by equation (7) and by the defaults.
    equation_7: Imaged,
    defaults: Imaged,
    /// Outputs of the nets of trainings 1 and 2.
    trained: [Imaged; 2],
    /// Frames with a finger, and of these the snapshots.
    touched: Vec<usize>,
    snapshots: Vec<usize>,
}

/// Makes the page.
///
/// # Errors
///
/// A folder with other files, or one that cannot be written.
pub fn run(
    args: &DemoSettings,
    stop: &StopFlag,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let start = Instant::now();
    let mut own = vec!["scene.toml", REPORT, NUMBERS, LEARNED];
    own.extend(figures::names());
    own.extend(EXPERIMENTS.map(|experiment| experiment.folder));
    let folder = DemoFolder::claim(&args.out, &own, args.force)?;
    folder.write_scene(&format!("{}\n{EQUATION_7}", Scene::text("paper-disc")?))?;
    let scene = Scene::load(&folder.scene().display().to_string())?;
    let recordings =
        EXPERIMENTS.map(|experiment| record(&experiment, &scene, args.quick, &folder, progress));
    let [one, two] = recordings;
    let recordings = [one?, two?];
    let goes_on = || match stop.is_set() {
        true => Err(ReportError::Failure(
            "interrupted: the recordings are complete, there is no page".to_owned(),
        )),
        false => Ok(()),
    };
    goes_on()?;
    let skin = Skin::set_up(&scene, &MeshOverride::default(), progress)?;
    let mut out = OutFolder::new(folder.path())?;
    let learned = pressed::learn(&skin, &recordings[0].skin, progress)?;
    out.write(LEARNED, |w| w.write_all(&learned).map_err(io))?;
    out.commit(&[])?;
    let nets = [Weights::paper_training_1()?, Weights::paper_training_2()?];
    let shown = images::of_both(recordings, &skin, &nets, &folder.join(LEARNED), progress)?;
    goes_on()?;
    let drawing = SkinDrawing::from_raster(&skin.mesh, &shown[0].equation_7.raster);
    let phantom = phantom::image(&scene, &skin, &shown[0], progress)?;
    let mut out = OutFolder::new(folder.path())?;
    let files = progress.stage("pictures", || figures::all(&shown, &phantom, &drawing))?;
    for (name, bytes) in &files {
        out.write(name, |w| w.write_all(bytes).map_err(io))?;
    }
    let seconds = start.elapsed().as_secs_f64();
    let page = page::page(&shown, &files, &nets, folder.path(), seconds);
    out.write(REPORT, |w| page.write(w))?;
    let json = json!({
        "scene": "paper-disc",
        "seed": SEED,
        "seconds": seconds,
        "experiments": shown.iter().map(page::numbers).collect::<Vec<_>>(),
        "report": folder.join(REPORT).display().to_string(),
    });
    out.write(NUMBERS, |w| writeln!(w, "{json:#}").map_err(io))?;
    out.commit(&[])?;
    Ok(Answer { text: page::text(&shown, &folder.join(REPORT), seconds), json })
}

/// Simulates an experiment and writes its frames, from which the net of its training was learnt.
fn record(
    experiment: &Experiment,
    scene: &Scene,
    quick: bool,
    folder: &DemoFolder,
    progress: &mut Progress,
) -> Result<SimulatedRecording, ReportError> {
    let settings = SimulateSettings {
        script: experiment.script.to_owned(),
        seed: SEED,
        frames: quick.then_some(QUICK_FRAMES),
        nodes: quick.then_some(QUICK_NODES),
        threads: None,
    };
    progress.group(experiment.name.to_owned());
    let made = SimulatedRecording::run(scene, &settings, progress)?;
    let mut out = OutFolder::new(folder.join(experiment.folder))?;
    out.write("frames.npy", |w| write_npy(&made.simulation.frames_v, w))?;
    out.commit(&[])?;
    Ok(made)
}

impl Experiment {
    /// The command that trains the net of this experiment.
    fn command(&self, number: usize, folder: &str) -> String {
        format!(
            "eit net train {folder}/scene.toml --recording {folder}/{}/frames.npy --pairs {} --images 1 \\\n    \
             --out training-{number}.safetensors",
            self.folder, self.pairs
        )
    }
}
