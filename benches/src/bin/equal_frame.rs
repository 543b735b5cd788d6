//! Compares the cost of a frame that equals its reference with that of one that does not, for every
//! stage that processes each frame. Writes the table of `docs/PERFORMANCE.md`.
//!
//! Usage: `equal_frame [--dry-run]`; one core, one thread. `--dry-run` only prints the table.
#![allow(clippy::print_stdout, reason = "the table is this program's output")]

use benches::stopwatch::median;
use benches::{Result, document, problem};
use eit_denoise::{Denoiser, NetStatus, Weights};
use eit_fem::ForwardModel;
use eit_inverse::{
    CausalSettings, CausalStream, DifferenceFrames, FrameStatus, Gradient, HyperparameterChoice,
    Laplace, LaplaceSettings, NoiseTarget, OneStepGaussNewton, OneStepSettings, Reconstructor,
    StTv, StTvSettings,
};
use eit_mesh::{Mesh, MeshSettings, Raster, generate};
use ndarray::{Array2, Axis};
use std::hint::black_box;

/// Pixels per side of the images.
const PIXELS: usize = 64;
/// Number of frames in the movie of two circling fingers.
const FRAMES: usize = 40;
/// Number of timings of each stage, and number of runs per timing for stages below a microsecond.
const REPEATS: usize = 31;
const RUNS: usize = 1000;
/// Noise of a voltage relative to the root mean square of all: 60 dB.
const NOISE: f64 = 1e-3;

/// A stage and its cost.
struct Row {
    stage: &'static str,
    full_s: f64,
    equal_s: f64,
}

/// The skin with its measurements and model.
struct Scene {
    mesh: Mesh,
    raster: Raster,
    jacobian: Array2<f64>,
    reference: Vec<f64>,
    frames: Vec<Vec<f64>>,
    noise_std: Vec<f64>,
}

fn main() -> Result<()> {
    let dry_run = match std::env::args().nth(1).as_deref() {
        None => false,
        Some("--dry-run") => true,
        Some(other) => return Err(format!("'{other}': only --dry-run is known").into()),
    };
    let load = document::load();
    let scene = scene()?;
    let to_pixels = to_pixels(&scene)?;
    let image = image(&scene, &to_pixels)?;
    let net = net(&scene, &to_pixels)?;
    let total_variation = total_variation(&scene)?;
    let rows = [image, net, total_variation];
    let body = table(&rows, scene.raster.masked_pixels().len(), load);
    if dry_run {
        println!("{body}");
        return Ok(());
    }
    document::write("equal-frame", &body)
}

fn table(rows: &[Row], pixels: usize, load: Option<f64>) -> String {
    let load = load.map_or_else(|| "unknown".to_owned(), |load| format!("{load:.1}"));
    let mut lines = vec![
        format!(
            "{}. One thread, CPU time, medians; 208 values, {pixels} pixels of {PIXELS} x {PIXELS}. \
             Load average before: {load}.",
            document::machine()
        ),
        String::new(),
        "| stage | full frame, µs | equal frame, µs | ratio |".to_owned(),
        "|---|---|---|---|".to_owned(),
    ];
    for Row { stage, full_s, equal_s } in rows {
        let [full, equal] = [full_s, equal_s].map(|s| document::digits(1e6 * s));
        let ratio = document::digits(100.0 * equal_s / full_s);
        lines.push(format!("| {stage} | {full} | {equal} | {ratio} % |"));
    }
    lines.join("\n")
}

/// Median time of one of `RUNS` calls.
fn quick(mut run: impl FnMut() -> Result<()>) -> Result<f64> {
    let times = median(REPEATS, || (0..RUNS).try_for_each(|_| run()))?;
    Ok(times.cpu_s / RUNS as f64)
}

fn scene() -> Result<Scene> {
    let (shape, electrodes) = problem::disc();
    let coarse = generate(&shape, &electrodes, &problem::mesh_settings(2000)?)?;
    let fine = MeshSettings::default().for_nodes(&shape, &electrodes, 4000)?;
    let fine = generate(&shape, &electrodes, &fine)?;
    let (model, finer) = (problem::model(&coarse)?, problem::model(&fine)?);
    let reference = finer.forward(&vec![1.0; finer.elements()])?.to_vec();
    let square = reference.iter().map(|v| v * v).sum::<f64>() / reference.len() as f64;
    let noise_std = vec![NOISE * square.sqrt(); reference.len()];
    let frames = frames(&fine, &finer, noise_std[0])?;
    let jacobian = model.jacobian(&vec![1.0; model.elements()])?;
    let raster = Raster::new(coarse.surface(), PIXELS)?;
    Ok(Scene { mesh: coarse, raster, jacobian, reference, frames, noise_std })
}

