//! `eit report`: error against run time of every method, image quality against noise, accuracy of
//! touch detection, and the effect of a U-net, all on simulated touches of built-in skins.

mod benchmark;
mod denoise;
mod markdown;
mod named_net;
mod quality;
mod reconstruction_model;
mod scores;
mod solver;
mod statistics;
mod table;
mod touches;

use crate::Answer;
use crate::error::ReportError;
use crate::output::OutFolder;
use crate::settings::ReportSettings;
use eit_skin::{Progress, StopFlag};

/// Output files of all parts: each run removes those of other parts.
const FILES: [&str; 23] = [
    "report.html",
    "report.md",
    "report.json",
    "incomplete.txt",
    // written by earlier versions
    "forward.png",
    "inverse.csv",
    "forward.csv",
    "plan.csv",
    "quality.md",
    "quality.csv",
    "touches.md",
    "touches.csv",
    "touches.json",
    "reliability.png",
    "position_centre.png",
    "position_half.png",
    "position_rim.png",
    "denoise.md",
    "denoise.csv",
    "denoise.json",
    "mse_one_finger.png",
    "mse_two_fingers.png",
    "denoised.png",
];

/// Runs the benchmark of error against run time, or the part selected in the settings: quality
/// tables, touch figures or U-nets.
///
/// # Errors
///
/// Settings that select no scene, weights that cannot be read, a folder that cannot be written to;
/// failures of solvers that a part needs.
pub fn run(
    settings: &ReportSettings,
    stop: &StopFlag,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let files: Vec<&str> = FILES.into_iter().chain(benchmark::pictures()).collect();
    if !(settings.quality || settings.denoise) && settings.touches.is_empty() {
        return benchmark::run(settings, &files, stop, progress);
    }
    let mut out = OutFolder::new(&settings.out)?;
    let answer = if settings.quality {
        quality::run(settings.quick, &mut out, progress)?
    } else if settings.denoise {
        denoise::run(settings, &mut out, progress)?
    } else {
        touches::run(&settings.touches, settings.quick, &mut out, progress)?
    };
    out.commit(&files)?;
    Ok(answer)
}
