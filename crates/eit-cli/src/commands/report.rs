//! `eit report`: error against run time of every method, their quality over noise, how well
//! touches are found, and what a U-net makes of it, all on simulated touches of the built-in skin and all from one run.

mod bench;
mod denoise;
mod quality;
mod race;
mod scores;
mod table;
mod touches;

#[cfg(test)]
pub(crate) use race::case::CASES;

use super::Answer;
use crate::cli::ReportArgs;
use crate::error::CliError;
use crate::output::OutFolder;
use crate::progress::Progress;

/// Files of the parts: each run removes those of the others that it does not make.
const FILES: [&str; 36] = [
    "report.html",
    "forward.png",
    "inverse.csv",
    "forward.csv",
    "plan.csv",
    "error_paper_disc_60.png",
    "error_paper_disc_40.png",
    "error_paper_fabric.png",
    "images_paper_fabric.png",
    "error_stiff_contact.png",
    "error_high_contrast.png",
    "error_general_32.png",
    "error_single_frame.png",
    "images_paper_disc_60.png",
    "images_paper_disc_40.png",
    "images_stiff_contact.png",
    "images_high_contrast.png",
    "images_general_32.png",
    "images_single_frame.png",
    // of an earlier version
    "images.png",
    "report.md",
    "report.json",
    "quality.md",
    "quality.csv",
    "touches.md",
    "touches.csv",
    "touches.json",
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

/// Runs the race, the table of quality or the touch figures.
pub(crate) fn run(args: &ReportArgs) -> Result<Answer, CliError> {
    let mut out = OutFolder::new(&args.out)?;
    let mut progress = Progress::default();
    let answer = if args.quality {
        quality::run(args.quick, &mut out, &mut progress)?
    } else if args.denoise {
        denoise::run(args, &mut out, &mut progress)?
    } else if !args.touches.is_empty() {
        touches::run((&args.touches, args.quick), &mut out, &mut progress)?
    } else {
        race::run(args, &mut out, &mut progress)?
    };
    out.commit(&FILES)?;
    Ok(answer)
}

/// A Markdown table.
fn markdown(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let names: Vec<String> = head.iter().map(|name| (*name).to_owned()).collect();
    let rule = format!("|{}\n", "---|".repeat(head.len()));
    let body: String = rows.iter().map(|row| line(row)).collect();
    format!("{}{rule}{body}", line(&names))
}
