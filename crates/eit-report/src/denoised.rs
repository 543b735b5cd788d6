//! `eit net apply`: applies a trained U-net to images.

use crate::error::ReportError;
use crate::output::{OutFolder, io, read_images, write_npy};
use crate::settings::DenoiseImages;
use crate::{Answer, reconstruct};
use eit_denoise::ThresholdRule;
use eit_skin::denoise::{Net, NetTarget, scores};
use eit_skin::scene::DenoiseSettings;
use eit_skin::{MeshOverride, Progress, Scene, Skin};
use ndarray::Array3;
use serde_json::json;

/// Images, their truth where it is known, and the net for them.
struct Input {
    raw: Array3<f64>,
    truth: Option<Array3<f64>>,
    net: Net,
}

/// Reads images and weights and checks both against the scene.
fn input(args: &DenoiseImages, scene: &Scene) -> Result<Input, ReportError> {
    scene.refuse_movement("net apply")?;
    let of_scene = scene.stage_settings().denoise;
    let name = args.weights.clone().or(of_scene.map(|keys| keys.weights)).ok_or_else(|| {
        ReportError::input(
            "no weights: give --weights default, a file of `eit net train`, or [denoise]",
        )
    })?;
    let raw = read_images(&args.images)?;
    let (frames, rows, columns) = raw.dim();
    if frames == 0 || rows != columns || rows == 0 {
        return Err(ReportError::input(format!(
            "{}: {frames} images of {rows} x {columns} pixels; at least one is needed, and images \
             must be square",
            args.images.display()
        )));
    }
    let allowed = scene.denoise.as_ref().is_some_and(|keys| keys.any_skin);
    let settings = DenoiseSettings { weights: name, any_skin: args.any_skin || allowed };
    let fingerprint = &scene.skin_fingerprint()?;
    let target = NetTarget { fingerprint, pixels: rows, sign: scene.touch.sign };
    let net = Net::load(&settings, &target)?.for_images();
    let truth = args.truth.as_deref().map(read_images).transpose()?;
    if let Some(truth) = truth.as_ref().filter(|truth| truth.dim() != raw.dim()) {
        return Err(ReportError::input(format!(
            "--truth has the shape [frame, row, column] = {:?}, but the images have {:?}",
            truth.shape(),
            raw.shape()
        )));
    }
    Ok(Input { raw, truth, net })
}

/// Reads images and weights, checks both against the scene, denoises the images, and writes
/// pictures and a report.
///
/// # Errors
///
/// Files that cannot be read, weights or images that do not fit the scene, and an output folder that cannot be
/// written.
pub fn run(args: &DenoiseImages, progress: &mut Progress) -> Result<Answer, ReportError> {
    let mut scene = Scene::load(&args.scene)?;
    let Input { raw, truth, net } = input(args, &scene)?;
    let (frames, rows, _) = raw.dim();
    let mut out = OutFolder::new(&args.out)?;
    // the number of pixels is that of the images
    scene.reconstruction.pixels = Some(rows);
    let skin = Skin::set_up(&scene, &MeshOverride::default(), progress)?;
    let raster = skin.raster(progress)?;
    let mut images = raw.clone();
    let applied = net.apply(&mut images, &raster, None, progress);
    applied.map_err(|e| e.within(&args.images.display().to_string()))?;
    let compared = match &truth {
        None => None,
        Some(truth) => {
            let mut rule = ThresholdRule::default().on(raster.mask().view())?;
            Some(scores(raw.view(), images.view(), truth.view(), &mut rule)?)
        }
    };
    out.write("images.npy", |w| write_npy(&images, w))?;
    let drawing = eit_picture::SkinDrawing::from_raster(&skin.mesh, &raster);
    let rate_hz = scene.recording.frame_rate_hz;
    let settings = reconstruct::picture_settings(&scene.name, "U-net".to_owned(), rate_hz);
    let range = (rate_hz, 0.0);
    reconstruct::write_pictures(&mut out, images.view(), &drawing, &settings, range, progress)?;
    let json = json!({
        "scene": scene.name,
        "frames": frames,
        "pixels": rows,
        "denoise": net.json(),
        "against_truth": compared,
        "stages": progress.times(),
    });
    let json = reconstruct::with_files(json, &out);
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let mut lines = vec![
        format!("{frames} images; {}", net.description()),
        "not checked against measurements; `eit reconstruct` with [denoise] does that".to_owned(),
    ];
    lines.extend(compared.map(|s| s.description()));
    lines.push(format!("written to {}: {}", out.path().display(), out.names().join(", ")));
    out.commit(&["movie.gif"])?;
    Ok(Answer { text: lines.join("\n"), json })
}
