//! `eit calibrate`: fits background conductivity and contact impedances to the untouched skin.

use crate::cli::CalibrateArgs;
use crate::commands::prelude::*;
use eit_inverse::{Calibration, CalibrationSettings, CalibrationStatus, Contacts};
use eit_skin::Weave;
use eit_skin::frames::{Frames, has_driven_electrodes};
use eit_skin::scene::{ElementOrder, Reference};

/// Reads the frame of the untouched skin, fits, and reports what to write into the scene.
pub(super) fn run(args: &CalibrateArgs) -> Result<Answer, CliError> {
    let mut scene = Scene::load(&args.scene)?;
    scene.reconstruction.use_driven_electrodes |= args.use_driven_electrodes;
    if scene.mesh.required_accuracy.is_some() {
        // derivatives with respect to contacts are those of linear elements
        scene.mesh.elements.get_or_insert(ElementOrder::Linear);
    }
    let mut progress = progress::terminal();
    let skin = Skin::set_up(&scene, &MeshOverride::default(), &mut progress)?;
    // frames given on the command line are all of the untouched skin
    let mean = || (!args.frames.is_empty()).then(|| "mean".to_owned());
    let reference = args.reference.clone().or_else(mean).map(Reference::Text);
    let mut frames =
        progress.stage("read frames", || skin.read_frames(&args.frames, reference.as_ref()))?;
    let mut notes = frames.notes.clone();
    let model = skin.model.forward(&skin.background_s())?;
    if frames.with_signs_of(&model.to_vec()) {
        notes.push(
            "the values are magnitudes: they have the signs of the model's voltages".to_owned(),
        );
    }
    let weave = progress.stage("weave", || skin.find_weave(&frames.reference, &frames.used))?;
    let skin = match &weave {
        Some(found) => {
            notes.push(found.description());
            skin.with_weave(found.weave)?
        }
        None => skin,
    };
    let found = progress.stage("calibrate", || {
        fit(&skin.model, &frames, settings(args, &skin, &frames), &mut notes)
    });
    let found = found.map_err(|error| error.within(&scene.place))?;
    let may_use_driven =
        !scene.reconstruction.use_driven_electrodes && has_driven_electrodes(&skin.protocol);
    Ok(answer(&skin, &frames, &found, &notes, may_use_driven, &progress))
}

fn settings(args: &CalibrateArgs, skin: &Skin, frames: &Frames) -> CalibrationSettings {
    // the noise of a mean of frames
    let share = (frames.reference_frames.max(1) as f64).sqrt();
    let noise = skin.settings.noise.additive_v.map(|e| vec![e / share; frames.used.len()]);
    CalibrationSettings {
        contacts: if args.one_contact { Contacts::Common } else { Contacts::Each },
        noise_std_v: noise,
        used: Some(frames.used.clone()),
        ..CalibrationSettings::starting_at(skin.conductivity_s, &skin.contact_impedance)
    }
}

/// Fits with the stated noise, or with the unexplained part if that is much larger: model error, which then counts as
/// noise.
fn fit(
    model: &eit_fem::ForwardModel,
    frames: &Frames,
    settings: CalibrationSettings,
    notes: &mut Vec<String>,
) -> Result<Calibration, CliError> {
    let found = Calibration::of_frame(model, &frames.reference, &settings)?;
    let times = found.reduced_chi_square.sqrt();
    if times <= 2.0 {
        return Ok(found);
    }
    notes.push(format!(
        "the unexplained part is {times:.0} times the stated noise: deviations are based on the former"
    ));
    let settings = CalibrationSettings { noise_std_v: None, ..settings };
    Ok(Calibration::of_frame(model, &frames.reference, &settings)?)
}

/// Electrodes (from 1) whose contacts are determined less by the data than by the prior.
fn undetermined(found: &Calibration) -> Vec<usize> {
    let all = 1..=found.contact_impedance.len();
    let common = found.determined.len() == 2;
    let weak = found.undetermined();
    all.filter(|l| weak.contains(if common { &1 } else { l })).collect()
}

