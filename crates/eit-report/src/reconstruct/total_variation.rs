//! The total-variation methods.

use super::{Made, kind_text};
use crate::error::ReportError;
use crate::output::axes;
use eit_core::median;
use eit_inverse::{Certificate, SequenceReport, SequenceStatus, WeightPoint, WeightStatus};
use eit_picture::{Canvas, Plot, Series, draw_plot};
use eit_skin::Reconstruction;
use eit_skin::total_variation::{TvMovie, Weights, stop};
use serde_json::{Value, json};

/// Reports the weights and the quality of the solution.
pub(super) fn make(done: &Reconstruction, movie: &TvMovie) -> Result<Made, ReportError> {
    Ok(Made {
        footnote: footnote(done, movie),
        curve: curve_picture(movie)?,
        report: report(done, movie),
        lines: lines(movie),
        notes: notes(movie),
    })
}

/// Describes why a method stopped.
pub(crate) fn status_text(status: SequenceStatus) -> &'static str {
    match status {
        SequenceStatus::Direct => "direct",
        SequenceStatus::Converged => "converged",
        SequenceStatus::Deadline => "deadline",
        SequenceStatus::IterationCap => "iteration cap",
        SequenceStatus::Stalled => "stalled",
        _ => "see the documentation of this version",
    }
}

/// Describes how the weights were chosen.
fn weight_text(status: WeightStatus) -> &'static str {
    match status {
        WeightStatus::Reached => "reached",
        WeightStatus::Flattened => "the residual hardly falls below",
        WeightStatus::AtLowerEdge => "not reachable: more than noise is left at any weight",
        WeightStatus::AtUpperEdge => "not reachable: less than noise is left at any weight",
        _ => "see the documentation of this version",
    }
}

/// Expected residual: the radius, or the norm of the noise.
fn wanted(movie: &TvMovie) -> Option<f64> {
    // residuals are in units of the noise with the model error, the stated delta in that of the noise alone
    let factor = movie.noise.as_ref().map_or(1.0, |noise| noise.per_known());
    let delta = movie.weights.as_ref().and_then(|weights| weights.delta);
    let delta = delta.map(|delta| delta / factor);
    delta.or_else(|| movie.noise.as_ref().map(|_| (movie.used as f64).sqrt()))
}

fn weights_json(weights: &Weights) -> Value {
    let chosen = weights.chosen.as_ref();
    json!({
        "lambda_space": weights.lambda_space,
        "lambda_time": weights.lambda_time,
        "delta": weights.delta,
        "rule": weights.rule,
        "search": chosen.map(|c| weight_text(c.status)),
        "search_lambda_space": chosen.map(|c| c.lambda_space),
        "search_residual": chosen.map(|c| c.residual),
        "l_curve_corner": chosen.and_then(|c| c.corner),
        "seconds": chosen.map(|c| c.seconds),
    })
}

fn report(done: &Reconstruction, movie: &TvMovie) -> Value {
    let solved = movie.report.as_ref();
    let certificate = solved.and_then(|report| report.certificate);
    let median = movie.noise.as_ref().and_then(|noise| median(noise.std.iter().copied()));
    json!({
        "status": solved.map_or("nothing to solve", |report| status_text(report.status)),
        "iterations": solved.map_or(0, |report| report.iterations),
        "seconds": solved.map_or(0.0, |report| report.seconds),
        "target_gap": stop(&done.fitted.skin.skin.settings.reconstruction).target_gap,
        "gap": certificate.map(|c| c.relative_gap()),
        "primal": certificate.map(|c| c.primal),
        "lower_bound": certificate.map(|c| c.lower_bound),
        "residual": movie.residual,
        "residual_wanted": wanted(movie),
        "weights": movie.weights.as_ref().map(weights_json),
        "noise": movie.noise.as_ref().map(|noise| json!({
            "source": noise.source,
            "median_std": median,
            // infinite if no noise is known: written as null
            "model_error_factor": noise.model_error,
        })),
        "blank_frames": movie.blank,
        "quiet_frames": movie.quiet_count() - movie.blank,
        "still": movie.still,
        "rank": movie.rank,
    })
}

fn lines(movie: &TvMovie) -> Vec<String> {
    let mut lines = Vec::new();
    match &movie.noise {
        Some(noise) if noise.model_error.is_finite() && noise.model_error > 1.05 => {
            lines.push(format!(
                "noise {}; {:.1} times that including model error",
                noise.source, noise.model_error
            ));
        }
        Some(noise) => lines.push(format!("noise {}", noise.source)),
        None => lines.push("noise unknown: all data weighted equally".to_owned()),
    }
    let (quiet, count) = (movie.quiet_count() - movie.blank, movie.quiet.len());
    if movie.blank > 0 {
        lines.push(format!(
            "{} of {count} frames without a usable value: image set to zero",
            movie.blank
        ));
    }
    if quiet > 0 {
        lines.push(format!(
            "{quiet} of {count} frames do not differ from the reference beyond noise: not solved, \
             image set to zero"
        ));
    }
    if movie.still {
        lines.push(format!(
            "{} frames do not differ from each other beyond noise (a static scene): reconstructed \
             as one image from their mean, without a time term",
            if quiet > 0 { "the other" } else { "the" }
        ));
    }
    lines.extend(movie.weights.as_ref().map(weights_line));
    if let Some(report) = &movie.report {
        lines.push(solved_line(report));
        lines.extend(residual_line(movie));
    }
    lines
}

