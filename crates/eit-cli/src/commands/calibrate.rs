//! `eit calibrate`: fits background conductivity and contact impedances to the untouched skin.

use super::Answer;
use crate::cli::CalibrateArgs;
use crate::error::CliError;
use crate::progress;
use eit_inverse::{Calibration, CalibrationSettings, CalibrationStatus, Contacts};
use eit_skin::frames::{Frames, has_driven_electrodes};
use eit_skin::scene::{ElementOrder, Reference, Scene};
use eit_skin::{MeshOverride, Progress, Skin};
use serde_json::{Value, json};

/// Reads the frame of the untouched skin, fits, and reports what to write into the scene.
pub(crate) fn run(args: &CalibrateArgs) -> Result<Answer, CliError> {
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
    let frames =
        progress.stage("read frames", || skin.read_frames(&args.frames, reference.as_ref()))?;
    let mut notes = frames.notes.clone();
    let found = progress.stage("calibrate", || {
        fit(&skin.model, &frames, settings(args, &skin, &frames), &mut notes)
    });
    let found = found.map_err(|error| error.within(&scene.place))?;
    let json = to_json(&skin.name, &frames, &found, &notes, &progress);
    let may_use_driven =
        !scene.reconstruction.use_driven_electrodes && has_driven_electrodes(&skin.protocol);
    Ok(Answer { text: text(&frames, &found, &notes, may_use_driven), json })
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

/// A misfit above this multiple of the stated noise is model error, and then counts as noise.
const MODEL_ERROR: f64 = 2.0;

/// Fits with the stated noise, or with the unexplained part if that is much larger.
fn fit(
    model: &eit_fem::ForwardModel,
    frames: &Frames,
    settings: CalibrationSettings,
    notes: &mut Vec<String>,
) -> Result<Calibration, CliError> {
    let found = Calibration::of_frame(model, &frames.reference, &settings)?;
    let times = found.reduced_chi_square.sqrt();
    if times <= MODEL_ERROR {
        return Ok(found);
    }
    notes.push(format!(
        "the unexplained part is {times:.0} times the stated noise: deviations are based on the former"
    ));
    let settings = CalibrationSettings { noise_std_v: None, ..settings };
    Ok(Calibration::of_frame(model, &frames.reference, &settings)?)
}

fn status(found: &Calibration) -> &'static str {
    match found.status {
        CalibrationStatus::Converged => "converged",
        CalibrationStatus::IterationCap => "iteration cap",
        CalibrationStatus::Stalled => "stalled",
    }
}

/// Electrodes (from 1) whose contacts are determined less by the data than by the prior.
fn undetermined(found: &Calibration) -> Vec<usize> {
    let all = 1..=found.contact_impedance.len();
    let common = found.determined.len() == 2;
    let weak = found.undetermined();
    all.filter(|l| weak.contains(if common { &1 } else { l })).collect()
}

fn text(frames: &Frames, found: &Calibration, notes: &[String], may_use_driven: bool) -> String {
    let std = found.std();
    let contact = |l: usize| std[(1 + l).min(std.len() - 1)];
    let used = frames.used.iter().filter(|used| **used).count();
    let mut lines = vec![
        format!(
            "{}: {used} measurements, {} after {} steps; unexplained {:.2} % of the frame, {:.2} % \
             before",
            frames.reference_source,
            status(found),
            found.iterations,
            100.0 * found.residual_after,
            100.0 * found.residual_before,
        ),
        format!("conductivity {:.4e} S, to {:.2} %", found.conductivity_s, 100.0 * std[0]),
    ];
    for (l, z) in found.contact_impedance.iter().enumerate() {
        // exponential of the standard deviation of a logarithm
        let factor = contact(l).exp();
        lines.push(format!("contact {}: {z:.3e} ohm m, to a factor of {factor:.2}", l + 1));
    }
    let weak = undetermined(found);
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
    let contacts: Vec<String> =
        found.contact_impedance.iter().map(|z| format!("{z:.4e}")).collect();
    lines.push(match found.status {
        CalibrationStatus::IterationCap => {
            "not converged, so not for a scene as they are:".to_owned()
        }
        _ => "for the scene:".to_owned(),
    });
    lines.push(format!("  [skin] conductivity_s = {:.5e}", found.conductivity_s));
    lines.push(format!("  [electrodes] contact_impedance_ohm_m = [{}]", contacts.join(", ")));
    lines.join("\n")
}

fn to_json(
    name: &str,
    frames: &Frames,
    found: &Calibration,
    notes: &[String],
    progress: &Progress,
) -> Value {
    let covariance: Vec<Vec<f64>> =
        found.covariance.rows().into_iter().map(|row| row.to_vec()).collect();
    json!({
        "scene": name,
        "frame": frames.reference_source,
        "measurements_used": frames.used.iter().filter(|used| **used).count(),
        "status": status(found),
        "iterations": found.iterations,
        "forward_solves": found.forward_solves,
        "conductivity_s": found.conductivity_s,
        "contact_impedance_ohm_m": found.contact_impedance,
        "std_of_logarithms": found.std(),
        "covariance_of_logarithms": covariance,
        "determined": found.determined,
        "undetermined_electrodes": undetermined(found),
        "residual_before": found.residual_before,
        "residual_after": found.residual_after,
        "noise_std_v": found.noise_std_v.first(),
        "reduced_chi_square": found.reduced_chi_square,
        "notes": notes,
        "stages": progress.times(),
    })
}
