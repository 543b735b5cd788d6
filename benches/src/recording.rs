//! Recordings of touch scripts on the simulated fabric, and what they are evaluated against.

use crate::Result;
use eit_fem::fabric::{FabricSettings, PlayCircle, Simulation, SimulationSettings, TouchScript};
use eit_inverse::touch::Touch;
use eit_mesh::Raster;
use eit_skin::denoise::{Chain, Chained, Lengths};
use eit_skin::method::Method;
use eit_skin::{MeshOverride, Progress, Scene, Skin};

/// A blob or touch farther than this from every finger is false, metres.
pub const WITHIN_M: f64 = 0.025;

/// The paper's skin, on the mesh that reconstructs and on a finer one that simulates.
pub struct Simulator {
    /// Skin of the reconstruction.
    pub own: Skin,
    /// Skin of the simulation.
    pub finer: Skin,
    /// Pixels of the simulated truth.
    pub raster: Raster,
}

/// A simulated recording of a script.
pub struct Recording {
    /// What touches the skin.
    pub script: TouchScript,
    /// The frames and their truth.
    pub simulation: Simulation,
}

/// A finger in a frame.
#[derive(Debug, Clone, Copy)]
pub struct Finger {
    /// Its position, metres.
    pub position_m: [f64; 2],
    /// Its force, newtons.
    pub force_n: f64,
}

impl Simulator {
    /// Sets up the paper's skin with the given number of pixels across it, and the same skin on a
    /// mesh of about `nodes` nodes.
    ///
    /// # Errors
    /// A mesh that cannot be made.
    pub fn paper_disc(pixels: usize, nodes: usize) -> Result<Self> {
        let mut scene = Scene::load("paper-disc")?;
        scene.reconstruction.pixels = Some(pixels);
        let mut silent = Progress::silent();
        let own = Skin::set_up(&scene, &MeshOverride::default(), &mut silent)?;
        let finer = own.with_nodes(nodes, &mut silent)?;
        let raster = Raster::new(finer.mesh.surface(), pixels)?;
        Ok(Self { own, finer, raster })
    }

    /// Simulates the first frames of a built-in script, at most `most` of them.
    ///
    /// # Errors
    /// An unknown script, or settings that cannot be simulated.
    pub fn built_in(
        &self,
        script: &str,
        seed: u64,
        fabric: &FabricSettings,
        most: usize,
    ) -> Result<Recording> {
        let mut script = TouchScript::built_in(script, &PlayCircle::of(&self.finer.mesh), seed)?;
        script.frames = script.frames.min(most);
        self.run(script, seed, fabric)
    }

    /// Simulates a script.
    ///
    /// # Errors
    /// Settings that cannot be simulated.
    pub fn run(
        &self,
        script: TouchScript,
        seed: u64,
        fabric: &FabricSettings,
    ) -> Result<Recording> {
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let how = SimulationSettings { seed, threads, keep_elements: false };
        let fabric = self.finer.fabric_with(fabric)?;
        let simulation = fabric.simulate(&script, &self.raster, &how, &mut |_| {})?;
        Ok(Recording { script, simulation })
    }

    /// Sets up what `eit reconstruct` does with recordings of a script: reference and noise from its
    /// quiet frames.
    ///
    /// # Errors
    /// A method whose images nets are not trained on.
    pub fn chain(
        &self,
        script: &TouchScript,
        method: Method,
        electrode_movement_m: Option<f64>,
    ) -> Result<Chain> {
        let mut skin = self.own.clone();
        skin.settings.reconstruction.electrode_movement_m = electrode_movement_m;
        let TouchScript { frames, quiet_frames: quiet, frame_rate_hz: rate_hz, .. } = *script;
        let lengths = Some(Lengths { frames, quiet, rate_hz });
        Ok(Chain::new(skin, Some(method.name()), lengths, &mut Progress::silent())?)
    }
}

impl Recording {
    /// Reconstructs the frames.
    ///
    /// # Errors
    /// Those of the method.
    pub fn reconstruct(&self, chain: &Chain) -> Result<Chained> {
        let mut made = chain.reconstruct(&self.simulation.frames_v)?;
        made.fitted.frames.rate_hz = Some(self.script.frame_rate_hz);
        Ok(made)
    }

    /// The fingers in a frame.
    pub fn fingers(&self, frame: usize) -> Vec<Finger> {
        let touches = self.simulation.truth.touches.iter().filter(|touch| touch.frame == frame);
        touches.map(|t| Finger { position_m: t.position_m, force_n: t.force_n }).collect()
    }

    /// Frames after the quiet ones.
    pub fn after_quiet(&self) -> std::ops::Range<usize> {
        self.script.quiet_frames..self.script.frames
    }
}

/// The valid touches of each frame, as `eit reconstruct` lists them.
///
/// # Errors
/// Those of the detector; unknown noise.
pub fn valid_touches(made: &Chained) -> Result<Vec<Vec<Touch>>> {
    let found = eit_skin::touches::touches(&made.fitted, &mut Progress::silent())?;
    let mut frames = found.ok_or("the noise of simulated frames is unknown")?.by_frame();
    for touches in &mut frames {
        touches.retain(|t| t.valid && t.state != eit_inverse::touch::TouchState::End);
    }
    Ok(frames)
}

/// Distance in the plane, metres.
pub fn distance_m(found: [f64; 3], place: [f64; 2]) -> f64 {
    (found[0] - place[0]).hypot(found[1] - place[1])
}
