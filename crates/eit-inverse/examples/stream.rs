//! A sliding finger: each frame is reconstructed as it arrives, by total variation in space and time. Each
//! image is linked to the one before it and has a certified gap.
//!
//! Run with `cargo run --release -p eit-inverse --example stream`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_fem::{ForwardModel, PairProtocol};
use eit_inverse::{CausalSettings, CausalStream, DifferenceFrames, Gradient, StTv, StTvSettings};
use eit_mesh::{Mesh, MeshSettings, Raster, RimElectrodes, SkinShape, generate};
use ndarray::Array2;
use std::error::Error;

const SHEET_S: f64 = 1e-5;
const FRAMES: usize = 24;
/// Number of frames of the untouched skin that follow.
const UNTOUCHED: usize = 16;
/// Noise of a voltage, volt; the smallest voltages of this skin are about 0.1 V.
const NOISE_V: f64 = 1e-4;

/// Results of the stream.
pub struct Outcome {
    /// Distance of the touch from the finger, metres, of each frame with a finger.
    pub errors_m: Vec<f64>,
    /// Largest proven relative gap.
    pub worst_gap: f64,
    /// Number of frames after the release that needed no iteration.
    pub quiet: usize,
}

fn skin(edge_m: f64) -> Result<(Mesh, ForwardModel), Box<dyn Error>> {
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let disc = SkinShape::Disc { radius_m: 0.1 };
    let mesh = generate(&disc, &electrodes, &MeshSettings::with_edge(edge_m))?;
    let model = ForwardModel::new(&mesh, &PairProtocol::default().protocol()?, &[1e3; 16])?;
    Ok((mesh, model))
}

/// Position of the finger in a frame, metres.
fn finger_m(frame: usize) -> [f64; 2] {
    let angle = 0.06 * frame as f64;
    [0.05 * angle.cos(), 0.05 * angle.sin()]
}

/// Differences from the untouched frame, `[frame, measurement]`, volts.
fn measure() -> Result<Array2<f64>, Box<dyn Error>> {
    let (mesh, model) = skin(0.005)?;
    let centroids = mesh.surface().centroids();
    let reference = model.forward(&vec![SHEET_S; centroids.len()])?;
    let mut state = 1_u64;
    let mut normal = || {
        // sums of twelve uniform numbers
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| draw()).sum::<f64>() - 6.0
    };
    let mut differences = Array2::zeros((FRAMES, reference.len()));
    for (frame, mut row) in differences.rows_mut().into_iter().enumerate() {
        let [x, y] = finger_m(frame);
        let bell = |c: &[f64; 3]| (-0.5 * ((c[0] - x).hypot(c[1] - y) / 0.012).powi(2)).exp();
        let sigma: Vec<f64> = centroids.iter().map(|c| SHEET_S * (1.0 + 0.3 * bell(c))).collect();
        let touched = model.forward(&sigma)?;
        row.assign(&(&touched - &reference).mapv(|dv| dv + NOISE_V * normal()));
    }
    Ok(differences)
}

/// Centre of the pixels above half of the largest value; total variation gives images with plateaus.
fn centre_m(image: &[f64], raster: &Raster) -> [f64; 2] {
    let half = 0.5 * image.iter().copied().fold(0.0, f64::max);
    let places = raster.masked_pixels().iter().map(|&[row, column]| raster.centre_m(row, column));
    let (mut sum, mut count) = ([0.0; 2], 0.0);
    for ([x, y], _) in places.zip(image).filter(|(_, value)| **value >= half) {
        sum = [sum[0] + x, sum[1] + y];
        count += 1.0;
    }
    sum.map(|s| s / count)
}

/// Simulates the frames and sets up the solver and its raster.
pub fn set_up() -> Result<(Array2<f64>, StTv, Raster), Box<dyn Error>> {
    let differences = measure()?;
    let (mesh, model) = skin(0.008)?;
    let raster = Raster::new(mesh.surface(), 32)?;
    let jacobian = model.jacobian(&vec![SHEET_S; model.elements()])?;
    let jacobian = raster.element_from_pixel().premultiply_dense(jacobian.view())?;
    let gradient = Gradient::pixels(raster.mask(), raster.pixel_m())?;
    let noise_std = Some(vec![NOISE_V; differences.ncols()]);
    let settings = StTvSettings { noise_std, lower_s: 0.0, ..Default::default() };
    let mut solver = StTv::new(&jacobian, &gradient, settings)?;
    // choose the weights from frames of the same skin, with the edge of a pixel as length
    let length_m = 0.2 / 32.0;
    solver.choose_weights(&DifferenceFrames::all_good(differences.view()), length_m)?;
    Ok((differences, solver, raster))
}

/// Streams the frames of the finger, then frames of the untouched skin.
pub fn run() -> Result<Outcome, Box<dyn Error>> {
    let (differences, solver, raster) = set_up()?;
    let settings = CausalSettings { target_gap: 1e-2, ..Default::default() };
    let mut stream = CausalStream::new(solver, settings)?;
    let mut outcome = Outcome { errors_m: Vec::new(), worst_gap: 0.0, quiet: 0 };
    let untouched = vec![0.0; differences.ncols()];
    for frame in 0..FRAMES + UNTOUCHED {
        let row = differences.rows().into_iter().nth(frame).map(|row| row.to_vec());
        let step = stream.push(row.as_ref().unwrap_or(&untouched), None)?;
        if step.quiet {
            outcome.quiet += 1;
            continue;
        }
        let gap = step.certificate.relative_gap();
        outcome.worst_gap = outcome.worst_gap.max(gap);
        if frame >= FRAMES {
            continue;
        }
        let ([x, y], finger) = (centre_m(step.image, &raster), finger_m(frame));
        outcome.errors_m.push((x - finger[0]).hypot(y - finger[1]));
        println!(
            "frame {frame}: finger at {:.0}, {:.0} mm, {} iterations, {:.1} ms, at \
             most {:.2} % above the optimum",
            1e3 * x,
            1e3 * y,
            step.iterations,
            1e3 * step.seconds,
            100.0 * gap
        );
    }
    println!("{} of {UNTOUCHED} frames without a touch cost nothing", outcome.quiet);
    Ok(outcome)
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
