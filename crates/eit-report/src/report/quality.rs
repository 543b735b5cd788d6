//! Quality of every method over noise, speed and number of touches.

mod tables;

use super::bench::{Bench, ENTRANTS, Entry};
use super::scores::{Scores, Truth};
use crate::Answer;
use crate::error::ReportError;
use crate::output::{OutFolder, io};
use crate::simulate::{FAST_M, Finger, FingerShape, MovieSettings, SLOW_M, TouchMovie};
use eit_inverse::{DifferenceFrames, Stop};
use eit_skin::scene::Rule;
use eit_skin::{Progress, Skin};
use serde_json::json;

/// The methods compared: all but the absolute one, which takes a hundred times longer than the
/// others together and is in the race only.
const METHODS: usize = ENTRANTS.len() - 1;

/// Rules for the hyperparameter of the methods that have one; the better in hindsight counts.
/// Cross-validation sees the noise, but takes the error of the model for signal where that is
/// larger; noise figure 1 sees neither.
const RULES: [Rule; 2] = [Rule::Gcv, Rule::NoiseFigure];

/// Gap of the iterated methods, the default of `eit reconstruct`: at 1e-3 no relative error of the
/// quick movies at 40 to 70 dB changes by more than 0.024.
const TARGET_GAP: f64 = 1e-2;

/// What is varied.
struct Grid {
    noise_db: &'static [f64],
    touches: &'static [usize],
    frames: usize,
    pixels: usize,
}

const FULL: Grid = Grid {
    noise_db: &[30.0, 40.0, 50.0, 60.0, 70.0],
    touches: &[1, 2, 3, 4],
    frames: 12,
    pixels: 64,
};
const QUICK: Grid = Grid { noise_db: &[60.0], touches: &[1, 2], frames: 6, pixels: 32 };

/// Slow and fast.
const SPEEDS: [(&str, f64); 2] = [("slow", SLOW_M), ("fast", FAST_M)];

/// One method on one movie.
struct Row {
    shape: &'static str,
    noise_db: f64,
    speed: &'static str,
    touches: usize,
    entrant: usize,
    scores: Scores,
    seconds: f64,
    choice: String,
}

