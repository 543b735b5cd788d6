//! `eit reconstruct`

mod gauss_newton;
mod total_variation;
pub(super) mod touches;

pub use total_variation::status_words as movie_status_words;

use crate::Answer;
use crate::error::ReportError;
use crate::output::{OutFolder, io, write_npy};
use crate::settings::ReconstructSettings;
use eit_fem::{SolvePath, SolveReport};
use eit_mesh::Raster;
use eit_picture::{Canvas, FrameLabels, PictureSettings, SkinDrawing, draw_sheet, write_gif};
use eit_skin::Progress;
use eit_skin::denoise;
use eit_skin::frames::{self, Frames, ModelFit};
use eit_skin::method::{self, Method};
use eit_skin::pipeline::movement::{self, Freed};
use eit_skin::pipeline::{self, Linearised, Setup};
use eit_skin::plan::measured;
use eit_skin::scene::{DifferenceKind, Reference, Scene};
use ndarray::{Array3, ArrayView3};
use serde_json::{Value, json};

/// Frames a second of a movie whose rate is not known.
const MOVIE_RATE_HZ: f64 = 10.0;

/// What a method made of the frames.
struct Made {
    /// Siemens, [frame, row, column], NaN outside the skin.
    images: Array3<f64>,
    raster: Raster,
    /// Small print of the pictures.
    footnote: String,
    /// How hyperparameter or weights were chosen, where there is a curve.
    curve: Option<Canvas>,
    /// The method's part of `report.json`.
    report: Value,
    /// The method's part of the text.
    lines: Vec<String>,
    /// What the user should know.
    notes: Vec<String>,
}

/// A recording ready for a method.
struct Task<'a> {
    scene: &'a Scene,
    method: Method,
    setup: &'a Setup,
    linearised: &'a Linearised,
    frames: &'a Frames,
    fit: ModelFit,
    /// Where electrodes moved: the recording as it came, and what was made of it.
    before: Option<(&'a Task<'a>, &'a Freed)>,
}

/// Reads frames, reconstructs, draws, reports.
pub fn run(args: &ReconstructSettings, progress: &mut Progress) -> Result<Answer, ReportError> {
    let scene = Scene::load(&args.scene)?;
    pipeline::touches::check(&scene)?;
    // an unknown name is refused before anything is made
    method::choose(&scene, args.method.as_deref(), None)?;
    let net = denoise::of_scene(&scene)?;
    let mut out = OutFolder::new(&args.out)?;
    let setup = pipeline::setup(&scene, None, None, progress)?;
    let reference = args.reference.clone().map(Reference::Text);
    let mut frames = progress.stage("read frames", || {
        frames::load(&scene, &setup.protocol, &args.frames, reference.as_ref())
    })?;
    let linearised = pipeline::linearise(&scene, &setup, progress)?;
    let model_voltages = linearised.voltages.to_vec();
    let count = Some(frames.values.nrows());
    let scene = measured::in_time(scene, &setup, (count, false), &model_voltages)?;
    let choice = method::choose(&scene, args.method.as_deref(), count)?;
    let kind = scene.difference_kind(&setup.protocol);
    let fit = frames.fit_model(&model_voltages, kind, scene.skin.conductivity_s)?;
    let method = choice.method;
    let (linearised, setup) = (&linearised, &setup);
    let task =
        Task { scene: &scene, method, setup, linearised, frames: &frames, fit, before: None };
    let mut made = make(&task, progress)?;
    let gain = task.fit.gain;
    if let Some(net) = &net {
        out.write("raw.npy", |w| write_npy(&made.images, w))?;
        let mut check =
            denoise::Check::new(&scene, (setup, linearised, &made.raster), (&frames, gain))?;
        let checked = net.apply(&mut made.images, &made.raster, Some(&mut check), progress)?;
        made.footnote += ", U-net";
        made.lines.push(net.words());
        made.report["denoise"] = net.json();
        match checked {
            Some(checked) => {
                made.lines.push(checked.words());
                made.report["denoise"]["check"] = checked.json();
            }
            None => made.notes.push(
                "these weights know no limit of misfit: denoised images are not checked against \
                 the measurements"
                    .to_owned(),
            ),
        }
    }
    let denoised = net.is_some().then(|| made.images.view());
    let (models, given) = ((setup, linearised), (&frames, gain));
    let found = pipeline::touches::touches(&scene, models, given, denoised, progress)?;
    let mut notes = frames.notes.clone();
    notes.extend(setup.notes.iter().map(|note| format!("mesh: {note}")));
    notes.extend(linearised.warning.clone());
    notes.extend(made.notes.clone());

    out.write("images.npy", |w| write_npy(&made.images, w))?;
    let skin = eit_picture::SkinDrawing::from_raster(&setup.mesh, &made.raster);
    let mut settings = picture_settings(&scene, made.footnote.clone(), frames.rate_hz);
    if let Some(found) = &found {
        out.write("touches.csv", |w| touches::write_csv(&found.rows, w))?;
        settings.marks_m = found.marks(frames.values.nrows());
    }
    write_pictures(&mut out, made.images.view(), &skin, &settings, frames.rate_hz, progress)?;
    if let Some(curve) = &made.curve {
        out.write("hyperparameter.png", |w| Ok(curve.write_png(w)?))?;
    }
    let mut report = report(&task, &made, (choice.why, &notes), progress);
    report["touches"] = touches::touches_json(found.as_ref());
    let json = with_files(report, &out);
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let line = touches::line(found.as_ref());
    let text = format!("{line}\n{}", text(&task, &made, (choice.why, &notes), &out));
    out.commit(&["movie.gif", "hyperparameter.png", "touches.csv", "raw.npy"])?;
    Ok(Answer { text, json })
}

