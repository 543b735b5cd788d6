//! What a skin needs, what is omitted and why, and what it costs.
//!
//! Builds what is needed for sizes (mesh and symbolic factorisation), and predicts the rest from measured
//! rates and the table of measured solvers ([`measured`]).

mod electrodes;
mod expected;
mod images;
pub mod left_out;
pub mod machine;
pub mod measured;
mod method_notes;
mod net;
mod rates;
#[cfg(feature = "complex")]
mod reactive;
pub mod sequence;
mod sizes;
mod stage;
mod stages;
mod touches;
mod voltage_error;

#[cfg(feature = "complex")]
pub use reactive::of_reactive;
use stage::Stage;

use crate::error::SkinError;
use crate::method::{self, MethodChoice};
use crate::progress::{Progress, StageTime};
use crate::skin::Skin;
use crate::twins;
use crate::weave::Weave;
use eit_fem::SolvePath;
use expected::Expected;
use left_out::LeftOut;
use machine::Machine;
use sequence::Sequence;
use serde_json::{Value, json};
use voltage_error::VoltageError;

/// A plan as text and as JSON.
#[derive(Debug, Clone)]
pub struct PlanText {
    /// Text for people.
    pub text: String,
    /// One JSON object for programs.
    pub json: Value,
}

/// What a skin needs, what is omitted and why.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Plan {
    /// Name of the skin.
    name: String,
    /// Method, and why it was chosen.
    choice: MethodChoice,
    /// Number of frames that the plan is for; `None` without a readable recording.
    frames: Option<usize>,
    /// How the method treats the frames.
    sequence: Sequence,
    /// Work to do, in order.
    stages: Vec<Stage>,
    /// Work that is omitted.
    left_out: Vec<LeftOut>,
    /// Notes on how the method works on this skin.
    method_notes: Vec<String>,
    /// Weave that the scene states or the reference frame shows.
    weave: Option<Weave>,
    /// Share of the skin whose touches the protocol cannot tell from touches elsewhere.
    twins: f64,
    error: VoltageError,
    expected: Expected,
    machine: Machine,
    mesh_notes: Vec<String>,
    built: Vec<StageTime>,
}

impl Plan {
    /// Plans for a skin with a given method, or with the one that its settings imply.
    ///
    /// # Errors
    ///
    /// An unknown method; a skin that cannot be solved; weights that cannot be read.
    pub fn of(
        mut skin: Skin,
        method: Option<&str>,
        progress: &mut Progress,
    ) -> Result<Self, SkinError> {
        method::choose(&skin.settings, method, None)?;
        // without recorded files, an instrument is processed live
        let is_live = skin.instrument.is_some() && skin.settings.recording.file.is_none();
        let recording = sequence::read(&skin, progress);
        let frames = recording.as_ref().map(|frames| frames.values.nrows());
        let weave = match &recording {
            Some(frames) => {
                progress.stage("weave", || skin.find_weave(&frames.reference, &frames.used))?
            }
            None => None,
        };
        if let Some(found) = &weave {
            skin = skin.with_weave(found.weave)?;
        }
        // a reference that is yet to be taken shows the noise
        let has_quiet = recording.as_ref().map(|frames| frames.quiet.is_some());
        let (voltages, path) = progress.stage("voltages", || untouched(&skin))?;
        skin.settings.reconstruction = measured::in_frame_time(&skin, frames, is_live, &voltages)?;
        let choice = method::choose(&skin.settings, method, frames)?;
        let sequence = Sequence::of(&skin, choice.method, recording, progress);
        let machine = progress.stage("this machine", || Ok::<_, SkinError>(Machine::measure()))?;
        let expected = Expected::of(&skin, choice.method, frames, &voltages, &machine)?;
        let row = expected.row.as_ref();
        let mut stages = stages::of(&skin, choice.method, sequence, &machine, row);
        stages.extend(stages::linearisation(&skin, path, &machine));
        stages.extend(net::of(&skin)?);
        let noise_is_known = skin.settings.noise.additive_v.is_some() || has_quiet != Some(false);
        if noise_is_known {
            stages.extend(touches::of(&skin, &machine));
        }
        let error = progress.stage("error of the mesh", || VoltageError::of(&skin, &voltages))?;
        let twins = progress.stage("places that are alike", || skin.twins())?.share();
        Ok(Self {
            name: skin.name.clone(),
            left_out: left_out::of(&skin, choice.method, sequence, noise_is_known),
            method_notes: {
                let mut notes = method_notes::of(&skin, choice.method, sequence);
                notes.extend(weave.map(|found| found.description()));
                notes
            },
            weave: skin.weave,
            twins,
            choice,
            frames,
            sequence,
            stages,
            error,
            expected,
            machine,
            mesh_notes: skin.notes.clone(),
            built: progress.times().to_vec(),
        })
    }

    /// Returns the plan as `eit plan --json` prints it.
    pub fn json(&self) -> Value {
        json!({
            "scene": self.name,
            "method": self.choice.method.name(),
            "method_because": self.choice.why,
            "method_notes": self.method_notes,
            "mesh_notes": self.mesh_notes,
            "weave": self.weave,
            "twins": self.twins,
            "frames": self.frames,
            "still": matches!(self.sequence, Sequence::Still(_)),
            "stages": self.stages,
            "left_out": self.left_out,
            "expected_voltage_error": self.error.of_mesh,
            "voltage_error": self.error,
            "expected_images": self.expected,
            "machine": self.machine,
            "built": self.built,
        })
    }

    /// Returns the plan as `eit plan` prints it.
    pub fn text(&self) -> String {
        let mut lines = vec![
            format!("method {}: {}", self.choice.method.name(), self.choice.why),
            format!("{}: what is done", self.name),
        ];
        lines.extend(self.stages.iter().flat_map(stage_lines));
        lines.push(format!("times on this machine: {}", self.machine.description()));
        lines.extend(self.error.description());
        lines.extend(self.expected.description());
        if !self.method_notes.is_empty() {
            lines.push("how the method works on this scene".to_owned());
            lines.extend(self.method_notes.iter().map(|line| format!("  {line}")));
        }
        lines.push("left out".to_owned());
        lines.extend(self.left_out.iter().map(LeftOut::line));
        lines.extend(twins::finding(self.twins).map(|finding| format!("warning: {finding}")));
        lines.join("\n")
    }
}

/// A stage and the reason for it.
fn stage_lines(s: &Stage) -> [String; 2] {
    [
        format!(
            "  {:<22} {:<44} {:>9} flop {:>9} B {:>9} s",
            s.name,
            s.size,
            short(s.flops),
            short(s.bytes),
            short(s.time_s)
        ),
        format!("  {:<22} {}", "", s.why),
    ]
}

/// Voltages of the untouched skin on this mesh, and how they were solved.
fn untouched(skin: &Skin) -> Result<(Vec<f64>, SolvePath), SkinError> {
    let background = skin.background_s();
    let mut workspace = skin.model.workspace()?;
    let mut solution = skin.solve(&background, &mut workspace)?;
    Ok((solution.measurements().to_vec(), solution.report().path))
}

/// Two digits and a power of ten.
fn short(value: f64) -> String {
    if value == 0.0 { "-".to_owned() } else { format!("{value:.1e}") }
}