/// Simulates every movie once, adds every noise, runs every method.
pub(super) fn run(
    quick: bool,
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let grid = if quick { QUICK } else { FULL };
    let bench = Bench::new(grid.pixels, progress)?;
    let nodes = MovieSettings::default().nodes;
    let simulation = bench.skin().with_nodes(nodes, progress)?;
    let movies = FingerShape::ALL.len() * SPEEDS.len() * grid.touches.len();
    let runs = movies * grid.noise_db.len() * METHODS;
    let (bench_ref, simulation_ref, grid_ref) = (&bench, &simulation, &grid);
    let rows = progress.steps("quality", runs, |bar| {
        // a thread for each shape; the rows come in the same order whatever their timing
        std::thread::scope(|scope| {
            let of_shape = |(name, shape)| {
                move || shape_rows((bench_ref, simulation_ref, grid_ref), (name, shape), bar)
            };
            let threads = FingerShape::ALL.map(|shape| scope.spawn(of_shape(shape)));
            let mut rows = Vec::new();
            for thread in threads {
                let died = |_| ReportError::Failure("a thread of the report died".to_owned());
                rows.extend(thread.join().map_err(died)??);
            }
            Ok::<_, ReportError>(rows)
        })
    })?;
    let note = note(&bench, &simulation, &grid);
    let markdown = tables::markdown_of(&rows, &grid, &note);
    out.write("quality.md", |w| w.write_all(markdown.as_bytes()).map_err(io))?;
    out.write("quality.csv", |w| w.write_all(tables::csv(&rows).as_bytes()).map_err(io))?;
    let json = json!({
        "note": note,
        "rows": rows.iter().map(|row| json!({
            "finger": row.shape,
            "noise_db": row.noise_db,
            "speed": row.speed,
            "touches": row.touches,
            "method": ENTRANTS[row.entrant].name(),
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

/// What was compared, in words.
fn note(bench: &Bench, simulation: &Skin, grid: &Grid) -> String {
    format!(
        "Simulated on {} nodes with the full non-linear model, reconstructed on {} nodes and {} x \
         {} pixels; {} frames a movie. Fingers raise the conductivity by half: bells of 12 mm \
         standard deviation, or pads, flat with an edge, of 17 mm radius and the same amount. Noise \
         in decibel below the root mean square voltage, on frames and reference. Slow: {} mm a \
         frame, fast: {} mm. Weights of total variation by the rule of `eit reconstruct`; \
         of the others the better, in hindsight, of cross-validation and noise figure 1. \"Never \
         below 0\": with the bound that pressing only raises the conductivity.",
        simulation.mesh.surface().nodes().len(),
        bench.skin().mesh.surface().nodes().len(),
        grid.pixels,
        grid.pixels,
        grid.frames,
        1e3 * SLOW_M,
        1e3 * FAST_M
    )
}

/// All movies of fingers of one shape.
fn shape_rows(
    (bench, simulation, grid): (&Bench, &Skin, &Grid),
    (name, shape): (&'static str, FingerShape),
    bar: &eit_skin::Steps<'_>,
) -> Result<Vec<Row>, ReportError> {
    let finger = Finger { shape, ..Default::default() };
    let mut rows = Vec::new();
    for (speed, step_m) in SPEEDS {
        for &touches in grid.touches {
            let frames = grid.frames;
            let settings = MovieSettings { touches, frames, step_m, finger, ..Default::default() };
            rows.extend(movie_rows(bench, simulation, grid, ((name, speed), &settings), bar)?);
        }
    }
    Ok(rows)
}

/// All noise levels and methods on one movie.
fn movie_rows(
    bench: &Bench,
    simulation: &Skin,
    grid: &Grid,
    ((shape, speed), settings): ((&'static str, &'static str), &MovieSettings),
    bar: &eit_skin::Steps<'_>,
) -> Result<Vec<Row>, ReportError> {
    let movie = TouchMovie::random(&bench.skin().source, settings)?;
    let voltages = movie.voltages(simulation, &mut Progress::silent())?;
    let pixels = bench.pixels_of(movie.truth(bench.skin().conductivity_s, &bench.raster).view())?;
    let truth = Truth { pixels: &pixels, positions_m: &movie.positions_m };
    let mut rows = Vec::new();
    for &noise_db in grid.noise_db {
        let noise_std_v = voltages.noise_std_v(noise_db);
        let frames = voltages.with_noise(noise_std_v, settings.noise_seed)?;
        let values = frames.differences(bench.kind());
        let differences = DifferenceFrames::all_good(values.view());
        for (entrant, &competitor) in ENTRANTS[..METHODS].iter().enumerate() {
            let rules = if competitor.method.is_tv() { &RULES[..1] } else { &RULES };
            let mut best: Option<(Scores, f64, String)> = None;
            for &rule in rules {
                let fitted = bench.fitted(&frames, noise_std_v, competitor.settings(bench, rule));
                let mut entry = Entry::new(bench, &fitted, competitor.method)?;
                let stop = Stop { target_gap: TARGET_GAP, ..Default::default() };
                let found = entry.run(&differences, &stop)?;
                let scores = Scores::new(bench, found.pixels.view(), &truth)?;
                let before = best.as_ref().map_or(f64::INFINITY, |best| best.0.relative_error);
                if scores.relative_error < before || best.is_none() {
                    best = Some((scores, found.report.seconds, entry.choice));
                }
            }
            bar.inc();
            let Some((scores, seconds, choice)) = best else { continue };
            rows.push(Row {
                shape,
                noise_db,
                speed,
                touches: settings.touches,
                entrant,
                scores,
                seconds,
                choice,
            });
        }
    }
    Ok(rows)
}
