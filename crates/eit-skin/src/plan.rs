//! `eit plan`: what a scene needs, what is left out and why.

mod electrodes;
pub mod expected;
pub mod left_out;
pub mod machine;
pub mod measured;
mod method_words;
mod net;
mod reactive;
pub mod sequence;
pub mod stages;
mod voltage_error;

use crate::error::SkinError;
use crate::method::{self, MethodChoice};
use crate::pipeline::{self, Setup};
use crate::progress::Progress;
use crate::scene::Scene;
use eit_fem::SolvePath;
use expected::Expected;
use machine::Machine;
use sequence::Sequence;
use serde_json::{Value, json};
use stages::Stage;
use voltage_error::VoltageError;

/// A plan, for people and for programs.
pub struct Plan {
    /// Lines of text.
    pub text: String,
    /// One object.
    pub json: Value,
}

/// Builds what sizes need (mesh and symbolic factorisation), predicts the rest.
pub fn plan(
    scene: Scene,
    method: Option<&str>,
    progress: &mut Progress,
) -> Result<Plan, SkinError> {
    if scene.is_reactive() {
        return reactive::plan(&scene, method, progress);
    }
    method::choose(&scene, method, None)?;
    let setup = pipeline::setup(&scene, None, None, progress)?;
    // an instrument alone is watched as it measures
    let scene_is_live = scene.instrument.is_some() && scene.recording.file.is_none();
    let mut recording = sequence::read(&scene, &setup, progress);
    let frames = recording.as_ref().map(|frames| frames.values.nrows());
    let (voltages, path) = progress.stage("voltages", || untouched(&scene, &setup))?;
    let scene = measured::in_time(scene, &setup, (frames, scene_is_live), &voltages)?;
    let choice = method::choose(&scene, method, frames)?;
    let sequence = Sequence::of(&scene, &setup, choice.method, recording.as_mut(), progress);
    let machine = progress.stage("this machine", || Ok::<_, SkinError>(Machine::measure()))?;
    let images = (choice.method, frames);
    let expected = Expected::of(&scene, &setup, images, &voltages, &machine)?;
    let planned = (choice.method, sequence);
    let mut stages = stages::of(&scene, &setup, planned, (&machine, expected.row.as_ref()));
    stages.extend(stages::linearisation(&setup, path, &machine));
    let of_net = (setup.protocol.measurements(), stages::skin_share(&setup));
    stages.extend(net::of(&scene, crate::denoise::of_scene(&scene)?.as_ref(), of_net));
    let left_out = left_out::of(&scene, &setup, choice.method, sequence);
    let words = method_words::of(&scene, choice.method, sequence);
    let error =
        progress.stage("error of the mesh", || VoltageError::of(&scene, &setup, &voltages))?;
    let json = json!({
        "scene": scene.name,
        "method": choice.method.name(),
        "method_because": choice.why,
        "method_notes": words,
        "mesh_notes": setup.notes,
        "frames": frames,
        "still": matches!(sequence, Sequence::Still(_)),
        "stages": stages.iter().map(stage_json).collect::<Vec<_>>(),
        "left_out": left_out.iter().map(|(what, why)| json!({"what": what, "why": why}))
            .collect::<Vec<_>>(),
        "expected_voltage_error": error.of_mesh,
        "voltage_error": error.json(),
        "expected_images": expected.json(),
        "machine": machine,
        "built": progress.times(),
    });
    let parts = (&stages[..], &left_out, &words[..]);
    let text = text(&scene.name, &choice, parts, (&error, &expected, &machine));
    Ok(Plan { text, json })
}

/// What a stage leaves out, and why.
type LeftOut = Vec<(&'static str, String)>;

fn text(
    name: &str,
    choice: &MethodChoice,
    (stages, left_out, words): (&[Stage], &LeftOut, &[String]),
    (error, expected, machine): (&VoltageError, &Expected, &Machine),
) -> String {
    let mut lines = vec![
        format!("method {}: {}", choice.method.name(), choice.why),
        format!("{name}: what is done"),
    ];
    lines.extend(stages.iter().flat_map(stage_lines));
    lines.push(format!("times on this machine: {}", machine.words()));
    lines.extend(error.words());
    lines.extend(expected.words());
    if !words.is_empty() {
        lines.push("how the method works on this scene".to_owned());
        lines.extend(words.iter().map(|line| format!("  {line}")));
    }
    lines.push("left out".to_owned());
    lines.extend(left_out.iter().map(|(what, why)| format!("  {what:<22} {why}")));
    lines.join("\n")
}

/// What is done, and why.
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

/// Voltages of the untouched skin on this mesh, and the path of their solve.
fn untouched(scene: &Scene, setup: &Setup) -> Result<(Vec<f64>, SolvePath), SkinError> {
    let background = vec![scene.skin.conductivity_s; setup.model.elements()];
    let mut workspace = setup.model.workspace()?;
    let mut solution = setup.solve(&background, &mut workspace)?;
    Ok((solution.measurements().to_vec(), solution.report().path))
}

fn stage_json(stage: &Stage) -> Value {
    json!({
        "stage": stage.name,
        "size": stage.size,
        "flops": stage.flops,
        "bytes": stage.bytes,
        "expected_time_s": stage.time_s,
        "why": stage.why,
    })
}

/// Three digits and a power of ten.
fn short(value: f64) -> String {
    if value == 0.0 { "-".to_owned() } else { format!("{value:.1e}") }
}
