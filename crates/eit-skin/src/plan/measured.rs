//! Results of `eit report` on the built-in scenes, from which plans predict others.
//!
//! `measured.csv` is the `inverse.csv` of `eit report --full`, without nets that are
//! not shipped (written by `benches/src/bin/adopt.rs`, never by hand). A scene is predicted from the most
//! similar built-in one, which the plan names.

mod in_time;
mod nearest;

pub use in_time::BUDGETS_S;
pub(crate) use in_time::{in_frame_time, suits};
pub(crate) use nearest::{Nearest, nearest};

use crate::error::SkinError;
use crate::method::Method;
use crate::plan::machine::Machine;
use crate::scene::{Hyperparameter, ReconstructionSettings, Rule};
use serde::{Deserialize, Serialize};

const TABLE: &str = include_str!("measured.csv");

/// Suffix of solvers whose bounds say that touches only raise the conductivity.
const BOUNDED: &str = " ≥ 0";
/// Suffix of solvers that process one frame after the other.
const STREAM: &str = " stream";
/// Errors within this factor are considered equal: other paths and other noise change them more.
const ALIKE: f64 = 1.02;

/// Results of a solver with one setting on a built-in scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Built-in scene, or case of the report.
    pub scene: String,
    /// Name of the solver.
    pub solver: String,
    /// Rule of the hyperparameter, as in a scene file; empty if there is none.
    pub rule: String,
    /// Pixels along the longer side; `None` if solved on the elements of the mesh.
    pub pixels: Option<usize>,
    /// Relative gap at which it stopped.
    pub target_gap: Option<f64>,
    /// Whether it returns a frame's image before the next frame arrives, without seeing the whole recording.
    pub live: bool,
    /// Whether it is another program.
    pub peer: bool,
    /// Root mean square of the relative error over the two recordings of the scene.
    pub relative_error: f64,
    /// Relative error on the first recording.
    pub relative_error_first: f64,
    /// Relative error on the second recording, if there is one.
    pub relative_error_second: Option<f64>,
    /// Mean distance of blobs from their fingers.
    pub position_error_mm: Option<f64>,
    /// Fraction of the fingers that were found.
    pub found: f64,
    /// False blobs per frame.
    pub extra_blobs: f64,
    /// Cost that counts against a budget: time per frame including its share of choosing weights or, if live,
    /// the time that 95 % of the frames do not exceed.
    pub cost_ms_a_frame: f64,
    /// Minimum time of a frame.
    pub ms_a_frame_least: f64,
    /// Median time of a frame.
    pub ms_a_frame: f64,
    /// Time that 95 % of the frames do not exceed.
    pub ms_a_frame_95: f64,
    /// Maximum time of a frame.
    pub ms_a_frame_most: f64,
    /// Number of times that the four statistics are taken over: runs, or single frames of live solvers.
    pub times: usize,
    /// Lower bound: the same work at the machine's best rates.
    pub floor_ms_a_frame: Option<f64>,
    /// Relative duality gap reached.
    pub proven_gap: Option<f64>,
    /// Number of iterations of a run.
    pub iterations: f64,
    /// Status at the end.
    pub status: String,
    /// Number of frames of a recording.
    pub frames: usize,
    /// Time for set-up, seconds.
    pub set_up_s: f64,
    /// Time for choosing weights or hyperparameter, seconds.
    pub choice_s: f64,
    /// How they were chosen.
    pub choice: String,
    /// Rate of a dense product on the machine where it was measured.
    pub machine_gflops: f64,
}

impl Measured {
    /// Returns the ratio of the time on `machine` to that where it was measured.
    pub(crate) fn slowness(&self, machine: &Machine) -> f64 {
        1e9 * self.machine_gflops / machine.double_flops_per_s
    }

    /// Returns solver and rule.
    pub fn label(&self) -> String {
        if self.rule == "gcv" { format!("{}, gcv", self.solver) } else { self.solver.clone() }
    }

    /// Describes the solver and its setting.
    pub fn description(&self) -> String {
        let pixels = self.pixels.map_or_else(String::new, |n| format!(", {n} pixels"));
        let gap = self.target_gap.map_or_else(String::new, |gap| format!(", gap {gap:e}"));
        format!("{}{pixels}{gap}", self.label())
    }

    /// Whether the solver processes one frame after the other, and is only meant for that.
    fn is_stream(&self) -> bool {
        self.solver.contains(STREAM)
    }
}

/// Time available for a frame.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Budget {
    /// Time, seconds.
    pub time_s: f64,
    /// Whether only solvers count that return an image before the next frame arrives.
    pub is_live: bool,
}

/// Key for looking up a method in the table.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a> {
    /// Method of reconstruction.
    pub method: Method,
    /// Bounds and rule of the hyperparameter.
    pub settings: &'a ReconstructionSettings,
    /// Pixels along the longer side.
    pub pixels: usize,
    /// Relative gap at which it stops.
    pub target_gap: f64,
}

/// Returns the best row within a budget: among those whose error is within 2 % of the smallest, the cheapest;
/// for equal work, the one with the smallest gap. Peers are never returned.
pub fn best<'a>(
    rows: impl Iterator<Item = &'a Measured> + Clone,
    budget: Budget,
) -> Option<&'a Measured> {
    let fits = move |row: &&Measured| {
        // a stream solver is only for live use
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

/// Table of measured solvers.
#[derive(Debug, Clone)]
pub struct Table {
    rows: Vec<Measured>,
}

impl Table {
    /// Loads the table that is built into the program.
    ///
    /// # Errors
    ///
    /// A damaged table, which would be a fault of the build.
    pub fn load() -> Result<Self, SkinError> {
        let mut reader = csv::Reader::from_reader(TABLE.as_bytes());
        let rows: Result<Vec<Measured>, csv::Error> = reader.deserialize().collect();
        let rows = rows.map_err(|e| SkinError::Failure(format!("measured.csv: {e}")))?;
        Ok(Self { rows })
    }

    /// Returns all rows of a scene.
    pub(crate) fn of_scene(&self, scene: &str) -> impl Iterator<Item = &Measured> + Clone {
        let scene = scene.to_owned();
        self.rows.iter().filter(move |row| row.scene == scene)
    }

    /// Returns the measurement of a method on a built-in scene, with the settings' bound and rule, at the
    /// nearest number of pixels and gap.
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

    /// Equal errors: the cheapest wins, for equal work the one with the tighter gap; never a peer, nor a
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
