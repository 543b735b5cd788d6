//! How well touches are found: position, discrimination, tracks, and how fast.

mod electrodes;
mod eyes;
mod greit;
mod lab;
mod latency;
mod movement;
mod pairs;
mod plots;
mod position;
mod tracks;

use super::{Answer, table};
use crate::error::ReportError;
use crate::output::OutFolder;
use crate::settings::TouchPart;
use eit_skin::Progress;
use lab::Lab;

/// What finds touches in a frame.
const METHODS: [&str; 3] = ["one-step image", "st-tv image", "fit"];

/// What is varied, and how often each is tried.
struct Grid {
    noise_db: &'static [f64],
    /// Places of a ring.
    places: usize,
    /// Trials of a ring and noise level.
    trials: usize,
    /// Distances of two touches, metres, ascending.
    distances_m: &'static [f64],
    /// Trials of a distance.
    pair_trials: usize,
    /// Frames of a recording of fingers.
    track_frames: usize,
    /// Parts of the radius for the GREIT figures.
    greit_radii: &'static [f64],
    /// Frames of the measurement of time.
    latency_frames: usize,
    pixels: usize,
    /// Quiet frames for the noise of ST-TV images.
    quiet: usize,
    /// Whether all cases of moving electrodes are simulated, and how many frames of each at most.
    all_scripts: bool,
    script_frames: usize,
}

const FULL: Grid = Grid {
    noise_db: &[40.0, 50.0, 60.0, 70.0],
    places: 5,
    trials: 100,
    distances_m: &[
        0.008, 0.012, 0.016, 0.020, 0.026, 0.032, 0.038, 0.044, 0.052, 0.060, 0.070, 0.080, 0.095,
        0.110, 0.130,
    ],
    pair_trials: 20,
    track_frames: 300,
    greit_radii: &[0.0, 0.2, 0.4, 0.6, 0.8, 0.9],
    latency_frames: 2000,
    pixels: 64,
    quiet: 60,
    all_scripts: true,
    script_frames: 400,
};
const QUICK: Grid = Grid {
    noise_db: &[60.0],
    places: 2,
    trials: 4,
    distances_m: &[0.030, 0.060, 0.090],
    pair_trials: 2,
    track_frames: 90,
    greit_radii: &[0.0, 0.6],
    latency_frames: 80,
    pixels: 32,
    quiet: 20,
    all_scripts: false,
    script_frames: 50,
};

/// Measures the wanted parts and writes them.
pub(super) fn run(
    (parts, quick): (&[TouchPart], bool),
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<Answer, ReportError> {
    let grid = if quick { QUICK } else { FULL };
    let wants = |part| parts.contains(&TouchPart::All) || parts.contains(&part);
    let lab = Lab::new((grid.pixels, grid.quiet), progress)?;
    let (levels, rings) = (grid.noise_db.len(), lab::RINGS.len());
    let mut tables = Vec::new();
    if wants(TouchPart::Position) {
        let errors = progress
            .steps("positions", levels * rings, |bar| position::measure(&lab, &grid, bar))?;
        tables.push(position::table(&lab, &grid, &errors));
        plots::draw(&errors, out)?;
    }
    if wants(TouchPart::Movement) {
        let steps = movement::FABRICS * rings;
        tables.push(progress.steps("movement", steps, |bar| movement::table(&lab, &grid, bar))?);
    }
    if wants(TouchPart::Electrodes) {
        let steps = electrodes::steps(&grid);
        let made = progress.steps("electrodes", steps, |bar| electrodes::table(&lab, &grid, bar));
        tables.push(made?);
    }
    if wants(TouchPart::Pairs) {
        let steps = levels * rings * METHODS.len();
        let pairs = progress.steps("two points", steps, |bar| pairs::measure(&lab, &grid, bar))?;
        tables.push(pairs::table(&grid, &pairs));
    }
    if wants(TouchPart::Tracks) {
        let steps = tracks::MOST * (1 + levels);
        tables.push(progress.steps("tracks", steps, |bar| tracks::table(&lab, &grid, bar))?);
    }
    if wants(TouchPart::Greit) {
        let steps = grid.greit_radii.len() * greit::METHODS;
        tables.push(progress.steps("greit", steps, |bar| greit::table(&lab, &grid, bar))?);
    }
    if wants(TouchPart::Latency) {
        tables.push(progress.steps("latency", 2, |bar| latency::table(&lab, &grid, bar))?);
    }
    let files = ["touches.md", "touches.csv", "touches.json"];
    table::write("Touch figures", &tables, files, (out, progress))
}

/// Work at each noise level, in threads; results in the order of the levels.
fn at_each<T: Send>(
    noise_db: &[f64],
    work: impl Fn(f64) -> Result<Vec<T>, ReportError> + Sync,
) -> Result<Vec<T>, ReportError> {
    let work = &work;
    std::thread::scope(|scope| {
        let threads: Vec<_> =
            noise_db.iter().map(|&noise_db| scope.spawn(move || work(noise_db))).collect();
        let mut all = Vec::new();
        for thread in threads {
            let died = |_| ReportError::Failure("a thread of the report died".to_owned());
            all.extend(thread.join().map_err(died)??);
        }
        Ok(all)
    })
}
