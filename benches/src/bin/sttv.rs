//! Times spatio-temporal total variation on the peers' reference problems, one thread.
//!
//! Usage: `sttv [PIXELS...]` with PIXELS of 32 and 64. Prints one JSON object per problem: set-up,
//! time of an iteration, and the times at which the primal objective was first known to be within
//! 1e-2, 1e-3 and 1e-4 of the certified optimum (what the peers' script reports), and at which the
//! solver's own certificate reached these gaps. Medians over repeated cold starts.
#![allow(clippy::print_stdout, reason = "the table is this program's output")]

use benches::Result;
use eit_inverse::{Differences, Gradient, StTv, StTvSettings, Stop};
use fixtures::st_tv::{self, StTvProblem};
use serde_json::{Map, Value, json};
use std::time::Instant;

/// Cold starts of each timing.
const REPEATS: usize = 5;
const GAPS: [f64; 3] = [1e-2, 1e-3, 1e-4];

fn main() -> Result<()> {
    let mut arguments: Vec<usize> = Vec::new();
    for argument in std::env::args().skip(1) {
        let pixels = argument.parse().ok().filter(|p| [32, 64].contains(p));
        arguments.push(pixels.ok_or_else(|| format!("'{argument}': give 32 or 64"))?);
    }
    if arguments.is_empty() {
        arguments = vec![32, 64];
    }
    for pixels in arguments {
        if let Some(problem) = st_tv::load(pixels)? {
            println!("{}", time(pixels, &problem)?);
        }
    }
    Ok(())
}

fn time(pixels: usize, problem: &StTvProblem) -> Result<Value> {
    let gradient = Gradient::pixels(&problem.mask, 1.0)?;
    let settings = StTvSettings {
        lambda_space: problem.lambda,
        lambda_time: problem.lambda,
        ..Default::default()
    };
    let start = Instant::now();
    let solver = StTv::new(&problem.jacobian, &gradient, settings)?;
    let set_up_s = start.elapsed().as_secs_f64();
    let frames = Differences::all_good(problem.values.view());

    // the image alone: with the least gap that runs in f32 no proof is tried before 1e-4 is reached
    let mut primal: [Vec<f64>; 3] = Default::default();
    let mut iteration_s = Vec::new();
    for _ in 0..REPEATS {
        let stop = Stop { target_gap: 1e-4, ..Default::default() };
        let report = solver.solve(&frames, &stop)?.report;
        for (times, gap) in primal.iter_mut().zip(GAPS) {
            let limit = problem.objective * (1.0 + gap);
            let first = report.trace.iter().find(|point| point.primal <= limit);
            times.push(first.map_or(f64::INFINITY, |point| point.seconds));
        }
        iteration_s.push(report.seconds / report.iterations as f64);
    }
    let mut certified: [Vec<f64>; 3] = Default::default();
    let mut reached = [0.0; 3];
    for ((times, gap), reached) in certified.iter_mut().zip(GAPS).zip(&mut reached) {
        for _ in 0..REPEATS {
            let report =
                solver.solve(&frames, &Stop { target_gap: gap, ..Default::default() })?.report;
            times.push(report.seconds);
            *reached = report.certificate.map_or(f64::NAN, |c| c.relative_gap());
        }
    }
    let named = |times: &mut [Vec<f64>; 3]| -> Value {
        let pairs = GAPS.iter().zip(times.iter_mut());
        Value::Object(
            pairs.map(|(g, t)| (format!("{g:e}"), json!(middle(t)))).collect::<Map<_, _>>(),
        )
    };
    Ok(json!({
        "pixels": pixels,
        "unknowns": solver.unknowns(),
        "frames": frames.values.nrows(),
        "rank": solver.rank(),
        "repeats": REPEATS,
        "set_up_s": set_up_s,
        "iteration_s": middle(&mut iteration_s),
        "primal_s": named(&mut primal),
        "certified_s": named(&mut certified),
        "certified_gap": reached,
    }))
}

/// Median of values that are not empty.
fn middle(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
