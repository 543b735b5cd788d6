//! Spatio-temporal total variation on the peers' reference problems, on one thread: set-up, a solve
//! to a certified gap of 1e-2, and one frame of a stream.
#![allow(clippy::expect_used, reason = "a stage that fails must end the bench, not be timed")]

use benches::Result;
use criterion::{BenchmarkId, Criterion, SamplingMode};
use eit_inverse::{
    CausalSettings, CausalStream, DifferenceFrames, Gradient, StTv, StTvSettings, Stop,
};
use std::time::Duration;

fn main() -> Result<()> {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2))
        .configure_from_args();
    for pixels in [32, 64] {
        let Some(problem) = fixtures::st_tv::load(pixels)? else { continue };
        let gradient = Gradient::pixels(&problem.mask, 1.0)?;
        let settings = StTvSettings {
            lambda_space: problem.lambda,
            lambda_time: problem.lambda,
            ..Default::default()
        };
        let new = || StTv::new(&problem.jacobian, &gradient, settings.clone());
        let solver = new()?;
        let frames = DifferenceFrames::all_good(problem.values.view());
        let stop = Stop { target_gap: 1e-2, ..Default::default() };
        let mut group = criterion.benchmark_group("st_tv");
        group.sampling_mode(SamplingMode::Flat);
        group.bench_function(BenchmarkId::new("set-up", pixels), |b| {
            b.iter(|| new().expect("a solver"));
        });
        group.bench_function(BenchmarkId::new("20 frames to a gap of 1e-2", pixels), |b| {
            b.iter(|| solver.solve(&frames, &stop).expect("a movie"));
        });
        let settings = CausalSettings { max_iterations: 32, ..Default::default() };
        let mut stream = CausalStream::new(solver.clone(), settings)?;
        let mut rows = problem.values.rows().into_iter().map(|row| row.to_vec()).cycle();
        group.bench_function(BenchmarkId::new("a frame, 32 iterations", pixels), |b| {
            b.iter(|| {
                let row = rows.next().expect("an endless sequence");
                stream.push(&row, None).expect("a step").iterations
            });
        });
        group.finish();
    }
    criterion.final_summary();
    Ok(())
}
