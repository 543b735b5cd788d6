//! What the race leaves: a page, a Markdown text, tables for programs, pictures.

use super::super::{Answer, markdown};
use super::{Findings, Size, best, plots};
use crate::error::CliError;
use crate::html::{Block, Page, Section};
use crate::machine::Machine;
use crate::measured::Measured;
use crate::output::{OutFolder, io};
use crate::progress::Progress;
use serde_json::{Value, json};

const TITLE: &str = "Error against run time";

/// A table: names of the columns, rows, conditions.
#[derive(Clone)]
struct Table {
    head: Vec<String>,
    rows: Vec<Vec<String>>,
    note: String,
}

impl Table {
    fn new(head: &[&str], rows: Vec<Vec<String>>, note: impl Into<String>) -> Self {
        Self { head: head.iter().map(|name| (*name).to_owned()).collect(), rows, note: note.into() }
    }

    fn block(&self) -> Block {
        let Self { head, rows, note } = self.clone();
        Block::Table { head, rows, note }
    }

    fn markdown(&self) -> String {
        let head: Vec<&str> = self.head.iter().map(String::as_str).collect();
        format!("{}\n{}\n", markdown(&head, &self.rows), self.note)
    }
}

/// Writes everything.
pub(super) fn write(
    results: &[Findings],
    (size, machine, quick): (&Size, &Machine, bool),
    out: &mut OutFolder,
    progress: &Progress,
) -> Result<Answer, CliError> {
    let lead = format!(
        "Simulated touches, one thread, times of a frame as medians over the runs. {}{}.",
        machine.words(),
        if quick { ". Quick: fewer frames, pixels, gaps and meshes" } else { "" }
    );
    // cases of one skin share its meshes
    let mut forward: Vec<_> = results.iter().map(|r| (r.case.scene, &r.forward)).collect();
    forward.dedup_by_key(|(scene, _)| *scene);
    let is_whole = forward.iter().any(|(_, course)| !course.points.is_empty());
    let forward_png = match is_whole {
        true => Some(plots::png(&plots::forward(&forward)?)?),
        false => None,
    };
    let mut page = Page { title: TITLE.to_owned(), lead: lead.clone(), sections: Vec::new() };
    let mut text = format!("# {TITLE}\n\n{lead}\n");
    let mut add = |title: &str, blocks: Vec<Block>, table: Option<&Table>| {
        if let Some(table) = table {
            text += &format!("\n## {title}\n\n{}", table.markdown());
        }
        page.sections.push(Section { title: title.to_owned(), blocks });
    };
    let choices = choices_table(results);
    if is_whole {
        add("Which solver for which time", vec![choices.block()], Some(&choices));
    }
    let promises = promise_table(results);
    add("What the plan promised", vec![promises.block()], Some(&promises));
    let meshes = forward_table(results);
    let picture = |bytes: &[u8], caption: &str| Block::Picture {
        bytes: bytes.to_vec(),
        caption: caption.to_owned(),
    };
    if let Some(png) = &forward_png {
        let blocks = vec![picture(png, "Error of the voltages over time"), meshes.block()];
        add("Forward problem", blocks, Some(&meshes));
    }
    for result in results.iter().filter(|_| is_whole) {
        let table = scene_table(result);
        let mut blocks: Vec<Block> =
            result.pictures.iter().map(|(_, bytes)| picture(bytes, &result.note)).collect();
        blocks.push(table.block());
        add(result.case.name, blocks, Some(&table));
    }
    page.sections.push(about(size, machine));
    out.write("report.html", |w| page.write(w))?;
    out.write("report.md", |w| w.write_all(text.as_bytes()).map_err(io))?;
    if let Some(png) = &forward_png {
        out.write("forward.png", |w| w.write_all(png).map_err(io))?;
    }
    for (name, bytes) in results.iter().flat_map(|result| &result.pictures) {
        out.write(name, |w| w.write_all(bytes).map_err(io))?;
    }
    if is_whole {
        out.write("inverse.csv", |w| {
            let mut writer = csv::Writer::from_writer(w);
            for row in results.iter().flat_map(|result| &result.rows) {
                writer.serialize(row).map_err(csv_failed)?;
            }
            writer.flush().map_err(io)
        })?;
        out.write("forward.csv", |w| csv_of(&meshes, w))?;
    }
    out.write("plan.csv", |w| csv_of(&promises, w))?;
    let json = json(results, machine, progress);
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let text = format!(
        "{}\n{}\nwritten to {}: {}; open report.html",
        machine.words(),
        if is_whole { choices.markdown() } else { promises.markdown() },
        out.path().display(),
        out.names().join(", ")
    );
    Ok(Answer { text, json })
}

