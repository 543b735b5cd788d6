//! Expected quality of a scene's images, as measured on the most similar built-in scene.

use super::machine::Machine;
use super::measured::{BUDGETS_S, Budget, Measured, Nearest, Table, Wanted, best, nearest, suits};
use crate::error::SkinError;
use crate::method::Method;
use crate::scene::StageSettings;
use crate::skin::Skin;
use crate::total_variation::DEFAULT_TARGET_GAP;
use serde::Serialize;

/// The best solver within a budget.
#[derive(Debug, Clone, Serialize)]
struct BestIn {
    budget_s: f64,
    live: bool,
    solver: Option<String>,
    pixels: Option<usize>,
    target_gap: Option<f64>,
    relative_error: Option<f64>,
    expected_time_s: Option<f64>,
    #[serde(skip)]
    words: Option<String>,
}

impl BestIn {
    fn of(budget: Budget, row: Option<&Measured>, machine: &Machine) -> Self {
        let time_s = |row: &Measured| 1e-3 * row.cost_ms_a_frame * row.slowness(machine);
        Self {
            budget_s: budget.time_s,
            live: budget.is_live,
            solver: row.map(Measured::label),
            pixels: row.and_then(|row| row.pixels),
            target_gap: row.and_then(|row| row.target_gap),
            relative_error: row.map(|row| row.relative_error),
            expected_time_s: row.map(time_s),
            words: row.map(|row| {
                let time_ms = row.cost_ms_a_frame * row.slowness(machine);
                format!("{}: error {:.2}, {time_ms:.2} ms", row.description(), row.relative_error)
            }),
        }
    }
}

/// Expected error and cost, and the best solvers for several frame times.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Expected {
    /// The built-in scene most similar to the skin.
    #[serde(flatten)]
    pub nearest: Nearest,
    /// Relative error of the images.
    pub relative_error: Option<f64>,
    /// Measurements of the scene's method there.
    #[serde(skip)]
    pub row: Option<Measured>,
    /// The best solver within each budget.
    best: Vec<BestIn>,
}

/// The settings as `frame_time_s` would see them if the user had stated the noise but chosen nothing else;
/// bounds and hyperparameter rule stay.
fn open(settings: &StageSettings) -> StageSettings {
    let mut settings = settings.clone();
    let keys = &mut settings.reconstruction;
    (keys.method, keys.pixels, keys.target_gap) = (None, None, None);
    settings.noise.additive_v.get_or_insert(1.0);
    settings
}

impl Expected {
    /// Looks up the skin for a method and number of frames. `voltages` are those of the untouched skin.
    ///
    /// # Errors
    ///
    /// A table that cannot be read.
    pub(crate) fn of(
        skin: &Skin,
        method: Method,
        frames: Option<usize>,
        voltages: &[f64],
        machine: &Machine,
    ) -> Result<Self, SkinError> {
        let table = Table::load()?;
        let nearest = nearest(skin, frames, voltages);
        let keys = &skin.settings.reconstruction;
        let target_gap = keys.target_gap.unwrap_or(DEFAULT_TARGET_GAP);
        let wanted = Wanted { method, settings: keys, pixels: skin.pixels(), target_gap };
        let row = table.of(nearest.scene, &wanted).cloned();
        let wishes = open(&skin.settings);
        let rows = table.of_scene(nearest.scene).filter(|row| suits(&wishes, row));
        let of = |is_live| {
            BUDGETS_S.map(|time_s| {
                let budget = Budget { time_s, is_live };
                BestIn::of(budget, best(rows.clone(), budget), machine)
            })
        };
        let best = [of(false), of(true)].concat();
        let relative_error = row.as_ref().map(|row| row.relative_error);
        Ok(Self { nearest, relative_error, row, best })
    }

    /// Returns lines for the plan.
    pub(crate) fn description(&self) -> Vec<String> {
        let Nearest { scene, why } = &self.nearest;
        let mut lines = vec![match &self.row {
            Some(row) => format!(
                "expected error of the images: {:.2} of the truth's norm (1: an empty image), as \
                 measured with \
                 {} on {scene}, the built-in scene most like this one ({why})",
                row.relative_error,
                row.description()
            ),
            None => format!("expected error of the images: not measured on {scene} ({why})"),
        }];
        lines.push(
            "smallest error within a frame time, among what this scene allows once its noise is stated \
             (frame_time_s selects it), and the time on this machine"
                .to_owned(),
        );
        let none = "nothing that the scene allows is fast enough";
        for BestIn { budget_s, live, words, .. } in &self.best {
            let kind = if *live { "live" } else { "recorded" };
            let found = words.as_deref().unwrap_or(none);
            lines.push(format!("  {:>4} ms, {kind:<9} {found}", 1e3 * budget_s));
        }
        lines
    }
}
