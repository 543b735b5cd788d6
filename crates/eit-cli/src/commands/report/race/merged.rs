//! Both recordings of a scene (soft and hard fingers; one finger and two on the fabric) together: what tables, plots and choices are made of.

use super::case::Case;
use super::point::{Course, Point, Solver, Spread};
use crate::commands::reconstruct::movie_status_words;
use crate::machine::Machine;
use serde_json::{Value, json};

/// A setting of a solver on a scene, over both shapes of fingers.
#[derive(Debug, Clone)]
pub(super) struct Row {
    pub case: &'static str,
    pub solver: Solver,
    pub target_gap: Option<f64>,
    /// Root mean square of the relative errors of the shapes.
    pub error: f64,
    /// That of each shape.
    pub errors: Vec<f64>,
    /// The slower shape's.
    pub time: Spread,
    pub floor_s: f64,
    /// Largest gap that was proven.
    pub gap: Option<f64>,
    /// Means over the shapes.
    pub iterations: f64,
    pub position_error_m: f64,
    pub found: f64,
    pub extra: f64,
    pub status: &'static str,
    pub set_up_s: f64,
    pub choice_s: f64,
    pub choice: String,
}

/// Rows of a scene whose recordings gave these courses, one list for each shape; what one shape
/// lacks is left out.
pub(super) fn rows(case: &Case, shapes: &[Vec<Course>]) -> Vec<Row> {
    let Some((first, others)) = shapes.split_first() else { return Vec::new() };
    let mut rows = Vec::new();
    for course in first {
        let same: Vec<&Course> = others
            .iter()
            .filter_map(|courses| courses.iter().find(|other| other.solver == course.solver))
            .collect();
        if same.len() < others.len() {
            continue;
        }
        let all: Vec<&Course> = std::iter::once(course).chain(same).collect();
        for point in &course.points {
            let points: Vec<&Point> = all
                .iter()
                .filter_map(|c| c.points.iter().find(|p| p.target_gap == point.target_gap))
                .collect();
            if points.len() == all.len() {
                rows.push(Row::of(case, &all, &points));
            }
        }
    }
    rows
}

impl Row {
    /// Of the same setting on each shape; not empty.
    fn of(case: &Case, courses: &[&Course], points: &[&Point]) -> Self {
        let count = points.len() as f64;
        let mean = |of: &dyn Fn(&Point) -> f64| points.iter().map(|p| of(p)).sum::<f64>() / count;
        let slowest = points
            .iter()
            .fold(points[0], |slow, p| if p.time.median_s > slow.time.median_s { p } else { slow });
        let errors: Vec<f64> = points.iter().map(|p| p.scores.relative_error).collect();
        let most = |of: &dyn Fn(&Course) -> f64| {
            courses.iter().map(|course| of(course)).fold(0.0, f64::max)
        };
        Self {
            case: case.name,
            solver: courses[0].solver.clone(),
            target_gap: points[0].target_gap,
            error: (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt(),
            errors,
            time: slowest.time,
            floor_s: slowest.floor_s,
            gap: points.iter().filter_map(|p| p.gap).reduce(f64::max),
            iterations: mean(&|p| p.iterations as f64),
            position_error_m: mean(&|p| p.scores.position_error_m),
            found: mean(&|p| p.scores.found),
            extra: mean(&|p| p.scores.extra),
            // what did not converge on one shape has not converged
            status: movie_status_words(
                points.iter().map(|p| p.status).fold(points[0].status, worse),
            ),
            set_up_s: most(&|c| c.set_up_s),
            choice_s: most(&|c| c.choice_s),
            choice: courses.iter().map(|c| c.choice.as_str()).collect::<Vec<_>>().join(" | "),
        }
    }

    /// Pixels in words.
    pub fn pixels_words(&self) -> String {
        self.solver.pixels.map_or_else(|| "elements".to_owned(), |pixels| pixels.to_string())
    }

    /// Gap that was asked for, in words.
    pub fn gap_words(&self) -> String {
        self.target_gap.map_or_else(|| "-".to_owned(), |gap| format!("{gap:.0e}"))
    }

    /// Names of the columns of [`Row::record`].
    pub const COLUMNS: [&'static str; 24] = [
        "scene",
        "solver",
        "pixels",
        "target_gap",
        "live",
        "relative_error",
        "relative_error_first",
        "relative_error_second",
        "position_error_mm",
        "found",
        "extra_blobs",
        "ms_a_frame_least",
        "ms_a_frame",
        "ms_a_frame_most",
        "runs",
        "floor_ms_a_frame",
        "proven_gap",
        "iterations",
        "status",
        "set_up_s",
        "choice_s",
        "overhead",
        "machine_gflops",
        "choice",
    ];

    /// One line of the CSV file.
    pub fn record(&self, machine: &Machine) -> Vec<String> {
        let number = |value: f64| match value.is_finite() {
            true => format!("{value:.4e}"),
            false => String::new(),
        };
        let optional = |value: Option<f64>| value.map_or_else(String::new, number);
        let time = self.time;
        vec![
            self.case.to_owned(),
            self.solver.name.clone(),
            self.solver.pixels.map_or_else(String::new, |pixels| pixels.to_string()),
            optional(self.target_gap),
            self.solver.is_live.to_string(),
            number(self.error),
            optional(self.errors.first().copied()),
            optional(self.errors.get(1).copied()),
            number(1e3 * self.position_error_m),
            number(self.found),
            number(self.extra),
            number(1e3 * time.least_s),
            number(1e3 * time.median_s),
            number(1e3 * time.most_s),
            time.runs.to_string(),
            number(1e3 * self.floor_s),
            optional(self.gap),
            number(self.iterations),
            self.status.to_owned(),
            number(self.set_up_s),
            number(self.choice_s),
            number(time.median_s / self.floor_s),
            number(1e-9 * machine.double_flops_per_s),
            self.choice.clone(),
        ]
    }

    /// The same for programs.
    pub fn json(&self, machine: &Machine) -> Value {
        let pairs = Self::COLUMNS.iter().zip(self.record(machine));
        let value = |text: String| text.parse::<f64>().map_or_else(|_| json!(text), Value::from);
        Value::Object(pairs.map(|(name, text)| ((*name).to_owned(), value(text))).collect())
    }
}

/// The status that says less.
fn worse(a: eit_inverse::MovieStatus, b: eit_inverse::MovieStatus) -> eit_inverse::MovieStatus {
    use eit_inverse::MovieStatus::{Converged, Direct};
    if matches!(a, Direct | Converged) { b } else { a }
}
