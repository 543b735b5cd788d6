//! The best solver for a time a frame may take.

use super::merged::Row;
use crate::machine::Machine;
use serde_json::{Value, json};

/// Times that a frame may take, seconds.
pub(super) const BUDGETS_S: [f64; 3] = [1e-2, 1e-3, 1e-4];

/// The row with the least error within a budget; of equals the faster one. `live`: only what gives
/// a frame's image before the next frame comes.
pub(super) fn within(rows: &[Row], budget_s: f64, live: bool) -> Option<&Row> {
    rows.iter()
        .filter(|row| row.time.median_s <= budget_s && row.error.is_finite())
        .filter(|row| (row.solver.is_live || !live) && !row.solver.is_peer)
        .min_by(|a, b| {
            a.error.total_cmp(&b.error).then(a.time.median_s.total_cmp(&b.time.median_s))
        })
}

/// A line of the table: budget, for recordings or live, and the row.
pub(super) type Choice<'a> = (f64, bool, Option<&'a Row>);

/// The choices of a scene.
pub(super) fn choices(rows: &[Row]) -> Vec<Choice<'_>> {
    let kinds = [false, true];
    let of = |budget: f64| kinds.map(|live| (budget, live, within(rows, budget, live)));
    BUDGETS_S.into_iter().flat_map(of).collect()
}

pub(super) const HEAD: [&str; 7] =
    ["ms a frame", "for", "solver", "pixels", "gap", "error", "takes, ms"];

/// Cells of a choice under [`HEAD`].
pub(super) fn cells((budget_s, live, row): &Choice<'_>) -> Vec<String> {
    let kind = if *live { "live" } else { "recordings" };
    let mut cells = vec![format!("{}", 1e3 * budget_s), kind.to_owned()];
    match row {
        Some(row) => cells.extend([
            row.solver.name.clone(),
            row.pixels_words(),
            row.gap_words(),
            format!("{:.3}", row.error),
            format!("{:.3}", 1e3 * row.time.median_s),
        ]),
        None => cells.extend(
            ["none is so fast".to_owned()]
                .into_iter()
                .chain(std::iter::repeat_n("-".to_owned(), HEAD.len() - 3)),
        ),
    }
    cells
}

/// For programs.
pub(super) fn json(rows: &[Row], machine: &Machine) -> Value {
    let one = |(budget_s, live, row): &Choice<'_>| json!({"budget_s": budget_s, "live": live, "choice": row.map(|row| row.json(machine))});
    choices(rows).iter().map(one).collect()
}
