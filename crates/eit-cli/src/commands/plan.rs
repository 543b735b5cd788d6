//! `eit plan`: what a scene needs, what is left out and why.

pub(super) mod left_out;
mod method_words;
mod net;
mod sequence;
mod stages;

use super::Answer;
use crate::cli::PlanArgs;
use crate::error::CliError;
use crate::method::{self, MethodChoice};
use crate::pipeline::{self, Setup};
use crate::progress::Progress;
use crate::scene::{OneOrMany, Scene, Shape};
use eit_fem::analytic::DiscSeries;
use eit_mesh::Placement;
pub(super) use sequence::Sequence;
use serde_json::{Value, json};
use stages::Stage;

/// The mesh-free series costs `electrodes^2` sums of Bessel products: 0.1 s for 16, 0.5 s for 32.
const MOST_SERIES_ELECTRODES: usize = 32;

/// Builds what sizes need (mesh and symbolic factorisation), predicts the rest.
pub(crate) fn run(args: &PlanArgs) -> Result<Answer, CliError> {
    if args.print_scene {
        let text = Scene::text(&args.scene)?;
        let json = json!({ "scene": text });
        return Ok(Answer { text: text.trim_end().to_owned(), json });
    }
    let scene = Scene::load(&args.scene)?;
    method::choose(&scene, args.method.as_deref(), None)?;
    let mut progress = Progress::default();
    let setup = pipeline::setup(&scene, None, None, &mut progress)?;
    let mut recording = sequence::read(&scene, &setup, &mut progress);
    let frames = recording.as_ref().map(|frames| frames.values.nrows());
    let choice = method::choose(&scene, args.method.as_deref(), frames)?;
    let sequence = Sequence::of(&scene, &setup, choice.method, recording.as_mut(), &mut progress);
    let mut stages = stages::of(&scene, &setup, choice.method, sequence);
    let of_net = (setup.protocol.measurements(), stages::skin_share(&setup));
    stages.extend(net::of(&scene, crate::denoise::of_scene(&scene)?.as_ref(), of_net));
    let left_out = left_out::of(&scene, &setup, choice.method, sequence);
    let words = method_words::of(&scene, choice.method, sequence);
    let voltage_error = progress.stage("mesh-free comparison", || voltage_error(&scene, &setup))?;
    let json = json!({
        "scene": scene.name,
        "method": choice.method.name(),
        "method_because": choice.why,
        "method_notes": words,
        "frames": frames,
        "still": matches!(sequence, Sequence::Still(_)),
        "stages": stages.iter().map(stage_json).collect::<Vec<_>>(),
        "left_out": left_out.iter().map(|(what, why)| json!({"what": what, "why": why}))
            .collect::<Vec<_>>(),
        "expected_voltage_error": voltage_error,
        "built": progress.times(),
    });
    let text = text(&scene.name, &choice, (&stages, &left_out, &words), voltage_error);
    Ok(Answer { text, json })
}

/// What a stage leaves out, and why.
type LeftOut = Vec<(&'static str, String)>;

fn text(
    name: &str,
    choice: &MethodChoice,
    (stages, left_out, words): (&[Stage], &LeftOut, &[String]),
    voltage_error: Option<f64>,
) -> String {
    let mut lines = vec![
        format!("method {}: {}", choice.method.name(), choice.why),
        format!("{name}: what is done"),
    ];
    for s in stages {
        lines.push(format!(
            "  {:<22} {:<44} {:>9} flop {:>9} B {:>9} s",
            s.name,
            s.size,
            short(s.flops),
            short(s.bytes),
            short(s.time_s)
        ));
        lines.push(format!("  {:<22} {}", "", s.why));
    }
    lines.push(match voltage_error {
        Some(error) => format!(
            "expected error of the voltages on this mesh: {error:.1e} of the largest (homogeneous \
             skin, against the mesh-free series)"
        ),
        None => {
            "expected error of the voltages: not computed (the mesh-free series is for discs of \
                 at most 32 equal electrodes); compare with a finer [mesh]"
                .to_owned()
        }
    });
    if !words.is_empty() {
        lines.push("how the method works on this scene".to_owned());
        lines.extend(words.iter().map(|line| format!("  {line}")));
    }
    lines.push("left out".to_owned());
    lines.extend(left_out.iter().map(|(what, why)| format!("  {what:<22} {why}")));
    lines.join("\n")
}

/// Error of this mesh on the homogeneous disc, relative to the largest voltage.
fn voltage_error(scene: &Scene, setup: &Setup) -> Result<Option<f64>, CliError> {
    if scene.skin.shape == Shape::Mesh || setup.protocol.electrodes() > MOST_SERIES_ELECTRODES {
        return Ok(None);
    }
    let electrodes = scene.rim_electrodes()?;
    let (Some(radius_m), Placement::EquallySpaced { count, first_angle_deg, direction }) =
        (scene.skin.radius_m.filter(|_| scene.skin.shape == Shape::Disc), &electrodes.placement)
    else {
        return Ok(None);
    };
    let Some(OneOrMany::One(contact_impedance_ohm_m)) = scene.electrodes.contact_impedance_ohm_m
    else {
        return Ok(None);
    };
    let turn = match direction {
        eit_mesh::Direction::Counterclockwise => 1.0,
        eit_mesh::Direction::Clockwise => -1.0,
    };
    let step = turn * std::f64::consts::TAU / *count as f64;
    let series = DiscSeries {
        radius_m,
        conductivity_s: scene.skin.conductivity_s,
        electrode_angles_rad: (0..*count)
            .map(|l| first_angle_deg.to_radians() + step * l as f64)
            .collect(),
        electrode_width_m: electrodes.width_m,
        contact_impedance_ohm_m,
        // the two digits printed do not change from degree 8 to 24 on the paper-disc
        degree: 12,
        harmonics: 2000,
    };
    let exact = series.electrode_potentials(setup.protocol.stimulations_a())?;
    let background = vec![scene.skin.conductivity_s; setup.model.elements()];
    let mut workspace = setup.model.workspace()?;
    let found = setup.model.solve(&background, &mut workspace)?.measurements();
    let patterns = setup.protocol.measurement_patterns();
    let exact = setup
        .protocol
        .data()
        .iter()
        .map(|&[s, m]| exact.row(s as usize).dot(&patterns.row(m as usize)));
    let (mut largest, mut error) = (0.0_f64, 0.0_f64);
    for (exact, found) in exact.zip(&found) {
        largest = largest.max(exact.abs());
        error = error.max((exact - found).abs());
    }
    Ok(Some(error / largest))
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
