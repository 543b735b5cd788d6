//! What `eit report` measured on the built-in scenes: what plans expect of others.
//!
//! `measured.csv` is the `inverse.csv` of a full run of `eit report`, without peers and without nets
//! that are not shipped (`benches/src/bin/adopt.rs`); nothing in it is written by hand. A scene is
//! told by the built-in one that is most like it, and says which that is.

mod in_time;
mod nearest;

pub use in_time::BUDGETS_S;
pub(crate) use in_time::{in_frame_time, suits};
pub use nearest::{Nearest, nearest};

use crate::error::SkinError;
use crate::method::Method;
use crate::plan::machine::Machine;
use crate::scene::{Hyperparameter, ReconstructionSettings, Rule};
use serde::{Deserialize, Serialize};

const TABLE: &str = include_str!("measured.csv");

/// End of a solver's name that knows that touches only raise the conductivity.
const BOUNDED: &str = " ≥ 0";
/// End of the name of one that takes frame after frame.
const STREAM: &str = " stream";
/// Errors that differ by less are one: other paths and other noise change them more.
const ALIKE: f64 = 1.02;

/// One setting of a solver on a built-in scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Built-in scene or case of the report.
    pub scene: String,
    /// Name of the solver.
    pub solver: String,
    /// Rule of the hyperparameter, as in a scene file; empty where there is none.
    pub rule: String,
    /// None: on the elements of the mesh.
    pub pixels: Option<usize>,
    /// Relative gap that it ran to.
    pub target_gap: Option<f64>,
    /// Gives a frame's image before the next frame comes, without having seen the recording.
    pub live: bool,
    /// Another program.
    pub peer: bool,
    /// Root mean square over the two recordings of the scene.
    pub relative_error: f64,
    /// Of the first recording.
    pub relative_error_first: f64,
    /// Of the second, where there is one.
    pub relative_error_second: Option<f64>,
    /// Mean distance of blobs from their fingers.
    pub position_error_mm: Option<f64>,
    /// Parts of the fingers found, blobs a frame that are none.
    pub found: f64,
    /// False blobs per frame.
    pub extra_blobs: f64,
    /// What counts against a budget: the time of a frame with its share of the choice of weights,
    /// or, live, the time that 95 of 100 frames do not exceed.
    pub cost_ms_a_frame: f64,
    /// Least time of a frame.
    pub ms_a_frame_least: f64,
    /// Median.
    pub ms_a_frame: f64,
    /// What 95 of 100 do not exceed.
    pub ms_a_frame_95: f64,
    /// Largest.
    pub ms_a_frame_most: f64,
    /// Times that the four are of: runs, or single frames of live solvers.
    pub times: usize,
    /// The same work at the best rates of the machine.
    pub floor_ms_a_frame: Option<f64>,
    /// Relative duality gap that was reached.
    pub proven_gap: Option<f64>,
    /// Iterations of a run.
    pub iterations: f64,
    /// How it ended.
    pub status: String,
    /// Frames of a recording.
    pub frames: usize,
    /// Time of the set-up, seconds.
    pub set_up_s: f64,
    /// Time of choosing weights or hyperparameter, seconds.
    pub choice_s: f64,
    /// How they were chosen.
    pub choice: String,
    /// Rate of a dense product where it was measured.
    pub machine_gflops: f64,
}

impl Measured {
    /// Time on a machine over that where it was measured.
    pub fn slowness(&self, machine: &Machine) -> f64 {
        1e9 * self.machine_gflops / machine.double_flops_per_s
    }

    /// Solver and rule.
    pub fn label(&self) -> String {
        if self.rule == "gcv" { format!("{}, gcv", self.solver) } else { self.solver.clone() }
    }

    /// The solver and its setting.
    pub fn words(&self) -> String {
        let pixels = self.pixels.map_or_else(String::new, |n| format!(", {n} pixels"));
        let gap = self.target_gap.map_or_else(String::new, |gap| format!(", gap {gap:e}"));
        format!("{}{pixels}{gap}", self.label())
    }

    /// Whether it takes frame after frame and is only for that.
    fn is_stream(&self) -> bool {
        self.solver.contains(STREAM)
    }
}

/// What a frame may take.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// Seconds.
    pub time_s: f64,
    /// Only what gives an image before the next frame comes.
    pub is_live: bool,
}

/// A method at some setting, as a table is asked for it.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a> {
    /// Its method.
    pub method: Method,
    /// Bounds and rule of the hyperparameter.
    pub settings: &'a ReconstructionSettings,
    /// Pixels along the longer side.
    pub pixels: usize,
    /// Relative gap that it runs to.
    pub target_gap: f64,
}

