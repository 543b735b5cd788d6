//! What a training step (16 examples of 64 x 64) costs by burn, and one image by burn and by
//! [`Denoiser`], in CPU time on one thread. `benches/compare_unet.py` sets them beside PyTorch.
//!
//! Run with `cargo run --release -p eit-denoise --features train --example step_time -- 6 3` for width
//! 6 and depth 3. The third argument is the time for each figure in seconds; a folder as the fourth
//! gets parameters, images and derivatives as f32, for others to compare with.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use cpu_time::ProcessTime;
use eit_denoise::burn::module::{Module as _, ModuleVisitor, Param};
use eit_denoise::burn::optim::GradientsParams;
use eit_denoise::burn::tensor::Tensor;
use eit_denoise::{
    DenoiseError, Denoiser, Examples, ImageStack, Shard, TrainDevice, TrainStep, Unet, UnetShape,
    images_through,
};
use ndarray::{Array2, Array3, Axis};
use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

const PIXELS: usize = 64;
const BATCH: usize = 16;

/// Times and derivatives of one net.
pub struct Cost {
    /// Error and derivative of a batch, by burn, without the optimiser.
    pub step_s: f64,
    /// One image by `Denoiser`.
    pub image_s: f64,
    /// One image by burn.
    pub burn_image_s: f64,
    /// Of the batch, in the order of the parameters.
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

/// Least CPU time of as many runs as fit, five at least, after one that does not count: what other
/// work on the machine adds is no property of a net.
fn least_s(
    budget_s: f64,
    mut work: impl FnMut() -> Result<(), DenoiseError>,
) -> Result<f64, DenoiseError> {
    work()?;
    let (mut least_s, mut runs) = (f64::INFINITY, 0);
    let first = Instant::now();
    while runs < 5 || first.elapsed().as_secs_f64() < budget_s {
        let cpu = ProcessTime::now();
        work()?;
        least_s = least_s.min(cpu.elapsed().as_secs_f64());
        runs += 1;
    }
    Ok(least_s)
}

/// Derivatives by name of tensor.
struct ByName {
    gradients: GradientsParams,
    path: Vec<String>,
    found: BTreeMap<String, Vec<f32>>,
}

impl ModuleVisitor for ByName {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }
    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let values = self.gradients.get::<D>(param.id).map(|d| d.into_data().try_into_vec());
        self.found.insert(self.path.join("."), values.and_then(Result::ok).unwrap_or_default());
    }
}

/// Names of the tensors in the order of `Weights::parameters`.
fn names(shape: UnetShape) -> Vec<String> {
    let down = (0..shape.depth).map(|level| format!("down.{level}"));
    let up = (0..shape.depth).rev().map(|level| format!("up.{level}"));
    let pairs = down.chain(["bottom".to_owned()]).chain(up);
    let all = pairs.flat_map(|pair| [format!("{pair}.0"), format!("{pair}.1")]);
    let all = all.chain(["head".to_owned()]);
    all.flat_map(|name| [format!("{name}.weight"), format!("{name}.bias")]).collect()
}

/// Times a net of this size for about `budget_s` each.
pub fn run(shape: UnetShape, budget_s: f64, values: Option<&Path>) -> Result<Cost, DenoiseError> {
    let mask = Array2::from_elem((PIXELS, PIXELS), true);
    let [raw, wanted] = [0.0, 1.0].map(images);
    let stack = |images: &Array3<f64>| ImageStack::new(images.clone(), mask.clone());
    let examples = Examples::new(&[Shard::new(&stack(&raw)?, &stack(&wanted)?)?], shape.history)?;
    let batch: Vec<usize> = (0..BATCH).collect();
    let net = Unet::new(shape, 1, &TrainDevice::Flex.open()?)?;
    let weights = net.to_weights("", [PIXELS, PIXELS], &BTreeMap::new())?;
    let step_s = least_s(budget_s, || {
        black_box(TrainStep::of(&net, &examples, &batch, 1)?);
        Ok(())
    })?;
    let one = ImageStack::new(raw.select(Axis(0), &[0]), mask.clone())?;
    let burn_image_s = least_s(budget_s, || {
        black_box(images_through(&net, &one)?);
        Ok(())
    })?;
    let mut denoiser = Denoiser::new(&weights, mask.view())?;
    let mut out = Array2::zeros(mask.dim());
    let image_s = least_s(budget_s, || {
        denoiser.push_into(raw.index_axis(Axis(0), 0), out.view_mut()).map(|_| ())
    })?;
    let gradients = TrainStep::of(&net, &examples, &batch, 1)?.gradients;
    let mut by_name = ByName { gradients, path: Vec::new(), found: BTreeMap::new() };
    net.visit(&mut by_name);
    let lists = names(shape).into_iter().filter_map(|name| by_name.found.remove(&name));
    let gradient: Vec<f32> = lists.flatten().collect();
    if let Some(folder) = values {
        let made = Denoiser::new(&weights, mask.view())?.denoise(&stack(&raw)?)?;
        let made_by_burn = images_through(&net, &stack(&raw)?)?;
        let f32s = |images: &Array3<f64>| images.iter().map(|v| *v as f32).collect();
        for (name, list) in [
            ("parameters", weights.parameters.clone()),
            ("raw", f32s(&raw)),
            ("wanted", f32s(&wanted)),
            ("made", f32s(&made.values().to_owned())),
            ("made_burn", f32s(&made_by_burn.values().to_owned())),
            ("gradient", gradient.clone()),
        ] {
            write(&folder.join(format!("{name}.f32")), &list)?;
        }
    }
    Ok(Cost { step_s, image_s, burn_image_s, gradient })
}

fn write(path: &PathBuf, list: &[f32]) -> Result<(), DenoiseError> {
    let bytes: Vec<u8> = list.iter().flat_map(|v: &f32| v.to_le_bytes()).collect();
    let io =
        |e: std::io::Error| DenoiseError::Io { path: path.display().to_string(), kind: e.kind() };
    std::fs::write(path, bytes).map_err(io)
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
    let cost = run(shape, number(2, 1.0), arguments.get(3).map(Path::new))?;
    println!(
        "{{\"width\": {}, \"depth\": {}, \"parameters\": {}, \"multiply_adds\": {}, \
         \"step_s\": {:.6}, \"image_s\": {:.6}, \"burn_image_s\": {:.6}}}",
        shape.width,
        shape.depth,
        shape.parameters(),
        shape.multiply_adds(PIXELS, PIXELS),
        cost.step_s,
        cost.image_s,
        cost.burn_image_s
    );
    Ok(())
}
