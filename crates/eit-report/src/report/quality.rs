//! Image quality of every method against noise, speed and number of touches.

mod comparison;
mod tables;

use super::reconstruction_model::ReconstructionModel;
use super::scores::{Scores, Truth};
use super::solver::{BoundedMethod, METHODS, Solver};
use crate::Answer;
use crate::error::ReportError;
use crate::output::{OutFolder, io};
use crate::simulate::{FAST_M, Finger, FingerShape, SLOW_M, SequenceSettings, TouchSequence};
use comparison::{COMPARED, FULL, Grid, QUICK, Row, Speed};
use eit_inverse::{DifferenceFrames, Stop};
use eit_skin::frames::Frames;
use eit_skin::scene::Rule;
use eit_skin::{Progress, Skin};
use serde_json::json;

/// Hyperparameter rules; for each method with a hyperparameter, the better result in hindsight
/// counts. Cross-validation adapts to the noise but treats larger model errors as signal; noise
/// figure 1 adapts to neither.
const RULES: [Rule; 2] = [Rule::Gcv, Rule::NoiseFigure];

/// Target gap of iterative methods, the default of `eit reconstruct`. At 1e-3, no relative error of
/// the quick sequences at 40 to 70 dB changes by more than 0.024.
const TARGET_GAP: f64 = 1e-2;

/// Slow and fast fingers.
const SPEEDS: [Speed; 2] =
    [Speed { name: "slow", step_m: SLOW_M }, Speed { name: "fast", step_m: FAST_M }];

/// State shared by all runs.
struct Comparison<'a> {
    /// Reconstruction model.
    model: &'a ReconstructionModel,
    /// Simulation model.
    simulation: &'a Skin,
    grid: &'a Grid,
}

/// Simulates every sequence once, adds every noise level and runs every method.
pub(super) fn run(
    quick: bool,
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let grid = if quick { QUICK } else { FULL };
    let model = ReconstructionModel::paper_disc(grid.pixels, progress)?;
    let simulation = model.skin().with_nodes(SequenceSettings::default().nodes, progress)?;
    let comparison = Comparison { model: &model, simulation: &simulation, grid: &grid };
    let sequences = FingerShape::ALL.len() * SPEEDS.len() * grid.touches.len();
    let runs = sequences * grid.noise_db.len() * COMPARED;
    let rows = progress.steps("quality", runs, |bar| comparison.rows(bar))?;
    let note = comparison.note();
    let markdown = tables::markdown_of(&rows, &grid, &note);
    out.write("quality.md", |w| w.write_all(markdown.as_bytes()).map_err(io))?;
    out.write("quality.csv", |w| w.write_all(tables::csv(&rows).as_bytes()).map_err(io))?;
    let json = json!({
        "note": note,
        "rows": rows.iter().map(|row| json!({
            "finger": row.shape.name(),
            "noise_db": row.noise_db,
            "speed": row.speed,
            "touches": row.touches,
            "method": METHODS[row.method].name(),
            "scores": row.scores.json(),
            "seconds": row.seconds,
            "choice": row.choice,
        })).collect::<Vec<_>>(),
        "stages": progress.times(),
    });
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let text =
        format!("{markdown}\nwritten to {}: {}", out.path().display(), out.names().join(", "));
    Ok(Answer { text, json })
}