/// Images by the task's method, of data without what moving electrodes explain where the scene says
/// that they move.
fn make(task: &Task<'_>, progress: &mut Progress) -> Result<Made, ReportError> {
    let of_method = |task: &Task<'_>, progress: &mut Progress| match task.method {
        Method::StTv | Method::Tv => total_variation::make(task, progress),
        _ => gauss_newton::make(task, progress),
    };
    let Task { scene, method, .. } = *task;
    let models = (task.setup, task.linearised);
    let given = (task.frames, task.fit.gain);
    let Some(freed) = movement::free(scene, method, models, given, progress)? else {
        return of_method(task, progress);
    };
    let Freed { scene, linearised, frames, .. } = &freed;
    let left = Task { scene, linearised, frames, before: Some((task, &freed)), ..*task };
    let mut made = of_method(&left, progress)?;
    made.footnote += ", movement of electrodes taken out";
    made.lines.push(freed.line.clone());
    made.notes.extend(freed.note.clone());
    made.report["electrode_movement_m"] = json!(task.scene.reconstruction.electrode_movement_m);
    Ok(made)
}

impl Task<'_> {
    /// Plain or normalised, of the recording as it came.
    fn kind(&self) -> DifferenceKind {
        let scene = self.before.map_or(self.scene, |(task, _)| task.scene);
        scene.difference_kind(&self.setup.protocol)
    }
}

