//! The Gauss-Newton methods: one-step images, and methods for whole sequences.

use super::{Made, kind_text};
use crate::error::ReportError;
use crate::output::axes;
use eit_inverse::{CurvePoint, HyperparameterStatus, SequenceReport};
use eit_picture::{Canvas, Plot, Series, draw_plot};
use eit_skin::Reconstruction;
use eit_skin::method::Method;
use eit_skin::one_step::Imaging;
use eit_skin::scene::DifferenceKind;
use serde_json::{Value, json};

/// Reports the choice of the hyperparameter, and the residuals.
pub(super) fn make(
    done: &Reconstruction,
    imaging: &Imaging,
    movie: Option<&SequenceReport>,
) -> Result<Made, ReportError> {
    let imaged = done.imaged();
    let mut report = imaging_json(imaging);
    match movie {
        Some(movie) => {
            report["status"] = json!(super::movie_status_text(movie.status));
            report["iterations"] = json!(movie.iterations);
            report["seconds"] = json!(movie.seconds);
            report["residual"] = json!(movie.residual);
            let used = imaging.difference.report().measurements_used as f64;
            let is_known = imaged.states_noise();
            report["residual_wanted"] = json!(is_known.then(|| used.sqrt()));
        }
        None => {
            report["status"] = json!("direct");
            report["relative_residual"] = json!(imaging.residuals(&imaged.frames)?);
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
    if let Some(movie) = movie.filter(|movie| movie.iterations > 0) {
        lines.push(format!(
            "{} after {} steps, {:.2} s",
            super::movie_status_text(movie.status),
            movie.iterations,
            movie.seconds
        ));
    }
    let footnote = footnote(done.choice.method, done.fitted.skin.difference_kind(), imaging);
    let (curve, notes) = (curve_picture(imaging)?, edge_note(imaging).into_iter().collect());
    Ok(Made { footnote, curve, report, lines, notes })
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
        series: vec![
            Series { name: String::new(), points: curve, line: true, markers: false },
            Series { name: "chosen".to_owned(), points: vec![mark], line: false, markers: true },
        ],
        ..axes([(x_label, true), (y_label, true)])
    };
    Ok(Some(draw_plot(&plot)?))
}
