//! Runs every inverse solver on one recording.

mod frame_by_frame;
pub(super) mod problem;
mod recorded;

use super::work_precision::WorkPrecisionCurve;
use crate::comparison::BoundedMethod;
use crate::error::ReportError;
use eit_skin::method::Method;
use eit_skin::scene::Rule;
use frame_by_frame::{StreamSetting, one_step, stream};
use problem::InverseProblem;
use recorded::{on_elements, total_variation};
use serde::Serialize;

/// Total variation of a sequence, also as in the paper, and of single frames, with and without knowledge of the fabric.
const SEQUENCE_METHODS: [BoundedMethod; 4] = [
    BoundedMethod::free(Method::StTv),
    BoundedMethod::paper(),
    BoundedMethod::rising(Method::StTv),
    BoundedMethod::rising(Method::Tv),
];
const FRAME_METHODS: [BoundedMethod; 2] =
    [BoundedMethod::free(Method::Tv), BoundedMethod::rising(Method::Tv)];
/// The streaming solvers.
const STREAMS: [StreamSetting; 2] = [
    StreamSetting { method: BoundedMethod::free(Method::StTv), target_gap: 1e-2 },
    StreamSetting { method: BoundedMethod::rising(Method::StTv), target_gap: 1e-1 },
];
/// Hyperparameter rules: one needs no data, the other depends on the noise of the recording.
const RULES: [Rule; 2] = [Rule::NoiseFigure, Rule::Gcv];
/// Methods on mesh elements; the last one reconstructs single frames.
const ON_ELEMENTS: [Method; 2] = [Method::TimePrior, Method::GaussNewtonAbsolute];

/// Number of solvers, for a progress bar.
pub(super) fn solvers(problem: &InverseProblem<'_>) -> usize {
    let (rasters, rules) = (problem.models.len(), RULES.len());
    match problem.is_still() {
        true => rasters * (rules + FRAME_METHODS.len()) + rules,
        false => {
            rasters * (rules + STREAMS.len() + SEQUENCE_METHODS.len())
                + ON_ELEMENTS.len() * rules
                + 2 * problem.nets.len()
        }
    }
}

/// A solver that failed on a recording.
#[derive(Serialize)]
pub(super) struct SolverFailure {
    pub solver: String,
    /// Shape or number of the fingers in the recording.
    pub shape: &'static str,
    pub why: String,
}

/// Runs all solvers; a failure does not stop the others. After an interrupt no further solver
/// starts.
pub(super) fn run(
    problem: &InverseProblem<'_>,
    failures: &mut Vec<SolverFailure>,
    bar: &eit_skin::Steps<'_>,
) -> Vec<WorkPrecisionCurve> {
    let mut curves = Vec::new();
    let mut keep = |name: &str, curve: &dyn Fn() -> Result<WorkPrecisionCurve, ReportError>| {
        bar.inc();
        if problem.stop.is_set() {
            return;
        }
        let shape = problem.recording.shape;
        match curve() {
            Ok(curve) => curves.push(curve),
            Err(error) => {
                let (solver, why) = (name.to_owned(), error.to_string());
                failures.push(SolverFailure { solver, shape, why });
            }
        }
    };
    let is_still = problem.is_still();
    let methods = if is_still { &FRAME_METHODS[..] } else { &SEQUENCE_METHODS[..] };
    for model in problem.models {
        for rule in RULES {
            keep("gauss-newton", &|| one_step(problem, model, rule, None));
        }
        for method in methods {
            keep(&method.name(), &|| total_variation(problem, model, *method));
        }
        if !is_still {
            for setting in STREAMS {
                keep("st-tv stream", &|| stream(problem, model, setting, None));
            }
        }
    }
    for net in problem.nets {
        let model = problem.finest();
        keep(&net.name, &|| one_step(problem, model, RULES[0], Some(net)));
        keep(&net.name, &|| stream(problem, model, STREAMS[0], Some(net)));
    }
    let first = if is_still { ON_ELEMENTS.len() - 1 } else { 0 };
    for method in &ON_ELEMENTS[first..] {
        for rule in RULES {
            keep(method.name(), &|| on_elements(problem, *method, rule));
        }
    }
    curves
}