/// Title, footnote, labels.
pub(super) fn picture_settings(
    scene: &Scene,
    footnote: String,
    rate_hz: Option<f64>,
) -> PictureSettings {
    PictureSettings {
        title: scene.name.clone(),
        footnote,
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

/// `sheet.png`, and `movie.gif` where there is a sequence.
pub fn write_pictures(
    out: &mut OutFolder,
    images: ArrayView3<'_, f64>,
    skin: &SkinDrawing,
    settings: &PictureSettings,
    rate_hz: Option<f64>,
    progress: &mut Progress,
) -> Result<(), ReportError> {
    let settings = &PictureSettings { range: common_range(images), ..settings.clone() };
    let sheet = progress.stage("sheet", || draw_sheet(images, skin, settings))?;
    out.write("sheet.png", |w| Ok(sheet.write_png(w)?))?;
    let count = images.shape()[0];
    if count > 1 {
        progress.steps("movie", count, |bar| {
            out.write("movie.gif", |w| {
                let rate = rate_hz.unwrap_or(MOVIE_RATE_HZ);
                let mut tick = |done: usize, _: usize| bar.set_position(done);
                Ok(write_gif(images, skin, settings, rate, w, &mut tick)?)
            })
        })?;
    }
    Ok(())
}

fn report(
    task: &Task<'_>,
    made: &Made,
    (why, notes): (&str, &[String]),
    progress: &Progress,
) -> Value {
    let (frames, setup) = (task.frames, task.setup);
    let mut report = json!({
        "scene": task.scene.name,
        "method": task.method.name(),
        "method_because": why,
        "frames": frames.values.nrows(),
        "measurements": setup.protocol.measurements(),
        "measurements_used": frames.used.iter().filter(|used| **used).count(),
        "reference": frames.reference_source,
        "reciprocity_error": frames.reciprocity_error,
        "model_gain": task.fit.gain,
        "model_correlation": task.fit.correlation,
        "mesh": {
            "nodes": setup.mesh.surface().nodes().len(),
            "elements": setup.model.elements(),
        },
        "solve": solve_json(&task.linearised.report),
        "difference": kind_words(task.scene.difference_kind(&setup.protocol)),
        "pixels": made.raster.pixels(),
        "extent_m": made.raster.extent_m(),
        "unit": "S",
        "notes": notes,
        "stages": progress.times(),
    });
    if let (Value::Object(report), Value::Object(of_method)) = (&mut report, &made.report) {
        report.extend(of_method.clone());
    }
    report
}

/// As in the scene file.
fn kind_words(kind: DifferenceKind) -> &'static str {
    match kind {
        DifferenceKind::Plain => "plain",
        DifferenceKind::Normalised => "normalised",
    }
}

fn with_files(mut report: Value, out: &OutFolder) -> Value {
    let mut files = out.names();
    files.push("report.json");
    report["out"] = json!(out.path().display().to_string());
    report["files"] = json!(files);
    report
}

fn text(task: &Task<'_>, made: &Made, (why, notes): (&str, &[String]), out: &OutFolder) -> String {
    let frames = task.frames;
    let count = frames.values.nrows();
    let mut lines = vec![format!(
        "{count} frame{} of {} measurements against {}",
        if count == 1 { "" } else { "s" },
        frames.used.iter().filter(|used| **used).count(),
        frames.reference_source
    )];
    if let Some(error) = frames.reciprocity_error {
        lines.push(format!("reciprocity error {:.1} %", 100.0 * error));
    }
    lines.push(format!(
        "homogeneous model explains the reference with correlation {:.4}, gain {:.3}",
        task.fit.correlation, task.fit.gain
    ));
    lines.push(format!("method {} ({why})", task.method.name()));
    lines.extend(made.lines.iter().cloned());
    lines.extend(notes.iter().map(|n| format!("note: {n}")));
    lines.push(format!("written to {}: {}", out.path().display(), out.names().join(", ")));
    lines.join("\n")
}

/// A forward solve for reports.
pub fn solve_json(report: &SolveReport) -> Value {
    json!({
        "unknowns": report.unknowns,
        "factor_entries": report.factor_entries,
        "field_solves": report.field_solves,
        "path": match report.path {
            SolvePath::NodalAssembly => "nodal-assembly",
            SolvePath::ElectrodesEliminated => "electrodes-eliminated",
            SolvePath::ExtendedPrecision => "extended-precision",
        },
        "backward_error": report.backward_error,
        "error_bound": report.error_bound,
        "expected_loss": report.expected_loss,
        "time_s": report.time_s,
    })
}
