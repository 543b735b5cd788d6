//! The paper's skin with simulated fabric, and scripts of fingers.

use super::{CONDUCTIVITY_S, IMPEDANCE_OHM_M, RADIUS_M, paper_electrodes, paper_protocol};
use eit_fem::FemError;
use eit_fem::fabric::{
    Fabric, FabricSettings, Finger, Interpolation, Key, Simulation, SimulationSettings, Tip,
    TouchScript,
};
use eit_mesh::{Mesh, MeshSettings, Raster, SkinShape, generate};

pub fn skin(shape: &SkinShape, edge_m: f64) -> Mesh {
    generate(shape, &paper_electrodes(), &MeshSettings::with_edge(edge_m)).unwrap()
}

pub fn disc(edge_m: f64) -> Mesh {
    skin(&SkinShape::Disc { radius_m: RADIUS_M }, edge_m)
}

pub fn dome(edge_m: f64) -> Mesh {
    skin(&SkinShape::Hemisphere { radius_m: RADIUS_M }, edge_m)
}

pub fn try_fabric(mesh: &Mesh, settings: &FabricSettings) -> Result<Fabric, FemError> {
    Fabric::new(mesh, &paper_protocol(), CONDUCTIVITY_S, &[IMPEDANCE_OHM_M; 16], settings)
}

/// The fabric's defaults but for a change.
pub fn fabric(mesh: &Mesh, change: impl FnOnce(&mut FabricSettings)) -> Fabric {
    try_fabric(mesh, &changed(FabricSettings::default(), change)).unwrap()
}

pub fn changed<T>(mut settings: T, change: impl FnOnce(&mut T)) -> T {
    change(&mut settings);
    settings
}

/// A fingertip of 10 mm at a time, seconds, and a place, pressing with a force, newtons.
pub fn key(time_s: f64, position_m: [f64; 2], force_n: f64) -> Key {
    Key { time_s, position_m, force_n, radius_m: 0.01 }
}

pub fn finger(id: u32, tip: Tip, keys: Vec<Key>) -> Finger {
    Finger { id, tip, interpolation: Interpolation::Linear, keys }
}

/// Ten frames per second.
pub fn script(frames: usize, quiet_frames: usize, fingers: Vec<Finger>) -> TouchScript {
    TouchScript { name: String::new(), frame_rate_hz: 10.0, frames, quiet_frames, fingers }
}

pub fn try_simulate(
    mesh: &Mesh,
    fabric: &Fabric,
    script: &TouchScript,
    pixels: usize,
) -> Result<Simulation, FemError> {
    let how = SimulationSettings { keep_elements: true, ..Default::default() };
    fabric.simulate(script, &Raster::new(mesh.surface(), pixels).unwrap(), &how, &mut |_| {})
}
