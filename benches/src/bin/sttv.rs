//! Times spatio-temporal total variation on the peers' reference problems, on one thread.
//!
//! Usage: `sttv [PIXELS...]` with PIXELS of 32 and 64. Prints one JSON object per problem: set-up
//! time, time per iteration, the times at which the primal objective first came within 1e-2, 1e-3
//! and 1e-4 of the certified optimum (which the peers' script reports), and the times at which the
//! solver's own certificate reached these gaps. All are medians over repeated cold starts. Then it
//! times a stream on the same skin: frames per second with a certified gap of 1e-2 on every frame.
//!
//! Times are processor times: wall time multiplied by the share of the processor that this program
//! got, because the peers' script also counts processor time.
#![allow(clippy::print_stdout, reason = "the table is this program's output")]

use benches::{Result, limits};
use cpu_time::ProcessTime;
use eit_inverse::{
    CausalSettings, CausalStream, DifferenceFrames, Gradient, StTv, StTvSettings, Stop,
};
use fixtures::Random;
use fixtures::st_tv::{self, StTvProblem};
use ndarray::Array1;
use serde_json::{Map, Value, json};
use std::time::Instant;

/// Number of cold starts per timing.
const REPEATS: usize = 5;
const GAPS: [f64; 3] = [1e-2, 1e-3, 1e-4];
/// Number of frames of the stream, of initial frames that are not counted, and of frames per turn:
/// the paper's finger takes 397.
const FRAMES: usize = 437;
const WARM_UP: usize = 40;
const TURN: usize = 397;
/// Gap of every frame of the stream.
const STREAM_GAP: f64 = 1e-2;

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
    let frames = DifferenceFrames::all_good(problem.values.view());

    // the image alone: with the smallest gap supported in f32, no certificate is computed before
    // 1e-4 is reached
    let mut primal: [Vec<f64>; 3] = Default::default();
    let mut iteration_s = Vec::new();
    for _ in 0..REPEATS {
        let stop = Stop { target_gap: 1e-4, ..Default::default() };
        let clocks = Clocks::start();
        let report = solver.solve(&frames, &stop)?.report;
        let share = clocks.processor_share();
        for (times, gap) in primal.iter_mut().zip(GAPS) {
            let limit = problem.objective * (1.0 + gap);
            let first = report.trace.iter().find(|point| point.primal <= limit);
            times.push(first.map_or(f64::INFINITY, |point| share * point.seconds));
        }
        iteration_s.push(share * report.seconds / report.iterations as f64);
    }
    let mut certified: [Vec<f64>; 3] = Default::default();
    let mut reached = [0.0; 3];
    for ((times, gap), reached) in certified.iter_mut().zip(GAPS).zip(&mut reached) {
        for _ in 0..REPEATS {
            let clocks = Clocks::start();
            let report =
                solver.solve(&frames, &Stop { target_gap: gap, ..Default::default() })?.report;
            times.push(clocks.processor_share() * report.seconds);
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
        "iteration_s": middle(&iteration_s),
        "primal_s": named(&mut primal),
        "certified_s": named(&mut certified),
        "certified_gap": reached,
        "flop_per_s": limits::matmul_f32_flop_per_s()?,
        "byte_per_s": limits::read_byte_per_s(2_500_000)?,
        "causal": stream(problem, solver)?,
    }))
}

/// Processor time and wall time since a moment.
struct Clocks {
    cpu: ProcessTime,
    wall: Instant,
}

impl Clocks {
    fn start() -> Self {
        Self { cpu: ProcessTime::now(), wall: Instant::now() }
    }

    /// Share of the processor that this single-threaded program got since the start.
    fn processor_share(&self) -> f64 {
        (self.cpu.elapsed().as_secs_f64() / self.wall.elapsed().as_secs_f64()).min(1.0)
    }
}

/// Simulates two circling touches, with the problem's noise, frame by frame.
fn stream(problem: &StTvProblem, solver: StTv) -> Result<Value> {
    let settings = CausalSettings { target_gap: STREAM_GAP, ..Default::default() };
    let mut stream = CausalStream::new(solver, settings)?;
    let noise_std = problem.noise_norm / (problem.values.len() as f64).sqrt();
    let mut random = Random::new(1);
    let side = problem.mask.nrows() as f64;
    let inside = problem.mask.indexed_iter().filter(|(_, inside)| **inside);
    let place = |i: usize| (i as f64 + 0.5) / side * 2.0 - 1.0;
    let pixels: Vec<[f64; 2]> = inside.map(|((i, j), _)| [place(j), place(i)]).collect();
    let (mut seconds, mut iterations, mut worst_gap) = (Vec::new(), 0, 0.0_f64);
    for frame in 0..FRAMES {
        let angle = frame as f64 / TURN as f64 * std::f64::consts::TAU;
        let touches = [[0.55, 0.15, 0.5, 0.0], [0.45, 0.12, 0.4, 2.0]];
        let change = |p: &[f64; 2]| -> f64 {
            let near = touches.iter().filter(|[radius, size, _, phase]| {
                let (x, y) = (radius * (angle + phase).cos(), radius * (angle + phase).sin());
                (p[0] - x).hypot(p[1] - y) < *size
            });
            near.map(|touch| touch[2]).sum()
        };
        let image: Array1<f64> = pixels.iter().map(change).collect();
        let mut dv = problem.jacobian.dot(&image).to_vec();
        for value in &mut dv {
            *value += noise_std * random.normal();
        }
        let clocks = Clocks::start();
        let step = stream.push(&dv, None)?;
        if frame >= WARM_UP {
            seconds.push(clocks.processor_share() * step.seconds);
            iterations += step.iterations;
            worst_gap = worst_gap.max(step.certificate.relative_gap());
        }
    }
    let frames_per_s = seconds.len() as f64 / seconds.iter().sum::<f64>();
    let mean = iterations as f64 / seconds.len() as f64;
    seconds.sort_by(f64::total_cmp);
    let quantile = |q: f64| seconds[((seconds.len() - 1) as f64 * q).round() as usize];
    Ok(json!({
        "frames": seconds.len(),
        "frames_per_s": frames_per_s,
        "iterations": mean,
        "worst_gap": worst_gap,
        "p50_s": quantile(0.5),
        "p95_s": quantile(0.95),
        "p99_s": quantile(0.99),
        "worst_s": quantile(1.0),
    }))
}

/// Median of a non-empty list.
fn middle(values: &[f64]) -> f64 {
    eit_core::median(values.iter().copied()).unwrap_or(f64::NAN)
}
