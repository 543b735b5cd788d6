//! `eit demo`: simulate on one mesh, reconstruct on another, write the pictures.
//!
//! The skin is `paper-disc`. One finger goes once around near the rim, then two fingers stand
//! opposite each other and turn. A finger raises the sheet conductivity in a bell of 12 mm. The
//! frames get additive noise; the reference frame is the untouched skin with noise of its own.

use super::{Answer, reconstruct};
use crate::cli::DemoArgs;
use crate::draw;
use crate::error::CliError;
use crate::method::Method;
use crate::output::{OutFolder, io, write_npy};
use crate::picture::{FrameLabels, PictureSettings, draw_sheet};
use crate::pipeline;
use crate::progress::Progress;
use crate::scene::Scene;
use crate::simulate::{Finger, FingerShape, TouchMovie};
use eit_inverse::metrics::{ChangeSign, correlation_coefficient, half_maximum_centre_m};
use ndarray::{Array1, Array3, Axis};
use serde_json::{Value, json};

/// Nodes of the mesh that simulates; the one that reconstructs has about 2 000.
const SIMULATION_NODES: usize = 7000;
/// Frames with one finger, then with two.
const FRAMES: [usize; 2] = [24, 16];
/// Seed of the noise.
const SEED: u64 = 20_190_620;
/// Noise, decibel below the root mean square voltage.
const NOISE_DB: f64 = 60.0;
/// What a finger does.
const FINGER: Finger = Finger { shape: FingerShape::Bell, sigma_m: 0.012, change: 0.5 };
/// Frames a second of the movie.
const RATE_HZ: f64 = 8.0;

/// Runs the demo.
pub(crate) fn run(args: &DemoArgs) -> Result<Answer, CliError> {
    let scene = Scene::load("paper-disc")?;
    let mut out = OutFolder::new(&args.out)?;
    let mut progress = Progress::default();
    let movie = TouchMovie { positions_m: touches(), finger: FINGER, rate_hz: RATE_HZ };
    let simulated = pipeline::setup(&scene, None, Some(SIMULATION_NODES), &mut progress)?;
    let voltages = movie.voltages(&scene, &simulated, &mut progress)?;
    let frames = voltages.with_noise(voltages.noise_std_v(NOISE_DB), SEED)?;

    let setup = pipeline::setup(&scene, None, None, &mut progress)?;
    let linearised = pipeline::linearise(&scene, &setup, &mut progress)?;
    let imaging = pipeline::imaging(&scene, &setup, &linearised, &frames, &mut progress)?;
    let images = imaging.images(&frames, &mut progress)?.into_parts().0;

    let truth = movie.truth(&scene, &imaging.raster);
    let scores = scores(&images, &truth, &imaging.raster, &movie.positions_m)?;
    let reference = Array1::from_vec(frames.reference.clone());
    out.write("frames.npy", |w| write_npy(&frames.values, w))?;
    out.write("reference.npy", |w| write_npy(&reference, w))?;
    out.write("images.npy", |w| write_npy(&images, w))?;
    out.write("truth.npy", |w| write_npy(&truth, w))?;
    let skin = draw::skin(&setup.mesh, &imaging.raster);
    let settings = PictureSettings {
        title: "paper-disc: one finger, then two".to_owned(),
        ..reconstruct::picture_settings(
            &scene,
            reconstruct::footnote(Method::GaussNewton, &imaging),
            Some(RATE_HZ),
        )
    };
    reconstruct::write_pictures(
        &mut out,
        images.view(),
        &skin,
        &settings,
        Some(RATE_HZ),
        &mut progress,
    )?;
    let compared = comparison(&images, &truth, &skin, &settings)?;
    out.write("truth_and_image.png", |w| Ok(compared.write_png(w)?))?;
    let report = json!({
        "scene": scene.name,
        "simulation_nodes": simulated.mesh.surface().nodes().len(),
        "reconstruction_nodes": setup.mesh.surface().nodes().len(),
        "frames": images.shape()[0],
        "noise_of_rms_voltage": 10_f64.powf(-NOISE_DB / 20.0),
        "seed": SEED,
        "hyperparameter": imaging.difference.report().hyperparameter,
        "hyperparameter_rule": imaging.rule,
        "scores": scores,
        "stages": progress.times(),
        "files": out.names(),
    });
    out.write("report.json", |w| writeln!(w, "{report:#}").map_err(io))?;
    let text = format!(
        "simulated {} frames on {} nodes, reconstructed on {} nodes\n\
         one finger: median position error {:.1} mm, correlation with the truth {:.2}\n\
         two fingers: correlation with the truth {:.2}\n\
         look at {}",
        images.shape()[0],
        report["simulation_nodes"],
        report["reconstruction_nodes"],
        1e3 * scores["one_finger_position_error_m"].as_f64().unwrap_or(f64::NAN),
        scores["one_finger_correlation"].as_f64().unwrap_or(f64::NAN),
        scores["two_fingers_correlation"].as_f64().unwrap_or(f64::NAN),
        out.path().join("truth_and_image.png").display()
    );
    out.commit(&[])?;
    Ok(Answer { text, json: report })
}

