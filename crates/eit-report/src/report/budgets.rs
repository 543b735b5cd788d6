//! Table of the best solver for each time budget per frame.

use eit_skin::plan::measured::{BUDGETS_S, Budget, Measured, best};
use serde_json::{Value, json};

/// The budgets of a scene, each with its best solver, if one is fast enough.
fn choices(rows: &[Measured]) -> impl Iterator<Item = (Budget, Option<&Measured>)> {
    let budgets = BUDGETS_S.into_iter();
    let budgets =
        budgets.flat_map(|time_s| [false, true].map(|is_live| Budget { time_s, is_live }));
    budgets.map(move |budget| (budget, best(rows.iter(), budget)))
}

/// The best solver within the largest budget, live or for recordings.
pub(super) fn best_of(rows: &[Measured], is_live: bool) -> Option<&Measured> {
    let time_s = BUDGETS_S.into_iter().fold(0.0, f64::max);
    best(rows.iter(), Budget { time_s, is_live })
}

pub(super) const HEAD: &str =
    "budget, ms | for | solver | pixels | gap | error | cost, ms | solver alone, ms";

/// Returns the cells of the choices for a scene, with headings [`HEAD`].
pub(super) fn cells(rows: &[Measured]) -> Vec<Vec<String>> {
    let one = |(budget, row): (Budget, Option<&Measured>)| {
        let kind = if budget.is_live { "live" } else { "recordings" };
        let mut cells = vec![format!("{}", 1e3 * budget.time_s), kind.to_owned()];
        match row {
            Some(row) => cells.extend([
                row.label(),
                row.pixels.map_or_else(|| "elements".to_owned(), |n| n.to_string()),
                row.target_gap.map_or_else(|| "-".to_owned(), |gap| format!("{gap:.0e}")),
                format!("{:.3}", row.relative_error),
                format!("{:.3}", row.cost_ms_a_frame),
                format!("{:.3}", row.ms_a_frame),
            ]),
            None => {
                cells.push("none is so fast".to_owned());
                cells.resize(HEAD.split('|').count(), "-".to_owned());
            }
        }
        cells
    };
    choices(rows).map(one).collect()
}

/// Returns the choices as JSON.
pub(super) fn json(rows: &[Measured]) -> Value {
    let one = |(budget, row): (Budget, Option<&Measured>)| json!({"budget_s": budget.time_s, "live": budget.is_live, "choice": row});
    choices(rows).map(one).collect()
}