fn choices_table(results: &[Findings]) -> Table {
    let head: Vec<&str> = std::iter::once("scene").chain(best::HEAD).collect();
    let rows = results.iter().flat_map(|result| {
        let named = |cells: Vec<String>| {
            std::iter::once(result.case.name.to_owned()).chain(cells).collect::<Vec<_>>()
        };
        best::cells(&result.rows).into_iter().map(named)
    });
    Table::new(
        &head,
        rows.collect(),
        "The least error within the time that a frame may take; of those within 2 % of it the \
         cheapest. Time: for recordings the median of a frame with its share of the choice of weights \
         or hyperparameter; live the time that 95 of 100 frames do not exceed, of solvers that know the \
         skin and the noise before the first frame and nothing of the recording. Without set-up. Error: \
         relative, root mean square over soft and hard fingers (one and two on the fabric), 1 for an \
         empty image.",
    )
}

fn promise_table(results: &[Findings]) -> Table {
    let mut rows = Vec::new();
    let all = results.iter().flat_map(|r| r.promises.iter().map(move |promise| (r, promise)));
    for (result, promise) in all {
        for (stage, planned_s, measured_s) in &promise.stages {
            rows.push(vec![
                result.case.name.to_owned(),
                promise.method.name().to_owned(),
                (*stage).to_owned(),
                format!("{:.3}", 1e3 * planned_s),
                format!("{:.3}", 1e3 * measured_s),
                format!("{:.2}", planned_s / measured_s),
            ]);
        }
        let (planned, measured) = promise.error;
        rows.push(vec![
            result.case.name.to_owned(),
            promise.method.name().to_owned(),
            "relative error".to_owned(),
            planned.map_or_else(|| "-".to_owned(), |error| format!("{error:.3}")),
            format!("{measured:.3}"),
            planned.map_or_else(|| "-".to_owned(), |error| format!("{:.2}", error / measured)),
        ]);
    }
    Table::new(
        &["scene", "method", "stage", "planned, ms", "measured, ms", "planned / measured"],
        rows,
        "What `eit plan` says of the scene with its noise stated, with its own method and with one-step \
         images, beside medians of three runs, on recordings with other paths and noise than those \
         that the plan knows. The error has no unit.",
    )
}

fn forward_table(results: &[Findings]) -> Table {
    let mut rows = Vec::new();
    for (number, result) in results.iter().enumerate() {
        if results[..number].iter().any(|before| before.case.scene == result.case.scene) {
            continue;
        }
        for point in &result.forward.points {
            rows.push(vec![
                result.case.scene.to_owned(),
                point.solver.clone(),
                point.nodes.to_string(),
                point.elements.to_string(),
                format!("{:.3}", 1e3 * point.time.least_s),
                format!("{:.3}", 1e3 * point.time.median_s),
                format!("{:.3}", 1e3 * point.time.most_s),
                format!("{:.3}", 1e3 * point.floor_s),
                format!("{:.1e}", point.error),
                result.forward.reference.clone(),
            ]);
        }
    }
    Table::new(
        &[
            "scene",
            "solver",
            "nodes",
            "elements",
            "least, ms",
            "median",
            "most",
            "floor, ms",
            "error",
            "against",
        ],
        rows,
        "Factorisation, voltages and Jacobian of the untouched skin with memory of earlier runs; \
         error: the largest over the largest voltage.",
    )
}

