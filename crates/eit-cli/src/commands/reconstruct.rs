//! `eit reconstruct`

use super::{Answer, solve_json};
use crate::cli::ReconstructArgs;
use crate::draw;
use crate::error::CliError;
use crate::frames::{self, Frames, ModelFit};
use crate::output::{OutFolder, io, write_npy};
use crate::picture::{
    Canvas, FrameLabels, PictureSettings, Plot, Series, SkinDrawing, draw_plot, draw_sheet,
    write_gif,
};
use crate::pipeline::{self, Imaging, Linearised, Setup};
use crate::progress::Progress;
use crate::scene::{DifferenceKind, Reference, Scene};
use eit_inverse::{CurvePoint, HyperparameterStatus};
use ndarray::ArrayView3;
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
    let mut frames = progress.stage("read frames", || {
        frames::load(&scene, &setup.protocol, &args.frames, reference.as_ref())
    })?;
    let linearised = pipeline::linearise(&scene, &setup, &mut progress)?;
    let kind = scene.difference_kind(&setup.protocol);
    let model_voltages = linearised.voltages.to_vec();
    let fit = frames.fit_model(&model_voltages, kind, scene.skin.conductivity_s)?;
    let imaging = pipeline::imaging(&scene, &setup, &linearised, &frames, &mut progress)?;
    if let HyperparameterStatus::AtLowerEdge | HyperparameterStatus::AtUpperEdge =
        imaging.chosen.status
    {
        let rule = &imaging.rule;
        frames.notes.push(format!(
            "{rule} found no optimum inside its range ({}): images may be useless; take \
             [reconstruction] hyperparameter = \"noise-figure\" or a number",
            status_words(imaging.chosen.status)
        ));
    }
    frames.notes.extend(linearised.warning.clone());
    let images = imaging.images(&frames, &mut progress)?;

    out.write("images.npy", |w| write_npy(&images.values(), w))?;
    let skin = draw::skin(&setup.mesh, &imaging.raster);
    let settings = picture_settings(&scene, &imaging, frames.rate_hz);
    write_pictures(&mut out, images.values(), &skin, &settings, frames.rate_hz, &mut progress)?;
    if let Some(curve) = curve_picture(&imaging)? {
        out.write("hyperparameter.png", |w| Ok(curve.write_png(w)?))?;
    }
    let report = report(&scene, &setup, &linearised, &frames, (&imaging, fit), &progress)?;
    let json = with_files(report, &out);
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let text = text(&frames, &imaging, &json, &out);
    out.commit(&["movie.gif", "hyperparameter.png"])?;
    Ok(Answer { text, json })
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
            "one-step Gauss-Newton, {} prior, hyperparameter {:.3e} ({}), {kind} difference",
            report.prior, report.hyperparameter, imaging.rule
        ),
        labels: match rate_hz {
            Some(rate_hz) => FrameLabels::Time { rate_hz },
            None => FrameLabels::Number,
        },
        ..Default::default()
    }
}

/// Colour range of a sequence: all values, unless a few frames dwarf the others. Then the largest
/// value of 95 % of the frames, but at least a quarter of the largest of all, so that noise stays
/// pale; the small print tells what was clipped.
fn common_range(images: ArrayView3<'_, f64>) -> Option<[f64; 2]> {
    let finite = |v: &&f64| v.is_finite();
    let mut largest: Vec<f64> = images
        .outer_iter()
        .map(|image| image.iter().filter(finite).fold(0.0_f64, |m, v| m.max(v.abs())))
        .collect();
    largest.sort_by(f64::total_cmp);
    let most = *largest.last()?;
    let usual = largest[(largest.len() - 1) * 95 / 100];
    let range = usual.max(0.25 * most);
    (largest.len() >= 20 && range < 0.5 * most).then_some([-range, range])
}

/// How the choice of the hyperparameter ended.
fn status_words(status: HyperparameterStatus) -> &'static str {
    match status {
        HyperparameterStatus::Given => "given",
        HyperparameterStatus::NoiseFigureReached => "reached",
        HyperparameterStatus::NoiseFigureUnreachable => "not reachable, the nearest is used",
        HyperparameterStatus::Interior => "an extremum inside the range",
        HyperparameterStatus::AtLowerEdge => "at the lower edge: no noise found in the data",
        HyperparameterStatus::AtUpperEdge => "at the upper edge: no signal found in the data",
        _ => "see the documentation of this version",
    }
}

