//! Compares the predictions of `eit plan` for the built-in scenes with measurements; the table of
//! `docs/PERFORMANCE.md`.
//!
//! Usage: `plan_check [--dry-run]`. Each scene is planned with its noise given, for its own method and
//! for one-step images, and run on recordings with other paths and noise than those of the table that
//! plans use. `--dry-run` only prints the table.
#![allow(clippy::print_stdout, reason = "the table is this program's output")]

use benches::table::{Cell, Table};
use benches::{Result, document};
use eit_core::median;
use eit_inverse::DifferenceFrames;
use eit_report::comparison::{
    BoundedMethod, Finger, FingerShape, ReconstructionModel, Scores, SequenceSettings,
    SimulatedSequence, Solver, Truth, simulate,
};
use eit_skin::method::{self, Method};
use eit_skin::plan::Plan;
use eit_skin::scene::{OneOrManyFiles, Rule};
use eit_skin::{Progress, Skin, total_variation};
use ndarray::Array2;
use std::time::Instant;

/// Number of timings of each stage; the median counts.
const REPEATS: usize = 3;
/// Pixels across the skin.
const PIXELS: usize = 64;

/// Name in the table of plans, built-in scene, noise in decibels, relative change under a finger, and
/// number of frames.
const SCENES: [(&str, &str, f64, f64, usize); 6] = [
    ("paper-disc-60", "paper-disc", 60.0, 0.5, 20),
    ("paper-disc-40", "paper-disc", 40.0, 0.5, 20),
    ("stiff-contact", "stiff-contact", 60.0, 0.5, 20),
    ("high-contrast", "high-contrast", 60.0, 10.0, 20),
    ("general-32", "general-32", 60.0, 0.5, 20),
    ("single-frame", "single-frame", 60.0, 0.5, 1),
];

