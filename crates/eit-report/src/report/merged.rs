//! Merges both recordings of a scene (soft and hard fingers, or one and two on the fabric) into the
//! rows used by tables, plots and choices.

use super::cases::Case;
use super::recording::RecordingResults;
use super::work_precision::{WorkPrecisionCurve, WorkPrecisionPoint};
use crate::reconstruct::movie_status_text;
use eit_inverse::SequenceStatus;
use eit_skin::plan::machine::Machine;
use eit_skin::plan::measured::Measured;

/// The merged rows of a scene.
#[derive(Default)]
pub(super) struct Merged {
    pub rows: Vec<Measured>,
    /// Solvers with results for only one of the recordings.
    pub missing: Vec<String>,
}

/// Merges the curves of a scene's recordings, which have the given number of frames.
pub(super) fn rows(
    case: &Case,
    frames: usize,
    recordings: &[RecordingResults],
    machine: &Machine,
) -> Merged {
    let mut merged = Merged::default();
    let Some((first, others)) = recordings.split_first() else { return merged };
    for curve in &first.curves {
        let mut all = vec![curve];
        all.extend(others.iter().filter_map(|recording| {
            recording.curves.iter().find(|other| other.solver == curve.solver)
        }));
        for point in &curve.points {
            let points: Vec<&WorkPrecisionPoint> = all
                .iter()
                .filter_map(|c| c.points.iter().find(|p| p.target_gap == point.target_gap))
                .collect();
            if points.len() == recordings.len() {
                merged.rows.push(row(case, frames, &all, &points, machine));
            } else {
                let missing = format!("{}, gap {:?}", curve.solver.label(), point.target_gap);
                merged.missing.push(missing);
            }
        }
    }
    merged
}

/// Merges the same setting from each recording; the list is not empty. Times are those of the
/// slower recording.
fn row(
    case: &Case,
    frames: usize,
    curves: &[&WorkPrecisionCurve],
    points: &[&WorkPrecisionPoint],
    machine: &Machine,
) -> Measured {
    let count = points.len() as f64;
    let mean =
        |of: &dyn Fn(&WorkPrecisionPoint) -> f64| points.iter().map(|p| of(p)).sum::<f64>() / count;
    let most =
        |of: &dyn Fn(&WorkPrecisionCurve) -> f64| curves.iter().map(|c| of(c)).fold(0.0, f64::max);
    let slowest = points
        .iter()
        .fold(points[0], |slow, p| if p.time.median_s > slow.time.median_s { p } else { slow });
    // five digits exceed the accuracy of a time or an error
    let short = |value: f64| format!("{value:.4e}").parse().unwrap_or(value);
    let finite = |value: f64| value.is_finite().then_some(short(value));
    let errors: Vec<f64> = points.iter().map(|p| p.scores.relative_error).collect();
    let (solver, time) = (&curves[0].solver, slowest.time);
    let choice_s = most(&|c| c.cost.choice_s);
    let cost_s = match solver.is_live {
        true => time.most_of_s,
        false => time.median_s + choice_s / frames as f64,
    };
    Measured {
        scene: case.name.clone(),
        solver: solver.name.clone(),
        rule: solver.rule.to_owned(),
        pixels: solver.pixels,
        target_gap: points[0].target_gap,
        live: solver.is_live,
        peer: false,
        relative_error: short((errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt()),
        relative_error_first: short(errors[0]),
        relative_error_second: errors.get(1).copied().map(short),
        position_error_mm: finite(1e3 * mean(&|p| p.scores.position_error_m)),
        found: short(mean(&|p| p.scores.found)),
        extra_blobs: short(mean(&|p| p.scores.extra)),
        cost_ms_a_frame: short(1e3 * cost_s),
        ms_a_frame_least: short(1e3 * time.least_s),
        ms_a_frame: short(1e3 * time.median_s),
        ms_a_frame_95: short(1e3 * time.most_of_s),
        ms_a_frame_most: short(1e3 * time.most_s),
        times: time.count,
        floor_ms_a_frame: finite(1e3 * slowest.floor_s),
        proven_gap: points.iter().filter_map(|p| p.convergence.gap).reduce(f64::max).map(short),
        iterations: mean(&|p| p.convergence.iterations as f64),
        status: status(points).to_owned(),
        frames,
        set_up_s: short(most(&|c| c.cost.set_up_s)),
        choice_s: short(choice_s),
        choice: curves.iter().map(|c| c.cost.choice.as_str()).collect::<Vec<_>>().join(" | "),
        machine_gflops: short(1e-9 * machine.double_flops_per_s),
    }
}

/// Returns the status; failure to converge on one recording counts for both.
fn status(points: &[&WorkPrecisionPoint]) -> &'static str {
    let done = |p: &&&WorkPrecisionPoint| {
        matches!(p.convergence.status, SequenceStatus::Direct | SequenceStatus::Converged)
    };
    let worst = points.iter().find(|p| !done(p)).unwrap_or(&points[0]);
    movie_status_text(worst.convergence.status)
}
