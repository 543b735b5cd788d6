//! Our side of `benches/compare_images.py`: the inverse problem of two fingers on the paper's skin at
//! 60 dB as arrays, and our times and errors on it.
//!
//! Usage: `peer_images FOLDER`; writes .npy files there and prints one JSON object per method: name,
//! milliseconds per frame, relative error.
#![allow(clippy::print_stdout, reason = "the results are this program's output")]

use benches::Result;
use eit_inverse::{DifferenceFrames, Stop};
use eit_report::comparison::{
    METHODS, ReconstructionModel, Scores, SequenceSettings, Solver, Truth, simulate,
};
use eit_skin::Progress;
use eit_skin::scene::Rule;
use ndarray::{Array1, Array2};
use serde_json::json;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<()> {
    let folder = std::env::args().nth(1).ok_or("name a folder for the arrays")?;
    let folder = Path::new(&folder);
    let mut silent = Progress::silent();
    let model = ReconstructionModel::new("paper-disc", 64, &mut silent)?;
    let settings = SequenceSettings { touches: 2, frames: 20, ..Default::default() };
    let made = simulate(model.skin(), &settings, &model.raster, &mut silent)?;
    let pixels = model.pixels_of(made.truth.view())?;
    let truth = Truth { pixels: &pixels, positions_m: &made.positions_m };
    let put = |name: &str, array: &Array2<f64>| {
        ndarray_npy::write_npy(folder.join(format!("{name}.npy")), array)
    };
    let fitted = model.fit(&made.frames, made.noise_std_v, model.settings().clone());
    let imaging = fitted.one_step(&mut silent)?;
    let on_pixels = imaging.difference.on_raster(model.raster.pixel_from_element())?;
    put("truth", &pixels)?;
    put("matrix", &on_pixels.reconstruction_matrix())?;
    put("frames", &fitted.differences())?;
    put("mask", &model.raster.mask().mapv(|inside| f64::from(u8::from(inside))))?;
    for method in METHODS.into_iter().filter(|method| method.method.is_tv()) {
        let settings = method.settings(&model, Rule::NoiseFigure);
        let fitted = model.fit(&made.frames, made.noise_std_v, settings);
        let mut solver = Solver::new(&model, &fitted, method.method)?;
        let values = fitted.differences();
        let differences = DifferenceFrames::all_good(values.view());
        for target_gap in [1e-1, 1e-2, 1e-3] {
            let stop = Stop { target_gap, ..Default::default() };
            let start = Instant::now();
            let found = solver.run(&differences, &stop)?;
            let ms = 1e3 * start.elapsed().as_secs_f64() / values.nrows() as f64;
            let error = Scores::new(&model, found.pixels.view(), &truth)?.relative_error;
            let name = format!("{}, gap {target_gap:.0e}", method.name());
            println!("{}", json!({ "name": name, "ms_a_frame": ms, "relative_error": error }));
        }
        if method != METHODS[0] {
            continue;
        }
        // the peer minimises the objective of st-tv with the same weights
        let Some(solver) = solver.into_total_variation() else { continue };
        let settings = solver.settings();
        let noise = settings.noise_std.clone().unwrap_or_else(|| vec![1.0; values.ncols()]);
        let used = &made.frames.used;
        let mut jacobian = model.linearised.pixel_jacobian(&model.raster, used)?;
        for (mut row, noise) in jacobian.rows_mut().into_iter().zip(&noise) {
            row.mapv_inplace(|j| j / noise);
        }
        put("whitened_jacobian", &jacobian)?;
        put("whitened_differences", &(&values / &Array1::from(noise)))?;
        let side = model.raster.pixel_m();
        let weights = [settings.lambda_space * side, settings.lambda_time * side * side];
        put("weights", &Array2::from_shape_vec((1, 2), weights.to_vec())?)?;
    }
    Ok(())
}
