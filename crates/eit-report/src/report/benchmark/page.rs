//! What the benchmark leaves: a page, a Markdown text, tables for programs, pictures.
//! Long because the tables are one list.

use super::budgets;
use super::forward::results::ForwardResults;
use super::forward::tables as forward_tables;
use super::images::{ImageResults, RecordingFailure};
use super::picture::Picture;
use super::plan_check::StageCheck;
use super::results::BenchmarkResults;
use super::settings::{BenchmarkSettings, Size};
use super::table::{Table, csv_failed};
use crate::Answer;
use crate::error::ReportError;
use crate::html::{Block, Page, Section};
use crate::output::{OutFolder, io};
use eit_skin::Progress;
use eit_skin::plan::machine::Machine;
use eit_skin::plan::measured::Measured;
use serde_json::{Value, json};

const TITLE: &str = "Error against run time";

/// Writes everything that is known so far; scenes that are `missing` are told.
pub(super) fn write(
    results: &BenchmarkResults,
    settings: &BenchmarkSettings<'_>,
    missing: &[&str],
    out: &mut OutFolder,
    progress: &Progress,
) -> Result<Answer, ReportError> {
    let BenchmarkResults { forward, images: scenes } = results;
    let (machine, quick) = (&settings.roofline.machine, settings.report.quick);
    let incomplete = match missing {
        [] => String::new(),
        _ => format!("Incomplete, without {}. ", missing.join(", ")),
    };
    let subject = match scenes.is_empty() {
        true => "Forward problems, one thread, times as medians over the runs",
        false => "Simulated touches, one thread, times of a frame as medians over the runs",
    };
    let lead = format!(
        "{incomplete}{subject}. {}{}.",
        machine.words(),
        if quick { ". Quick: fewer frames, pixels, gaps and meshes" } else { "" }
    );
    let mut page = Page { title: TITLE.to_owned(), lead: lead.clone(), sections: Vec::new() };
    let mut text = format!("# {TITLE}\n\n{lead}\n");
    let mut add = |title: &str, blocks: Vec<Block>, table: &Table| {
        text += &format!("\n## {title}\n\n{}", table.markdown());
        page.sections.push(Section { title: title.to_owned(), blocks });
    };
    // with --plans no solver was run
    let measured = || scenes.iter().filter(|scene| !scene.rows.is_empty());
    let (choices, plans) = (choices_table(measured()), plan_table(scenes));
    let (chosen_meshes, meshes) =
        (forward_tables::choices(forward), forward_tables::meshes(forward));
    if measured().next().is_some() {
        add("Which solver for which time", vec![choices.block()], &choices);
    }
    if !scenes.is_empty() {
        add("What the plan promised", vec![plans.block()], &plans);
    }
    if !forward.is_empty() {
        let mut blocks = vec![chosen_meshes.block()];
        blocks.extend(forward.iter().filter_map(forward_picture));
        add("Forward problem", blocks, &chosen_meshes);
        add("Forward problem, mesh by mesh", vec![meshes.block()], &meshes);
    }
    for scene in measured() {
        let table = scene_table(scene);
        let mut blocks: Vec<Block> =
            scene.pictures.iter().map(|picture| block(picture, &scene.note)).collect();
        blocks.push(table.block());
        add(scene.case.name, blocks, &table);
    }
    page.sections.push(about(settings.size, machine));
    out.write("report.html", |w| page.write(w))?;
    out.write("report.md", |w| w.write_all(text.as_bytes()).map_err(io))?;
    write_pictures(results, out)?;
    if measured().next().is_some() {
        out.write("inverse.csv", |w| {
            let mut writer = csv::Writer::from_writer(w);
            for row in measured().flat_map(|scene| &scene.rows) {
                writer.serialize(row).map_err(csv_failed)?;
            }
            writer.flush().map_err(io)
        })?;
    }
    if !forward.is_empty() {
        out.write("forward.csv", |w| meshes.write_csv(w))?;
    }
    if !scenes.is_empty() {
        out.write("plan.csv", |w| plans.write_csv(w))?;
    }
    if !missing.is_empty() {
        let words = format!("{incomplete}\n");
        out.write("incomplete.txt", |w| w.write_all(words.as_bytes()).map_err(io))?;
    }
    let json = json(results, machine, missing, progress);
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let shown = [&choices, &chosen_meshes, &plans].into_iter().find(|table| !table.is_empty());
    let text = format!(
        "{}\n{}\nwritten to {}: {}; open report.html",
        machine.words(),
        shown.map(Table::markdown).unwrap_or_default(),
        out.path().display(),
        out.names().join(", ")
    );
    Ok(Answer { text, json })
}

