//! Touches on a simulated fabric, from a seeded script to their score.

#[cfg(feature = "learn")]
mod presses;
mod score;
mod script;
mod source;

#[cfg(feature = "learn")]
pub use presses::*;
pub use {score::*, script::*, source::*};

use eit_skin::eit_fem::fabric::{PlayCircle, Random, SimulationSettings, TouchScript, TrueTouch};
use eit_skin::eit_mesh::Raster;
use eit_skin::ndarray::{Array2, Axis};
use eit_skin::scene::{Reference, Scene};
use eit_skin::touches::{Touches, touches};
use eit_skin::{FittedFrames, LinearisedSkin, MeshOverride, Progress, Skin};
use std::sync::{Arc, LazyLock};

/// Nodes of the mesh that simulates; the one that reconstructs is the scene's own.
const NODES: usize = 3000;

/// Seeds of scripts and fabrics: most scripts are drawn three times.
pub const SEEDS: [u64; 3] = [71, 81, 91];

/// A skin twice: for simulation, and for finding touches.
pub struct Bench {
    simulated: Skin,
    raster: Raster,
    pub linearised: Arc<LinearisedSkin>,
}

pub static PAPER: LazyLock<Bench> = LazyLock::new(|| Bench::of("paper-disc"));

/// Six fingers that land at once, in regular hexagons on the paper's skin.
pub static HEXAGONS: LazyLock<[Recording; 3]> = LazyLock::new(|| {
    PAPER.draw(SEEDS, 6, |drawn, _| {
        for (radius_m, angle) in [(0.06, 0.0), (0.06, 0.2), (0.05, 0.4), (0.07, 0.1)] {
            drawn.ring(radius_m, angle, 1.5);
        }
    })
});

/// The paper's scene with another pattern of drive.
pub fn with_drive(drive: &str) -> String {
    let text = Scene::text("paper-disc").unwrap();
    text.replace("drive = \"adjacent\"", &format!("drive = \"{drive}\""))
}

/// The skin of a scene on a mesh of this many nodes.
pub fn meshed(scene: &Scene, nodes: usize) -> Skin {
    let mesh = MeshOverride { nodes: Some(nodes), ..Default::default() };
    Skin::set_up(scene, &mesh, &mut Progress::silent()).unwrap()
}

/// Settings that `eit simulate` writes into its scene.
pub fn quiet_first(mut skin: Skin) -> Arc<LinearisedSkin> {
    let quiet = format!("0..{QUIET_FRAMES}");
    skin.settings.recording.frame_rate_hz = Some(RATE_HZ);
    skin.settings.noise.quiet_frames = Some(quiet.parse().unwrap());
    skin.settings.recording.reference = Some(Reference::Text(quiet));
    Arc::new(skin.linearise(&mut Progress::silent()).unwrap())
}

pub fn fit(linearised: &Arc<LinearisedSkin>, values: &Array2<f64>) -> FittedFrames {
    linearised.fit(linearised.skin.frames_of_values(values).unwrap()).unwrap()
}

pub fn touches_of(fitted: &FittedFrames) -> Touches {
    touches(fitted, &mut Progress::silent()).unwrap().unwrap()
}

impl Bench {
    pub fn of(name: &str) -> Self {
        Self::of_text(&Scene::text(name).unwrap())
    }

    /// A scene that is measured, and taken for what it is.
    pub fn of_text(text: &str) -> Self {
        let scene = Scene::parse(text, "scene").unwrap();
        Self::believing(&scene, &scene)
    }

    /// One scene is measured, the frames are taken for those of another.
    pub fn believing(measured: &Scene, scene: &Scene) -> Self {
        let simulated = meshed(measured, NODES);
        // for images of the truth, which no test uses
        let raster = Raster::new(simulated.mesh.surface(), 8).unwrap();
        let linearised = quiet_first(Skin::from_scene(scene.clone()).unwrap());
        Self { simulated, raster, linearised }
    }

    /// One thread, because tests run in parallel.
    pub fn simulate(&self, script: &TouchScript, seed: u64) -> Recording {
        let how = SimulationSettings { seed, ..Default::default() };
        let fabric = self.simulated.simulated_fabric().unwrap();
        let made = fabric.simulate(script, &self.raster, &how, &mut |_| {}).unwrap();
        Recording { values: made.frames_v, truth: made.truth.touches }
    }

    /// Draws and simulates a script with each seed.
    pub fn draw<const N: usize>(
        &self,
        seeds: [u64; N],
        fingers: u32,
        draw: impl Fn(&mut Drawn, u64),
    ) -> [Recording; N] {
        seeds.map(|seed| {
            let mut drawn = Drawn::new(seed, fingers);
            draw(&mut drawn, seed);
            self.simulate(&drawn.script(), seed)
        })
    }

    pub fn script(&self, name: &str, seed: u64) -> TouchScript {
        let circle = PlayCircle::of(&self.simulated.mesh);
        let mut script = TouchScript::built_in(name, &circle, seed).unwrap();
        script.frames = (script.frames as f64 * RATE_HZ / script.frame_rate_hz) as usize;
        (script.frame_rate_hz, script.quiet_frames) = (RATE_HZ, QUIET_FRAMES);
        script
    }

    pub fn fit(&self, recording: &Recording) -> FittedFrames {
        fit(&self.linearised, &recording.values)
    }

    pub fn touches(&self, recording: &Recording) -> Touches {
        touches_of(&self.fit(recording))
    }

    pub fn score(&self, recordings: &[Recording]) -> Score {
        let mut score = Score::default();
        recordings.iter().for_each(|recording| score.add(recording, &self.touches(recording)));
        score
    }

    /// Measurements that an electrode drives or measures.
    pub fn measurements_of(&self, electrode: usize) -> Vec<usize> {
        let quadruples = self.simulated.protocol.quadruples().unwrap();
        let involves = |i: &usize| quadruples[*i].contains(&(electrode as u32));
        (0..quadruples.len()).filter(involves).collect()
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
    /// Frames turned about their reference: touches seem to lower the conductivity.
    pub fn turned(&self) -> Self {
        let quiet = self.values.slice_axis(Axis(0), (..QUIET_FRAMES).into());
        let quiet = quiet.mean_axis(Axis(0)).unwrap();
        Self { values: 2.0 * &quiet - &self.values, truth: self.truth.clone() }
    }

    pub fn largest_v(&self) -> f64 {
        self.values.iter().fold(0.0, |most, v| most.max(v.abs()))
    }

    /// Opens an electrode: its inputs float, so what it drives or measures is noise of a tenth of the largest voltage.
    pub fn open(&mut self, electrode: usize, frames: std::ops::Range<usize>, random: &mut Random) {
        let (largest, lost) = (self.largest_v(), PAPER.measurements_of(electrode));
        for (frame, &i) in frames.flat_map(|frame| lost.iter().map(move |i| (frame, i))) {
            self.values[[frame, i]] = 0.1 * largest * random.normal();
        }
    }

    /// From this frame on the voltages of an electrode change steadily, by this part each second.
    pub fn drift(&mut self, electrode: usize, from: usize, per_s: f64) {
        let measurements = PAPER.measurements_of(electrode);
        for frame in from..self.values.nrows() {
            let gain = 1.0 + per_s * (frame - from) as f64 / RATE_HZ;
            measurements.iter().for_each(|&i| self.values[[frame, i]] *= gain);
        }
    }
}