/// Finger positions of each frame, metres.
fn touches() -> Vec<Vec<[f64; 2]>> {
    let at = |radius: f64, turns: f64| {
        let angle = std::f64::consts::TAU * (turns + 0.25);
        [radius * angle.cos(), radius * angle.sin()]
    };
    let one = (0..FRAMES[0]).map(|f| vec![at(0.065, f as f64 / FRAMES[0] as f64)]);
    let two = (0..FRAMES[1]).map(|f| {
        let turns = -0.5 * f as f64 / FRAMES[1] as f64;
        vec![at(0.055, turns), at(0.055, turns + 0.5)]
    });
    one.chain(two).collect()
}

/// Position error of the one-finger frames and correlation with the truth.
fn scores(
    images: &Array3<f64>,
    truth: &Array3<f64>,
    raster: &eit_mesh::Raster,
    touches: &[Vec<[f64; 2]>],
) -> Result<Value, CliError> {
    let mut errors = Vec::new();
    let mut correlations = Vec::new();
    let areas = raster.covered_areas_m2();
    let positions_m: Vec<[f64; 2]> =
        raster.masked_pixels().iter().map(|&[i, j]| raster.centre_m(i, j)).collect();
    for (f, fingers) in touches.iter().enumerate() {
        let pick = |array: &Array3<f64>| -> Vec<f64> {
            raster.masked_pixels().iter().map(|&[i, j]| array[[f, i, j]]).collect()
        };
        correlations.push(correlation_coefficient(&pick(images), &pick(truth), areas)?);
        if let [finger] = fingers[..] {
            let found =
                half_maximum_centre_m(&pick(images), areas, &positions_m, ChangeSign::Increase)?;
            // an image without any increase is as wrong as can be
            let [x, y] = found.unwrap_or([f64::INFINITY; 2]);
            errors.push((x - finger[0]).hypot(y - finger[1]));
        }
    }
    errors.sort_by(f64::total_cmp);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    Ok(json!({
        "one_finger_position_error_m": errors[errors.len() / 2],
        "one_finger_correlation": mean(&correlations[..FRAMES[0]]),
        "two_fingers_correlation": mean(&correlations[FRAMES[0]..]),
    }))
}

/// Truth and image side by side for frames chosen evenly from both parts.
fn comparison(
    images: &Array3<f64>,
    truth: &Array3<f64>,
    skin: &crate::picture::SkinDrawing,
    settings: &PictureSettings,
) -> Result<crate::picture::Canvas, CliError> {
    // four to a row: the truth stands over its image
    let chosen = [3, 14, FRAMES[0], FRAMES[0] + 10];
    let mut panels = Vec::new();
    let mut labels = Vec::new();
    for (name, source) in [("truth", truth), ("image", images)] {
        for f in chosen {
            panels.push(source.index_axis(Axis(0), f));
            labels.push(format!("{name}, frame {f}"));
        }
    }
    let stacked = ndarray::stack(Axis(0), &panels).map_err(|e| CliError::Failure(e.to_string()))?;
    let settings = PictureSettings { labels: FrameLabels::Text(labels), ..settings.clone() };
    Ok(draw_sheet(stacked.view(), skin, &settings)?)
}