fn block(picture: &Picture, caption: &str) -> Block {
    Block::Picture { bytes: picture.bytes.clone(), caption: caption.to_owned() }
}

fn forward_picture(results: &ForwardResults) -> Option<Block> {
    let mut caption = format!("{}: {}", results.case.scene, results.case.what);
    for why in &results.failures {
        caption += &format!(". Failed: {why}");
    }
    Some(block(results.picture.as_ref()?, &caption))
}

fn write_pictures(results: &BenchmarkResults, out: &mut OutFolder) -> Result<(), ReportError> {
    let of_skins = results.forward.iter().filter_map(|forward| forward.picture.as_ref());
    let of_scenes = results.images.iter().flat_map(|scene| &scene.pictures);
    for Picture { file, bytes } in of_skins.chain(of_scenes) {
        out.write(file, |w| w.write_all(bytes).map_err(io))?;
    }
    Ok(())
}

fn choices_table<'a>(scenes: impl Iterator<Item = &'a ImageResults>) -> Table {
    let head: Vec<&str> = std::iter::once("scene").chain(budgets::HEAD).collect();
    let rows = scenes.flat_map(|result| {
        let named = |cells: Vec<String>| {
            std::iter::once(result.case.name.to_owned()).chain(cells).collect::<Vec<_>>()
        };
        budgets::cells(&result.rows).into_iter().map(named)
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

fn plan_table(results: &[ImageResults]) -> Table {
    let mut rows = Vec::new();
    let all = results.iter().flat_map(|r| r.plans.iter().map(move |plan| (r, plan)));
    for (result, plan) in all {
        for StageCheck { stage, planned_s, measured_s } in &plan.stages {
            rows.push(vec![
                result.case.name.to_owned(),
                plan.method.name().to_owned(),
                (*stage).to_owned(),
                format!("{:.3}", 1e3 * planned_s),
                format!("{:.3}", 1e3 * measured_s),
                format!("{:.2}", planned_s / measured_s),
            ]);
        }
        let (planned, measured) = (plan.expected_error, plan.measured_error);
        rows.push(vec![
            result.case.name.to_owned(),
            plan.method.name().to_owned(),
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

fn scene_table(result: &ImageResults) -> Table {
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
    for RecordingFailure { solver, shape, why } in &result.failures {
        note += &format!(". Failed on {shape}: {solver}: {why}");
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
            "forward problem",
            "two families of meshes with linear and with quadratic elements, every mesh finer than the \
             one before by the root of two: the same edge everywhere, or twice that inside and at \
             electrode ends a quarter of an electrode's width at first, which falls with the square of \
             the edge (of round patches with the edge). The untouched skin, or what a \
             picture says. Errors are against the mesh-free series, whose own error is what more \
             terms change, or against quadratic elements on a mesh that is finer everywhere and ever \
             finer towards the ends of electrodes and the corners of holes, whose own error is the \
             change from a mesh that is coarser by the factor 1.5"
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

fn json(
    results: &BenchmarkResults,
    machine: &Machine,
    missing: &[&str],
    progress: &Progress,
) -> Value {
    let of_scene = |result: &ImageResults| {
        json!({
            "scene": result.case.name,
            "note": result.note,
            "solvers": result.rows,
            "choices": budgets::json(&result.rows),
            "failures": result.failures.iter()
                .map(|RecordingFailure { solver, shape, why }| {
                    json!({"solver": solver, "shape": shape, "why": why})
                })
                .collect::<Vec<_>>(),
            "plans": result.plans.iter().map(|plan| json!({
                "method": plan.method.name(),
                "stages": plan.stages.iter().map(|check| json!({
                    "stage": check.stage,
                    "planned_s": check.planned_s,
                    "measured_s": check.measured_s,
                })).collect::<Vec<_>>(),
                "expected_error": plan.expected_error,
                "measured_error": plan.measured_error,
            })).collect::<Vec<_>>(),
        })
    };
    json!({
        "machine": machine,
        "missing": missing,
        "forward": forward_tables::json(&results.forward),
        "scenes": results.images.iter().map(of_scene).collect::<Vec<_>>(),
        "stages": progress.times(),
    })
}
