//! `eit reconstruct`: reconstructs images from a recording. One file because it lists the steps of
//! a single command.

mod gauss_newton;
mod pressures;
mod total_variation;
pub(super) mod touches;

pub(crate) use total_variation::status_text as movie_status_text;

use crate::Answer;
use crate::error::ReportError;
use crate::output::{OutFolder, io, write_npy};
use crate::settings::ReconstructSettings;
use crate::solve::joined;
use eit_fem::{SolvePath, SolveReport};
use eit_picture::{Canvas, FrameLabels, PictureSettings, SkinDrawing, draw_sheet, write_gif};
use eit_skin::denoise::Net;
use eit_skin::method;
use eit_skin::scene::{DifferenceKind, Reference};
use eit_skin::text::counted;
use eit_skin::{
    FittedFrames, ImageSolver, MeshOverride, Pressures, Progress, Reconstruction, Scene, Skin,
};
use ndarray::ArrayView3;
use serde_json::{Value, json};

/// Frames per second of a movie whose rate is unknown.
const MOVIE_RATE_HZ: f64 = 10.0;
/// Least colour range of frames without touch, in conductivity changes of the faintest one: noise stays pale.
const RANGE_IN_LEVELS: f64 = 2.0;

/// What a method says about its images.
struct Made {
    /// Footnote of the pictures.
    footnote: String,
    /// Plot of the choice of hyperparameter or weights, if there was one.
    curve: Option<Canvas>,
    /// Part of `report.json` for the method.
    report: Value,
    /// Part of the text for the method.
    lines: Vec<String>,
    /// Notes for the user.
    notes: Vec<String>,
}

/// Notes for the user.
struct Remarks {
    notes: Vec<String>,
    /// Number of notes, from the first, that were shown during the work; the text does not repeat them.
    shown: usize,
}

impl Remarks {
    /// Those of mesh and frames, then those of the method.
    fn new(done: &Reconstruction, made: &Made) -> Self {
        let FittedFrames { skin, frames, fit, .. } = &done.fitted;
        // those of the mesh were shown when it was built
        let mut notes: Vec<String> =
            skin.skin.notes.iter().map(|note| format!("mesh: {note}")).collect();
        let of_frames = notes.len();
        notes.extend(frames.notes.iter().cloned());
        let shown = if fit.is_alike() { of_frames } else { notes.len() };
        notes.extend(done.touches.as_ref().and_then(|_| frames.rate_note()));
        notes.extend(skin.warning.clone());
        notes.extend(made.notes.clone());
        Self { notes, shown }
    }
}

/// Reads frames, reconstructs images, and writes pictures and a report.
///
/// # Errors
///
/// Invalid input, with its place; failure of a method; a folder that cannot be written to.
pub fn run(args: &ReconstructSettings, progress: &mut Progress) -> Result<Answer, ReportError> {
    let scene = Scene::load(&args.scene)?;
    scene.check_stages()?;
    // reject an unknown method before doing any work
    method::choose(&scene.stage_settings(), args.method.as_deref(), None)?;
    // those of a simulation are the truth
    if args.out.join("truth_conductivity.npy").exists() {
        return Err(ReportError::input(format!(
            "{}: this folder holds a simulation, whose touches.csv and report.json would be replaced; give another one \
             with --out",
            args.out.display()
        )));
    }
    let mut out = OutFolder::new(&args.out)?;
    let skin = Skin::set_up(&scene, &MeshOverride::default(), progress)?;
    let reference = args.reference.clone().map(Reference::Text);
    let frames =
        progress.stage("read frames", || skin.read_frames(&args.frames, reference.as_ref()))?;
    let mut done = skin.reconstruct(frames, args.method.as_deref(), progress)?;
    let mut made = make(&done)?;
    if done.net.is_some() {
        out.write("raw.npy", |w| write_npy(&done.images.values, w))?;
        denoise(&mut done, &mut made, progress)?;
    }
    let mut remarks = Remarks::new(&done, &made);
    let pressures = done.pressures()?;
    let found = done.touches.as_ref();
    remarks.notes.extend(found.and(pressures.as_ref()).map(pressures::note));
    write_images(&done, &made, pressures.as_ref(), &mut out, progress)?;
    let mut report = report(&done, &made, &remarks, progress);
    report["pressure"] = json!(pressures.as_ref().map(pressures::json));
    report["touches"] = touches::touches_json(found);
    let json = with_files(report, &out);
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let line = touches::line(found);
    let text = format!("{line}\n{}", text(&done, &made, &remarks, &out));
    let own = ["movie.gif", "hyperparameter.png", "touches.csv", "raw.npy"];
    out.commit(&[&own[..], &pressures::FILES[..]].concat())?;
    Ok(Answer { text, json })
}

