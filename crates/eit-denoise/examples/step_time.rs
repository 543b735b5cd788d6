//! What a training step (16 examples of 64 x 64) and one image cost by every engine that is compiled
//! in, in CPU time on one thread. `benches/compare_unet.py` sets it beside PyTorch.
//!
//! Run with `cargo run --release -p eit-denoise --features train --example step_time -- 6 3` for width
//! 6 and depth 3; with `--features burn` burn is timed too. The third argument is the time for each
//! figure in seconds; a folder as the fourth gets parameters, images and derivatives as f32, for
//! others to compare with.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use cpu_time::ProcessTime;
use eit_denoise::{
    DenoiseError, Denoiser, Engine, Examples, ImageStack, Shard, TrainSettings, Trainer, UnetShape,
    Weights,
};
use ndarray::{Array2, Array3};
use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

const PIXELS: usize = 64;
const BATCH: usize = 16;

/// One engine's times.
pub struct Cost {
    pub engine: Engine,
    /// Error and derivative of a batch from parameters that are new in every step.
    pub step_s: f64,
    /// One image, the parameters in place. Ours by `Denoiser`; burn's with its error.
    pub image_s: f64,
    /// Of the batch.
    pub gradient: Vec<f32>,
}

/// Bells over stripes; the largest value of each is one, so that nothing is scaled.
fn images(phase: f64) -> Array3<f64> {
    let mut images = Array3::from_shape_fn((BATCH, PIXELS, PIXELS), |(k, r, c)| {
        let [y, x] = [r, c].map(|i| i as f64 / PIXELS as f64 - 0.3 - 0.02 * k as f64);
        (-30.0 * (x * x + y * y)).exp() + 0.2 * (phase + 0.3 * r as f64 + 0.7 * c as f64).sin()
    });
    for mut image in images.outer_iter_mut() {
        let largest = image.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
        image /= largest;
    }
    images
}

/// Least of as many runs as fit, five at least, after one that does not count: what other work on
/// the machine adds is no property of an engine. CPU time, but wall time where another processor
/// does the work.
fn least_s(
    engine: Engine,
    budget_s: f64,
    mut work: impl FnMut() -> Result<(), DenoiseError>,
) -> Result<f64, DenoiseError> {
    work()?;
    let (mut least_s, mut runs) = (f64::INFINITY, 0);
    let first = Instant::now();
    while runs < 5 || first.elapsed().as_secs_f64() < budget_s {
        let (start, cpu) = (Instant::now(), ProcessTime::now());
        work()?;
        let took: Duration = match engine {
            Engine::Own | Engine::Burn => cpu.elapsed(),
            _ => start.elapsed(),
        };
        least_s = least_s.min(took.as_secs_f64());
        runs += 1;
    }
    Ok(least_s)
}

/// Times a net of this size for about `budget_s` each.
pub fn run(
    shape: UnetShape,
    budget_s: f64,
    values: Option<&Path>,
) -> Result<Vec<Cost>, DenoiseError> {
    let mask = Array2::from_elem((PIXELS, PIXELS), true);
    let [raw, wanted] = [0.0, 1.0].map(images);
    let stack = |images: &Array3<f64>| ImageStack::new(images.clone(), mask.clone());
    let examples = Examples::new(&[Shard::new(&stack(&raw)?, &stack(&wanted)?)?], shape.history)?;
    let batch: Vec<usize> = (0..BATCH).collect();
    let settings = TrainSettings { shape, ..Default::default() };
    let weights = Trainer::new(&settings, "")?.weights("", [PIXELS, PIXELS], BTreeMap::new());
    let mut costs = Vec::new();
    for engine in Engine::ALL.into_iter().filter(|engine| engine.check().is_ok()) {
        let mut steps = engine.start(shape, [PIXELS, PIXELS], 1)?;
        let step_s = least_s(engine, budget_s, || {
            steps.load(&weights.parameters)?;
            black_box(steps.step(&examples, &batch)?);
            Ok(())
        })?;
        let image_s = match engine {
            Engine::Own => own_image_s(&weights, &mask, &raw, budget_s)?,
            _ => least_s(engine, budget_s, || {
                black_box(steps.error(&examples, &[0])?);
                Ok(())
            })?,
        };
        let gradient = steps.step(&examples, &batch)?.1.to_vec();
        costs.push(Cost { engine, step_s, image_s, gradient });
    }
    if let Some(folder) = values {
        let made = Denoiser::new(&weights, mask.view())?.denoise(&stack(&raw)?)?;
        let f32s = |images: &Array3<f64>| images.iter().map(|v| *v as f32).collect();
        let made = made.values().to_owned();
        let mut lists = vec![
            ("parameters".to_owned(), weights.parameters.clone()),
            ("raw".to_owned(), f32s(&raw)),
            ("wanted".to_owned(), f32s(&wanted)),
            ("made".to_owned(), f32s(&made)),
        ];
        lists.extend(costs.iter().map(|c| (format!("gradient_{}", c.engine), c.gradient.clone())));
        for (name, list) in lists {
            let path: PathBuf = folder.join(format!("{name}.f32"));
            let bytes: Vec<u8> = list.iter().flat_map(|v: &f32| v.to_le_bytes()).collect();
            std::fs::write(&path, bytes).map_err(|e| DenoiseError::Io {
                path: path.display().to_string(),
                kind: e.kind(),
            })?;
        }
    }
    Ok(costs)
}

fn own_image_s(
    weights: &Weights,
    mask: &Array2<bool>,
    raw: &Array3<f64>,
    budget_s: f64,
) -> Result<f64, DenoiseError> {
    let mut net = Denoiser::new(weights, mask.view())?;
    let mut out = Array2::zeros(mask.dim());
    least_s(Engine::Own, budget_s, || {
        net.push_into(raw.index_axis(ndarray::Axis(0), 0), out.view_mut()).map(|_| ())
    })
}

fn main() -> Result<(), DenoiseError> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, default: f64| {
        arguments.get(k).and_then(|text| text.parse().ok()).unwrap_or(default)
    };
    let shape = UnetShape {
        width: number(0, 6.0) as usize,
        depth: number(1, 3.0) as usize,
        ..Default::default()
    };
    for cost in run(shape, number(2, 1.0), arguments.get(3).map(Path::new))? {
        println!(
            "{{\"engine\": \"{}\", \"width\": {}, \"depth\": {}, \"parameters\": {}, \
             \"multiply_adds\": {}, \"step_s\": {:.6}, \"image_s\": {:.6}}}",
            cost.engine,
            shape.width,
            shape.depth,
            shape.parameters(),
            shape.multiply_adds(PIXELS, PIXELS),
            cost.step_s,
            cost.image_s
        );
    }
    Ok(())
}