/// The best of some rows for a time that a frame may take where they were measured: of those whose
/// error is within 2 % of the least, the cheapest; of equal work, what has proven more. Peers never.
pub fn best<'a>(
    rows: impl Iterator<Item = &'a Measured> + Clone,
    budget: Budget,
) -> Option<&'a Measured> {
    let fits = move |row: &&Measured| {
        // a stream is for what streams
        let kind = if budget.is_live { row.live } else { !row.is_stream() };
        kind && !row.peer && 1e-3 * row.cost_ms_a_frame <= budget.time_s
    };
    let fitting = rows.filter(fits);
    let least = fitting.clone().map(|row| row.relative_error).reduce(f64::min)?;
    let alike = fitting.filter(move |row| row.relative_error <= ALIKE * least);
    let cheapest = alike.clone().min_by(|a, b| a.cost_ms_a_frame.total_cmp(&b.cost_ms_a_frame))?;
    let same = |row: &&Measured| {
        (&row.solver, row.pixels, row.iterations)
            == (&cheapest.solver, cheapest.pixels, cheapest.iterations)
    };
    let gap = |row: &Measured| row.target_gap.unwrap_or(0.0);
    alike.filter(same).min_by(|a, b| gap(a).total_cmp(&gap(b)))
}

/// The table.
pub struct Table {
    rows: Vec<Measured>,
}

impl Table {
    /// Reads what comes with the program.
    pub fn load() -> Result<Self, SkinError> {
        let mut reader = csv::Reader::from_reader(TABLE.as_bytes());
        let rows: Result<Vec<Measured>, csv::Error> = reader.deserialize().collect();
        let rows = rows.map_err(|e| SkinError::Failure(format!("measured.csv: {e}")))?;
        Ok(Self { rows })
    }

    /// All rows of a scene.
    pub fn of_scene(&self, scene: &str) -> impl Iterator<Item = &Measured> + Clone {
        let scene = scene.to_owned();
        self.rows.iter().filter(move |row| row.scene == scene)
    }

    /// What was measured of a method on a built-in scene, with the bound and the rule that the
    /// settings state, at the nearest number of pixels and gap.
    pub fn of(&self, built_in: &str, wanted: &Wanted<'_>) -> Option<&Measured> {
        let Wanted { method, settings: keys, pixels, target_gap: gap } = *wanted;
        let bounded = keys.lower_s.is_some_and(|lower| lower >= 0.0);
        let rule = match keys.hyperparameter {
            Some(Hyperparameter::Rule(Rule::Gcv)) => "gcv",
            _ => "noise-figure",
        };
        let with_bound = format!("{}{BOUNDED}", method.name());
        let [first, second] = match bounded {
            true => [with_bound.as_str(), method.name()],
            false => [method.name(), with_bound.as_str()],
        };
        let far = |a: f64, b: f64| (a / b).ln().abs();
        let distance = |row: &Measured| {
            row.pixels.map_or(0.0, |own| 10.0 * far(own as f64, pixels as f64))
                + row.target_gap.map_or(0.0, |own| far(own, gap))
        };
        let of = |name: &str| {
            let rows = self.of_scene(built_in).filter(|row| row.solver == name);
            rows.filter(|row| row.rule.is_empty() || row.rule == rule)
                .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        };
        of(first).or_else(|| of(second))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The columns are those that a report writes.
    #[test]
    fn the_table_has_the_columns_of_a_report() {
        let table = Table::load().unwrap();
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.serialize(&table.rows[0]).unwrap();
        let written = String::from_utf8(writer.into_inner().unwrap()).unwrap();
        assert_eq!(written.lines().next(), TABLE.lines().next(), "columns of an older report");
    }

    /// Alike errors: the cheapest counts, of equal work the tighter gap, and never a peer, nor a
    /// stream for recordings.
    #[test]
    fn the_best_is_the_cheapest_of_those_alike() {
        let table = Table::load().unwrap();
        let row = table.of_scene("paper-disc-60").find(|row| row.solver == "tv ≥ 0").unwrap();
        let of = |solver: &str, error: f64, cost: f64, gap: f64, iterations: f64| Measured {
            solver: solver.to_owned(),
            relative_error: error,
            cost_ms_a_frame: cost,
            target_gap: Some(gap),
            iterations,
            ..row.clone()
        };
        let mut rows = [
            of("a", 0.40, 5.0, 1e-1, 52.0),
            of("a", 0.40, 4.9, 3e-1, 52.0),
            of("b", 0.396, 9.0, 1e-2, 99.0),
            of("b", 0.30, 20.0, 1e-3, 999.0),
            of("c stream", 0.1, 1.0, 1e-1, 9.0),
            Measured { peer: true, ..of("d", 0.1, 1.0, 1e-1, 9.0) },
        ];
        let found = best(rows.iter(), Budget { time_s: 1e-2, is_live: false }).unwrap();
        assert_eq!((found.solver.as_str(), found.target_gap), ("a", Some(1e-1)));
        assert_eq!(
            best(rows.iter(), Budget { time_s: 1.0, is_live: false }).unwrap().relative_error,
            0.30
        );
        assert!(best(rows.iter(), Budget { time_s: 1e-4, is_live: false }).is_none());
        assert!(best(rows.iter(), Budget { time_s: 1.0, is_live: true }).is_none(), "none is live");
        rows[4].live = true;
        assert_eq!(
            best(rows.iter(), Budget { time_s: 1.0, is_live: true }).unwrap().solver,
            "c stream"
        );
    }
}
