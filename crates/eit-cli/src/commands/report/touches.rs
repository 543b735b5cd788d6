//! How well touches are found: position, discrimination, tracks, and how fast.

mod eyes;
mod lab;
mod position;
mod table;

use super::Answer;
use crate::error::CliError;
use crate::output::{OutFolder, io};
use crate::progress::Progress;
use lab::Lab;
use serde_json::json;
use table::Table;

/// What finds touches in a frame.
const METHODS: [&str; 3] = ["one-step image", "st-tv image", "fit"];

/// What is varied, and how often each is tried.
struct Grid {
    noise_db: &'static [f64],
    /// Places of a ring.
    places: usize,
    /// Trials of a ring and noise level.
    trials: usize,
    pixels: usize,
}

const FULL: Grid = Grid { noise_db: &[40.0, 50.0, 60.0, 70.0], places: 5, trials: 100, pixels: 64 };
const QUICK: Grid = Grid { noise_db: &[60.0], places: 2, trials: 6, pixels: 32 };

/// Measures everything and writes it.
pub(super) fn run(
    quick: bool,
    out: &mut OutFolder,
    progress: &mut Progress,
) -> Result<Answer, CliError> {
    let grid = if quick { QUICK } else { FULL };
    let lab = Lab::new(grid.pixels, progress)?;
    let cells = grid.noise_db.len() * lab::RINGS.len();
    let errors =
        progress.steps("positions", cells, |bar| position::measure(&lab, &grid, bar))?;
    let tables = [position::table(&lab, &grid, &errors)];
    write(&tables, out, progress)
}

/// Markdown, CSV and JSON of all tables.
fn write(
    tables: &[Table],
    out: &mut OutFolder,
    progress: &Progress,
) -> Result<Answer, CliError> {
    let sections: Vec<String> = tables.iter().map(Table::markdown).collect();
    let markdown = format!("# Touch figures\n\n{}", sections.join("\n"));
    out.write("touches.md", |w| w.write_all(markdown.as_bytes()).map_err(io))?;
    let lines: String = tables.iter().map(Table::csv).collect();
    let csv = format!("table,row,column,value\n{lines}");
    out.write("touches.csv", |w| w.write_all(csv.as_bytes()).map_err(io))?;
    let json = json!({
        "tables": tables.iter().map(Table::json).collect::<Vec<_>>(),
        "stages": progress.times(),
    });
    out.write("touches.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let text =
        format!("{markdown}\nwritten to {}: {}", out.path().display(), out.names().join(", "));
    Ok(Answer { text, json })
}

/// Work at each noise level, in threads; results in the order of the levels.
fn at_each<T: Send>(
    noise_db: &[f64],
    work: impl Fn(f64) -> Result<Vec<T>, CliError> + Sync,
) -> Result<Vec<T>, CliError> {
    let work = &work;
    std::thread::scope(|scope| {
        let threads: Vec<_> =
            noise_db.iter().map(|&noise_db| scope.spawn(move || work(noise_db))).collect();
        let mut all = Vec::new();
        for thread in threads {
            let died = |_| CliError::Failure("a thread of the report died".to_owned());
            all.extend(thread.join().map_err(died)??);
        }
        Ok(all)
    })
}
