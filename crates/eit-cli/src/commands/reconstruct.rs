//! `eit reconstruct`

use super::{Answer, solve_json};
use crate::cli::ReconstructArgs;
use crate::draw;
use crate::error::CliError;
use crate::frames::{self, Frames};
use crate::output::{OutFolder, io, write_npy};
use crate::picture::{FrameLabels, PictureSettings, SkinDrawing, draw_sheet, write_gif};
use crate::pipeline::{self, Imaging, Linearised, Setup};
use crate::progress::Progress;
use crate::scene::{DifferenceKind, Reference, Scene};
use ndarray::Array3;
use serde_json::{Value, json};

/// Frames a second of a movie whose rate is not known.
const MOVIE_RATE_HZ: f64 = 10.0;

/// Reads frames, reconstructs, draws, reports.
pub(crate) fn run(args: &ReconstructArgs) -> Result<Answer, CliError> {
    let scene = Scene::load(&args.scene)?;
    check_method(&scene, args.method.as_deref())?;
    let mut out = OutFolder::new(&args.out)?;
    let mut progress = Progress::default();
    let setup = pipeline::setup(&scene, None, None, &mut progress)?;
    let reference = args.reference.clone().map(Reference::Text);
    let frames = progress.stage("read frames", || {
        frames::load(&scene, &setup.protocol, &args.frames, reference.as_ref())
    })?;
    let linearised = pipeline::linearise(&scene, &setup, &mut progress)?;
    let imaging = pipeline::imaging(&scene, &setup, &linearised, &frames, &mut progress)?;
    let images = imaging.images(&frames, &mut progress)?;

    out.write("images.npy", |w| write_npy(&images, w))?;
    let skin = draw::skin(&setup.mesh, &imaging.raster);
    let settings = picture_settings(&scene, &imaging, frames.rate_hz);
    write_pictures(&mut out, &images, &skin, &settings, frames.rate_hz, &mut progress)?;
    let report = report(&scene, &setup, &linearised, &frames, &imaging, &progress);
    let json = with_files(report, &out);
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    Ok(Answer { text: text(&frames, &imaging, &json, &out), json })
}

/// This version has one method; the scene must not ask for another.
fn check_method(scene: &Scene, method: Option<&str>) -> Result<(), CliError> {
    let (key, method) = match method {
        Some(method) => ("--method", Some(method)),
        None => ("reconstruction.method", scene.reconstruction.method.as_deref()),
    };
    if let Some(other) = method.filter(|m| *m != "gauss-newton") {
        let message =
            format!("{key} = \"{other}\": this version has \"gauss-newton\" (one-step difference)");
        return Err(CliError::input(message));
    }
    let absent = [("denoise", &scene.denoise), ("instrument", &scene.instrument)];
    match absent.iter().find(|(_, section)| section.is_some()) {
        None => Ok(()),
        Some((name, _)) => Err(CliError::input(format!(
            "[{name}] is not in this version: take the section out of the scene"
        ))),
    }
}

/// Title, footnote, labels.
pub(super) fn picture_settings(
    scene: &Scene,
    imaging: &Imaging,
    rate_hz: Option<f64>,
) -> PictureSettings {
    let report = imaging.difference.report();
    let kind = match imaging.kind {
        DifferenceKind::Plain => "plain",
        DifferenceKind::Normalised => "normalised",
    };
    PictureSettings {
        title: scene.name.clone(),
        footnote: format!(
            "one-step Gauss-Newton, {} prior, hyperparameter {:.3e} by {}, {kind} difference",
            report.prior, report.hyperparameter, imaging.rule
        ),
        labels: match rate_hz {
            Some(rate_hz) => FrameLabels::Time { rate_hz },
            None => FrameLabels::Number,
        },
        ..Default::default()
    }
}

/// `sheet.png`, and `movie.gif` where there is a sequence.
pub(super) fn write_pictures(
    out: &mut OutFolder,
    images: &Array3<f64>,
    skin: &SkinDrawing,
    settings: &PictureSettings,
    rate_hz: Option<f64>,
    progress: &mut Progress,
) -> Result<(), CliError> {
    let sheet = progress.stage("sheet", || draw_sheet(images.view(), skin, settings))?;
    out.write("sheet.png", |w| Ok(sheet.write_png(w)?))?;
    let count = images.shape()[0];
    if count > 1 {
        progress.steps("movie", count, |bar| {
            out.write("movie.gif", |w| {
                let rate = rate_hz.unwrap_or(MOVIE_RATE_HZ);
                let mut tick = |done: usize, _: usize| bar.set_position(done as u64);
                Ok(write_gif(images.view(), skin, settings, rate, w, &mut tick)?)
            })
        })?;
    }
    Ok(())
}

