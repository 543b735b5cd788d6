//! A recording of the simulated fabric, in which electrodes move with the fingers, gains differ and
//! the skin drifts: one and two fingers, for which networks are trained.

use super::recording::SimulatedRecording;
use crate::comparison::ReconstructionModel;
use crate::comparison::SimulatedSequence;
use crate::error::ReportError;
use eit_fem::fabric::{FabricSettings, PlayCircle, SimulationSettings, TouchScript};
use eit_mesh::Raster;
use eit_skin::Progress;
use eit_skin::frames::Frames;
use ndarray::{Array2, Axis, Slice};

/// A built-in touch script.
#[derive(Debug, Clone, Copy)]
pub(super) struct FabricScript {
    /// Name in the benchmark.
    pub shape: &'static str,
    /// Name of the built-in script.
    pub script: &'static str,
    pub seed: u64,
}

/// One and two fingers, with seeds not used in training.
pub(super) const FABRIC_SCRIPTS: [FabricScript; 2] = [
    FabricScript { shape: "one", script: "one-finger", seed: 501 },
    FabricScript { shape: "two", script: "two-fingers", seed: 502 },
];

/// Nodes of the simulation mesh.
const NODES: usize = 7000;
/// Number of frames between the quiet ones and the first finger pressing with full force.
const ARRIVAL: usize = 10;

/// Returns the frames of a script from when the fingers press; the quiet frames before serve as
/// reference.
pub(super) fn recording(
    model: &ReconstructionModel,
    script: &FabricScript,
    frames: usize,
    progress: &mut Progress,
) -> Result<SimulatedRecording, ReportError> {
    let FabricScript { shape, script, seed } = *script;
    let skin = model.skin().with_nodes(NODES, progress)?;
    let raster = Raster::new(skin.mesh.surface(), model.raster.pixels())?;
    let mut script = TouchScript::built_in(script, &PlayCircle::of(&skin.mesh), seed)?;
    let quiet = script.quiet_frames;
    let first = quiet + ARRIVAL;
    script.frames = script.frames.min(first + frames);
    let fabric = skin.fabric_with(&FabricSettings::default())?;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let how = SimulationSettings { seed, threads, keep_elements: false };
    let made = progress.steps("simulate", script.frames, |bar| {
        fabric.simulate(&script, &raster, &how, &mut |done| bar.set_position(done))
    })?;
    let touched = Slice::from(first..);
    let values = made.frames_v.slice_axis(Axis(0), touched).to_owned();
    let silent = made.frames_v.slice_axis(Axis(0), Slice::from(..quiet));
    let reference = silent.mean_axis(Axis(0)).unwrap_or_else(|| made.reference_v.clone());
    let change = made.truth.conductivity_change_s.slice_axis(Axis(0), touched);
    let mut positions_m = vec![Vec::new(); values.nrows()];
    for touch in made.truth.touches.iter().filter(|touch| touch.frame >= first) {
        positions_m[touch.frame - first].push(touch.position_m);
    }
    let noise = &made.truth.noise_std_v;
    let noise_std_v = (noise.dot(noise) / noise.len() as f64).sqrt();
    let frames = Frames {
        good: Array2::from_elem(values.raw_dim(), true),
        used: vec![true; reference.len()],
        values,
        reference: reference.to_vec(),
        reference_source: "the quiet frames".to_owned(),
        reference_frames: quiet,
        quiet: None,
        faults: Vec::new(),
        rate_hz: Some(script.frame_rate_hz),
        reciprocity_error: None,
        notes: Vec::new(),
    };
    // the masks of the two meshes may differ by a pixel at the rim
    let truth = change.mapv(|value| if value.is_finite() { value } else { 0.0 });
    let nodes = skin.mesh.surface().nodes().len();
    let pixels = model.pixels_of(truth.view())?;
    let simulated = SimulatedSequence { frames, truth, positions_m, noise_std_v, nodes };
    Ok(SimulatedRecording { shape, simulated, truth: pixels })
}
