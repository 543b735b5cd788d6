//! From a recording's images to a stack of comparable scale, and back.
//!
//! Run with `cargo run --release -p eit-denoise --example image_stack`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_denoise::{DenoiseError, ImageStack};
use ndarray::{Array2, Array3};

const PIXELS: usize = 32;

/// A touch that grows over ten frames on a disc of 32 x 32 pixels; returns the largest value after
/// the stack was scaled to one.
pub(crate) fn run() -> Result<f64, DenoiseError> {
    // pixel centres in units of the radius; row 0 has the largest y
    let place = |row: usize, column: usize| {
        let at = |i: usize| (2 * i + 1) as f64 / PIXELS as f64 - 1.0;
        [at(column), -at(row)]
    };
    let mask = Array2::from_shape_fn((PIXELS, PIXELS), |(row, column)| {
        let [x, y] = place(row, column);
        x * x + y * y < 1.0
    });
    let images = Array3::from_shape_fn((10, PIXELS, PIXELS), |(frame, row, column)| {
        let [x, y] = place(row, column);
        1e-6 * frame as f64 * (-((x - 0.4).powi(2) + (y - 0.3).powi(2)) / 0.05).exp()
    });
    let stack = ImageStack::new(images, mask)?;
    let scale = stack.max_abs();
    for (frame, image) in stack.iter().enumerate() {
        let peak = image.iter().fold(0.0_f64, |m, v| v.max(m));
        println!("frame {frame}: peak {peak:.2e} S");
    }
    let (values, mask) = stack.into_parts();
    let scaled = ImageStack::new(values / scale, mask)?;
    Ok(scaled.max_abs())
}

fn main() -> Result<(), DenoiseError> {
    run().map(|_| ())
}
