//! Frames of the simulated fabric for the touch figures.

use super::simulated_disc::SimulatedDisc;
use crate::error::ReportError;
use eit_fem::fabric::{Fabric, FabricSettings, SimulationSettings, TouchScript};
use eit_mesh::Raster;
use ndarray::Array2;

/// Frames of a fabric and its untouched skin, without instrument.
pub(super) struct FabricFrames {
    /// [frame, measurement], volt.
    pub values: Array2<f64>,
    /// The untouched skin, volt.
    pub reference: Vec<f64>,
}

/// Simulates a script without instrument.
pub(super) fn simulate(
    disc: &SimulatedDisc,
    settings: &FabricSettings,
    script: &TouchScript,
) -> Result<FabricFrames, ReportError> {
    let skin = &disc.simulation;
    let (sheet_s, impedance) = (skin.conductivity_s, &skin.contact_impedance);
    let fabric = Fabric::new(&skin.mesh, &skin.protocol, sheet_s, impedance, settings)?;
    // the truth images are not looked at
    let raster = Raster::new(skin.mesh.surface(), 8)?;
    let made = fabric.simulate(script, &raster, &SimulationSettings::default(), &mut |_| {})?;
    Ok(FabricFrames { values: made.exact_v, reference: made.reference_v.to_vec() })
}
