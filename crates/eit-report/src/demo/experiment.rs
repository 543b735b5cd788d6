//! Two experiments like the paper's, ten times as fast, on the simulated fabric.

use crate::error::ReportError;
use crate::output::{OutFolder, write_npy};
use eit_fem::fabric::{Fabric, PlayCircle, Simulation, SimulationSettings, TouchScript};
use eit_mesh::Raster;
use eit_skin::live::REFERENCE_FRAMES;
use eit_skin::{MeshOverride, Progress, Scene, Skin, rounding_warning};
use std::path::Path;

/// Nodes of the simulation mesh: 3.5 times those of the reconstruction mesh, or 1.5 times in quick
/// mode.
const NODES: [usize; 2] = [7000, 3000];
/// Number of frames after the quiet ones in quick mode.
const QUICK_FRAMES: usize = 30;
/// Seed of fabric, drift and noise; differs from the seeds used to train the network.
const SEED: u64 = 20_190_620;

/// An experiment of the demo: script and titles.
#[derive(Debug, Clone, Copy)]
pub(super) struct Experiment {
    /// Name for display.
    pub name: &'static str,
    /// Folder of its results.
    pub folder: &'static str,
    /// File name of its recording.
    pub recording: &'static str,
    /// File name of its movie.
    pub movie: &'static str,
    /// Pictures: images, error per frame, touches, position error.
    pub figures: [&'static str; 4],
    /// Names of its stages, for progress reports.
    pub stages: [&'static str; 3],
    script: &'static str,
}

/// Both experiments.
pub(super) const EXPERIMENTS: [Experiment; 2] = [
    Experiment {
        name: "one finger",
        folder: "one-finger",
        recording: "one-finger.mcap",
        movie: "one-finger.gif",
        figures: [
            "one-finger-images.png",
            "one-finger-error.png",
            "one-finger-touches.png",
            "one-finger-position-error.png",
        ],
        stages: ["simulate one finger", "one finger live", "pictures of one finger"],
        script: "one-finger",
    },
    Experiment {
        name: "two fingers",
        folder: "two-fingers",
        recording: "two-fingers.mcap",
        movie: "two-fingers.gif",
        figures: [
            "two-fingers-images.png",
            "two-fingers-error.png",
            "two-fingers-touches.png",
            "two-fingers-position-error.png",
        ],
        stages: ["simulate two fingers", "two fingers live", "pictures of two fingers"],
        script: "two-fingers",
    },
];

/// The simulated fabric and its script.
pub(super) struct TouchedFabric {
    skin: Skin,
    raster: Raster,
    fabric: Fabric,
    quick: bool,
}

impl TouchedFabric {
    /// Sets up the fabric on a finer mesh than that of the reconstruction.
    pub(crate) fn new(
        scene: &Scene,
        quick: bool,
        progress: &mut Progress,
    ) -> Result<Self, ReportError> {
        let mesh = MeshOverride { file: None, nodes: Some(NODES[usize::from(quick)]) };
        let skin = Skin::set_up(scene, &mesh, progress)?;
        let raster = skin.raster(progress)?;
        let fabric = skin.simulated_fabric()?;
        Ok(Self { skin, raster, fabric, quick })
    }

    /// Number of nodes of its mesh.
    pub(crate) fn nodes(&self) -> usize {
        self.skin.mesh.surface().nodes().len()
    }

    /// Returns the script of an experiment, with more quiet frames at the start.
    pub(crate) fn script(&self, experiment: &Experiment) -> Result<TouchScript, ReportError> {
        let circle = PlayCircle::of(&self.skin.mesh);
        let mut script = TouchScript::built_in(experiment.script, &circle, SEED)?;
        let more = REFERENCE_FRAMES.saturating_sub(script.quiet_frames);
        script.quiet_frames += more;
        script.frames += more;
        let shift_s = more as f64 / script.frame_rate_hz;
        let keys = script.fingers.iter_mut().flat_map(|finger| &mut finger.keys);
        keys.for_each(|key| key.time_s += shift_s);
        if self.quick {
            script.frames = REFERENCE_FRAMES + QUICK_FRAMES;
        }
        script.validate(&self.skin.mesh)?;
        Ok(script)
    }

    /// Simulates touches of the fabric and writes the measurements of the instrument.
    pub(crate) fn simulate(
        &self,
        experiment: &Experiment,
        folder: impl AsRef<Path>,
        progress: &mut Progress,
    ) -> Result<Simulation, ReportError> {
        let folder = folder.as_ref();
        let script = self.script(experiment)?;
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let how = SimulationSettings { seed: SEED, threads, keep_elements: false };
        let made = progress.steps(experiment.stages[0], script.frames, |bar| {
            let mut tick = |done| bar.set_position(done);
            self.fabric.simulate(&script, &self.raster, &how, &mut tick)
        })?;
        rounding_warning(&made.report.untouched)?;
        let mut out = OutFolder::new(folder)?;
        out.write("frames.npy", |w| write_npy(&made.frames_v, w))?;
        out.write("truth.npy", |w| write_npy(&made.truth.conductivity_change_s, w))?;
        out.commit(&[])?;
        Ok(made)
    }
}
