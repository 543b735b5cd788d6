//! Simulated sequences of fingers on a linear skin (`eit_fem::fabric::LinearResponse`): soft ones are bells,
//! hard ones pads with an edge.
//!
//! The simulated fabric solves each frame on a mesh finer than the one that reconstructs; noise of
//! any level and seed goes onto the same voltages afterwards. The reference frame is the untouched
//! skin with noise of its own. Everything random comes from a seed, so a sequence has the same bytes
//! every time.

mod fabric_frames;
mod sequence;
mod settings;
mod voltages;

pub(crate) use fabric_frames::FabricFrames;
pub(crate) use sequence::TouchSequence;
pub(crate) use settings::{FAST_M, Finger, FingerShape, SLOW_M, SequenceSettings};

use crate::error::ReportError;
use eit_mesh::Raster;
use eit_skin::frames::Frames;
use eit_skin::{Progress, Skin};
use ndarray::Array3;

/// A simulated sequence and its truth.
pub(crate) struct SimulatedSequence {
    /// Voltages with noise and their reference.
    pub frames: Frames,
    /// True conductivity change, siemens, [frame, row, column], NaN outside the skin.
    pub truth: Array3<f64>,
    /// True places of the fingers, metres, `[frame][finger]`; a finger keeps its number.
    pub positions_m: Vec<Vec<[f64; 2]>>,
    /// Standard deviation of the noise, volt.
    pub noise_std_v: f64,
    /// Nodes of the mesh that simulated.
    pub nodes: usize,
}

/// Simulates a random sequence on a mesh of its own; its truth is on the raster of the reconstruction.
///
/// For several noise levels of one sequence take its steps: [`TouchSequence::random`],
/// [`TouchSequence::voltages`] once, [`with_noise`](voltages::SequenceVoltages::with_noise) for each.
pub(crate) fn simulate(
    skin: &Skin,
    settings: &SequenceSettings,
    raster: &Raster,
    progress: &mut Progress,
) -> Result<SimulatedSequence, ReportError> {
    let sequence = TouchSequence::random(&skin.source, settings)?;
    let skin = skin.with_nodes(settings.nodes, progress)?;
    let voltages = sequence.voltages(&skin, progress)?;
    let noise_std_v = voltages.noise_std_v(settings.noise_db);
    Ok(SimulatedSequence {
        frames: voltages.with_noise(noise_std_v, settings.noise_seed)?,
        truth: sequence.truth(skin.conductivity_s, raster),
        noise_std_v,
        nodes: skin.mesh.surface().nodes().len(),
        positions_m: sequence.positions_m(),
    })
}

#[cfg(test)]
mod tests;
