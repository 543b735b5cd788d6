//! Accuracy of touch detection: false touches, position, discrimination, tracking and speed.

mod detectors;
mod electrodes;
mod estimators;
mod greit;
mod grid;
mod latency;
mod movement;
mod noise_levels;
mod pairs;
mod plots;
mod position;
mod reliability;
mod script_recording;
mod simulated_disc;
mod tracking_scores;
mod tracks;

use super::table::{self, TableReport};
use crate::Answer;
use crate::error::ReportError;
use crate::output::OutFolder;
use crate::settings::TouchPart;
use eit_skin::Progress;
use estimators::Estimator;
use grid::{FULL, QUICK};
use simulated_disc::{RINGS, SimulatedDisc};

/// Measures the requested parts and writes them.
pub(super) fn run(
    parts: &[TouchPart],
    quick: bool,
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let grid = if quick { QUICK } else { FULL };
    let wants = |part| parts.contains(&TouchPart::All) || parts.contains(&part);
    let disc = SimulatedDisc::new(grid.pixels, progress)?;
    let (levels, rings) = (grid.noise_db.len(), RINGS.len());
    let mut tables = Vec::new();
    if wants(TouchPart::Position) {
        let errors = progress
            .steps("positions", levels * rings, |bar| position::measure(&disc, &grid, bar))?;
        tables.push(position::table(&disc, &grid, &errors));
        plots::draw(&errors, out)?;
    }
    if wants(TouchPart::Movement) {
        let steps = movement::FABRICS * rings;
        tables.push(progress.steps("movement", steps, |bar| movement::table(&disc, &grid, bar))?);
    }
    if wants(TouchPart::Electrodes) {
        let steps = electrodes::steps(&grid);
        let made = progress.steps("electrodes", steps, |bar| electrodes::table(&disc, &grid, bar));
        tables.push(made?);
    }
    if wants(TouchPart::Pairs) {
        let steps = levels * rings * Estimator::ALL.len();
        let pairs = progress.steps("two points", steps, |bar| pairs::measure(&disc, &grid, bar))?;
        tables.push(pairs::table(&grid, &pairs));
    }
    if wants(TouchPart::Tracks) {
        let steps = tracks::MOST * (1 + levels);
        tables.push(progress.steps("tracks", steps, |bar| tracks::table(&disc, &grid, bar))?);
    }
    if wants(TouchPart::Reliability) {
        let told = progress.steps("reliability", reliability::steps(&grid), |bar| {
            reliability::measure(&disc, &grid, bar)
        })?;
        tables.insert(0, reliability::table(&grid, &told));
        reliability::draw(&told, out)?;
    }
    if wants(TouchPart::Greit) {
        let steps = grid.greit_radii.len() * greit::COMPARED;
        tables.push(progress.steps("greit", steps, |bar| greit::table(&disc, &grid, bar))?);
    }
    if wants(TouchPart::Latency) {
        tables.push(progress.steps("latency", 2, |bar| latency::table(&disc, &grid, bar))?);
    }
    let files = ["touches.md", "touches.csv", "touches.json"];
    let report = TableReport { title: "Touch figures", tables: &tables, files };
    table::write(&report, out, progress)
}