/// Writes the images, touches, pressures and pictures.
fn write_images(
    done: &Reconstruction,
    made: &Made,
    pressures: Option<&Pressures>,
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<(), ReportError> {
    let FittedFrames { skin, frames, .. } = &done.fitted;
    let (skin, images, found) = (&skin.skin, &done.images, done.touches.as_ref());
    out.write("images.npy", |w| write_npy(&images.values, w))?;
    let drawing = SkinDrawing::from_raster(&skin.mesh, &images.raster);
    let mut settings = picture_settings(&skin.name, made.footnote.clone(), frames.rate_hz);
    if let Some(found) = found {
        out.write("touches.csv", |w| touches::write_csv(found, w))?;
        settings.marks_m = found.marks(frames.values.nrows());
        if let Some(pressures) = pressures {
            pressures::write(out, pressures, found, &drawing, &settings, frames.rate_hz)?;
        }
    }
    let untouched = found.filter(|found| found.count() == 0);
    let least_s = untouched.map_or(0.0, |found| RANGE_IN_LEVELS * found.level_s);
    let range = (frames.rate_hz, least_s);
    write_pictures(out, images.values.view(), &drawing, &settings, range, progress)?;
    match &made.curve {
        Some(curve) => out.write("hyperparameter.png", |w| Ok(curve.write_png(w)?)),
        None => Ok(()),
    }
}

/// Applies the network to the images; those that do not explain their measurements stay raw.
fn denoise(
    done: &mut Reconstruction,
    made: &mut Made,
    progress: &mut Progress,
) -> Result<(), ReportError> {
    let checked = done.denoise(progress)?;
    made.footnote += ", U-net";
    made.lines.extend(done.net.as_ref().map(Net::description));
    made.report["denoise"] = json!(done.net.as_ref().map(Net::json));
    match checked {
        Some(checked) => {
            made.lines.push(checked.description());
            made.report["denoise"]["check"] = json!(checked);
        }
        None => made.notes.push(
            "these weights contain no misfit limit: denoised images are not checked against the \
             measurements"
                .to_owned(),
        ),
    }
    Ok(())
}

/// Describes how the images were made.
fn make(done: &Reconstruction) -> Result<Made, ReportError> {
    let mut made = match &done.images.solver {
        ImageSolver::TotalVariation(movie) => total_variation::make(done, movie)?,
        ImageSolver::GaussNewton { imaging, sequence } => {
            gauss_newton::make(done, imaging, sequence.as_ref())?
        }
    };
    if let Some(without) = &done.images.without {
        made.footnote += ", electrode movement removed";
        made.lines.push(without.line.clone());
        made.notes.extend(without.note.clone());
        let movement_m = done.fitted.skin.skin.settings.reconstruction.electrode_movement_m;
        made.report["electrode_movement_m"] = json!(movement_m);
    }
    Ok(made)
}

/// Returns picture settings with title, footnote and labels.
pub(crate) fn picture_settings(
    name: &str,
    footnote: String,
    rate_hz: Option<f64>,
) -> PictureSettings {
    PictureSettings {
        title: name.to_owned(),
        footnote,
        labels: match rate_hz {
            Some(rate_hz) => FrameLabels::Time { rate_hz },
            None => FrameLabels::Number,
        },
        ..Default::default()
    }
}

/// Colour range of a sequence: all values, unless a few frames are much larger than the rest. In
/// that case it is the largest value of 95 % of the frames, but at least a quarter of the overall
/// maximum, so that noise stays faint; the footnote states what was clipped. The range is never
/// below `least`.
fn common_range(images: ArrayView3<'_, f64>, least: f64) -> Option<[f64; 2]> {
    let finite = |v: &&f64| v.is_finite();
    let mut largest: Vec<f64> = images
        .outer_iter()
        .map(|image| image.iter().filter(finite).fold(0.0_f64, |m, v| m.max(v.abs())))
        .collect();
    largest.sort_by(f64::total_cmp);
    let most = *largest.last()?;
    if most < least {
        return Some([-least, least]);
    }
    let usual = largest[(largest.len() - 1) * 95 / 100];
    let range = usual.max(0.25 * most).max(least);
    (largest.len() >= 20 && range < 0.5 * most).then_some([-range, range])
}

/// Writes `sheet.png`, and `movie.gif` for a sequence of a frame rate, with colours for at least the given value.
///
/// # Errors
///
/// A picture that cannot be encoded or written.
pub(crate) fn write_pictures(
    out: &mut OutFolder,
    images: ArrayView3<'_, f64>,
    skin: &SkinDrawing,
    settings: &PictureSettings,
    (rate_hz, least): (Option<f64>, f64),
    progress: &mut Progress,
) -> Result<(), ReportError> {
    let settings = &PictureSettings { range: common_range(images, least), ..settings.clone() };
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
    done: &Reconstruction,
    made: &Made,
    Remarks { notes, .. }: &Remarks,
    progress: &Progress,
) -> Value {
    let FittedFrames { skin: linearised, frames, fit, .. } = &done.fitted;
    let skin = &linearised.skin;
    let report = json!({
        "scene": skin.name,
        "method": done.choice.method.name(),
        "method_because": done.choice.why,
        "frames": frames.values.nrows(),
        "measurements": skin.protocol.measurements(),
        "measurements_used": frames.used.iter().filter(|used| **used).count(),
        "reference": frames.reference_source,
        "reciprocity_error": frames.reciprocity_error,
        "model_gain": fit.gain,
        "model_correlation": fit.correlation,
        "mesh": {
            "nodes": skin.mesh.surface().nodes().len(),
            "elements": skin.model.elements(),
        },
        "solve": solve_json(&linearised.report),
        "difference": kind_text(linearised.difference_kind()),
        "pixels": done.images.raster.pixels(),
        "extent_m": done.images.raster.extent_m(),
        "unit": "S",
        "notes": notes,
        "stages": progress.times(),
    });
    joined(report, made.report.clone())
}

/// Name of the difference, as in the scene file.
fn kind_text(kind: DifferenceKind) -> &'static str {
    match kind {
        DifferenceKind::Plain => "plain",
        DifferenceKind::Normalised => "normalised",
    }
}

