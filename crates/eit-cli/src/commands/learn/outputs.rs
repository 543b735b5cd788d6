//! Files written by `eit learn`: what was learnt, and the learning curve.

use super::Found;
use crate::cli::LearnArgs;
use crate::error::CliError;
use eit_picture::{Plot, Series, draw_plot};
use eit_report::output::{OutFile, io};
use eit_skin::learn::{CurvePoint, LearnedSkin};
use eit_skin::scene::{Reference, Scene};
use std::path::{Path, PathBuf};

/// Files that are reserved before any work.
pub(super) struct Outputs {
    learned: OutFile,
    csv: OutFile,
    png: OutFile,
}

/// File name of the curve: skin.curve.csv for skin.learned.
pub(super) fn beside(out: &Path, ending: &str) -> PathBuf {
    out.with_extension(format!("curve.{ending}"))
}

impl Outputs {
    /// Rejects outputs that are also inputs, and folders that cannot be written to.
    pub fn new(args: &LearnArgs, scene: &Scene) -> Result<Self, CliError> {
        let outs = [args.out.clone(), beside(&args.out, "csv"), beside(&args.out, "png")];
        for (what, input) in inputs(args, scene) {
            if let Some(out) = outs.iter().find(|out| is_same(out, &input)) {
                let (out, input) = (out.display(), input.display());
                let message = format!(
                    "{out}: --out would overwrite {what} {input}: name another file with --out"
                );
                return Err(CliError::input(message));
            }
        }
        let [learned, csv, png] = outs.each_ref().map(OutFile::new);
        Ok(Self { learned: learned?, csv: csv?, png: png? })
    }

    /// Writes what was learnt; a curve without points gets no picture.
    pub fn write(self, found: &Found) -> Result<(), CliError> {
        let learned = &found.learning.skin;
        let bytes = learned.to_bytes()?;
        self.learned.write(|w| w.write_all(&bytes).map_err(io))?;
        write_csv(self.csv, &found.curve)?;
        match found.curve.is_empty() {
            true => Ok(()),
            false => write_png(self.png, learned, &found.curve),
        }
    }
}

/// Input files, with their roles.
fn inputs(args: &LearnArgs, scene: &Scene) -> Vec<(&'static str, PathBuf)> {
    let named = |what: &'static str, file: &Path| (what, file.to_path_buf());
    let frames = match args.frames.is_empty() {
        false => args.frames.clone(),
        true => {
            let files = scene.recording.files().into_iter().flatten();
            files.map(|file| scene.resolve(file)).collect()
        }
    };
    // a text that is not a file name leads to no existing file
    let reference = match (&args.reference, &scene.recording.reference) {
        (Some(text), _) => Some(PathBuf::from(text)),
        (None, Some(Reference::Text(text))) => Some(scene.resolve(Path::new(text))),
        _ => None,
    };
    std::iter::once(named("the scene", Path::new(&args.scene)))
        .chain(args.presses.iter().map(|file| named("the presses", file)))
        .chain(args.with.iter().map(|file| named("the earlier file", file)))
        .chain(frames.into_iter().map(|file| ("the frames", file)))
        .chain(reference.map(|file| ("the reference", file)))
        .collect()
}

/// Whether two paths lead to the same existing file.
fn is_same(one: &Path, other: &Path) -> bool {
    let [one, other] = [one, other].map(std::fs::canonicalize);
    matches!((one, other), (Ok(one), Ok(other)) if one == other)
}

fn write_csv(file: OutFile, curve: &[CurvePoint]) -> Result<(), CliError> {
    file.write(|w| {
        writeln!(
            w,
            "learnt,earlier,tested,places_by,median_m,mean_m,force_median,force_p90,time_s"
        )
        .map_err(io)?;
        for CurvePoint { learnt, earlier, tested, places_by, place, force, time_s } in curve {
            let [median, p90] = match force {
                Some(parts) => parts.map(|part| format!("{part:.4}")),
                None => [String::new(), String::new()],
            };
            let by = format!("{places_by:?}").to_lowercase();
            let (m, a) = (place.median_m, place.mean_m);
            writeln!(
                w,
                "{learnt},{earlier},{tested},{by},{m:.6},{a:.6},{median},{p90},{time_s:.3}"
            )
            .map_err(io)?;
        }
        Ok(())
    })?;
    Ok(())
}

fn write_png(file: OutFile, learned: &LearnedSkin, curve: &[CurvePoint]) -> Result<(), CliError> {
    let line = |name: &str, value: &dyn Fn(&CurvePoint) -> f64| Series {
        name: name.to_owned(),
        points: curve.iter().map(|p| [p.learnt as f64, 1e3 * value(p)]).collect(),
        line: true,
        markers: true,
    };
    let mut series = vec![line("median", &|p| p.place.median_m), line("mean", &|p| p.place.mean_m)];
    if let Some(model) = &learned.errors.model {
        let ends = [curve.first(), curve.last()].map(|p| p.map_or(0.0, |p| p.learnt as f64));
        let points = ends.map(|x| [x, 1e3 * model.median_m]).to_vec();
        let name = "model alone, median".to_owned();
        series.push(Series { name, points, line: true, markers: false });
    }
    let picture = draw_plot(&Plot {
        title: "Position error after learning".to_owned(),
        footnote: "the first presses are learnt, all later ones tested".to_owned(),
        x_label: "presses learnt".to_owned(),
        y_label: "error, mm".to_owned(),
        x_log: true,
        y_log: true,
        series,
        zoom: 2,
    })?;
    Ok(file.write(|w| Ok(picture.write_png(w)?))?)
}