fn scene_table(result: &Findings) -> Table {
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
    for (solver, shape, why) in &result.failures {
        note += &format!(". Failed on {shape}: {solver}: {why}");
    }
    for why in &result.forward.failures {
        note += &format!(". Failed: {why}");
    }
    Table::new(
        &[
            "solver",
            "pixels",
            "gap asked",
            "error",
            "soft / one",
            "hard / two",
            "position, mm",
            "found",
            "live",
            "ms a frame",
            "spread, ms",
            "times",
            "floor, ms",
            "gap proven",
            "iterations",
            "status",
            "set-up, s",
            "choice, s",
        ],
        result.rows.iter().map(row).collect(),
        note,
    )
}

/// How to read it, and how to make it again.
fn about(size: &Size, machine: &Machine) -> Section {
    let pair = |name: &str, words: String| (name.to_owned(), words);
    let pairs = vec![
        pair("machine", machine.words()),
        pair("made by", format!("eit report, version {}", env!("CARGO_PKG_VERSION"))),
        pair(
            "error",
            "norm of the movie's difference from the truth over the norm of the truth, weighted by \
             area; coarser rasters are shown on the finest as squares"
                .to_owned(),
        ),
        pair(
            "time",
            format!(
                "of a frame, without set-up and choice of weights; of recordings median, least and \
                 most of up to {} runs ({} of direct methods), of live solvers of single frames of {} \
                 runs ({} of direct ones), those that fill a window included",
                size.runs, size.direct_runs, size.stream_runs, size.direct_runs
            ),
        ),
        pair(
            "floor",
            "operations over the rate of a dense product, or bytes over that of a plain read, \
             whichever takes longer; both rates measured as the run begins. Total variation is counted \
             with every direction of the data, of which the solver leaves half and more to an explicit \
             step. A time below the floor says that directions were left out, or that the machine has \
             become faster since"
                .to_owned(),
        ),
        pair(
            "gap",
            "part by which the objective can still fall, proven by a dual point; a solver stops when \
             its proof is below what was asked"
                .to_owned(),
        ),
    ];
    Section { title: "How to read it".to_owned(), blocks: vec![Block::List(pairs)] }
}

fn json(results: &[Findings], machine: &Machine, progress: &Progress) -> Value {
    let of_scene = |result: &Findings| {
        json!({
            "scene": result.case.name,
            "note": result.note,
            "solvers": result.rows,
            "choices": best::json(&result.rows),
            "failures": result.failures.iter()
                .map(|(solver, shape, why)| json!({"solver": solver, "shape": shape, "why": why}))
                .collect::<Vec<_>>(),
            "forward": {
                "reference": result.forward.reference,
                "meshes": result.forward.points.iter().map(|p| json!({
                    "solver": p.solver, "nodes": p.nodes, "elements": p.elements, "time": p.time,
                    "floor_s": p.floor_s, "error": p.error,
                })).collect::<Vec<_>>(),
            },
            "plans": result.promises.iter().map(|promise| json!({
                "method": promise.method.name(),
                "stages": promise.stages.iter().map(|(stage, planned_s, measured_s)| json!({
                    "stage": stage, "planned_s": planned_s, "measured_s": measured_s,
                })).collect::<Vec<_>>(),
                "expected_error": promise.error.0,
                "measured_error": promise.error.1,
            })).collect::<Vec<_>>(),
        })
    };
    json!({
        "machine": machine,
        "scenes": results.iter().map(of_scene).collect::<Vec<_>>(),
        "stages": progress.times(),
    })
}

fn csv_of(table: &Table, out: &mut dyn std::io::Write) -> Result<(), CliError> {
    let head: Vec<&str> = table.head.iter().map(String::as_str).collect();
    csv(&head, &table.rows, out)
}

/// Comma-separated values; cells with commas, quotes or line breaks are quoted.
fn csv(head: &[&str], rows: &[Vec<String>], out: &mut dyn std::io::Write) -> Result<(), CliError> {
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(head).map_err(csv_failed)?;
    for row in rows {
        writer.write_record(row).map_err(csv_failed)?;
    }
    writer.flush().map_err(io)
}

fn csv_failed(error: csv::Error) -> CliError {
    CliError::Failure(format!("writing failed: {error}"))
}