/// The curve that chose the hyperparameter, with the choice marked.
fn curve_picture(imaging: &Imaging) -> Result<Option<Canvas>, CliError> {
    let chosen = &imaging.chosen;
    let l_curve = imaging.rule == "L-curve";
    let at = |p: &CurvePoint| match l_curve {
        true => [p.residual_norm, p.solution_norm],
        false => [p.hyperparameter, p.criterion],
    };
    let nearest = chosen.curve.iter().min_by(|a, b| {
        let distance = |p: &CurvePoint| (p.hyperparameter / chosen.hyperparameter).ln().abs();
        distance(a).total_cmp(&distance(b))
    });
    let Some(nearest) = nearest else { return Ok(None) };
    let curve = chosen.curve.iter().map(at).collect();
    let mark = if l_curve { at(nearest) } else { [chosen.hyperparameter, chosen.criterion] };
    let [x_label, y_label] = match l_curve {
        true => ["weighted residual |Δv - J Δσ|", "image size |Δσ| by the prior"],
        false if imaging.rule.starts_with("noise") => ["hyperparameter λ", "noise figure"],
        false => ["hyperparameter λ", "cross-validation function"],
    };
    let plot = Plot {
        title: format!("Hyperparameter: {}", imaging.rule),
        footnote: format!("λ = {:.3e}: {}", chosen.hyperparameter, status_words(chosen.status)),
        x_label: x_label.to_owned(),
        y_label: y_label.to_owned(),
        x_log: true,
        y_log: true,
        series: vec![
            Series { name: String::new(), points: curve, line: true, markers: false },
            Series { name: "chosen".to_owned(), points: vec![mark], line: false, markers: true },
        ],
        zoom: 2,
    };
    Ok(Some(draw_plot(&plot)?))
}

/// `sheet.png`, and `movie.gif` where there is a sequence.
pub(super) fn write_pictures(
    out: &mut OutFolder,
    images: ArrayView3<'_, f64>,
    skin: &SkinDrawing,
    settings: &PictureSettings,
    rate_hz: Option<f64>,
    progress: &mut Progress,
) -> Result<(), CliError> {
    let settings = &PictureSettings { range: common_range(images), ..settings.clone() };
    let sheet = progress.stage("sheet", || draw_sheet(images, skin, settings))?;
    out.write("sheet.png", |w| Ok(sheet.write_png(w)?))?;
    let count = images.shape()[0];
    if count > 1 {
        progress.steps("movie", count, |bar| {
            out.write("movie.gif", |w| {
                let rate = rate_hz.unwrap_or(MOVIE_RATE_HZ);
                let mut tick = |done: usize, _: usize| bar.set_position(done as u64);
                Ok(write_gif(images, skin, settings, rate, w, &mut tick)?)
            })
        })?;
    }
    Ok(())
}

fn report(
    scene: &Scene,
    setup: &Setup,
    linearised: &Linearised,
    frames: &Frames,
    (imaging, fit): (&Imaging, ModelFit),
    progress: &Progress,
) -> Result<Value, CliError> {
    let inverse = imaging.difference.report();
    Ok(json!({
        "scene": scene.name,
        "method": "gauss-newton",
        "frames": frames.values.nrows(),
        "measurements": setup.protocol.measurements(),
        "measurements_used": inverse.measurements_used,
        "reference": frames.reference_source,
        "reciprocity_error": frames.reciprocity_error,
        "model_gain": fit.gain,
        "model_correlation": fit.correlation,
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
        "hyperparameter_status": status_words(imaging.chosen.status),
        "criterion": imaging.chosen.criterion,
        "degrees_of_freedom": inverse.degrees_of_freedom,
        "rank": inverse.rank,
        "relative_residual": imaging.residuals(frames)?,
        "pixels": imaging.raster.pixels(),
        "extent_m": imaging.raster.extent_m(),
        "unit": "S",
        "notes": frames.notes,
        "stages": progress.times(),
    }))
}

fn with_files(mut report: Value, out: &OutFolder) -> Value {
    let mut files = out.names();
    files.push("report.json");
    report["out"] = json!(out.path().display().to_string());
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
        "hyperparameter {:.3e}, {} ({}), {:.1} degrees of freedom",
        inverse.hyperparameter,
        imaging.rule,
        status_words(imaging.chosen.status),
        inverse.degrees_of_freedom
    ));
    lines.extend(frames.notes.iter().map(|n| format!("note: {n}")));
    lines.push(format!("written to {}: {}", out.path().display(), out.names().join(", ")));
    lines.join("\n")
}