/// Stages with their median times, seconds.
type Times = Vec<(&'static str, f64)>;

fn main() -> Result<()> {
    let dry_run = std::env::args().nth(1).is_some_and(|argument| argument == "--dry-run");
    let mut rows = Vec::new();
    for (name, scene, noise_db, change, frames) in SCENES {
        let model = ReconstructionModel::new(scene, PIXELS, &mut Progress::silent())?;
        let of = |shape| {
            let settings = SequenceSettings {
                touches: 2,
                frames,
                finger: Finger { shape, change, ..Default::default() },
                noise_db,
                // the table of plans is measured with seed 1
                path_seed: 2,
                noise_seed: 2,
                ..Default::default()
            };
            simulate(model.skin(), &settings, &model.raster, &mut Progress::silent())
        };
        let recordings =
            FingerShape::ALL.map(of).into_iter().collect::<std::result::Result<Vec<_>, _>>()?;
        let mut skin = model.skin().clone();
        skin.settings.noise.additive_v = Some(recordings[0].noise_std_v);
        let own = method::choose(&skin.settings, None, Some(frames))?.method;
        for method in [own, Method::GaussNewton] {
            let label = [name, method.name()].map(Cell::text);
            for row in check(&skin, &model, method, &recordings)? {
                rows.push([label.to_vec(), row].concat());
            }
        }
    }
    let table = Table {
        title: "What the plan promised",
        note: format!(
            "{}; load average {:.1}. Predictions of `eit plan` for the scene with its noise given, for \
             its own method and for one-step images, compared with medians of {REPEATS} runs on \
             recordings with other paths and noise than those known to the plan. The error has no unit.",
            document::machine(),
            document::load().unwrap_or(f64::NAN)
        ),
        columns: vec![
            "scene",
            "method",
            "stage",
            "planned, ms",
            "measured, ms",
            "planned / measured",
        ],
        rows,
    };
    println!("{table}");
    if dry_run { Ok(()) } else { document::write("plan", &table.body()) }
}

/// Rows of a scene: each stage that both sides name, and the relative error.
fn check(
    skin: &Skin,
    model: &ReconstructionModel,
    method: Method,
    recordings: &[SimulatedSequence],
) -> Result<Vec<Vec<Cell>>> {
    // a plan reads the number of frames from the scene's recording
    let file = std::env::temp_dir().join(format!("eit-plan-check-{}.npy", std::process::id()));
    ndarray_npy::write_npy(&file, &recordings[0].frames.values)?;
    let mut recorded = skin.clone();
    recorded.settings.recording.file = Some(OneOrManyFiles::One(file.clone()));
    let plan = Plan::of(recorded, Some(method.name()), &mut Progress::silent());
    std::fs::remove_file(file)?;
    let plan = plan?.json();

    let mut runs = Vec::new();
    let mut squares = 0.0;
    for recording in recordings {
        let (times, error) = measure(skin, model, method, recording)?;
        squares += error * error;
        runs.push(times);
    }
    let error = (squares / recordings.len() as f64).sqrt();
    let mut rows = Vec::new();
    for stage in plan["stages"].as_array().into_iter().flatten() {
        let name = stage["stage"].as_str().unwrap_or_default();
        let planned_s = stage["expected_time_s"].as_f64().unwrap_or(f64::NAN);
        let of = |times: &Times| times.iter().find(|time| time.0 == name).map(|time| time.1);
        let Some(sum) = runs.iter().map(of).sum::<Option<f64>>() else { continue };
        let measured_s = sum / runs.len() as f64;
        rows.push(row(name, [1e3 * planned_s, 1e3 * measured_s]));
    }
    let expected = plan["expected_images"]["relative_error"].as_f64().unwrap_or(f64::NAN);
    rows.push(row("relative error", [expected, error]));
    Ok(rows)
}

fn row(name: &str, [planned, measured]: [f64; 2]) -> Vec<Cell> {
    vec![
        Cell::text(name),
        Cell::Number(planned, 3),
        Cell::Number(measured, 3),
        Cell::Number(planned / measured, 2),
    ]
}

/// Times of the stages and the relative error on one recording.
fn measure(
    skin: &Skin,
    model: &ReconstructionModel,
    method: Method,
    recording: &SimulatedSequence,
) -> Result<(Times, f64)> {
    let mut times = forward_times(skin)?;
    let (pixels, of_images) = match method.is_tv() {
        true => total_variation(model, method, recording)?,
        false => one_step(model, recording)?,
    };
    times.extend(of_images);
    let truth = model.pixels_of(recording.truth.view())?;
    let truth = Truth { pixels: &truth, positions_m: &recording.positions_m };
    Ok((times, Scores::new(model, pixels.view(), &truth)?.relative_error))
}

/// Times of what every method needs: mesh, forward solution and Jacobian.
fn forward_times(skin: &Skin) -> Result<Times> {
    let (_, mesh_s) = timed(|| Ok(skin.source.build()?))?;
    let background = skin.background_s();
    let mut workspace = skin.model.workspace()?;
    let (_, forward_s) =
        timed(|| Ok(skin.model.solve(&background, &mut workspace)?.measurements()))?;
    let (_, both_s) = timed(|| {
        let mut solution = skin.model.solve(&background, &mut workspace)?;
        Ok((solution.measurements(), solution.jacobian()))
    })?;
    Ok(vec![("mesh", mesh_s), ("forward", forward_s), ("Jacobian", both_s - forward_s)])
}

fn total_variation(
    model: &ReconstructionModel,
    method: Method,
    recording: &SimulatedSequence,
) -> Result<(Array2<f64>, Times)> {
    let bounded = BoundedMethod { method, lower_s: model.settings().lower_s, is_paper: false };
    let settings = bounded.settings(model, Rule::NoiseFigure);
    let fitted = model.fit(&recording.frames, recording.noise_std_v, settings);
    let (mut set_up, mut choice) = (Vec::new(), Vec::new());
    let (mut solver, _) = timed(|| {
        let solver = Solver::new(model, &fitted, method)?;
        set_up.push(solver.cost.set_up_s);
        choice.push(solver.cost.choice_s);
        Ok(solver)
    })?;
    let values = fitted.differences();
    let differences = DifferenceFrames::all_good(values.view());
    let stop = total_variation::stop(model.settings());
    let (made, solve_s) = timed(|| Ok(solver.run(&differences, &stop)?))?;
    let iterations = made.report.iterations.max(1) as f64;
    let times = vec![
        ("Jacobian of pixels", median(set_up).unwrap_or(f64::NAN)),
        ("weights", median(choice).unwrap_or(f64::NAN)),
        ("iteration", solve_s / iterations),
        ("solve", solve_s),
    ];
    Ok((made.pixels, times))
}

fn one_step(
    model: &ReconstructionModel,
    recording: &SimulatedSequence,
) -> Result<(Array2<f64>, Times)> {
    let frames = &recording.frames;
    let fitted = model.fit(frames, recording.noise_std_v, model.settings().clone());
    let (imaging, matrix_s) = timed(|| Ok(fitted.one_step(&mut Progress::silent())?))?;
    let reconstructor = imaging.difference.on_raster(model.raster.pixel_from_element())?;
    let mut workspace = reconstructor.workspace();
    let mut pixels = Array2::zeros((frames.values.nrows(), reconstructor.image_len()));
    let mut image = vec![0.0; reconstructor.image_len()];
    let (_, all_s) = timed(|| {
        for (frame, mut row) in frames.values.rows().into_iter().zip(pixels.rows_mut()) {
            reconstructor.reconstruct_into(
                &frame.to_vec(),
                &frames.reference,
                &mut workspace,
                &mut image,
            )?;
            row.iter_mut().zip(&image).for_each(|(out, value)| *out = *value);
        }
        Ok(())
    })?;
    let each_s = all_s / frames.values.nrows() as f64;
    Ok((pixels, vec![("reconstruction matrix", matrix_s), ("each frame", each_s)]))
}

/// Result of the last of several runs, and their median wall time in seconds.
fn timed<T>(mut run: impl FnMut() -> Result<T>) -> Result<(T, f64)> {
    let mut seconds = Vec::new();
    loop {
        let start = Instant::now();
        let made = run()?;
        seconds.push(start.elapsed().as_secs_f64());
        if seconds.len() == REPEATS {
            return Ok((made, median(seconds).unwrap_or(f64::NAN)));
        }
    }
}
