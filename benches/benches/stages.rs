//! Times every stage at two sizes: 2 000 and 20 000 nodes, one thread, f64.
//!
//! Forward problem and Jacobian use the peers' meshes if available, so that the numbers are
//! comparable with the peers'; everything else uses generated meshes.
#![allow(clippy::expect_used, reason = "a stage that fails must end the bench, not be timed")]

use benches::{Result, problem};
use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, BenchmarkId, Criterion, SamplingMode};
use eit_fem::ForwardModel;
use eit_inverse::{
    Gaussian, GaussianSettings, InverseError, Laplace, LaplaceSettings, Noser, OneStepGaussNewton,
    OneStepSettings, Prior, Tikhonov,
};
use eit_mesh::{Mesh, Raster, Surface, generate};
use ndarray::Array2;
use std::time::Duration;

const NODES: [usize; 2] = [2000, 20000];
/// Pixels per side of rasters and images.
const PIXELS: usize = 64;
/// Number of frames in the batch.
const FRAMES: usize = 100;

fn main() -> Result<()> {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args();
    for nodes in NODES {
        let mesh = meshes(&mut criterion, nodes)?;
        let jacobian = forward(&mut criterion, nodes, &mesh)?;
        let difference = set_up(&mut criterion, nodes, &mesh, &jacobian)?;
        frames(&mut criterion, nodes, &mesh, &difference)?;
    }
    criterion.final_summary();
    Ok(())
}

/// Creates one group per crate; the longer stages run only a few times in the second they are
/// given.
fn group<'a>(criterion: &'a mut Criterion, name: &str) -> BenchmarkGroup<'a, WallTime> {
    let mut group = criterion.benchmark_group(name);
    group.sampling_mode(SamplingMode::Flat);
    group
}

/// Times mesh generation and raster; returns the mesh.
fn meshes(criterion: &mut Criterion, nodes: usize) -> Result<Mesh> {
    let (shape, electrodes) = problem::disc();
    let settings = problem::mesh_settings(nodes)?;
    let mesh = generate(&shape, &electrodes, &settings)?;
    let mut group = group(criterion, "mesh");
    group.bench_function(BenchmarkId::new("generate", nodes), |b| {
        b.iter(|| generate(&shape, &electrodes, &settings).expect("a mesh"));
    });
    group.bench_function(BenchmarkId::new("raster 64 x 64", nodes), |b| {
        b.iter(|| Raster::new(mesh.surface(), PIXELS).expect("a raster"));
    });
    group.finish();
    Ok(mesh)
}

/// Times model set-up, forward problem and Jacobian; returns the Jacobian on the generated mesh.
fn forward(criterion: &mut Criterion, nodes: usize, generated: &Mesh) -> Result<Array2<f64>> {
    let peers = problem::peers_mesh(nodes)?;
    let mesh = peers.as_ref().unwrap_or(generated);
    let model = problem::model(mesh)?;
    let sigma = problem::conductivity(model.elements());
    let mut workspace = model.workspace()?;
    let mut jacobian = Array2::zeros((model.protocol().measurements(), model.elements()));
    let mut group = group(criterion, "fem");
    group.bench_function(BenchmarkId::new("model set-up", nodes), |b| {
        b.iter(|| problem::model(mesh).expect("a model"));
    });
    group.bench_function(BenchmarkId::new("forward", nodes), |b| {
        b.iter(|| model.solve(&sigma, &mut workspace).expect("a solution").measurements());
    });
    group.bench_function(BenchmarkId::new("forward and Jacobian", nodes), |b| {
        b.iter(|| {
            let mut solution = model.solve(&sigma, &mut workspace).expect("a solution");
            solution.jacobian_into(jacobian.view_mut()).expect("a Jacobian");
            solution.measurements()
        });
    });
    group.finish();
    linearise(&problem::model(generated)?)
}

fn linearise(model: &ForwardModel) -> Result<Array2<f64>> {
    Ok(model.jacobian(&vec![1.0; model.elements()])?)
}

type MakePrior = fn(&Surface) -> std::result::Result<Box<dyn Prior>, InverseError>;

/// Times reconstruction set-up for 208 measurements, including the prior; returns the one with the
/// NOSER prior.
fn set_up(
    criterion: &mut Criterion,
    nodes: usize,
    mesh: &Mesh,
    jacobian: &Array2<f64>,
) -> Result<OneStepGaussNewton> {
    let priors: [(&str, MakePrior); 4] = [
        ("Tikhonov", |s| Ok(Box::new(Tikhonov::new(s)))),
        ("NOSER", |_| Ok(Box::new(Noser::default()))),
        ("Laplace", |s| Ok(Box::new(Laplace::new(s, &LaplaceSettings::default())?))),
        ("Gaussian", |s| Ok(Box::new(Gaussian::new(s, &GaussianSettings::default())?))),
    ];
    let mut group = group(criterion, "set-up");
    for (name, make) in priors {
        group.bench_function(BenchmarkId::new(name, nodes), |b| {
            b.iter(|| {
                let prior = make(mesh.surface()).expect("a prior");
                OneStepGaussNewton::new(jacobian, &*prior, OneStepSettings::default())
                    .expect("a reconstruction")
            });
        });
    }
    group.finish();
    Ok(OneStepGaussNewton::new(jacobian, &Noser::default(), OneStepSettings::default())?)
}

/// Times one frame and a batch of frames on pixels.
fn frames(
    criterion: &mut Criterion,
    nodes: usize,
    mesh: &Mesh,
    difference: &OneStepGaussNewton,
) -> Result<()> {
    let raster = Raster::new(mesh.surface(), PIXELS)?;
    let on_pixels = difference.on_raster(raster.pixel_from_element())?;
    let measurements = on_pixels.measurements();
    let frames = Array2::from_shape_fn((FRAMES, measurements), |(f, m)| ((f + 3 * m) % 7) as f64);
    let (frame, reference) = (frames.row(0).to_vec(), vec![0.0; measurements]);
    let (mut memory, mut image) = (on_pixels.workspace(), vec![0.0; on_pixels.image_len()]);
    let mut group = group(criterion, "frames");
    group.bench_function(BenchmarkId::new("one frame on pixels", nodes), |b| {
        b.iter(|| {
            on_pixels
                .reconstruct_into(&frame, &reference, &mut memory, &mut image)
                .expect("an image");
        });
    });
    group.bench_function(BenchmarkId::new("100 frames on pixels", nodes), |b| {
        b.iter(|| on_pixels.reconstruct_frames(frames.view(), &reference).expect("images"));
    });
    group.finish();
    Ok(())
}
