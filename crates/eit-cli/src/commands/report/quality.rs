//! Quality of every method over noise, speed and number of touches.

use super::bench::{Bench, ENTRANTS, Entry};
use super::scores::{Greit, Scores, Truth};
use super::{Answer, markdown};
use crate::error::CliError;
use crate::method::Method;
use crate::output::{OutFolder, io};
use crate::pipeline;
use crate::progress::Progress;
use crate::scene::Rule;
use crate::simulate::{FAST_M, Finger, FingerShape, MovieSettings, SLOW_M, TouchMovie};
use eit_inverse::{Differences, Stop};
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
) -> Result<Answer, CliError> {
    let grid = if quick { QUICK } else { FULL };
    let bench = Bench::new(grid.pixels, progress)?;
    let nodes = MovieSettings::default().nodes;
    let simulation = pipeline::setup(&bench.scene, None, Some(nodes), progress)?;
    let movies = FingerShape::ALL.len() * SPEEDS.len() * grid.touches.len();
    let runs = movies * grid.noise_db.len() * METHODS;
    let rows = progress.steps("quality", runs, |bar| {
        let mut rows = Vec::new();
        for (shape_name, shape) in FingerShape::ALL {
            let finger = Finger { shape, ..Default::default() };
            for (speed, step_m) in SPEEDS {
                for &touches in grid.touches {
                    let frames = grid.frames;
                    let settings =
                        MovieSettings { touches, frames, step_m, finger, ..Default::default() };
                    let names = (shape_name, speed);
                    rows.extend(movie_rows(&bench, &simulation, &grid, (names, &settings), bar)?);
                }
            }
        }
        Ok::<_, CliError>(rows)
    })?;
    let note = format!(
        "Simulated on {} nodes with the full non-linear model, reconstructed on {} nodes and {} x \
         {} pixels; {} frames a movie. Fingers raise the conductivity by half: bells of 12 mm \
         standard deviation, or pads, flat with an edge, of 17 mm radius and the same amount. Noise \
         in decibel below the root mean square voltage, on frames and reference. Slow: {} mm a \
         frame, fast: {} mm. Weights of total variation by the rule of `eit reconstruct`; \
         of the others the better, in hindsight, of cross-validation and noise figure 1. \"Never \
         below 0\": with the bound that pressing only raises the conductivity.",
        simulation.mesh.surface().nodes().len(),
        bench.setup.mesh.surface().nodes().len(),
        grid.pixels,
        grid.pixels,
        grid.frames,
        1e3 * SLOW_M,
        1e3 * FAST_M
    );
    let markdown = report(&rows, &grid, &note);
    out.write("quality.md", |w| w.write_all(markdown.as_bytes()).map_err(io))?;
    out.write("quality.csv", |w| w.write_all(csv(&rows).as_bytes()).map_err(io))?;
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

/// All noise levels and methods on one movie.
fn movie_rows(
    bench: &Bench,
    simulation: &pipeline::Setup,
    grid: &Grid,
    ((shape, speed), settings): ((&'static str, &'static str), &MovieSettings),
    bar: &indicatif::ProgressBar,
) -> Result<Vec<Row>, CliError> {
    let movie = TouchMovie::random(&bench.scene, settings)?;
    let voltages = movie.voltages(&bench.scene, simulation, &mut Progress::silent())?;
    let pixels = bench.pixels_of(movie.truth(&bench.scene, &bench.raster).view())?;
    let truth = Truth { pixels: &pixels, positions_m: &movie.positions_m };
    let mut rows = Vec::new();
    for &noise_db in grid.noise_db {
        let noise_std_v = voltages.noise_std_v(noise_db);
        let frames = voltages.with_noise(noise_std_v, settings.noise_seed)?;
        let values = frames.differences(bench.kind());
        let differences = Differences::all_good(values.view());
        for (entrant, &competitor) in ENTRANTS[..METHODS].iter().enumerate() {
            let rules = if competitor.method.is_tv() { &RULES[..1] } else { &RULES };
            let mut best: Option<(Scores, f64, String)> = None;
            for &rule in rules {
                let mut entry = Entry::new(bench, (competitor, rule), &frames, noise_std_v)?;
                let stop = Stop { target_gap: TARGET_GAP, ..Default::default() };
                let (found, report) = entry.run(&differences, &stop)?;
                let scores = Scores::new(bench, found.view(), &truth)?;
                let before = best.as_ref().map_or(f64::INFINITY, |best| best.0.relative_error);
                if scores.relative_error < before || best.is_none() {
                    best = Some((scores, report.seconds, entry.choice));
                }
            }
            bar.inc(1);
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

/// A figure of merit in a table.
struct Figure {
    title: &'static str,
    value: fn(&Scores) -> f64,
    digits: usize,
    /// Whether more is better.
    more: bool,
}

const FIGURES: [Figure; 5] = [
    Figure {
        title: "Relative error (0 best, 1 for an empty image)",
        value: |s| s.relative_error,
        digits: 3,
        more: false,
    },
    Figure { title: "Correlation", value: |s| s.correlation, digits: 3, more: true },
    Figure {
        title: "Structural similarity (SSIM)",
        value: |s| s.similarity,
        digits: 3,
        more: true,
    },
    Figure {
        title: "Position error of found fingers, mm",
        value: |s| 1e3 * s.position_error_m,
        digits: 1,
        more: false,
    },
    Figure { title: "Part of the fingers found", value: |s| s.found, digits: 2, more: true },
];

fn report(rows: &[Row], grid: &Grid, note: &str) -> String {
    let mut text = format!("# Quality of every method\n\n{note} Best of a row in bold.\n");
    for figure in &FIGURES {
        text += &format!("\n## {}\n\nMean over the numbers of touches.\n\n", figure.title);
        text += &table(rows, figure, &["finger", "noise, dB", "speed"], &|row| {
            vec![row.shape.to_owned(), format!("{}", row.noise_db), row.speed.to_owned()]
        });
        text += "\nMean over noise levels and speeds.\n\n";
        text += &table(rows, figure, &["finger", "touches"], &|row| {
            vec![row.shape.to_owned(), row.touches.to_string()]
        });
    }
    text += "\n## GREIT figures of a single finger\n\nMean over frames and speeds: amplitude \
             response (1 best), position error in mm, resolution, shape deformation, ringing (0 \
             best).\n\n";
    text += &greit_table(rows, grid);
    text += &format!("\n## Where st-tv is not the best by relative error\n\n{}", losses(rows));
    text
}

/// Means of a figure: one line for each key that rows have, one column a method.
fn table(
    rows: &[Row],
    figure: &Figure,
    keys: &[&str],
    key: &dyn Fn(&Row) -> Vec<String>,
) -> String {
    let mut lines: Vec<Vec<String>> = Vec::new();
    for row in rows {
        let key = key(row);
        if !lines.contains(&key) {
            lines.push(key);
        }
    }
    let body: Vec<Vec<String>> = lines
        .into_iter()
        .map(|line| {
            let means: Vec<f64> = (0..METHODS)
                .map(|entrant| {
                    let of = rows.iter().filter(|row| row.entrant == entrant && key(row) == line);
                    mean(of.map(|row| (figure.value)(&row.scores)))
                })
                .collect();
            let finite = means.iter().copied().filter(|m| m.is_finite());
            let better = |a: f64, b: f64| if figure.more { a.max(b) } else { a.min(b) };
            let best = finite.reduce(better).unwrap_or(f64::NAN);
            let cells = means.iter().map(|m| {
                let cell = format!("{m:.*}", figure.digits);
                if *m == best { format!("**{cell}**") } else { cell }
            });
            line.iter().cloned().chain(cells).collect()
        })
        .collect();
    let names: Vec<String> = ENTRANTS[..METHODS].iter().map(|entrant| entrant.name()).collect();
    let head: Vec<&str> = keys.iter().copied().chain(names.iter().map(String::as_str)).collect();
    markdown(&head, &body)
}

fn greit_table(rows: &[Row], grid: &Grid) -> String {
    type Of = fn(&Greit) -> f64;
    let figures: [(&str, Of); 5] = [
        ("AR", |g| g.amplitude_response),
        ("PE, mm", |g| 1e3 * g.position_error_m),
        ("RES", |g| g.resolution),
        ("SD", |g| g.shape_deformation),
        ("RNG", |g| g.ringing),
    ];
    let mut body = Vec::new();
    let levels =
        FingerShape::ALL.iter().flat_map(|shape| grid.noise_db.iter().map(|db| (shape.0, *db)));
    for (shape, noise_db) in levels {
        for (entrant, competitor) in ENTRANTS[..METHODS].iter().enumerate() {
            let of = |row: &&Row| {
                row.shape == shape && row.noise_db == noise_db && row.entrant == entrant
            };
            let single: Vec<Greit> =
                rows.iter().filter(of).filter_map(|row| row.scores.greit).collect();
            let cells = figures.iter().map(|(name, value)| {
                let digits = if name.ends_with("mm") { 1 } else { 2 };
                format!("{:.digits$}", mean(single.iter().map(value)))
            });
            body.push(
                [format!("{noise_db}"), competitor.name()].into_iter().chain(cells).collect(),
            );
        }
    }
    let head: Vec<&str> =
        ["finger", "noise, dB", "method"].into_iter().chain(figures.iter().map(|f| f.0)).collect();
    markdown(&head, &body)
}

/// Movies on which another method has a smaller error than both forms of st-tv.
fn losses(rows: &[Row]) -> String {
    let mut body = Vec::new();
    for movie in rows.chunks(METHODS) {
        let error = |row: &&Row| row.scores.relative_error;
        let least = |part: &mut dyn Iterator<Item = &'_ Row>| {
            part.map(|row| (error(&row), row.entrant)).min_by(|a, b| a.0.total_cmp(&b.0))
        };
        let is_st_tv = |row: &&Row| ENTRANTS[row.entrant].method == Method::StTv;
        let own = least(&mut movie.iter().filter(is_st_tv));
        let other = least(&mut movie.iter().filter(|row| !is_st_tv(row)));
        if let (Some(own), Some(other), Some(row)) = (own, other, movie.first())
            && other.0 < own.0
        {
            body.push(vec![
                row.shape.to_owned(),
                format!("{}", row.noise_db),
                row.speed.to_owned(),
                row.touches.to_string(),
                format!("{:.3}", own.0),
                format!("{:.3} ({})", other.0, ENTRANTS[other.1].name()),
            ]);
        }
    }
    if body.is_empty() {
        return "Nowhere.\n".to_owned();
    }
    markdown(
        &["finger", "noise, dB", "speed", "touches", "st-tv, better form", "best other"],
        &body,
    )
}

/// Mean of the finite values; NaN where there are none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) =
        values.filter(|v| v.is_finite()).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / count
}

fn csv(rows: &[Row]) -> String {
    let mut text = "finger,noise_db,speed,touches,method,relative_error,correlation,ssim,\
                    position_error_m,found,extra,amplitude_response,greit_position_error_m,\
                    resolution,shape_deformation,ringing,seconds,choice\n"
        .to_owned();
    for row in rows {
        let s = &row.scores;
        let g = s.greit.map_or_else(
            || ",,,,".to_owned(),
            |g| {
                format!(
                    "{},{},{},{},{}",
                    g.amplitude_response,
                    g.position_error_m,
                    g.resolution,
                    g.shape_deformation,
                    g.ringing
                )
            },
        );
        text += &format!(
            "{},{},{},{},\"{}\",{},{},{},{},{},{},{g},{},\"{}\"\n",
            row.shape,
            row.noise_db,
            row.speed,
            row.touches,
            ENTRANTS[row.entrant].name(),
            s.relative_error,
            s.correlation,
            s.similarity,
            s.position_error_m,
            s.found,
            s.extra,
            row.seconds,
            row.choice
        );
    }
    text
}
