//! Frames of the simulated fabric without instrument.

use crate::error::ReportError;
use eit_fem::SolveReport;
use eit_fem::fabric::{FabricSettings, SimulationSettings, TouchScript};
use eit_mesh::Raster;
use eit_skin::{Progress, Skin};
use ndarray::{Array1, Array2};

/// Frames of a script and the untouched skin, without instrument.
pub(crate) struct FabricFrames {
    /// Volt, [frame, measurement].
    pub exact_v: Array2<f64>,
    /// The untouched skin, volt.
    pub reference_v: Array1<f64>,
    /// How its solve went.
    pub untouched: SolveReport,
}

impl FabricFrames {
    /// Simulates a script on one thread.
    pub fn simulate(
        skin: &Skin,
        settings: &FabricSettings,
        script: &TouchScript,
        progress: &mut Progress,
    ) -> Result<Self, ReportError> {
        let fabric = skin.fabric_with(settings)?;
        // the truth images are not looked at
        let raster = Raster::new(skin.mesh.surface(), 8)?;
        let how = SimulationSettings::default();
        let made = progress.steps("simulate", script.frames, |bar| {
            fabric.simulate(script, &raster, &how, &mut |done| bar.set_position(done))
        })?;
        let untouched = made.report.untouched;
        Ok(Self { exact_v: made.exact_v, reference_v: made.reference_v, untouched })
    }
}
