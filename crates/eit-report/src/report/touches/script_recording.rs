//! Recordings of built-in scripts on the simulated fabric, including the instrument.

use super::simulated_disc::SimulatedDisc;
use super::tracking_scores::{FULL_N, PresentFinger};
use crate::error::ReportError;
use eit_fem::fabric::{
    Fabric, FabricSettings, PlayCircle, Simulation, SimulationSettings, TouchScript,
};
use eit_mesh::Raster;
use eit_skin::denoise::{Chain, Lengths};
use eit_skin::method::Method;
use eit_skin::{Progress, Skin};

/// A simulated recording of a script.
pub(super) struct ScriptRecording {
    pub script: TouchScript,
    pub simulation: Simulation,
}

impl ScriptRecording {
    /// Simulates the first frames of a built-in script on a fabric, at most `most` of them.
    pub fn simulate(
        disc: &SimulatedDisc,
        script: &str,
        seed: u64,
        fabric: &FabricSettings,
        most: usize,
    ) -> Result<Self, ReportError> {
        let skin = &disc.simulation;
        let mesh = &skin.mesh;
        let mut script = TouchScript::built_in(script, &PlayCircle::of(mesh), seed)?;
        script.frames = script.frames.min(most);
        let (sheet_s, impedance) = (skin.conductivity_s, &skin.contact_impedance);
        let fabric = Fabric::new(mesh, &skin.protocol, sheet_s, impedance, fabric)?;
        let raster = Raster::new(mesh.surface(), disc.model.raster.pixels())?;
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let how = SimulationSettings { seed, threads, keep_elements: false };
        let simulation = fabric.simulate(&script, &raster, &how, &mut |_| {})?;
        Ok(Self { script, simulation })
    }

    /// Sets up the processing chain of `eit reconstruct` for it.
    pub fn chain(
        &self,
        disc: &SimulatedDisc,
        method: Method,
        movement_m: Option<f64>,
    ) -> Result<Chain, ReportError> {
        let mut skin: Skin = disc.model.skin().clone();
        skin.settings.reconstruction.electrode_movement_m = movement_m;
        let TouchScript { frames, quiet_frames: quiet, frame_rate_hz: rate_hz, .. } = self.script;
        let lengths = Some(Lengths { frames, quiet, rate_hz });
        Ok(Chain::new(skin, Some(method.name()), lengths, &mut Progress::silent())?)
    }

    /// Largest displacement of an electrode in the plane of the skin, metres.
    pub fn moved_m(&self) -> f64 {
        let shifts = self.simulation.truth.electrode_shift_m.rows().into_iter();
        shifts.map(|s| s[0].hypot(s[1])).fold(0.0, f64::max)
    }

    /// The fingers in a frame.
    pub fn present(&self, frame: usize) -> Vec<PresentFinger> {
        let touches = self.simulation.truth.touches.iter().filter(|touch| touch.frame == frame);
        touches
            .map(|t| PresentFinger {
                finger: t.finger,
                position_m: t.position_m,
                is_full: t.force_n >= FULL_N,
            })
            .collect()
    }
}
