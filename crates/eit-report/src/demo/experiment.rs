//! The two experiments of the paper, on the simulated fabric.

use crate::error::ReportError;
use crate::output::{OutFolder, write_npy};
use eit_fem::fabric::{Fabric, PlayCircle, Simulation, SimulationSettings, TouchScript};
use eit_mesh::Raster;
use eit_skin::live::REFERENCE_FRAMES;
use eit_skin::{MeshOverride, Progress, Scene, Skin, rounding_warning};
use std::path::Path;

/// Nodes of the mesh that simulates: 3.5 times those that reconstruct; quick: 1.5 times.
const NODES: [usize; 2] = [7000, 3000];
/// Frames after the quiet ones, quick.
const QUICK_FRAMES: usize = 30;
/// Seed of fabric, drift and noise: no seed of the net's training, which takes its own.
const SEED: u64 = 20_190_620;

/// One experiment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Experiment {
    /// For people.
    pub name: &'static str,
    /// Folder of its numbers.
    pub folder: &'static str,
    /// Its recording.
    pub recording: &'static str,
    /// Its movie.
    pub movie: &'static str,
    /// Pictures in the place of the paper's figures: images, error of each frame, touches.
    pub figures: [&'static str; 3],
    /// Stages, for the progress.
    pub stages: [&'static str; 3],
    script: &'static str,
}

/// Both.
pub(super) const EXPERIMENTS: [Experiment; 2] = [
    Experiment {
        name: "one finger",
        folder: "one-finger",
        recording: "one-finger.mcap",
        movie: "one-finger.gif",
        figures: [
            "figure-10-one-finger-images.png",
            "figure-11-one-finger-error.png",
            "figure-12-one-finger-touches.png",
        ],
        stages: ["simulate one finger", "one finger live", "pictures of one finger"],
        script: "paper-one-finger",
    },
    Experiment {
        name: "two fingers",
        folder: "two-fingers",
        recording: "two-fingers.mcap",
        movie: "two-fingers.gif",
        figures: [
            "figure-13-two-fingers-images.png",
            "figure-14-two-fingers-error.png",
            "figure-15-two-fingers-touches.png",
        ],
        stages: ["simulate two fingers", "two fingers live", "pictures of two fingers"],
        script: "paper-two-fingers",
    },
];

/// The simulated fabric that is touched.
pub(super) struct TouchedFabric {
    skin: Skin,
    raster: Raster,
    fabric: Fabric,
    quick: bool,
}

impl TouchedFabric {
    /// On a finer mesh than the one that reconstructs.
    pub fn new(scene: &Scene, quick: bool, progress: &mut Progress) -> Result<Self, ReportError> {
        let mesh = MeshOverride { file: None, nodes: Some(NODES[usize::from(quick)]) };
        let skin = Skin::set_up(scene, &mesh, progress)?;
        let raster = skin.raster(progress)?;
        let fabric = skin.simulated_fabric()?;
        Ok(Self { skin, raster, fabric, quick })
    }

    /// Nodes of its mesh.
    pub fn nodes(&self) -> usize {
        self.skin.mesh.surface().nodes().len()
    }

    /// The script of an experiment, with more quiet frames before it.
    pub fn script(&self, experiment: &Experiment) -> Result<TouchScript, ReportError> {
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

    /// Touches the fabric, and writes what the instrument would have measured.
    pub fn simulate(
        &self,
        experiment: &Experiment,
        folder: &Path,
        progress: &mut Progress,
    ) -> Result<Simulation, ReportError> {
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