/// Adds the folder and the names of its files, with that of the report itself.
pub(crate) fn with_files(mut report: Value, out: &OutFolder) -> Value {
    let mut files = out.names();
    files.push("report.json");
    report["out"] = json!(out.path().display().to_string());
    report["files"] = json!(files);
    report
}

fn text(done: &Reconstruction, made: &Made, remarks: &Remarks, out: &OutFolder) -> String {
    let Remarks { notes, shown } = remarks;
    let FittedFrames { frames, fit, .. } = &done.fitted;
    let mut lines = vec![format!(
        "{} of {} measurements against {}",
        counted(frames.values.nrows(), "frame", "frames"),
        frames.used.iter().filter(|used| **used).count(),
        frames.reference_source
    )];
    if let Some(error) = frames.reciprocity_error {
        lines.push(format!("reciprocity error {:.1} %", 100.0 * error));
    }
    lines.push(format!(
        "homogeneous model explains the reference with correlation {:.4}, gain {:.3}",
        fit.correlation, fit.gain
    ));
    lines.push(format!("method {} ({})", done.choice.method.name(), done.choice.why));
    lines.extend(made.lines.iter().cloned());
    lines.extend(notes.iter().skip(*shown).map(|n| format!("note: {n}")));
    lines.push(format!("written to {}: {}", out.path().display(), out.names().join(", ")));
    lines.join("\n")
}

/// Returns the JSON report of a forward solve.
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

#[cfg(test)]
mod tests {
    use super::common_range;
    use ndarray::Array3;

    #[test]
    fn noise_does_not_fill_the_colours() {
        let noise = Array3::from_elem((3, 2, 2), 1e-9);
        assert_eq!(common_range(noise.view(), 2e-8), Some([-2e-8, 2e-8]));
        let touched = Array3::from_elem((3, 2, 2), 1e-7);
        assert_eq!(common_range(touched.view(), 2e-8), None);
    }
}
