//! Error against run time: a simulated recording of soft and one of hard fingers, every method.
//!
//! A direct method is one point. An iterated one is a curve: it is run again from cold with a later
//! and later deadline, as a robot would run it, and each run is a point with its certificate.

mod plots;

use super::bench::{Bench, ENTRANTS, Entrant, Entry};
use super::scores::{Scores, Truth};
use super::{Answer, markdown};
use crate::error::CliError;
use crate::method::Method;
use crate::output::{OutFolder, io};
use crate::progress::Progress;
use crate::scene::Rule;
use crate::simulate::{Finger, FingerShape, MovieSettings, SLOW_M, Simulated, simulate};
use eit_inverse::{Differences, MovieReport, MovieStatus, Stop};
use ndarray::{Array2, Axis};
use serde_json::{Value, json};
use std::time::Duration;

/// Noise of the recording, decibel below the voltages.
const NOISE_DB: f64 = 60.0;
/// Fingers on the skin.
const TOUCHES: usize = 2;
/// First deadline and the factor from each to the next.
const FIRST_DEADLINE_S: f64 = 1e-3;
const LATER: f64 = 2.0;
/// Runs of a direct method, of which the median time counts: they take milliseconds.
const RUNS: usize = 5;

/// Sizes of the race.
struct Size {
    frames: usize,
    pixels: usize,
    /// Frames of the absolute method, whose frames take longest by far.
    absolute_frames: usize,
    /// Where the iterated methods end.
    target_gap: f64,
    last_deadline_s: f64,
}

const FULL: Size =
    Size { frames: 20, pixels: 64, absolute_frames: 20, target_gap: 1e-4, last_deadline_s: 10.0 };
const QUICK: Size =
    Size { frames: 8, pixels: 32, absolute_frames: 2, target_gap: 1e-3, last_deadline_s: 2.0 };

/// One run of a method.
struct Point {
    seconds: f64,
    relative_error: f64,
    gap: Option<f64>,
    iterations: usize,
    status: MovieStatus,
}

/// A method's whole race.
struct Course {
    shape: &'static str,
    name: String,
    set_up_s: f64,
    choice_s: f64,
    choice: String,
    frames: usize,
    points: Vec<Point>,
    scores: Scores,
    /// [frame, masked pixel], of the last run.
    movie: Array2<f64>,
}