fn answer(
    skin: &Skin,
    frames: &Frames,
    found: &Calibration,
    notes: &[String],
    may_use_driven: bool,
    progress: &Progress,
) -> Answer {
    let Calibration { conductivity_s, contact_impedance, iterations, .. } = found;
    let (std, weak) = (found.std(), undetermined(found));
    let used = frames.used.iter().filter(|used| **used).count();
    let status = match found.status {
        CalibrationStatus::Converged => "converged",
        CalibrationStatus::Stalled => "stalled",
        CalibrationStatus::IterationCap => "iteration cap",
    };
    let [before, after] = [found.residual_before, found.residual_after].map(|part| 100.0 * part);
    let mut lines = vec![
        format!(
            "{}: {used} measurements, {status} after {iterations} steps; unexplained {after:.2} % of the frame, \
             {before:.2} % before",
            frames.reference_source
        ),
        format!("conductivity {conductivity_s:.4e} S, to {:.2} %", 100.0 * std[0]),
    ];
    for (number, z) in (1..).zip(contact_impedance) {
        // exponential of the standard deviation of a logarithm
        let factor = std[number.min(std.len() - 1)].exp();
        lines.push(format!("contact {number}: {z:.3e} ohm m, to a factor of {factor:.2}"));
    }
    if !weak.is_empty() {
        let advice = match may_use_driven {
            true => " (measurements on driven electrodes would tell: --use-driven-electrodes)",
            false => "",
        };
        lines.push(format!(
            "the data hardly determine the contacts of electrodes {weak:?}: their values say little{advice}"
        ));
    }
    lines.extend(notes.iter().map(|note| format!("note: {note}")));
    lines.extend(for_scene(skin, found));
    let json = json!({
        "scene": skin.name,
        "weave": skin.weave,
        "frame": frames.reference_source,
        "measurements_used": used,
        "status": status,
        "undetermined_electrodes": weak,
        "std_of_logarithms": std,
        "notes": notes,
        "stages": progress.times(),
    });
    Answer { text: lines.join("\n"), json: joined(json, numbers(found)) }
}

/// What was fitted, as keys of a scene.
fn for_scene(skin: &Skin, found: &Calibration) -> Vec<String> {
    let Calibration { conductivity_s, contact_impedance, .. } = found;
    let heading = match found.status {
        CalibrationStatus::Converged | CalibrationStatus::Stalled => "for the scene:",
        CalibrationStatus::IterationCap => "not converged, so not for a scene as they are:",
    };
    let mut lines =
        vec![heading.to_owned(), format!("  [skin] conductivity_s = {conductivity_s:.5e}")];
    if let Some(Weave { ratio, angle_deg }) = skin.weave {
        lines.push(format!("  [skin] weave_ratio = {ratio:.3}, weave_angle_deg = {angle_deg:.1}"));
    }
    let contacts: Vec<String> = contact_impedance.iter().map(|z| format!("{z:.4e}")).collect();
    lines.push(format!("  [electrodes] contact_impedance_ohm_m = [{}]", contacts.join(", ")));
    lines
}

/// What was fitted, for programs.
fn numbers(found: &Calibration) -> Value {
    let covariance = found.covariance.rows().into_iter().map(|row| row.to_vec());
    json!({
        "iterations": found.iterations,
        "forward_solves": found.forward_solves,
        "conductivity_s": found.conductivity_s,
        "contact_impedance_ohm_m": found.contact_impedance,
        "covariance_of_logarithms": covariance.collect::<Vec<_>>(),
        "determined": found.determined,
        "residual_before": found.residual_before,
        "residual_after": found.residual_after,
        "noise_std_v": found.noise_std_v.first(),
        "reduced_chi_square": found.reduced_chi_square,
    })
}
