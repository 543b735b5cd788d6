//! Frames of the simulated fabric without an instrument.

use crate::error::ReportError;
use eit_fem::SolveReport;
use eit_fem::fabric::{FabricSettings, SimulationSettings, TouchScript};
use eit_mesh::Raster;
use eit_skin::{Progress, Skin};
use ndarray::{Array1, Array2};

/// Frames of a script and of the untouched skin, without an instrument.
pub(crate) struct FabricFrames {
    /// Exact voltages, volts, [frame, measurement].
    pub exact_v: Array2<f64>,
    /// Exact voltages of the untouched skin, volts.
    pub reference_v: Array1<f64>,
    /// Report of the solve for the untouched skin.
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
        // the true images are not used
        let raster = Raster::new(skin.mesh.surface(), 8)?;
        let how = SimulationSettings::default();
        let made = progress.steps("simulate", script.frames, |bar| {
            fabric.simulate(script, &raster, &how, &mut |done| bar.set_position(done))
        })?;
        let untouched = made.report.untouched;
        Ok(Self { exact_v: made.exact_v, reference_v: made.reference_v, untouched })
    }
}