fn weights_line(weights: &Weights) -> String {
    let in_time = match weights.lambda_time {
        0.0 => "no time term".to_owned(),
        weight => format!("lambda_time {weight:.3e}"),
    };
    let mut line =
        format!("lambda_space {:.3e}, {in_time}: {}", weights.lambda_space, weights.rule);
    if let Some(delta) = weights.delta {
        line += &format!(", delta {delta:.3e}");
    }
    if let Some(chosen) = &weights.chosen {
        line += &format!(" ({}, {:.2} s)", weight_text(chosen.status), chosen.seconds);
    }
    line
}

fn solved_line(report: &SequenceReport) -> String {
    let certificate = match report.certificate {
        None => String::new(),
        Some(c) if c.primal.is_infinite() => {
            ", no images found whose residuals are all within delta".to_owned()
        }
        Some(c) => format!(
            ", objective {:.4e}, proven to be at most {:.2} % above the optimum",
            c.primal,
            percent(c)
        ),
    };
    format!(
        "{} after {} iterations, {:.2} s{certificate}",
        status_text(report.status),
        report.iterations,
        report.seconds
    )
}

/// Gap in percent for output; rounding may swap the bounds, so it is at least zero.
fn percent(certificate: Certificate) -> f64 {
    100.0 * certificate.relative_gap().max(0.0)
}

/// Describes the residuals of the solved frames relative to the expected residual.
fn residual_line(movie: &TvMovie) -> Option<String> {
    let wanted = wanted(movie)?;
    let ratios: Vec<f64> = movie.residual.iter().flatten().map(|r| r / wanted).collect();
    let least = ratios.iter().copied().fold(f64::INFINITY, f64::min);
    let most = ratios.iter().copied().fold(0.0, f64::max);
    let what = match movie.weights.as_ref().and_then(|weights| weights.delta) {
        Some(_) => "delta",
        None => "the noise",
    };
    let middle = median(ratios).unwrap_or(f64::NAN);
    Some(format!("residual of a frame {middle:.2} of {what} ({least:.2} to {most:.2})"))
}

fn notes(movie: &TvMovie) -> Vec<String> {
    let mut notes = Vec::new();
    let weights = movie.weights.as_ref();
    let chosen = weights.and_then(|weights| weights.chosen.as_ref());
    if chosen.is_some() && movie.noise.as_ref().is_some_and(|noise| noise.model_error.is_infinite())
    {
        notes.push(
            "the weights depend on the noise, which is unknown: set [noise] additive_v or quiet_frames"
                .to_owned(),
        );
    }
    match chosen.map(|chosen| chosen.status) {
        Some(WeightStatus::AtLowerEdge) => notes.push(
            "no image explains the data to within the noise, so the weights are based on the model \
             error: check electrodes, contact impedance and reference if it seems large"
                .to_owned(),
        ),
        Some(WeightStatus::Flattened) => notes.push(
            "smaller weights would explain more of the data, but with artefacts: the model does \
             not fit that part, for example because electrodes move"
                .to_owned(),
        ),
        Some(WeightStatus::AtUpperEdge) => notes.push(
            "a constant image explains the data to within the noise: either the frames contain \
             nothing more, or the noise is smaller than stated"
                .to_owned(),
        ),
        _ => {}
    }
    if movie.report.is_none() {
        notes.push("no frame differs from the reference beyond noise".to_owned());
    }
    notes
}

fn footnote(done: &Reconstruction, movie: &TvMovie) -> String {
    let kind = kind_text(done.fitted.skin.difference_kind());
    let weights = movie.weights.as_ref().map_or_else(String::new, |weights| {
        format!(", λ {:.2e}, {:.2e} ({})", weights.lambda_space, weights.lambda_time, weights.rule)
    });
    let certificate = movie.report.as_ref().and_then(|report| report.certificate);
    let gap = certificate.map_or_else(String::new, |c| format!(", gap {:.2} %", percent(c)));
    format!("{}{weights}{gap}, {kind} difference", done.choice.method.description())
}

/// Plots the search for the weights: residual against weight, with the noise, the weight used and
/// the corner of the L-curve.
fn curve_picture(movie: &TvMovie) -> Result<Option<Canvas>, ReportError> {
    let Some((weights, chosen)) =
        movie.weights.as_ref().and_then(|weights| weights.chosen.as_ref().map(|c| (weights, c)))
    else {
        return Ok(None);
    };
    let at = |p: &WeightPoint| [p.lambda_space, p.residual_norm];
    let curve: Vec<[f64; 2]> = chosen.curve.iter().map(at).collect();
    let residuals = || curve.iter().map(|p| p[1]).chain([1.0]);
    let ends = [residuals().fold(f64::INFINITY, f64::min), residuals().fold(0.0, f64::max)];
    let used = ends.map(|residual| [weights.lambda_space, residual]);
    let all = || curve.iter().map(|p| p[0]).chain([weights.lambda_space]);
    let noise = [all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max)];
    let corner =
        chosen.corner.and_then(|weight| chosen.curve.iter().find(|p| p.lambda_space == weight));
    let series =
        |name: &str, points, line| Series { name: name.to_owned(), points, line, markers: !line };
    let plot = Plot {
        title: format!("Weight in space: {}", weights.rule),
        footnote: format!(
            "λ = {:.3e}, in time {:.3e}; residual of the noise {}",
            weights.lambda_space,
            weights.lambda_time,
            weight_text(chosen.status)
        ),
        series: vec![
            series("trials", curve.clone(), true),
            series("noise", noise.map(|weight| [weight, 1.0]).to_vec(), true),
            series("used", used.to_vec(), true),
            series("corner of the L-curve", corner.map(at).into_iter().collect(), false),
        ],
        ..axes([("weight in space λ", true), ("residual, in units of the noise", true)])
    };
    Ok(Some(draw_plot(&plot)?))
}