impl Comparison<'_> {
    /// Describes the comparison.
    fn note(&self) -> String {
        let nodes = |skin: &Skin| skin.mesh.surface().nodes().len();
        format!(
            "Simulated on {} nodes with the full non-linear model, reconstructed on {} nodes and \
             {} x {} pixels; {} frames per movie. Fingers raise the conductivity by half: bells of \
             12 mm standard deviation, or pads, flat with an edge, of 17 mm radius and the same \
             total change. Noise in decibels below the root mean square voltage, on frames and \
             reference. Slow: {} mm per frame, fast: {} mm per frame. Total variation uses the \
             weight rule of `eit reconstruct`; the other methods use the better, in hindsight, of \
             cross-validation and noise figure 1. \"Never below 0\": with the bound that pressing \
             only raises the conductivity.",
            nodes(self.simulation),
            nodes(self.model.skin()),
            self.grid.pixels,
            self.grid.pixels,
            self.grid.frames,
            1e3 * SLOW_M,
            1e3 * FAST_M
        )
    }

    /// Runs one thread per shape; rows are always in the same order.
    fn rows(&self, bar: &eit_skin::Steps<'_>) -> Result<Vec<Row>, ReportError> {
        std::thread::scope(|scope| {
            let threads =
                FingerShape::ALL.map(|shape| scope.spawn(move || self.rows_of_shape(shape, bar)));
            let mut rows = Vec::new();
            for thread in threads {
                let died = |_| ReportError::Failure("a thread of the report panicked".to_owned());
                rows.extend(thread.join().map_err(died)??);
            }
            Ok(rows)
        })
    }

    /// Runs all sequences with fingers of one shape.
    fn rows_of_shape(
        &self,
        shape: FingerShape,
        bar: &eit_skin::Steps<'_>,
    ) -> Result<Vec<Row>, ReportError> {
        let finger = Finger { shape, ..Default::default() };
        let mut rows = Vec::new();
        for speed in SPEEDS {
            for &touches in self.grid.touches {
                let (frames, step_m) = (self.grid.frames, speed.step_m);
                let settings =
                    SequenceSettings { touches, frames, step_m, finger, ..Default::default() };
                rows.extend(self.rows_of_sequence(&settings, speed.name, bar)?);
            }
        }
        Ok(rows)
    }

    /// Runs all noise levels and methods on one sequence.
    fn rows_of_sequence(
        &self,
        settings: &SequenceSettings,
        speed: &'static str,
        bar: &eit_skin::Steps<'_>,
    ) -> Result<Vec<Row>, ReportError> {
        let model = self.model;
        let sequence = TouchSequence::random(&model.skin().source, settings)?;
        let voltages = sequence.voltages(self.simulation, &mut Progress::silent())?;
        let conductivity_s = model.skin().conductivity_s;
        let pixels = model.pixels_of(sequence.truth(conductivity_s, &model.raster).view())?;
        let truth = Truth { pixels: &pixels, positions_m: &sequence.positions_m() };
        let mut rows = Vec::new();
        for &noise_db in self.grid.noise_db {
            let noise_std_v = voltages.noise_std_v(noise_db);
            let frames = voltages.with_noise(noise_std_v, settings.noise_seed)?;
            let noisy = NoisyFrames { frames: &frames, noise_std_v, truth: &truth };
            for (number, &method) in METHODS[..COMPARED].iter().enumerate() {
                let best = self.best(method, &noisy)?;
                bar.inc();
                let Some(Best { scores, seconds, choice }) = best else { continue };
                rows.push(Row {
                    shape: settings.finger.shape,
                    noise_db,
                    speed,
                    touches: settings.touches,
                    method: number,
                    scores,
                    seconds,
                    choice,
                });
            }
        }
        Ok(rows)
    }

    /// Runs a method with the better rule.
    fn best(
        &self,
        method: BoundedMethod,
        noisy: &NoisyFrames<'_>,
    ) -> Result<Option<Best>, ReportError> {
        let NoisyFrames { frames, noise_std_v, truth } = *noisy;
        let model = self.model;
        let values = frames.differences(model.difference_kind());
        let differences = DifferenceFrames::all_good(values.view());
        let rules = if method.method.is_tv() { &RULES[..1] } else { &RULES };
        let mut best: Option<Best> = None;
        for &rule in rules {
            let fitted = model.fit(frames, noise_std_v, method.settings(model, rule));
            let mut solver = Solver::new(model, &fitted, method.method)?;
            let stop = Stop { target_gap: TARGET_GAP, ..Default::default() };
            let found = solver.run(&differences, &stop)?;
            let scores = Scores::new(model, found.pixels.view(), truth)?;
            let before = best.as_ref().map_or(f64::INFINITY, |best| best.scores.relative_error);
            if scores.relative_error < before || best.is_none() {
                let (seconds, choice) = (found.report.seconds, solver.cost.choice);
                best = Some(Best { scores, seconds, choice });
            }
        }
        Ok(best)
    }
}

/// Frames of a sequence at one noise level.
struct NoisyFrames<'a> {
    frames: &'a Frames,
    noise_std_v: f64,
    truth: &'a Truth<'a>,
}

/// Result of a method with the better rule.
struct Best {
    scores: Scores,
    seconds: f64,
    choice: String,
}
