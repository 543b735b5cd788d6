//! The simulated fabric of a scene: a recording, as `eit simulate` computes it, or a skin that is stepped.

use crate::error::SkinError;
use crate::limits::{check_images, rounding_warning};
use crate::progress::Progress;
use crate::scene::{FrameRange, Reference, Scene, Shape, from_toml, read_settings};
use crate::skin::{MeshOverride, Skin};
use eit_fem::fabric::{PlayCircle, SimulatedSkin, Simulation, SimulationSettings, TouchScript};
use eit_mesh::{Mesh, Raster};
use std::path::Path;

/// Nodes of the simulation mesh: 3.5 times those of the reconstruction mesh.
const NODES: usize = 7000;
/// Nodes of a linearised skin: its voltages are within 6 % of solved ones of 7 000 nodes (docs/FABRIC.md).
const LINEARISED_NODES: usize = 900;
/// Fewer quiet frames do not show the noise.
const LEAST_QUIET: usize = 3;

/// What to simulate.
#[derive(Debug, Clone, Default)]
pub struct SimulateSettings {
    /// Name of a built-in touch script, or a file `F.toml`.
    pub script: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Number of frames of the script to simulate; `None` for all.
    pub frames: Option<usize>,
    /// Nodes of the simulation mesh; `None` for 7000, or for those of a mesh file.
    pub nodes: Option<usize>,
    /// Number of threads; `None` for all. The result does not depend on it.
    pub threads: Option<usize>,
}

/// A simulated recording with its truth.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SimulatedRecording {
    /// The skin on the mesh of the simulation.
    pub skin: Skin,
    /// The script that was run.
    pub script: TouchScript,
    /// Pixels of the true images.
    pub raster: Raster,
    /// Frames and truth.
    pub simulation: Simulation,
    /// Effect of rounding, if it may matter.
    pub warning: Option<String>,
}

impl SimulatedRecording {
    /// Runs a script on the simulated fabric of a scene.
    ///
    /// # Errors
    ///
    /// A script that is unknown or invalid; frames that are all quiet; the errors of the fabric.
    pub fn run(
        scene: &Scene,
        settings: &SimulateSettings,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        let file = script_file(&settings.script)?;
        let skin = on_mesh(scene, settings.nodes, NODES, progress)?;
        let script = script(settings, file, &skin.mesh)?;
        check_images(2 * script.frames, skin.pixels())?;
        let raster = skin.raster(progress)?;
        let threads = match settings.threads {
            Some(threads) => threads,
            None => std::thread::available_parallelism().map_or(1, usize::from),
        };
        let how = SimulationSettings { seed: settings.seed, threads, keep_elements: false };
        let fabric = skin.simulated_fabric()?;
        let simulation = progress.steps("simulate", script.frames, |bar| {
            fabric.simulate(&script, &raster, &how, &mut |done| bar.set_position(done))
        });
        let simulation = simulation.map_err(|e| SkinError::from(e).within(&settings.script))?;
        let warning = rounding_warning(&simulation.report.untouched)?;
        Ok(Self { skin, script, raster, simulation, warning })
    }

    /// Returns the reference of these frames: the quiet ones, if they show the noise, else the first.
    pub fn reference(&self) -> Reference {
        match self.quiet_frames() {
            Some(quiet) => Reference::Text(quiet.to_string()),
            None => Reference::Frame(0),
        }
    }

    /// Returns the frames from which the noise is measured, if there are enough.
    pub fn quiet_frames(&self) -> Option<FrameRange> {
        let quiet = self.script.quiet_frames;
        (quiet >= LEAST_QUIET).then(|| (0..quiet).into())
    }

    /// Returns a skin with the reference, frame rate and noise of these frames.
    pub fn described(&self, mut skin: Skin) -> Skin {
        let recording = &mut skin.settings.recording;
        recording.reference = Some(self.reference());
        recording.frame_rate_hz = Some(self.script.frame_rate_hz);
        skin.settings.noise.quiet_frames = self.quiet_frames();
        skin.settings.noise.additive_v = None;
        skin
    }
}

/// Sets up the simulated fabric of a scene to be stepped, frame by frame, with the contacts of a robot's simulator:
/// solved, on the mesh and with the frames of [`SimulatedRecording`], or linearised, some fifty times as fast.
/// `nodes` are those of the mesh; `None` for 7000, 900 if linearised, or those of a mesh file.
///
/// # Errors
///
/// A scene that cannot be set up; the errors of [`SimulatedSkin::new`] and [`SimulatedSkin::linearised`].
pub fn simulator(
    scene: &Scene,
    seed: u64,
    nodes: Option<usize>,
    linearised: bool,
) -> Result<SimulatedSkin, SkinError> {
    let usual = if linearised { LINEARISED_NODES } else { NODES };
    let fabric = on_mesh(scene, nodes, usual, &mut Progress::silent())?.simulated_fabric()?;
    Ok(match linearised {
        true => SimulatedSkin::linearised(&fabric, seed)?,
        false => SimulatedSkin::new(&fabric, seed)?,
    })
}

/// The skin on a mesh for simulation.
fn on_mesh(
    scene: &Scene,
    nodes: Option<usize>,
    usual: usize,
    progress: &mut Progress,
) -> Result<Skin, SkinError> {
    let nodes = match scene.skin.shape {
        Shape::Mesh => nodes,
        _ => Some(nodes.unwrap_or(usual)),
    };
    Skin::set_up(scene, &MeshOverride { file: None, nodes }, progress)
}

/// Reads the script from a file; `None` for the name of a built-in one, which needs the mesh.
fn script_file(name: &str) -> Result<Option<TouchScript>, SkinError> {
    if Path::new(name).extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
        let text = read_settings(name).map_err(|error| SkinError::input(error.to_string()))?;
        return from_toml(&text, name).map(Some);
    }
    if TouchScript::BUILT_IN.contains(&name) {
        return Ok(None);
    }
    let known = TouchScript::BUILT_IN.join(", ");
    let problem =
        format!("{name}: no such script; known scripts are {known}; or give a file F.toml");
    Err(SkinError::argument("script", problem))
}

/// Returns the script to run, checked against its skin.
fn script(
    settings: &SimulateSettings,
    file: Option<TouchScript>,
    mesh: &Mesh,
) -> Result<TouchScript, SkinError> {
    let name = &settings.script;
    let mut script = match file {
        Some(script) => script,
        None => TouchScript::built_in(name, &PlayCircle::of(mesh), settings.seed)?,
    };
    if let Some(frames) = settings.frames {
        let quiet = script.quiet_frames;
        if frames <= quiet && script.frames > quiet {
            let problem = format!(
                "{frames}, but the script {name} begins with {quiet} frames of the untouched skin: give more"
            );
            return Err(SkinError::argument("frames", problem));
        }
        script.frames = script.frames.min(frames);
    }
    script.validate(mesh).map_err(|e| SkinError::from(e).within(name))?;
    Ok(script)
}
