//! A net and nothing else: images in, the shipped weights, images out.
//!
//! Run with `cargo run --release -p eit-denoise --features unet --example clean`.
//!
//! `data/one_finger.f32` has three frames of the simulated skin, each its raw image and the true one,
//! siemens, the 3228 pixels of the skin row by row, little-endian:
//!
//! ```text
//! eit simulate paper-disc --seed 77 --frames 90 --nodes 3000 --out sim      # frames 30, 57 and 84
//! eit reconstruct sim/scene.toml --method st-tv --out images
//! ```
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_denoise::{DenoiseError, Denoiser, ImageStack, Weights};
use ndarray::{Array2, Array3};

const PIXELS: usize = 64;
const FRAMES: usize = 3;
/// Fingerprint of the skin that the images are of, as `eit` computes it from the scene.
const SKIN: &str = "6d1b102e";

/// Raw and true images. On the skin is a pixel whose centre lies on the disc.
fn images() -> Result<[ImageStack; 2], DenoiseError> {
    let bytes = include_bytes!("data/one_finger.f32");
    let values: Vec<f32> =
        bytes.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect();
    let at = |i: usize| (2 * i + 1) as f64 / PIXELS as f64 - 1.0;
    let mask = Array2::from_shape_fn((PIXELS, PIXELS), |(r, c)| at(r).hypot(at(c)) < 1.0);
    let places: Vec<(usize, usize)> =
        mask.indexed_iter().filter(|(_, inside)| **inside).map(|(place, _)| place).collect();
    let stack = |which: usize| {
        let mut images = Array3::zeros((FRAMES, PIXELS, PIXELS));
        for (frame, list) in values.chunks_exact(places.len()).skip(which).step_by(2).enumerate() {
            for (&(row, column), &value) in places.iter().zip(list) {
                images[[frame, row, column]] = f64::from(value);
            }
        }
        ImageStack::new(images, mask.clone())
    };
    Ok([stack(0)?, stack(1)?])
}

/// Squared error over the skin.
fn error(image: &ImageStack, truth: &ImageStack, frame: usize) -> Result<f64, DenoiseError> {
    let (image, truth) = (image.frame(frame)?, truth.frame(frame)?);
    let squares = image.iter().zip(&truth).map(|(a, b)| (a - b).powi(2));
    // outside the skin both are NaN
    Ok(squares.filter(|square| square.is_finite()).sum())
}

/// Cleans the images; the error of each as a part of the raw one's.
pub fn run() -> Result<Vec<f64>, DenoiseError> {
    let [raw, truth] = images()?;
    let weights = Weights::paper_disc()?;
    weights.check_skin(SKIN, [PIXELS; 2])?;
    let mut net = Denoiser::new(&weights, raw.mask())?;
    // a stream gives its images one by one instead: `Denoiser::push_into`
    let clean = net.denoise(&raw)?;
    let mut parts = Vec::new();
    for frame in 0..clean.frames() {
        let part = error(&clean, &truth, frame)? / error(&raw, &truth, frame)?;
        println!("frame {frame}: {part:.2} of the raw image's squared error is left");
        parts.push(part);
    }
    Ok(parts)
}

fn main() -> Result<(), DenoiseError> {
    run().map(|_| ())
}
