//! Output of the benchmark: a page, a Markdown file, CSV tables and JSON, and pictures.

use super::budgets;
use super::forward::results::ForwardResults;
use super::forward::tables as forward_tables;
use super::image_tables;
use super::images::ImageResults;
use super::picture::Picture;
use super::results::BenchmarkResults;
use super::settings::{BenchmarkSettings, Size};
use super::table::{Table, csv_failed};
use crate::Answer;
use crate::error::ReportError;
use crate::html::{Block, Page, Section};
use crate::output::{OutFolder, io};
use eit_skin::Progress;
use eit_skin::plan::machine::Machine;
use serde_json::{Value, json};

const TITLE: &str = "Error against run time";

/// The tables of a benchmark.
struct Tables {
    choices: Table,
    chosen_meshes: Table,
    meshes: Table,
}

impl Tables {
    fn of(results: &BenchmarkResults) -> Self {
        Self {
            choices: image_tables::choices(measured(results)),
            chosen_meshes: forward_tables::choices(&results.forward),
            meshes: forward_tables::meshes(&results.forward),
        }
    }
}

/// Returns the scenes whose images were measured.
fn measured(results: &BenchmarkResults) -> impl Iterator<Item = &ImageResults> {
    results.images.iter().filter(|scene| !scene.rows.is_empty())
}

/// Writes all results so far and lists the scenes that are `missing`.
pub(super) fn write(
    results: &BenchmarkResults,
    settings: &BenchmarkSettings<'_>,
    missing: &[&str],
    out: &mut OutFolder,
    progress: &Progress,
) -> Result<Answer, ReportError> {
    let machine = &settings.roofline.machine;
    let incomplete = match missing {
        [] => String::new(),
        _ => format!("Incomplete, without {}. ", missing.join(", ")),
    };
    let tables = Tables::of(results);
    let mut document = Document::new(&lead(results, settings, &incomplete), machine);
    document.add_results(results, &tables);
    let Document { mut page, text } = document;
    page.sections.push(about(settings.size, machine));
    out.write("report.html", |w| page.write(w))?;
    out.write("report.md", |w| w.write_all(text.as_bytes()).map_err(io))?;
    write_pictures(results, out)?;
    write_tables(results, &tables, out)?;
    if !missing.is_empty() {
        let words = format!("{incomplete}\n");
        out.write("incomplete.txt", |w| w.write_all(words.as_bytes()).map_err(io))?;
    }
    let json = json(results, machine, missing, progress);
    out.write("report.json", |w| writeln!(w, "{json:#}").map_err(io))?;
    let Tables { choices, chosen_meshes, .. } = &tables;
    let shown = [choices, chosen_meshes].into_iter().find(|table| !table.is_empty());
    let text = format!(
        "{}\n{}\nwritten to {}: {}; open report.html",
        machine.description(),
        shown.map(Table::markdown).unwrap_or_default(),
        out.path().display(),
        out.names().join(", ")
    );
    Ok(Answer { text, json })
}

/// Describes what was run, and on which machine.
fn lead(results: &BenchmarkResults, settings: &BenchmarkSettings<'_>, incomplete: &str) -> String {
    let subject = match results.images.is_empty() {
        true => "Forward problems; times are medians over the runs",
        false => "Simulated touches; times per frame are medians over the runs",
    };
    let short = match settings.report.full {
        true => "",
        false => " Short form: with --full, more frames, pixels, gaps and meshes.",
    };
    let result = measured(results).next().and_then(result).unwrap_or_default();
    let processor = &settings.roofline.machine.processor;
    format!("{incomplete}{result}{subject}, on one thread of {processor}.{short}")
}

/// The result of a scene in a sentence: the smallest errors within the largest budget.
fn result(scene: &ImageResults) -> Option<String> {
    let of = |(is_live, kind): (bool, &str)| {
        let best = budgets::best_of(&scene.rows, is_live)?;
        let (percent, ms) = (100.0 * best.relative_error, best.cost_ms_a_frame);
        Some(format!("{percent:.0} % {kind} ({}, {ms:.1} ms a frame)", best.label()))
    };
    let found: Vec<String> =
        [(true, "live"), (false, "for a recording")].into_iter().filter_map(of).collect();
    let (name, what) = (&scene.case.name, &scene.case.what);
    (!found.is_empty()).then(|| {
        format!(
            "{name} ({what}): relative error of the best images {}; an empty image has 100 %. ",
            found.join(", ")
        )
    })
}

/// The same sections as a page and as Markdown.
struct Document {
    page: Page,
    text: String,
}

impl Document {
    /// Creates the document. The page names the machine at its end, and Markdown, from which
    /// documents copy, at its start.
    fn new(lead: &str, machine: &Machine) -> Self {
        let (title, lead) = (TITLE.to_owned(), lead.to_owned());
        let text = format!("# {TITLE}\n\n{lead} Machine: {}.\n", machine.description());
        Self { page: Page { title, lead, sections: Vec::new() }, text }
    }

    fn add(&mut self, title: &str, blocks: Vec<Block>, table: &Table) {
        self.text += &format!("\n## {title}\n\n{}", table.markdown());
        self.page.sections.push(Section { title: title.to_owned(), blocks });
    }

