//! Image quality of every method on simulated touches of the paper's skin: against noise, speed and
//! number of touches, and the GREIT figures of merit across the disc.
//!
//! Usage: `quality [--quick] [--greit]`; prints tables, `--greit` only the last.
#![allow(clippy::print_stdout, reason = "the tables are this program's output")]

use benches::Result;
use benches::table::{Cell, Table};
use eit_fem::fabric::{Interpolation, Key, LinearResponse, Tip, TouchScript};
use eit_inverse::{DifferenceFrames, Stop};
use eit_report::comparison::{
    BoundedMethod, FAST_M, Finger, FingerShape, GreitFigures, METHODS, ReconstructionModel, SLOW_M,
    Scores, SequenceSettings, Solver, TouchSequence, Truth,
};
use eit_skin::scene::Rule;
use eit_skin::{Progress, Skin};

/// Methods: all except the last, the absolute one, which takes a hundred times longer than the others
/// together.
const METHODS_COMPARED: &[BoundedMethod] = METHODS.split_at(METHODS.len() - 1).0;
/// Hyperparameter rules; for each method with a hyperparameter, the better result in hindsight counts.
/// Cross-validation adapts to the noise but treats larger model errors as signal; noise figure 1 adapts
/// to neither.
const RULES: [Rule; 2] = [Rule::Gcv, Rule::NoiseFigure];
/// Target gap of iterative methods, the default of `eit reconstruct`. At 1e-3, no relative error of the
/// quick sequences at 40 to 70 dB changes by more than 0.024.
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

/// A sequence at a noise level, and the scores of each method.
struct Run {
    shape: FingerShape,
    noise_db: f64,
    speed: &'static str,
    touches: usize,
    scores: Vec<Scores>,
}

