//! The Gauss-Newton methods: one-step images, and methods for whole sequences.

use super::{Made, Task, kind_text};
use crate::error::ReportError;
use eit_inverse::{CurvePoint, DifferenceFrames, HyperparameterStatus, SequenceReport};
use eit_picture::{Canvas, Plot, Series, draw_plot};
use eit_skin::method::Method;
use eit_skin::one_step::Imaging;
use eit_skin::scene::DifferenceKind;
use eit_skin::{FittedFrames, Progress, sequence};
use ndarray::Array3;
use serde_json::{Value, json};

/// Chooses the hyperparameter for one-step images, then applies the requested method with it.
pub(super) fn make(task: &Task<'_>, progress: &mut Progress) -> Result<Made, ReportError> {
    let fitted = task.fitted;
    let left = match task.before {
        Some(before) => before.without.one_step(progress)?,
        None => None,
    };
    let imaging = match left {
        Some(imaging) => imaging,
        None => fitted.one_step(progress)?,
    };
    let Images { images, report: movie } = images(task, &imaging, progress)?;
    let mut report = imaging_json(&imaging);
    match &movie {
        Some(movie) => {
            report["status"] = json!(super::movie_status_text(movie.status));
            report["iterations"] = json!(movie.iterations);
            report["seconds"] = json!(movie.seconds);
            report["residual"] = json!(movie.residual);
            let used = imaging.difference.report().measurements_used as f64;
            let is_known = task.knows_noise();
            report["residual_wanted"] = json!(is_known.then(|| used.sqrt()));
        }
        None => {
            report["status"] = json!("direct");
            report["relative_residual"] = json!(imaging.residuals(&fitted.frames)?);
        }
    }
    let inverse = imaging.difference.report();
    let mut lines = vec![format!(
        "hyperparameter {:.3e}, {} ({}), {:.1} degrees of freedom",
        inverse.hyperparameter,
        imaging.rule,
        status_text(imaging.chosen.status),
        inverse.degrees_of_freedom
    )];
    if let Some(movie) = movie.as_ref().filter(|movie| movie.iterations > 0) {
        lines.push(format!(
            "{} after {} steps, {:.2} s",
            super::movie_status_text(movie.status),
            movie.iterations,
            movie.seconds
        ));
    }
    let footnote = footnote(task.method, task.kind(), &imaging);
    let (curve, notes) = (curve_picture(&imaging)?, edge_note(&imaging).into_iter().collect());
    Ok(Made { images, raster: imaging.raster, footnote, curve, report, lines, notes })
}

/// Images [frame, row, column] and, for methods of sequences, the solver's report.
struct Images {
    images: Array3<f64>,
    report: Option<SequenceReport>,
}

impl Task<'_> {
    /// Whether the noise is known, as opposed to treating the data as white.
    fn knows_noise(&self) -> bool {
        let settings = &self.fitted.skin.skin.settings;
        self.before.is_some() || settings.noise.additive_v.is_some()
    }
}

/// Computes the images.
fn images(
    task: &Task<'_>,
    imaging: &Imaging,
    progress: &mut Progress,
) -> Result<Images, ReportError> {
    let FittedFrames { skin: linearised, frames, .. } = task.fitted;
    if task.method == Method::GaussNewton {
        let images = imaging.images(frames, progress)?.into_parts().0;
        return Ok(Images { images, report: None });
    }
    let prior = linearised.prior()?;
    let mut settings = task.fitted.one_step_settings()?;
    settings.hyperparameter = imaging.difference.report().hyperparameter;
    if task.knows_noise() {
        // with gain and reference, so that residuals are in units of the noise; images depend only
        // on ratios
        let known = task.fitted.noise()?;
        settings.noise_std = known.map(|noise| noise.std);
    }
    let built = progress.stage("set-up of the method", || {
        sequence::method(task.method, linearised, prior.as_ref(), settings)
    })?;
    let Some(mut method) = built else {
        return Err(ReportError::Failure(format!("{} works on pixels", task.method.name())));
    };
    let values = frames.differences(imaging.kind);
    let differences = DifferenceFrames { values: values.view(), good: Some(frames.good.view()) };
    let movie = progress.stage("images", || method.reconstruct_sequence(&differences))?;
    let pixels = sequence::pixels_of(movie.images.view(), &imaging.raster)?;
    let images = imaging.raster.images_from_pixels(pixels.view())?;
    Ok(Images { images, report: Some(movie.report) })
}

/// Returns the footnote of pictures.
fn footnote(method: Method, kind: DifferenceKind, imaging: &Imaging) -> String {
    let report = imaging.difference.report();
    format!(
        "{}, {} prior, hyperparameter {:.3e} ({}), {} difference",
        method.description(),
        report.prior,
        report.hyperparameter,
        imaging.rule,
        kind_text(kind)
    )
}

fn imaging_json(imaging: &Imaging) -> Value {
    let inverse = imaging.difference.report();
    json!({
        "prior": inverse.prior,
        "hyperparameter": inverse.hyperparameter,
        "hyperparameter_rule": imaging.rule,
        "hyperparameter_status": status_text(imaging.chosen.status),
        "criterion": imaging.chosen.criterion,
        "degrees_of_freedom": inverse.degrees_of_freedom,
        "rank": inverse.rank,
    })
}

/// Returns a note if a rule found no optimum.
fn edge_note(imaging: &Imaging) -> Option<String> {
    let status = imaging.chosen.status;
    let edge =
        matches!(status, HyperparameterStatus::AtLowerEdge | HyperparameterStatus::AtUpperEdge);
    edge.then(|| {
        format!(
            "{} found no optimum inside its range ({}): images may be useless; set \
             [reconstruction] hyperparameter = \"noise-figure\" or a number",
            imaging.rule,
            status_text(status)
        )
    })
}

/// Describes how the hyperparameter was chosen.
fn status_text(status: HyperparameterStatus) -> &'static str {
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

/// Plots the curve used to choose the hyperparameter, with the choice marked.
fn curve_picture(imaging: &Imaging) -> Result<Option<Canvas>, ReportError> {
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
        footnote: format!("λ = {:.3e}: {}", chosen.hyperparameter, status_text(chosen.status)),
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
