//! Touches on a simulated fabric, from a seeded script to their score.

#![allow(missing_docs, reason = "tests")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a panic is a failed test")]

pub mod score;
pub mod script;
pub mod source;

use eit_skin::eit_fem::fabric::{PlayCircle, Random, SimulationSettings, TouchScript, TrueTouch};
use eit_skin::eit_mesh::Raster;
use eit_skin::ndarray::Array2;
use eit_skin::scene::{Reference, Scene};
use eit_skin::touches::{Touches, touches};
use eit_skin::{FittedFrames, LinearisedSkin, MeshOverride, Progress, Skin};
use script::{QUIET_FRAMES, RATE_HZ};
use std::sync::{Arc, LazyLock};

/// Nodes of the mesh that simulates; the one that reconstructs is the scene's own.
const NODES: usize = 3000;

/// Pixels of the truth's images, which no test uses.
const PIXELS: usize = 8;

/// A skin twice: for simulation, and for finding touches.
pub struct Bench {
    simulated: Skin,
    raster: Raster,
    linearised: Arc<LinearisedSkin>,
}

static BENCH: LazyLock<Bench> = LazyLock::new(|| Bench::of("paper-disc"));

impl Bench {
    /// A built-in scene.
    pub fn of(name: &str) -> Self {
        Self::believing(Scene::load(name).unwrap(), Scene::load(name).unwrap())
    }

    /// One scene is measured, the frames are taken for those of another.
    pub fn believing(measured: Scene, scene: Scene) -> Self {
        let mut progress = Progress::silent();
        let mesh = MeshOverride { nodes: Some(NODES), ..Default::default() };
        let simulated = Skin::set_up(&measured, &mesh, &mut progress).unwrap();
        let raster = Raster::new(simulated.mesh.surface(), PIXELS).unwrap();
        // what `eit simulate` writes into its scene
        let mut skin = Skin::from_scene(scene).unwrap();
        let quiet = format!("0..{QUIET_FRAMES}");
        skin.settings.recording.frame_rate_hz = Some(RATE_HZ);
        skin.settings.noise.quiet_frames = Some(quiet.parse().unwrap());
        skin.settings.recording.reference = Some(Reference::Text(quiet));
        let linearised = Arc::new(skin.linearise(&mut progress).unwrap());
        Self { simulated, raster, linearised }
    }

    /// One thread, because tests run in parallel.
    pub fn simulate(&self, script: &TouchScript, seed: u64) -> Recording {
        let how = SimulationSettings { seed, ..Default::default() };
        let fabric = self.simulated.simulated_fabric().unwrap();
        let made = fabric.simulate(script, &self.raster, &how, &mut |_| {}).unwrap();
        Recording { values: made.frames_v, truth: made.truth.touches }
    }

    /// A built-in script on this skin.
    pub fn script(&self, name: &str, seed: u64) -> TouchScript {
        let circle = PlayCircle::of(&self.simulated.mesh);
        let mut script = TouchScript::built_in(name, &circle, seed).unwrap();
        script.frames = (script.frames as f64 * RATE_HZ / script.frame_rate_hz) as usize;
        (script.frame_rate_hz, script.quiet_frames) = (RATE_HZ, QUIET_FRAMES);
        script
    }

    /// Frames fitted to the model, with default settings.
    pub fn fit(&self, recording: &Recording) -> FittedFrames {
        let frames = self.linearised.skin.frames_of_values(&recording.values).unwrap();
        self.linearised.fit(frames).unwrap()
    }

    /// Touches as returned to every user of the library.
    pub fn touches(&self, recording: &Recording) -> Touches {
        touches(&self.fit(recording), &mut Progress::silent()).unwrap().unwrap()
    }
}

/// Frames of a script with its truth.
#[derive(Clone)]
pub struct Recording {
    /// Volts, `[frame, measurement]`.
    pub values: Array2<f64>,
    pub truth: Vec<TrueTouch>,
}

impl Recording {
    /// On the paper's skin.
    pub fn simulate(script: &TouchScript, seed: u64) -> Self {
        BENCH.simulate(script, seed)
    }

    /// Fitted to the paper's skin.
    pub fn fitted(&self) -> FittedFrames {
        BENCH.fit(self)
    }

    /// On the paper's skin.
    pub fn touches(&self) -> Touches {
        BENCH.touches(self)
    }

    /// Opens an electrode in these frames: no current flows through it and its inputs float, so what it
    /// drives or measures is noise of a tenth of the largest voltage.
    pub fn open(&mut self, electrode: usize, frames: std::ops::Range<usize>, random: &mut Random) {
        let largest = self.values.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        let lost = measurements_of(electrode);
        for frame in frames {
            for &i in &lost {
                self.values[[frame, i]] = 0.1 * largest * random.normal();
            }
        }
    }

    /// From this frame on the voltages of an electrode change steadily, by this part each second.
    pub fn drift(&mut self, electrode: usize, from: usize, per_s: f64) {
        let measurements = measurements_of(electrode);
        for frame in from..self.values.nrows() {
            let gain = 1.0 + per_s * (frame - from) as f64 / script::RATE_HZ;
            measurements.iter().for_each(|&i| self.values[[frame, i]] *= gain);
        }
    }
}

/// Measurements that an electrode drives or measures.
pub fn measurements_of(electrode: usize) -> Vec<usize> {
    let quadruples = BENCH.simulated.protocol.quadruples().unwrap();
    let involves = |i: &usize| quadruples[*i].contains(&(electrode as u32));
    (0..quadruples.len()).filter(involves).collect()
}
