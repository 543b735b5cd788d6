//! Two fingers on the built-in skin: touches from images, and the position of each finger fitted to the
//! frame.
//!
//! The data is simulated on a finer mesh than that of the reconstruction. Prints the positions and the
//! time per image.

#![allow(missing_docs, reason = "an example is read, not linked against")]
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use eit_fem::{ForwardModel, PairProtocol};
use eit_inverse::metrics::Cells;
use eit_inverse::touch::{
    Bell, FitSettings, NoiseFloor, TouchFit, TouchStream, TouchStreamSettings,
};
use eit_inverse::{
    HyperparameterChoice, Laplace, LaplaceSettings, NoiseTarget, OneStepGaussNewton,
    OneStepSettings,
};
use eit_mesh::{Mesh, MeshSettings, Raster, RimElectrodes, SkinShape, generate};
use std::error::Error;
use std::time::Instant;

const SHEET_S: f64 = 1e-5;
const FINGERS_M: [[f64; 2]; 2] = [[0.04, 0.01], [-0.03, -0.04]];
const IMAGES: usize = 2000;

/// Results of the example.
pub struct Outcome {
    /// Distance of each finger from its tracked touch, metres.
    pub image_errors_m: Vec<f64>,
    /// Distance of each finger from its fitted bell, metres.
    pub fit_errors_m: Vec<f64>,
    /// Median, 95th percentile and maximum of the time per image, seconds.
    pub push_s: [f64; 3],
}

fn model(edge_m: f64) -> Result<(Mesh, ForwardModel), Box<dyn Error>> {
    let skin = SkinShape::Disc { radius_m: 0.1 };
    let electrodes = RimElectrodes::equally_spaced(16, 0.0196);
    let mesh = generate(&skin, &electrodes, &MeshSettings::with_edge(edge_m))?;
    let protocol = PairProtocol { current_a: 1e-4, ..Default::default() }.protocol()?;
    let model = ForwardModel::new(&mesh, &protocol, &[1e3; 16])?;
    Ok((mesh, model))
}

/// A frame with both fingers and one without, volts.
fn measure() -> Result<(Vec<f64>, Vec<f64>), Box<dyn Error>> {
    let (mesh, model) = model(0.003)?;
    let pressed = |p: &[f64; 3]| {
        let bell = |c: &[f64; 2]| (-0.5 * ((p[0] - c[0]).hypot(p[1] - c[1]) / 0.01).powi(2)).exp();
        SHEET_S * (1.0 + 0.3 * FINGERS_M.iter().map(bell).sum::<f64>())
    };
    let sigma: Vec<f64> = mesh.surface().centroids().iter().map(pressed).collect();
    let rest = model.forward(&vec![SHEET_S; model.elements()])?;
    Ok((model.forward(&sigma)?.to_vec(), rest.to_vec()))
}

/// Finds the fingers.
pub fn run() -> Result<Outcome, Box<dyn Error>> {
    let (pressed, rest) = measure()?;
    // 60 dB below the root mean square of the reference
    let square = rest.iter().map(|v| v * v).sum::<f64>() / rest.len() as f64;
    let noise_std = vec![1e-3 * square.sqrt(); rest.len()];
    let (mesh, model) = model(0.005)?;
    let surface = mesh.surface();
    let sheet = vec![SHEET_S; model.elements()];
    let jacobian = model.jacobian(&sheet)?;
    let settings = OneStepSettings { noise_std: Some(noise_std.clone()), ..Default::default() };
    let prior = Laplace::new(surface, &LaplaceSettings::default())?;
    let mut inverse = OneStepGaussNewton::new(&jacobian, &prior, settings)?;
    let target = NoiseTarget::central(surface, &jacobian)?;
    inverse.choose_hyperparameter(&HyperparameterChoice::NoiseFigure {
        figure: 1.0,
        target: &target,
    })?;
    let raster = Raster::new(surface, 64)?;
    let to_pixels = inverse.on_raster(raster.pixel_from_element())?;

    let floor = NoiseFloor::of_reconstruction(&to_pixels, &noise_std)?;
    let cells = Cells::of_raster_on(&raster, surface)?;
    let mut stream = TouchStream::new(cells, floor, TouchStreamSettings::default())?;
    println!(
        "a touch begins at {:.2} standard deviations ({:.0} independent pixels)",
        stream.threshold(),
        stream.effective_cells()
    );
    // a small generator of noise: sums of twelve uniform numbers
    let mut state = 1_u64;
    let mut uniform = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
    let (mut workspace, mut image) = (to_pixels.workspace(), vec![0.0; to_pixels.image_len()]);
    let mut frame = pressed.clone();
    let mut times_s = Vec::with_capacity(IMAGES);
    for k in 0..IMAGES {
        for ((v, clean), e) in frame.iter_mut().zip(&pressed).zip(&noise_std) {
            *v = clean + e * normal();
        }
        to_pixels.reconstruct_into(&frame, &rest, &mut workspace, &mut image)?;
        let start = Instant::now();
        stream.push(&image, k as f64 / 20.0)?;
        times_s.push(start.elapsed().as_secs_f64());
    }
    times_s.sort_by(f64::total_cmp);
    let push_s = [IMAGES / 2, IMAGES * 95 / 100, IMAGES - 1].map(|k| times_s[k]);
    let touches = stream.touches().to_vec();

    let mut fit = TouchFit::new(&model, surface, &sheet, FitSettings::with_noise(noise_std))?;
    let start = |touch: &eit_inverse::touch::Touch| Bell {
        position_m: touch.position_m,
        amplitude: (touch.peak_s / SHEET_S).clamp(0.05, 2.0),
        radius_m: (touch.area_m2.unwrap_or_default() / std::f64::consts::PI).sqrt() / 1.18,
    };
    let starts: Vec<Bell> = touches.iter().map(start).collect();
    let (fitted, _) = fit.fit_number(&frame, &rest, &starts, 4)?;
    println!(
        "{} touches fitted in {:.0} ms, chi^2 {:.2} per degree of freedom",
        fitted.touches.len(),
        1e3 * fitted.seconds,
        fitted.reduced_chi_square()
    );
    let nearest = |places: &[[f64; 3]]| -> Vec<f64> {
        let to = |c: &[f64; 2]| {
            let distances = places.iter().map(|p| (p[0] - c[0]).hypot(p[1] - c[1]));
            distances.fold(f64::INFINITY, f64::min)
        };
        FINGERS_M.iter().map(to).collect()
    };
    let image_errors_m = nearest(&touches.iter().map(|t| t.position_m).collect::<Vec<_>>());
    let fit_errors_m =
        nearest(&fitted.touches.iter().map(|t| t.bell.position_m).collect::<Vec<_>>());
    for (image_m, fit_m) in image_errors_m.iter().zip(&fit_errors_m) {
        println!("image {:.2} mm off, fit {:.2} mm off", 1e3 * image_m, 1e3 * fit_m);
    }
    println!(
        "an image takes {:.0} us, 95 % {:.0} us, at most {:.0} us",
        1e6 * push_s[0],
        1e6 * push_s[1],
        1e6 * push_s[2]
    );
    Ok(Outcome { image_errors_m, fit_errors_m, push_s })
}

fn main() -> Result<(), Box<dyn Error>> {
    run().map(|_| ())
}