/// A figure of merit: heading, value, decimals, and whether more is better.
type Figure = (&'static str, fn(&Scores) -> f64, usize, bool);

const FIGURES: [Figure; 5] = [
    ("Relative error (0 best, 1 for an empty image)", |s| s.relative_error, 3, false),
    ("Correlation", |s| s.correlation, 3, true),
    ("Structural similarity (SSIM)", |s| s.similarity, 3, true),
    ("Position error of found fingers, mm", |s| 1e3 * s.position_error_m, 1, false),
    ("Fraction of the fingers found", |s| s.found, 2, true),
];

fn main() -> Result<()> {
    let (mut quick, mut only_greit) = (false, false);
    for argument in std::env::args().skip(1) {
        match argument.as_str() {
            "--quick" => quick = true,
            "--greit" => only_greit = true,
            other => return Err(format!("'{other}': only --quick and --greit are known").into()),
        }
    }
    let grid = if quick { QUICK } else { FULL };
    let mut silent = Progress::silent();
    let model = ReconstructionModel::new("paper-disc", grid.pixels, &mut silent)?;
    if !only_greit {
        let finer = model.skin().with_nodes(SequenceSettings::default().nodes, &mut silent)?;
        let runs = runs(&model, &finer, &grid)?;
        println!("{}", note(&model, &finer, &grid));
        for figure in &FIGURES {
            println!("\n{}", by_noise(figure, &runs));
            println!("{}", by_touches(figure, &runs));
        }
        println!("{}", greit_of_singles(&runs));
    }
    println!("{}", greit_over_the_disc(&model, quick)?);
    Ok(())
}

fn note(model: &ReconstructionModel, finer: &Skin, grid: &Grid) -> String {
    let nodes = |skin: &Skin| skin.mesh.surface().nodes().len();
    format!(
        "# Quality of every method\n\nSimulated on {} nodes with the full non-linear model, \
         reconstructed on {} nodes and {} x {} pixels; {} frames per sequence. Fingers raise the \
         conductivity by half: bells of 12 mm standard deviation, or pads, flat with an edge, of 17 mm \
         radius and the same total change. Noise in decibels below the root mean square voltage, on \
         frames and reference. Slow: {} mm per frame, fast: {} mm per frame. Total variation uses the \
         weight rule of `eit reconstruct`; the other methods use the better, in hindsight, of \
         cross-validation and noise figure 1. The best value of each row is in bold.",
        nodes(finer),
        nodes(model.skin()),
        grid.pixels,
        grid.pixels,
        grid.frames,
        1e3 * SLOW_M,
        1e3 * FAST_M
    )
}

/// Runs every method on every sequence; the two shapes on a thread each.
fn runs(model: &ReconstructionModel, finer: &Skin, grid: &Grid) -> Result<Vec<Run>> {
    std::thread::scope(|scope| {
        let of = |shape| {
            scope.spawn(move || runs_of(shape, model, finer, grid).map_err(|e| e.to_string()))
        };
        let mut runs = Vec::new();
        for thread in FingerShape::ALL.map(of) {
            runs.extend(thread.join().map_err(|_| "a thread panicked")??);
        }
        Ok(runs)
    })
}

fn runs_of(
    shape: FingerShape,
    model: &ReconstructionModel,
    finer: &Skin,
    grid: &Grid,
) -> Result<Vec<Run>> {
    let mut runs = Vec::new();
    for (speed, step_m) in [("slow", SLOW_M), ("fast", FAST_M)] {
        for &touches in grid.touches {
            let settings = SequenceSettings {
                touches,
                frames: grid.frames,
                step_m,
                finger: Finger { shape, ..Default::default() },
                ..Default::default()
            };
            let sequence = TouchSequence::random(&model.skin().source, &settings)?;
            for &noise_db in grid.noise_db {
                let scores = scores(model, finer, &sequence, noise_db, &RULES)?;
                runs.push(Run { shape, noise_db, speed, touches, scores });
            }
        }
    }
    Ok(runs)
}

/// Scores of each method on a sequence with noise, with the best of the rules.
fn scores(
    model: &ReconstructionModel,
    finer: &Skin,
    sequence: &TouchSequence,
    noise_db: f64,
    rules: &[Rule],
) -> Result<Vec<Scores>> {
    let voltages = sequence.voltages(finer, &mut Progress::silent())?;
    let noise_std_v = voltages.noise_std_v(noise_db);
    let frames = voltages.with_noise(noise_std_v, 1)?;
    let truth = sequence.truth(model.skin().conductivity_s, &model.raster);
    let pixels = model.pixels_of(truth.view())?;
    let truth = Truth { pixels: &pixels, positions_m: &sequence.positions_m() };
    let values = frames.differences(model.difference_kind());
    let differences = DifferenceFrames::all_good(values.view());
    let stop = Stop { target_gap: TARGET_GAP, ..Default::default() };
    let mut all = Vec::new();
    for &method in METHODS_COMPARED {
        let rules = if method.method.is_tv() { &rules[..1] } else { rules };
        let mut best: Option<Scores> = None;
        for &rule in rules {
            let fitted = model.fit(&frames, noise_std_v, method.settings(model, rule));
            let found = Solver::new(model, &fitted, method.method)?.run(&differences, &stop)?;
            let scores = Scores::new(model, found.pixels.view(), &truth)?;
            if best.is_none_or(|best| scores.relative_error < best.relative_error) {
                best = Some(scores);
            }
        }
        all.extend(best);
    }
    Ok(all)
}

/// Means of a figure over the numbers of touches, a row for each finger, noise and speed.
fn by_noise(figure: &Figure, runs: &[Run]) -> Table {
    let key = |run: &Run| {
        [run.shape.name().to_owned(), run.noise_db.to_string(), run.speed.to_owned()].to_vec()
    };
    let note = "Mean over the numbers of touches.";
    Table {
        title: figure.0,
        note: note.to_owned(),
        ..means(figure, runs, &["finger", "noise, dB", "speed"], key)
    }
}

/// Means of a figure over noise levels and speeds, a row for each finger and number of touches.
fn by_touches(figure: &Figure, runs: &[Run]) -> Table {
    let key = |run: &Run| [run.shape.name().to_owned(), run.touches.to_string()].to_vec();
    let note = "Mean over noise levels and speeds.";
    Table {
        title: figure.0,
        note: note.to_owned(),
        ..means(figure, runs, &["finger", "touches"], key)
    }
}

/// Means of a figure with a row for each key and a column for each method.
fn means(
    &(title, value, digits, more): &Figure,
    runs: &[Run],
    keys: &[&'static str],
    key: impl Fn(&Run) -> Vec<String>,
) -> Table {
    let mut all: Vec<Vec<String>> = Vec::new();
    for key in runs.iter().map(&key) {
        if !all.contains(&key) {
            all.push(key);
        }
    }
    let row = |wanted: Vec<String>| {
        let own: Vec<&Run> = runs.iter().filter(|run| key(run) == wanted).collect();
        let of = |method: usize| mean(own.iter().map(|run| value(&run.scores[method])));
        let means: Vec<f64> = (0..METHODS_COMPARED.len()).map(of).collect();
        let better = |a: f64, b: f64| if more { a.max(b) } else { a.min(b) };
        let best = means.iter().copied().reduce(better).unwrap_or(f64::NAN);
        let cells = means.iter().map(|mean| {
            let cell = format!("{mean:.digits$}");
            if *mean == best { format!("**{cell}**") } else { cell }
        });
        wanted.iter().cloned().chain(cells).map(Cell::Text).collect()
    };
    let names = METHODS_COMPARED.iter().map(|method| &*method.name().leak());
    let columns = keys.iter().copied().chain(names).collect();
    Table { title, note: String::new(), columns, rows: all.into_iter().map(row).collect() }
}

/// Mean of the finite values; NaN if there are none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) =
        values.filter(|v| v.is_finite()).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / count
}

/// Cells of the mean of GREIT figures.
fn greit_cells(figures: &[GreitFigures]) -> Vec<Cell> {
    let of = |value: fn(&GreitFigures) -> f64, digits| {
        Cell::Number(mean(figures.iter().map(value)), digits)
    };
    vec![
        of(|g| g.amplitude_response, 2),
        of(|g| 1e3 * g.position_error_m, 2),
        of(|g| g.resolution, 3),
        of(|g| g.shape_deformation, 2),
        of(|g| g.ringing, 2),
    ]
}

const GREIT: [&str; 5] = ["AR", "PE, mm", "RES", "SD", "RNG"];

/// GREIT figures of the sequences with one finger.
fn greit_of_singles(runs: &[Run]) -> Table {
    let mut rows = Vec::new();
    for slow in runs.iter().filter(|run| run.touches == 1 && run.speed == "slow") {
        for (number, method) in METHODS_COMPARED.iter().enumerate() {
            let same = runs.iter().filter(|run| {
                run.touches == 1 && run.shape == slow.shape && run.noise_db == slow.noise_db
            });
            let figures: Vec<GreitFigures> =
                same.filter_map(|run| run.scores[number].greit).collect();
            let names = [slow.shape.name().to_owned(), slow.noise_db.to_string(), method.name()];
            rows.push(names.into_iter().map(Cell::Text).chain(greit_cells(&figures)).collect());
        }
    }
    Table {
        title: "GREIT figures of a single finger",
        note:
            "Mean over frames and speeds: amplitude response (1 best), position error, resolution, \
               shape deformation, ringing (0 best)."
                .to_owned(),
        columns: ["finger", "noise, dB", "method"].into_iter().chain(GREIT).collect(),
        rows,
    }
}

/// GREIT figures of a bell held at several radii.
fn greit_over_the_disc(model: &ReconstructionModel, quick: bool) -> Result<Table> {
    const RADIUS_M: f64 = 0.010;
    const FRAMES: usize = 6;
    /// Between two electrodes, off the axes of symmetry.
    const ANGLE: f64 = 0.13;
    let parts: &[f64] = if quick { &[0.0, 0.6] } else { &[0.0, 0.2, 0.4, 0.6, 0.8, 0.9] };
    let finer = model.skin().with_nodes(9000, &mut Progress::silent())?;
    let mut rows = Vec::new();
    for part in parts {
        // the paper's skin has a radius of 0.1 m
        let position_m = [0.1 * part * ANGLE.cos(), 0.1 * part * ANGLE.sin()];
        let key = |frame: usize| Key {
            time_s: frame as f64 / 10.0,
            position_m,
            force_n: 1.0,
            radius_m: RADIUS_M,
        };
        let finger = eit_fem::fabric::Finger {
            id: 1,
            tip: Tip::Round,
            interpolation: Interpolation::Linear,
            keys: vec![key(0), key(FRAMES - 1)],
        };
        let script = TouchScript {
            name: "held".to_owned(),
            frame_rate_hz: 10.0,
            frames: FRAMES,
            quiet_frames: 0,
            fingers: vec![finger],
        };
        let response = LinearResponse { change_per_newton: 0.3 };
        let sequence = TouchSequence { script, response };
        let scores = scores(model, &finer, &sequence, 60.0, &[Rule::NoiseFigure])?;
        for (method, scores) in METHODS_COMPARED.iter().zip(scores) {
            let greit: Vec<GreitFigures> = scores.greit.into_iter().collect();
            let names = [part.to_string(), method.name()].map(Cell::Text);
            rows.push(names.into_iter().chain(greit_cells(&greit)).collect());
        }
    }
    Ok(Table {
        title: "GREIT figures of merit across the disc",
        note: format!(
            "A bell of 10 mm and 30 % held for {FRAMES} frames at each radius (relative to the skin's), \
             60 dB on frames and reference; means over the frames. Hyperparameter by noise figure 1, \
             weights of total variation by the rule of `eit reconstruct`. AR: amplitude response (1 \
             best); PE: absolute position error along the radius; RES: resolution; SD: shape \
             deformation; RNG: ringing (0 best). The truth's own RES is {:.3}.",
            // a bell is above a quarter of its peak within sigma sqrt(2 ln 4)
            RADIUS_M * (2.0 * 4.0_f64.ln()).sqrt() / 0.1
        ),
        columns: ["radius", "method"].into_iter().chain(GREIT).collect(),
        rows,
    })
}
