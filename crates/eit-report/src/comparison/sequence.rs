//! Simulated sequences of fingers on a linear skin (`eit_fem::fabric::LinearResponse`): soft
//! fingers are Gaussian bells, hard ones are pads with an edge.
//!
//! The simulated fabric solves each frame on a mesh finer than that of the reconstruction; noise of
//! any level and seed is then added to the same voltages. The reference frame is the untouched skin
//! with its own noise. All random numbers come from seeds, so a sequence is always the same bit for
//! bit.

mod settings;
mod touches;
mod voltages;

pub use settings::{FAST_M, Finger, FingerShape, SLOW_M, SequenceSettings};
pub use touches::TouchSequence;
pub use voltages::SequenceVoltages;

use crate::error::ReportError;
use eit_mesh::Raster;
use eit_skin::frames::Frames;
use eit_skin::{Progress, Skin};
use ndarray::Array3;

/// A simulated sequence with its truth.
pub struct SimulatedSequence {
    /// Noisy voltages and their reference.
    pub frames: Frames,
    /// True conductivity change, siemens, [frame, row, column], NaN outside the skin.
    pub truth: Array3<f64>,
    /// True positions of the fingers, metres, `[frame][finger]`; the index of a finger does not
    /// change.
    pub positions_m: Vec<Vec<[f64; 2]>>,
    /// Standard deviation of the noise, volts.
    pub noise_std_v: f64,
    /// Nodes of the simulation mesh.
    pub nodes: usize,
}

/// Simulates a random sequence on its own mesh; the truth is on the reconstruction raster.
///
/// For several noise levels of one sequence, use its steps: [`TouchSequence::random`] and
/// [`TouchSequence::voltages`] once, [`SequenceVoltages::with_noise`] for
/// each level.
///
/// # Errors
/// A skin that is not flat, a frame that cannot be solved.
pub fn simulate(
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
