//! Plots the error of each frame before and after, and images, similar to the paper's figures 10 to
//! 15.

use crate::held_out::QUIET_FRAMES;
use crate::scores::errors;
use crate::variants::ImagedSequence;
use benches::Result;
use eit_picture::{FrameLabels, PictureSettings, Plot, Series, SkinDrawing, draw_plot, draw_sheet};
use eit_skin::Progress;
use eit_skin::denoise::Chain;
use ndarray::Axis;
use std::fs::File;
use std::path::Path;

/// The paper's two experiments are the first two sequences.
const FILES: [&str; 2] = ["mse_one_finger.png", "mse_two_fingers.png"];
/// Frames of each sequence in the picture of images.
const FRAMES: usize = 4;
/// Variants in that picture: raw and the first network. With the truth this makes three, and a row
/// holds six.
const VARIANTS: [usize; 2] = [0, 2];

/// Draws and writes the pictures.
pub(crate) fn draw(imaged: &[ImagedSequence], chain: &Chain, out: &Path) -> Result<()> {
    let linearised = &chain.linearised;
    let (mut labels, mut images) = (Vec::new(), Vec::new());
    for (ImagedSequence { sequence, variants }, file) in imaged.iter().zip(FILES) {
        let Some(truth) = &sequence.truth else { continue };
        let curves = variants.iter().map(|variant| {
            let errors = errors(variant.images.view(), truth.view());
            // errors of frames without a touch are orders of magnitude smaller and would flatten
            // the curves
            let least = 1e-4 * errors.iter().copied().fold(0.0, f64::max);
            let points = errors.iter().enumerate().map(|(f, e)| [(f + QUIET_FRAMES) as f64, *e]);
            let points = points.filter(|p| p[1] > least).collect();
            Series { name: variant.name.clone(), points, line: true, markers: false }
        });
        let picture = draw_plot(&Plot {
            title: format!("Mean squared error of each frame: {}", sequence.name),
            footnote: "against the true change of conductivity; simulated, not trained on"
                .to_owned(),
            x_label: "frame".to_owned(),
            y_label: "mean squared error (S²)".to_owned(),
            x_log: false,
            y_log: true,
            series: curves.collect(),
            zoom: 2,
        })?;
        picture.write_png(File::create(out.join(file))?)?;
        let count = sequence.touches.len();
        for k in 0..FRAMES {
            let frame = QUIET_FRAMES + 5 + k * (count - QUIET_FRAMES - 10) / FRAMES;
            labels.push(format!("frame {frame}: truth"));
            images.push(truth.index_axis(Axis(0), frame));
            for variant in VARIANTS.iter().filter_map(|k| variants.get(*k)) {
                labels.push(variant.name.clone());
                images.push(variant.images.index_axis(Axis(0), frame));
            }
        }
    }
    let stacked = ndarray::stack(Axis(0), &images)?;
    let skin = SkinDrawing::from_raster(
        &linearised.skin.mesh,
        linearised.raster(&mut Progress::silent())?,
    );
    let settings = PictureSettings {
        title: "Truth, raw image, and image after the U-net".to_owned(),
        footnote: format!(
            "{}; held-out scripts of the simulated fabric",
            chain.method.description()
        ),
        labels: FrameLabels::Text(labels),
        ..Default::default()
    };
    let sheet = draw_sheet(stacked.view(), &skin, &settings)?;
    Ok(sheet.write_png(File::create(out.join("denoised.png"))?)?)
}
