//! Touches on a simulated fabric, from a seeded script to their score.

#![allow(dead_code, missing_docs, reason = "each test file uses its part")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "a panic is a failed test")]

pub mod score;
pub mod script;

use eit_skin::eit_fem::fabric::{Random, SimulationSettings, TouchScript, TrueTouch};
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

/// The paper's skin twice: for simulation, and for finding touches.
struct Bench {
    simulated: Skin,
    raster: Raster,
    linearised: Arc<LinearisedSkin>,
}

static BENCH: LazyLock<Bench> = LazyLock::new(|| {
    let mut progress = Progress::silent();
    let scene = Scene::load("paper-disc").unwrap();
    let mesh = MeshOverride { nodes: Some(NODES), ..Default::default() };
    let simulated = Skin::set_up(&scene, &mesh, &mut progress).unwrap();
    let raster = Raster::new(simulated.mesh.surface(), PIXELS).unwrap();
    // what `eit simulate` writes into its scene
    let mut skin = Skin::from_scene(scene).unwrap();
    let quiet = format!("0..{QUIET_FRAMES}");
    skin.settings.recording.frame_rate_hz = Some(RATE_HZ);
    skin.settings.noise.quiet_frames = Some(quiet.parse().unwrap());
    skin.settings.recording.reference = Some(Reference::Text(quiet));
    let linearised = Arc::new(skin.linearise(&mut progress).unwrap());
    Bench { simulated, raster, linearised }
});

/// Frames of a script with its truth.
pub struct Recording {
    /// Volts, `[frame, measurement]`.
    pub values: Array2<f64>,
    pub truth: Vec<TrueTouch>,
}

impl Recording {
    /// One thread, because tests run in parallel.
    pub fn simulate(script: &TouchScript, seed: u64) -> Self {
        let Bench { simulated, raster, .. } = &*BENCH;
        let how = SimulationSettings { seed, ..Default::default() };
        let fabric = simulated.simulated_fabric().unwrap();
        let made = fabric.simulate(script, raster, &how, &mut |_| {}).unwrap();
        Self { values: made.frames_v, truth: made.truth.touches }
    }

    /// Fitted to the model, with default settings.
    pub fn fitted(&self) -> FittedFrames {
        let linearised = &BENCH.linearised;
        let frames = linearised.skin.frames_of_values(&self.values).unwrap();
        linearised.fit(frames).unwrap()
    }

    /// Touches as returned to every user of the library.
    pub fn touches(&self) -> Touches {
        touches(&self.fitted(), &mut Progress::silent()).unwrap().unwrap()
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
