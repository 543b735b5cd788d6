//! Tables of image results.

use super::budgets;
use super::images::{ImageResults, LeftOutNet};
use super::inverse::SolverFailure;
use super::table::Table;
use eit_skin::plan::measured::Measured;

/// Table of the best solver of each scene for each time budget per frame.
pub(super) fn choices<'a>(scenes: impl Iterator<Item = &'a ImageResults>) -> Table {
    let head = format!("scene | {}", budgets::HEAD);
    let rows = scenes.flat_map(|result| {
        let named = |cells: Vec<String>| {
            std::iter::once(result.case.name.clone()).chain(cells).collect::<Vec<_>>()
        };
        budgets::cells(&result.rows).into_iter().map(named)
    });
    Table::new(
        &head,
        rows.collect(),
        "The solver with the smallest error within the time budget per frame or, among those \
         within 2 % of that error, the cheapest. Time: for recordings, the median per frame \
         including its share of choosing weights or hyperparameter; for live solvers, which know \
         the skin and the noise but not the recording in advance, the time that 95 % of the frames \
         do not exceed. Set-up is excluded. Error: relative, root mean square over soft and hard \
         fingers (one and two on the fabric), 1 for an empty image.",
    )
}

/// Table of every solver of a scene at every setting.
pub(super) fn solvers(result: &ImageResults) -> Table {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let gap = |gap: Option<f64>| gap.map_or_else(|| "-".to_owned(), |gap| format!("{gap:.1e}"));
    let row = |row: &Measured| {
        vec![
            row.label(),
            row.pixels.map_or_else(|| "elements".to_owned(), |pixels| pixels.to_string()),
            gap(row.target_gap),
            format!("{:.3}", row.relative_error),
            format!("{:.3}", row.relative_error_first),
            number(row.relative_error_second, 3),
            number(row.position_error_mm, 1),
            format!("{:.2}", row.found),
            if row.live { "yes" } else { "no" }.to_owned(),
            format!("{:.3}", row.ms_a_frame),
            format!("{:.3} to {:.3}", row.ms_a_frame_least, row.ms_a_frame_most),
            row.times.to_string(),
            number(row.floor_ms_a_frame, 4),
            gap(row.proven_gap),
            format!("{:.0}", row.iterations),
            row.status.clone(),
            format!("{:.2}", row.set_up_s),
            format!("{:.2}", row.choice_s),
        ]
    };
    let mut note = result.note.clone();
    for SolverFailure { solver, shape, why } in &result.failures {
        note += &format!(". Failed on {shape}: {solver}: {why}");
    }
    for LeftOutNet { net, why } in &result.left_out {
        note += &format!(". Left out: {net}: {why}");
    }
    Table::new(
        "solver | pixels | gap asked | error | soft / one | hard / two | position, mm | found | live | ms a frame | spread, ms | times | floor, ms | gap proven | iterations | status | set-up, s | choice, s",
        result.rows.iter().map(row).collect(),
        note,
    )
}
