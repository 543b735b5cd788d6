//! One frame, one image: the smallest program that shows where a skin is touched.
//!
//! It uses a mesh, a model and a linear reconstruction. Sequences, instruments and neural networks are
//! neither used nor linked (checked by `tests/one_frame.rs`).
//!
//! Run with `cargo run --release -p eit-inverse --example one_frame`.
#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_fem::{ForwardModel, PairProtocol};
use eit_inverse::{Laplace, LaplaceSettings, OneStepGaussNewton, OneStepSettings};
use eit_mesh::{Mesh, MeshSettings, Raster, RimElectrodes, SkinShape, generate};
use std::error::Error;

/// Conductivity of the untouched sheet, siemens per square.
const SHEET_S: f64 = 1e-5;
/// Where the skin is touched, metres.
const FINGER_M: [f64; 2] = [0.04, 0.03];

fn skin(edge_m: f64) -> Result<(Mesh, ForwardModel), Box<dyn Error>> {
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let disc = SkinShape::Disc { radius_m: 0.1 };
    let mesh = generate(&disc, &electrodes, &MeshSettings::with_edge(edge_m))?;
    let model = ForwardModel::new(&mesh, &PairProtocol::default().protocol()?, &[1e3; 16])?;
    Ok((mesh, model))
}

/// Simulates a touched and an untouched frame as measured by an instrument, volts.
fn measure() -> Result<[Vec<f64>; 2], Box<dyn Error>> {
    let (mesh, model) = skin(0.004)?;
    let away = |c: &[f64; 3]| (c[0] - FINGER_M[0]).hypot(c[1] - FINGER_M[1]);
    let touched = |c: &[f64; 3]| SHEET_S * (1.0 + 0.3 * (-0.5 * (away(c) / 0.01).powi(2)).exp());
    let touched: Vec<f64> = mesh.surface().centroids().iter().map(touched).collect();
    let untouched = vec![SHEET_S; touched.len()];
    Ok([model.forward(&touched)?.to_vec(), model.forward(&untouched)?.to_vec()])
}

/// Prints the image and returns the distance of the brightest pixel from the finger, metres.
pub fn run() -> Result<f64, Box<dyn Error>> {
    let [frame, reference_frame] = measure()?;
    let (mesh, model) = skin(0.006)?;
    let jacobian = model.jacobian(&vec![SHEET_S; model.elements()])?;
    let prior = Laplace::new(mesh.surface(), &LaplaceSettings::default())?;
    let inverse = OneStepGaussNewton::new(&jacobian, &prior, OneStepSettings::default())?;
    let raster = Raster::new(mesh.surface(), 32)?;
    let to_pixels = inverse.on_raster(raster.pixel_from_element())?;

    let pixels = to_pixels.reconstruct(&frame, &reference_frame)?;

    let largest = pixels.iter().copied().fold(0.0, f64::max);
    let image = raster.image_from_pixels(&pixels.to_vec())?;
    for row in image.rows() {
        // pixels outside the skin are NaN and stay blank
        let shade =
            |x: &f64| b" .:-=+*#%@"[((x / largest).max(0.0) * 9.0).round() as usize] as char;
        let line = |x: &f64| if x.is_nan() { [' '; 2] } else { [shade(x); 2] };
        println!("{}", row.iter().flat_map(line).collect::<String>());
    }
    let brightest = raster.masked_pixels().iter().max_by(|a, b| image[**a].total_cmp(&image[**b]));
    let [row, column] = *brightest.ok_or("a skin without pixels")?;
    let [x, y] = raster.centre_m(row, column);
    println!("touched at {:.0}, {:.0} mm", 1e3 * x, 1e3 * y);
    Ok((x - FINGER_M[0]).hypot(y - FINGER_M[1]))
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