/// Simulates two circling fingers, with noise.
fn frames(mesh: &Mesh, model: &ForwardModel, noise_std: f64) -> Result<Vec<Vec<f64>>> {
    let mut state = 1_u64;
    let mut normal = move || {
        // sums of twelve uniform numbers
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| draw()).sum::<f64>() - 6.0
    };
    let centroids = mesh.surface().centroids();
    let one = |k: usize| {
        let turn = 0.05 * k as f64;
        let fingers = [turn, turn + 2.5].map(|a| [0.5 * a.cos(), 0.5 * a.sin()]);
        let bell = |c: &[f64; 3], f: &[f64; 2]| {
            (-0.5 * ((c[0] - f[0]).hypot(c[1] - f[1]) / 0.1).powi(2)).exp()
        };
        let touched = |c: &[f64; 3]| 1.0 + 0.3 * fingers.iter().map(|f| bell(c, f)).sum::<f64>();
        let sigma: Vec<f64> = centroids.iter().map(touched).collect();
        Ok(model.forward(&sigma)?.iter().map(|v| v + noise_std * normal()).collect())
    };
    (0..FRAMES).map(one).collect()
}

fn to_pixels(scene: &Scene) -> Result<Reconstructor> {
    let surface = scene.mesh.surface();
    let prior = Laplace::new(surface, &LaplaceSettings::default())?;
    let settings =
        OneStepSettings { noise_std: Some(scene.noise_std.clone()), ..Default::default() };
    let mut inverse = OneStepGaussNewton::new(&scene.jacobian, &prior, settings)?;
    let target = NoiseTarget::central(surface, &scene.jacobian)?;
    let rule = HyperparameterChoice::NoiseFigure { figure: 1.0, target: &target };
    inverse.choose_hyperparameter(&rule)?;
    Ok(inverse.on_raster(scene.raster.pixel_from_element())?)
}

fn image(scene: &Scene, to_pixels: &Reconstructor) -> Result<Row> {
    let mut memory = to_pixels.workspace();
    let mut image = vec![0.0; to_pixels.image_len()];
    let mut cost = |frame: &[f64], wanted: FrameStatus| {
        quick(|| {
            let status =
                to_pixels.reconstruct_into(frame, &scene.reference, &mut memory, &mut image)?;
            black_box(&image);
            if status == wanted { Ok(()) } else { Err("another status".into()) }
        })
    };
    let full_s = cost(&scene.frames[0], FrameStatus::Computed)?;
    let equal_s = cost(&scene.reference, FrameStatus::Unchanged)?;
    Ok(Row { stage: "one-step image", full_s, equal_s })
}

fn net(scene: &Scene, to_pixels: &Reconstructor) -> Result<Row> {
    let mask = scene.raster.mask();
    let mut net = Denoiser::new(&Weights::paper_disc()?, mask.view())?;
    let pixels = to_pixels.reconstruct(&scene.frames[0], &scene.reference)?.to_vec();
    let image = scene.raster.image_from_pixels(&pixels)?;
    let mut out = Array2::zeros(mask.dim());
    let full = median(REPEATS, || {
        let status = net.push_into(image.view(), out.view_mut())?;
        if status == NetStatus::Computed { Ok(()) } else { Err("no image".into()) }
    })?;
    net.reset();
    let zero = mask.mapv(|inside| if inside { 0.0 } else { f64::NAN });
    let equal_s = quick(|| {
        let status = net.push_into(zero.view(), out.view_mut())?;
        black_box(&out);
        if status == NetStatus::Zero { Ok(()) } else { Err("an image".into()) }
    })?;
    Ok(Row { stage: "net, shipped weights", full_s: full.cpu_s, equal_s })
}

fn total_variation(scene: &Scene) -> Result<Row> {
    let raster = &scene.raster;
    let jacobian = raster.element_from_pixel().premultiply_dense(scene.jacobian.view())?;
    let gradient = Gradient::pixels(raster.mask(), raster.pixel_m())?;
    let settings = StTvSettings { noise_std: Some(scene.noise_std.clone()), ..Default::default() };
    let mut solver = StTv::new(&jacobian, &gradient, settings)?;
    let mut dv = Array2::zeros((FRAMES, scene.reference.len()));
    for (mut row, frame) in dv.axis_iter_mut(Axis(0)).zip(&scene.frames) {
        let parts = row.iter_mut().zip(frame.iter().zip(&scene.reference));
        parts.for_each(|(dv, (v, reference))| *dv = v - reference);
    }
    // the scaling between space and time used by `eit`
    let length_m = raster.pixel_m() * raster.pixels() as f64 / 32.0;
    solver.choose_weights(&DifferenceFrames::all_good(dv.view()), length_m)?;
    let mut stream = CausalStream::new(solver, CausalSettings::default())?;
    let mut full = Vec::new();
    for (k, row) in dv.rows().into_iter().enumerate() {
        let frame = row.to_vec();
        let start = cpu_time::ProcessTime::now();
        black_box(stream.push(&frame, None)?);
        // the first frames start from rest
        if k >= FRAMES / 2 {
            full.push(start.elapsed().as_secs_f64());
        }
    }
    full.sort_by(f64::total_cmp);
    let zero = vec![0.0; scene.reference.len()];
    // it comes to rest after a few of them
    for _ in 0..64 {
        stream.push(&zero, None)?;
    }
    let equal_s = quick(|| {
        let step = stream.push(&zero, None)?;
        if step.quiet { Ok(()) } else { Err("a frame that is not quiet".into()) }
    })?;
    Ok(Row { stage: "ST-TV stream, gap 1e-2", full_s: full[full.len() / 2], equal_s })
}
