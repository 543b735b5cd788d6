//! `eit report`: error against run time of every method, their quality over noise, how well touches
//! are found, and what a U-net makes of it, all on simulated touches of built-in skins.

mod bench;
mod denoise;
mod quality;
mod race;
mod scores;
mod table;
mod touches;

use crate::Answer;
use crate::error::ReportError;
use crate::output::OutFolder;
use crate::settings::ReportSettings;
use eit_skin::{Progress, StopFlag};

/// Files of the parts: each run removes those of the others that it does not make.
const FILES: [&str; 22] = [
    "report.html",
    "report.md",
    "report.json",
    "incomplete.txt",
    // of earlier versions
    "forward.png",
    "inverse.csv",
    "forward.csv",
    "plan.csv",
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

/// Runs the race, the table of quality, the touch figures or those of nets.
pub fn run(
    args: &ReportSettings,
    stop: &StopFlag,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    if !(args.quality || args.denoise) && args.touches.is_empty() {
        return race::run(args, stop, progress);
    }
    let mut out = OutFolder::new(&args.out)?;
    let answer = if args.quality {
        quality::run(args.quick, &mut out, progress)?
    } else if args.denoise {
        denoise::run(args, &mut out, progress)?
    } else {
        touches::run((&args.touches, args.quick), &mut out, progress)?
    };
    out.commit(&files())?;
    Ok(answer)
}

/// Names of every file of the report: a run removes those that it does not make.
fn files() -> Vec<&'static str> {
    FILES.into_iter().chain(race::pictures()).collect()
}

/// A Markdown table.
fn markdown(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let names: Vec<String> = head.iter().map(|name| (*name).to_owned()).collect();
    let rule = format!("|{}\n", "---|".repeat(head.len()));
    let body: String = rows.iter().map(|row| line(row)).collect();
    format!("{}{rule}{body}", line(&names))
}
