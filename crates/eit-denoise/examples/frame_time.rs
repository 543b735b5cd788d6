//! What a frame of 64 x 64 pixels costs with nets of several sizes, on this machine and one core: the
//! time part of error against run time.
//!
//! Run with `cargo run --release -p eit-denoise --features unet --example frame_time`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_denoise::{DenoiseError, Denoiser, NetFrame, UnetShape, Weights};
use ndarray::Array2;
use std::collections::BTreeMap;
use std::time::Instant;

const PIXELS: usize = 64;

/// One net's size and cost.
pub struct Cost {
    pub shape: UnetShape,
    pub parameters: usize,
    pub multiply_adds: f64,
    /// Least of some frames: what other work on the machine adds is no property of the net.
    pub time_s: f64,
}

/// Times nets that were never trained: their cost is the same.
pub fn run() -> Result<Vec<Cost>, DenoiseError> {
    let mask = Array2::from_elem((PIXELS, PIXELS), true);
    let image = Array2::from_shape_fn((PIXELS, PIXELS), |(r, c)| (0.1 * r as f64).sin() + c as f64);
    let mut out = Array2::zeros((PIXELS, PIXELS));
    let mut costs = Vec::new();
    let widths = [2, 3, 4, 6, 8, 12];
    let one = |history, width, depth| UnetShape { history, width, depth, ..UnetShape::ONE_IMAGE };
    let mut sizes: Vec<UnetShape> = Vec::new();
    for depth in [2, 3] {
        sizes.extend(widths.map(|width| one(1, width, depth)));
    }
    sizes.extend([one(3, 6, 3), one(1, 16, 3)]);
    // that of the shipped weights that see detected touches
    sizes.push(Weights::paper_disc_with_touches()?.shape);
    for shape in sizes {
        let UnetShape { history, width, depth, images, conditions, fold } = shape;
        // of about unit gain
        let weight = |k: usize| 0.1 * (0.7 * k as f32).sin();
        let parameters = (0..shape.parameters()).map(weight).collect();
        let (skin, pixels) = (String::new(), [PIXELS, PIXELS]);
        let weights =
            Weights { shape, parameters, skin, pixels, about: BTreeMap::new(), model_error: None };
        let mut net = Denoiser::new(&weights, mask.view())?;
        let mut time_s = f64::INFINITY;
        for _ in 0..50 {
            let start = Instant::now();
            let views = vec![image.view(); images];
            let frame = NetFrame { images: &views, conditions: &vec![0.5; conditions] };
            net.push_frame_into(frame, out.view_mut())?;
            time_s = time_s.min(start.elapsed().as_secs_f64());
        }
        let (parameters, multiply_adds) = (shape.parameters(), shape.multiply_adds(PIXELS, PIXELS));
        println!(
            "history {history}, width {width}, depth {depth}, images {images}, fold {fold}: {parameters} \
             weights, {:.1} million multiply-adds, {:.2} ms",
            1e-6 * multiply_adds,
            1e3 * time_s
        );
        costs.push(Cost { shape, parameters, multiply_adds, time_s });
    }
    Ok(costs)
}

fn main() -> Result<(), DenoiseError> {
    run().map(|_| ())
}