    fn add_results(&mut self, results: &BenchmarkResults, tables: &Tables) {
        let Tables { choices, chosen_meshes, meshes } = tables;
        if measured(results).next().is_some() {
            // the result as a picture comes first, and stays with the page where the folder is lost
            let first = measured(results).next().and_then(|scene| scene.pictures.first());
            let caption = "Error against time of every solver on the first scene";
            let embed = |picture: &Picture| Block::Picture {
                bytes: picture.bytes.clone(),
                caption: caption.to_owned(),
            };
            let mut blocks: Vec<Block> = first.map(embed).into_iter().collect();
            let images = measured(results).next().and_then(|scene| scene.pictures.get(1));
            blocks.extend(images.map(|images| block(images, "One frame of it by every solver")));
            blocks.push(choices.block());
            self.add("Which solver for which time", blocks, choices);
        }
        if !results.forward.is_empty() {
            let mut blocks = vec![chosen_meshes.block()];
            blocks.extend(results.forward.iter().filter_map(forward_picture));
            self.add("Forward problem", blocks, chosen_meshes);
        }
        for scene in measured(results) {
            let table = image_tables::solvers(scene);
            let mut blocks: Vec<Block> =
                scene.pictures.iter().map(|picture| block(picture, &scene.note)).collect();
            blocks.push(table.block());
            self.add(&scene.case.name, blocks, &table);
        }
        // long tables come after all pictures
        if !results.forward.is_empty() {
            self.add("Forward problem, mesh by mesh", vec![meshes.block()], meshes);
        }
    }
}

/// Writes the CSV tables.
fn write_tables(
    results: &BenchmarkResults,
    tables: &Tables,
    out: &mut OutFolder,
) -> Result<(), ReportError> {
    if measured(results).next().is_some() {
        out.write("inverse.csv", |w| {
            let mut writer = csv::Writer::from_writer(w);
            for row in measured(results).flat_map(|scene| &scene.rows) {
                writer.serialize(row).map_err(csv_failed)?;
            }
            writer.flush().map_err(io)
        })?;
    }
    if !results.forward.is_empty() {
        out.write("forward.csv", |w| tables.meshes.write_csv(w))?;
    }
    Ok(())
}

fn block(picture: &Picture, caption: &str) -> Block {
    Block::File { name: picture.file.clone(), caption: caption.to_owned() }
}

fn forward_picture(results: &ForwardResults) -> Option<Block> {
    let caption = format!("{}: {}", results.case.skin(), results.case.what);
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

/// Explains how to read the report and how it was made.
fn about(size: &Size, machine: &Machine) -> Section {
    let version = format!("eit report, version {}", env!("CARGO_PKG_VERSION"));
    let made = [("machine", machine.description()), ("made by", version)];
    let times = times(size);
    let terms = terms(&times).map(|(name, words)| (name, words.to_owned()));
    let pairs = made.into_iter().chain(terms).map(|(name, words)| (name.to_owned(), words));
    Section { title: "How to read it".to_owned(), blocks: vec![Block::List(pairs.collect())] }
}

/// Says how often what was timed.
fn times(size: &Size) -> String {
    format!(
        "per frame, excluding set-up and the choice of weights; for recordings the median, minimum and \
         maximum of up to {} runs ({} for direct methods); for live solvers those of single frames in up \
         to {} runs, including frames that fill a window",
        size.runs,
        size.direct_runs,
        size.stream_runs.max(size.direct_runs)
    )
}

/// What the columns and sections mean.
fn terms(times: &str) -> [(&str, &str); 7] {
    [
        (
            "solver",
            "as `eit reconstruct --method` names it. \"≥ 0\": a touch can only raise the conductivity; \
             \"stream\": frame by frame, as in live use; \"gcv\": hyperparameter by generalised \
             cross-validation instead of the noise figure",
        ),
        (
            "cost",
            "time per frame that counts against the budget: that of the solver alone and its share of \
             choosing weights or, if live, the time that 95 % of the frames do not exceed",
        ),
        (
            "error",
            "area-weighted norm of the difference between movie and truth, divided by the norm of \
             the truth; pixels of coarser rasters appear as squares on the finest",
        ),
        ("time", times),
        (
            "floor",
            "the longer of operations divided by the rate of a dense product and bytes divided by \
             the rate of a plain read; both rates are measured at the start of the run. The floor \
             of total variation counts every direction of the data, of which the solver handles \
             half or more by an explicit step. A time below the floor means that directions were \
             omitted, or that the machine has since become faster",
        ),
        (
            "forward problem",
            "two families of meshes with linear and with quadratic elements, each mesh finer than \
             the previous one by a factor of the square root of two. One family has the same edge \
             length everywhere; the other has twice that length in the interior and, at electrode \
             ends, initially a quarter of an electrode's width, which decreases with the square of \
             the edge length (on outlines of round patches, with the edge length). The skin is \
             untouched unless a picture says otherwise. Errors are relative to the mesh-free \
             series, whose own error is estimated by adding terms, or to quadratic elements on a \
             mesh that is finer everywhere and strongly refined towards electrode ends and corners \
             of holes, whose own error is the change from a mesh coarser by a factor of 1.5",
        ),
        (
            "gap",
            "fraction by which the objective can still decrease, proven by a dual point; a solver \
             stops when this bound is below the target",
        ),
    ]
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
            "failures": result.failures,
            "left_out": result.left_out,
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