/// Simulates, runs every method, draws.
pub(super) fn run(
    quick: bool,
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<Answer, CliError> {
    let size = if quick { QUICK } else { FULL };
    let bench = Bench::new(size.pixels, progress)?;
    let simulated = recordings(&bench, &size, progress)?;
    let courses = progress.steps("methods", simulated.len() * ENTRANTS.len(), |bar| {
        let mut courses = Vec::new();
        for (shape, movie, truth) in &simulated {
            for entrant in ENTRANTS {
                bar.set_message(entrant.method.name());
                courses.push(course(&bench, entrant, (shape, movie, truth), &size)?);
                bar.inc(1);
            }
        }
        Ok::<_, CliError>(courses)
    })?;
    let note = format!(
        "paper-disc, {} frames of {TOUCHES} slow fingers, noise {NOISE_DB} dB, {} x {} pixels; \
         simulated on {} nodes, reconstructed on {}; times without set-up",
        size.frames,
        size.pixels,
        size.pixels,
        simulated[0].1.nodes,
        bench.setup.mesh.surface().nodes().len()
    );
    plots::draw(&bench, &courses, &simulated, (&note, &size), out)?;
    let table = table(&courses);
    let text = format!("# Error against run time\n\n{note}.\n\n{table}");
    out.write("report.md", |w| w.write_all(text.as_bytes()).map_err(io))?;
    let json = json!({
        "scene": bench.scene.name,
        "frames": size.frames,
        "pixels": size.pixels,
        "touches": TOUCHES,
        "noise_db": NOISE_DB,
        "simulation_nodes": simulated[0].1.nodes,
        "reconstruction_nodes": bench.setup.mesh.surface().nodes().len(),
        "methods": courses.iter().map(course_json).collect::<Vec<_>>(),
        "stages": progress.times(),
    });
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let text = format!(
        "{note}\n\n{table}\nwritten to {}: {}",
        out.path().display(),
        out.names().join(", ")
    );
    Ok(Answer { text, json })
}

/// A simulated recording, its name and its truth [frame, masked pixel].
type Recording = (&'static str, Simulated, Array2<f64>);

/// Simulates a recording of each shape of fingers.
fn recordings(
    bench: &Bench,
    size: &Size,
    progress: &mut Progress,
) -> Result<Vec<Recording>, CliError> {
    let mut simulated = Vec::new();
    for (name, shape) in FingerShape::ALL {
        let settings = MovieSettings {
            touches: TOUCHES,
            frames: size.frames,
            step_m: SLOW_M,
            finger: Finger { shape, ..Default::default() },
            noise_db: NOISE_DB,
            ..Default::default()
        };
        let movie = simulate(&bench.scene, &settings, &bench.raster, progress)?;
        let truth = bench.pixels_of(movie.truth.view())?;
        simulated.push((name, movie, truth));
    }
    Ok(simulated)
}

/// Sets a method up and runs it, once or with growing deadlines.
fn course(
    bench: &Bench,
    entrant: Entrant,
    (shape, simulated, truth): (&'static str, &Simulated, &Array2<f64>),
    size: &Size,
) -> Result<Course, CliError> {
    let (method, noise_std_v) = (entrant.method, simulated.noise_std_v);
    // of the rules, cross-validation alone sees the noise of the recording, as st-tv does
    let mut entry = Entry::new(bench, (entrant, Rule::Gcv), &simulated.frames, noise_std_v)?;
    let absolute = method == Method::GaussNewtonAbsolute;
    let frames = if absolute { size.absolute_frames } else { size.frames };
    let values = simulated.frames.differences(bench.kind());
    let values = values.slice_axis(Axis(0), (..frames).into());
    let differences = Differences::all_good(values);
    let truth = Truth { pixels: truth, positions_m: &simulated.positions_m };
    let mut points = Vec::new();
    let mut point = |movie: &Array2<f64>, report: &MovieReport, seconds| {
        let scores = Scores::new(bench, movie.view(), &truth)?;
        points.push(Point {
            seconds,
            relative_error: scores.relative_error,
            gap: report.certificate.map(|certificate| certificate.relative_gap()),
            iterations: report.iterations,
            status: report.status,
        });
        Ok::<_, CliError>(scores)
    };
    let (movie, scores) = if method.is_tv() {
        let mut deadline_s = FIRST_DEADLINE_S;
        loop {
            let deadline = Some(Duration::from_secs_f64(deadline_s));
            let stop = Stop { target_gap: size.target_gap, deadline, max_iterations: usize::MAX };
            let (movie, report) = entry.run(&differences, &stop)?;
            let scores = point(&movie, &report, report.seconds)?;
            deadline_s *= LATER;
            if report.status != MovieStatus::Deadline || deadline_s > size.last_deadline_s {
                break (movie, scores);
            }
        }
    } else {
        let stop = Stop::default();
        let (movie, report) = entry.run(&differences, &stop)?;
        let mut times = vec![report.seconds];
        for _ in 1..if absolute { 1 } else { RUNS } {
            times.push(entry.run(&differences, &stop)?.1.seconds);
        }
        times.sort_by(f64::total_cmp);
        let scores = point(&movie, &report, times[times.len() / 2])?;
        (movie, scores)
    };
    let Entry { set_up_s, choice_s, choice, .. } = entry;
    let name = entrant.name();
    Ok(Course { shape, name, set_up_s, choice_s, choice, frames, points, scores, movie })
}

fn table(courses: &[Course]) -> String {
    let head = [
        "finger",
        "method",
        "relative error",
        "correlation",
        "SSIM",
        "position error, mm",
        "ms a frame",
        "certified gap",
        "iterations",
        "set-up, s",
        "choice, s",
        "chosen",
    ];
    let rows: Vec<Vec<String>> = courses
        .iter()
        .map(|course| {
            let last = course.points.last();
            let frames = course.frames as f64;
            let of_last = |value: &dyn Fn(&Point) -> String| last.map_or_else(String::new, value);
            vec![
                course.shape.to_owned(),
                course.name.clone(),
                format!("{:.3}", course.scores.relative_error),
                format!("{:.3}", course.scores.correlation),
                format!("{:.3}", course.scores.similarity),
                format!("{:.1}", 1e3 * course.scores.position_error_m),
                of_last(&|p| format!("{:.2}", 1e3 * p.seconds / frames)),
                of_last(&|p| p.gap.map_or_else(|| "-".to_owned(), |gap| format!("{gap:.1e}"))),
                of_last(&|p| p.iterations.to_string()),
                format!("{:.2}", course.set_up_s),
                format!("{:.2}", course.choice_s),
                course.choice.clone(),
            ]
        })
        .collect();
    markdown(&head, &rows)
}

fn course_json(course: &Course) -> Value {
    let point = |p: &Point| {
        json!({
            "seconds": p.seconds,
            "relative_error": p.relative_error,
            "gap": p.gap,
            "iterations": p.iterations,
            "status": super::super::reconstruct::movie_status_words(p.status),
        })
    };
    json!({
        "finger": course.shape,
        "method": course.name,
        "frames": course.frames,
        "set_up_s": course.set_up_s,
        "choice_s": course.choice_s,
        "choice": course.choice,
        "scores": course.scores.json(),
        "points": course.points.iter().map(point).collect::<Vec<_>>(),
    })
}