/// How well the homogeneous model explains the reference: gain `g` of the best `v = g v0` and the
/// correlation (cosine) of the two.
fn model_fit(model: &[f64], reference: &[f64], used: &[bool]) -> (f64, f64) {
    let (mut mr, mut mm, mut rr) = (0.0, 0.0, 0.0);
    for ((m, r), _) in model.iter().zip(reference).zip(used).filter(|(_, used)| **used) {
        mr += m * r;
        mm += m * m;
        rr += r * r;
    }
    (mr / mm, mr / (mm * rr).sqrt())
}

fn report(
    scene: &Scene,
    setup: &Setup,
    linearised: &Linearised,
    frames: &Frames,
    imaging: &Imaging,
    progress: &Progress,
) -> Value {
    let inverse = imaging.difference.report();
    let (gain, correlation) = model_fit(
        linearised.voltages.as_slice().unwrap_or_default(),
        &frames.reference,
        &frames.used,
    );
    let residuals: Vec<Option<f64>> = frames
        .values
        .rows()
        .into_iter()
        .map(|f| imaging.difference.relative_residual(&f.to_vec(), &frames.reference).ok())
        .collect();
    json!({
        "scene": scene.name,
        "method": "gauss-newton",
        "frames": frames.values.nrows(),
        "measurements": setup.protocol.measurements(),
        "measurements_used": inverse.measurements_used,
        "reference": frames.reference_source,
        "reciprocity_error": frames.reciprocity_error,
        "model_gain": gain,
        "model_correlation": correlation,
        "mesh": {
            "nodes": setup.mesh.surface().nodes().len(),
            "elements": setup.model.elements(),
        },
        "solve": solve_json(&linearised.report),
        "prior": inverse.prior,
        "difference": match imaging.kind {
            DifferenceKind::Plain => "plain",
            DifferenceKind::Normalised => "normalised",
        },
        "hyperparameter": inverse.hyperparameter,
        "hyperparameter_rule": imaging.rule,
        "hyperparameter_status": format!("{:?}", imaging.chosen.status),
        "criterion": imaging.chosen.criterion,
        "degrees_of_freedom": inverse.degrees_of_freedom,
        "rank": inverse.rank,
        "relative_residual": residuals,
        "pixels": imaging.raster.pixels(),
        "extent_m": imaging.raster.extent_m(),
        "unit": "S",
        "notes": frames.notes,
        "stages": progress.times(),
    })
}

fn with_files(mut report: Value, out: &OutFolder) -> Value {
    let mut files = out.written().to_vec();
    files.push("report.json".to_owned());
    report["out"] = json!(out.path());
    report["files"] = json!(files);
    report
}

fn text(frames: &Frames, imaging: &Imaging, json: &Value, out: &OutFolder) -> String {
    let inverse = imaging.difference.report();
    let mut lines = vec![format!(
        "{} frames of {} measurements against {}",
        frames.values.nrows(),
        inverse.measurements_used,
        frames.reference_source
    )];
    if let Some(error) = frames.reciprocity_error {
        lines.push(format!("reciprocity error {:.1} %", 100.0 * error));
    }
    lines.push(format!(
        "homogeneous model explains the reference with correlation {:.4}, gain {:.3}",
        json["model_correlation"].as_f64().unwrap_or(f64::NAN),
        json["model_gain"].as_f64().unwrap_or(f64::NAN)
    ));
    lines.push(format!(
        "hyperparameter {:.3e} by {} ({:?}), {:.1} degrees of freedom",
        inverse.hyperparameter,
        imaging.rule,
        imaging.chosen.status,
        inverse.degrees_of_freedom
    ));
    lines.extend(frames.notes.iter().map(|n| format!("note: {n}")));
    lines.push(format!("written to {}: {}", out.path().display(), out.written().join(", ")));
    lines.join("\n")
}
