//! Spatio-temporal total variation on a problem of our own, on one thread: whole sequences to a
//! certified gap, with bounds, masked channels and data constraints; frames of a causal
//! stream, steady and at the onset of a touch; the choice of weights.
#![allow(clippy::expect_used, reason = "a stage that fails must end the bench, not be timed")]

use benches::{Result, problem};
use criterion::{Criterion, SamplingMode};
use eit_inverse::{
    CausalSettings, CausalStream, DifferenceFrames, Fidelity, Gradient, StTv, StTvSettings, Stop,
};
use eit_mesh::{Raster, generate};
use fixtures::Random;
use ndarray::Array2;
use std::hint::black_box;
use std::time::Duration;

/// Nodes of the mesh, pixels per side, frames of a sequence and per turn of the touches.
const NODES: usize = 1000;
const PIXELS: usize = 32;
const FRAMES: usize = 20;
const TURN: f64 = 397.0;
/// Noise relative to the root mean square of the data.
const NOISE: f64 = 0.01;

/// Two touches that circle on the unit disc, as voltage differences.
struct Movie {
    jacobian: Array2<f64>,
    gradient: Gradient,
    /// `[frame][measurement]`.
    values: Array2<f64>,
    noise_std: f64,
    pixel_m: f64,
}

fn movie() -> Result<Movie> {
    let (shape, electrodes) = problem::disc();
    let mesh = generate(&shape, &electrodes, &problem::mesh_settings(NODES)?)?;
    let model = problem::model(&mesh)?;
    let by_element = model.jacobian(&vec![1.0; model.elements()])?;
    let raster = Raster::new(mesh.surface(), PIXELS)?;
    let jacobian = raster.element_from_pixel().premultiply_dense(by_element.view())?;
    let centre = |&[row, column]: &[usize; 2]| raster.centre_m(row, column);
    let centres: Vec<[f64; 2]> = raster.masked_pixels().iter().map(centre).collect();
    let touches = [(0.55, 0.15, 0.5, 0.0), (0.45, 0.12, 0.4, 2.0)];
    let truth = Array2::from_shape_fn((FRAMES, centres.len()), |(t, p)| {
        let angle = std::f64::consts::TAU * t as f64 / TURN;
        let inside = |(radius, size, height, phase): (f64, f64, f64, f64)| {
            let (y, x) = (angle + phase).sin_cos();
            let apart = (centres[p][0] - radius * x).hypot(centres[p][1] - radius * y);
            if apart < size { height } else { 0.0 }
        };
        touches.into_iter().map(inside).sum()
    });
    let mut values = truth.dot(&jacobian.t());
    let mean = values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64;
    let noise_std = NOISE * mean.sqrt();
    let mut random = Random::new(1);
    values.mapv_inplace(|v| v + noise_std * random.normal());
    let gradient = Gradient::pixels(raster.mask(), raster.pixel_m())?;
    Ok(Movie { jacobian, gradient, values, noise_std, pixel_m: raster.pixel_m() })
}

impl Movie {
    fn solver(&self, change: impl FnOnce(&mut StTvSettings)) -> Result<StTv> {
        let noise_std = Some(vec![self.noise_std; self.jacobian.nrows()]);
        let mut settings = StTvSettings { noise_std, ..Default::default() };
        change(&mut settings);
        Ok(StTv::new(&self.jacobian, &self.gradient, settings)?)
    }

    fn frames(&self) -> DifferenceFrames<'_> {
        DifferenceFrames::all_good(self.values.view())
    }
}

fn main() -> Result<()> {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(2))
        .configure_from_args();
    let movie = movie()?;
    let mut chosen = movie.solver(|_| {})?;
    let weights = chosen.choose_weights(&movie.frames(), movie.pixel_m)?;
    let with = |settings: &mut StTvSettings| {
        (settings.lambda_space, settings.lambda_time) = (weights.lambda_space, weights.lambda_time);
    };
    let solver = movie.solver(with)?;
    let mut group = criterion.benchmark_group("st_tv_core");
    group.sampling_mode(SamplingMode::Flat);

    group.bench_function("choice of weights", |b| {
        b.iter(|| chosen.choose_weights(&movie.frames(), movie.pixel_m).expect("weights"));
    });
    for (name, target_gap) in [("batch to 1e-2", 1e-2), ("batch to 1e-3", 1e-3)] {
        let stop = Stop { target_gap, ..Default::default() };
        group.bench_function(name, |b| {
            b.iter(|| solver.solve(&movie.frames(), &stop).expect("a movie"));
        });
    }
    let stop = Stop { target_gap: 1e-2, ..Default::default() };
    let good = Array2::from_shape_fn(movie.values.dim(), |(t, i)| t < 5 || i % 13 != 0);
    let masked = DifferenceFrames { values: movie.values.view(), good: Some(good.view()) };
    group.bench_function("masked to 1e-2", |b| {
        b.iter(|| solver.solve(&masked, &stop).expect("a movie"));
    });
    let bounded = movie.solver(|settings| {
        with(settings);
        settings.lower_s = 0.0;
    })?;
    group.bench_function("bounded to 1e-2", |b| {
        b.iter(|| bounded.solve(&movie.frames(), &stop).expect("a movie"));
    });
    let constrained = movie.solver(|settings| {
        with(settings);
        let delta = 1.1 * (movie.jacobian.nrows() as f64).sqrt();
        settings.fidelity = Fidelity::Constrained { delta };
    })?;
    group.bench_function("constrained to 1e-2", |b| {
        b.iter(|| constrained.solve(&movie.frames(), &stop).expect("a movie"));
    });

    let rows: Vec<Vec<f64>> = movie.values.rows().into_iter().map(|row| row.to_vec()).collect();
    // back and forth, so that the touches never jump
    let mut to_and_fro = (0..FRAMES).chain((1..FRAMES - 1).rev()).cycle();
    let silence = vec![0.0; rows[0].len()];
    let settings = CausalSettings { target_gap: 1e-2, ..Default::default() };
    let mut causal = CausalStream::new(solver, settings)?;
    group.bench_function("causal, a steady frame", |b| {
        b.iter(|| {
            let frame = to_and_fro.next().unwrap_or_default();
            causal.push(&rows[frame], None).expect("a step").iterations
        });
    });
    group.bench_function("causal, onset after rest", |b| {
        b.iter(|| {
            // eight empty frames bring the image to rest
            for _ in 0..8 {
                causal.push(&silence, None).expect("a step");
            }
            black_box(causal.push(&rows[0], None).expect("a step").iterations)
        });
    });
    group.finish();
    criterion.final_summary();
    Ok(())
}
