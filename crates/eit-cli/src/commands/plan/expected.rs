//! What is to be expected of a scene's images: as measured on the built-in scene most like it.

use crate::error::CliError;
use crate::machine::Machine;
use crate::measured::{Measured, Nearest, Table, nearest};
use crate::method::Method;
use crate::pipeline::tv::DEFAULT_TARGET_GAP;
use crate::pipeline::{DEFAULT_PIXELS, Setup};
use crate::scene::Scene;
use serde_json::{Value, json};

/// Times that a frame may take, seconds.
const BUDGETS_S: [f64; 3] = [1e-2, 1e-3, 1e-4];

/// Error, cost, and what would be better for the time a frame may take.
pub(crate) struct Expected {
    pub nearest: Nearest,
    /// The scene's method there.
    pub row: Option<Measured>,
    /// Budget, whether live, and the best within it.
    best: Vec<(f64, bool, Option<Measured>)>,
    /// Time here over that where the table was measured.
    slowness: f64,
}

impl Expected {
    /// Looks the scene up. `voltages` are those of the untouched skin.
    pub fn of(
        scene: &Scene,
        setup: &Setup,
        (method, frames): (Method, Option<usize>),
        voltages: &[f64],
        machine: &Machine,
    ) -> Result<Self, CliError> {
        let table = Table::load()?;
        let nearest = nearest(scene, setup, frames, voltages);
        let keys = &scene.reconstruction;
        let pixels = keys.pixels.unwrap_or(DEFAULT_PIXELS);
        let gap = keys.target_gap.unwrap_or(DEFAULT_TARGET_GAP);
        let bounded = keys.lower_s.is_some_and(|lower| lower >= 0.0);
        let row = table.of(nearest.scene, (method, bounded), (pixels, gap)).cloned();
        let kinds = [false, true].map(|live| {
            BUDGETS_S.map(|budget_s| {
                (budget_s, live, table.best(nearest.scene, (budget_s, live), |_| true).cloned())
            })
        });
        let slowness = row.as_ref().map_or(1.0, |row| row.slowness(machine));
        Ok(Self { nearest, row, best: kinds.into_iter().flatten().collect(), slowness })
    }

    /// Relative error of the images.
    pub fn error(&self) -> Option<f64> {
        self.row.as_ref().map(|row| row.relative_error)
    }

    /// Lines of the plan.
    pub fn words(&self) -> Vec<String> {
        let Nearest { scene, why } = &self.nearest;
        let mut lines = vec![match &self.row {
            Some(row) => format!(
                "expected error of the images: {:.2} of the truth's norm (1: an empty image), as {} \
                 measured on {scene}, the built-in scene most like this one ({why})",
                row.relative_error,
                row.words()
            ),
            None => format!("expected error of the images: not measured on {scene} ({why})"),
        }];
        lines.push("least error within the time that a frame may take here".to_owned());
        for (budget_s, live, row) in &self.best {
            let kind = if *live { "live" } else { "recorded" };
            let found = row.as_ref().map_or_else(
                || "nothing is so fast".to_owned(),
                |row| {
                    let time_ms = row.ms_a_frame * self.slowness;
                    format!("{}: error {:.2}, {time_ms:.2} ms", row.words(), row.relative_error)
                },
            );
            lines.push(format!("  {:>4} ms, {kind:<9} {found}", 1e3 * budget_s));
        }
        lines
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let one = |(budget_s, live, row): &(f64, bool, Option<Measured>)| {
            json!({
                "budget_s": budget_s,
                "live": live,
                "solver": row.as_ref().map(|row| &row.solver),
                "pixels": row.as_ref().and_then(|row| row.pixels),
                "target_gap": row.as_ref().and_then(|row| row.target_gap),
                "relative_error": row.as_ref().map(|row| row.relative_error),
                "expected_time_s": row.as_ref().map(|row| 1e-3 * row.ms_a_frame * self.slowness),
            })
        };
        json!({
            "measured_on": self.nearest.scene,
            "because": self.nearest.why,
            "relative_error": self.error(),
            "best": self.best.iter().map(one).collect::<Vec<_>>(),
        })
    }
}
