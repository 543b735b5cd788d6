//! What a U-net costs a frame.

use super::stages::Stage;
use crate::denoise::Net;
use crate::pipeline::DEFAULT_PIXELS;
use crate::scene::Scene;

/// Multiplications and additions a second of the small convolutions, and of the products of the
/// check, fitted as those of the other stages.
const NET_FLOPS_PER_S: f64 = 3.5e10;
const CHECK_FLOPS_PER_S: f64 = 1e10;

/// Net and check; none without `[denoise]`.
pub fn of(scene: &Scene, net: Option<&Net>, (measurements, share): (usize, f64)) -> Vec<Stage> {
    let Some(net) = net else { return Vec::new() };
    let pixels = scene.reconstruction.pixels.unwrap_or(DEFAULT_PIXELS);
    let shape = net.shape();
    let flops = 2.0 * shape.multiply_adds(pixels, pixels);
    let inside = share * (pixels * pixels) as f64;
    let check = 2.0 * measurements as f64 * inside;
    vec![
        Stage {
            name: "U-net",
            size: format!("{} weights, {pixels} x {pixels} pixels", shape.parameters()),
            flops,
            bytes: 4.0 * shape.parameters() as f64,
            time_s: flops / NET_FLOPS_PER_S,
            why: "a frame: the scene has [denoise]".to_owned(),
        },
        Stage {
            name: "check",
            size: format!("[{measurements}, {inside:.0}]"),
            flops: check,
            bytes: 4.0 * measurements as f64 * inside,
            time_s: check / CHECK_FLOPS_PER_S,
            why: "a frame: does the net's image explain the measurements?".to_owned(),
        },
    ]
}
