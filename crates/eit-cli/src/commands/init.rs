//! `eit init`: the first scene of a new skin, from its size, a port and two presses.

mod ask;
mod board;
mod presses;

use super::Answer;
use crate::cli::{InitArgs, ShapeArg};
use crate::error::CliError;
use ask::Questions;
use eit_skin::first_scene::{FirstScene, Numbering, Outline};
use eit_skin::scene::{ChangeSign, Direction};
use serde_json::{Value, json};
use std::path::Path;

/// Correlation below which the model does not represent the skin at all.
const UNLIKE: f64 = 0.6;
/// Correlation below which electrodes are reported as unequally spaced: positions on a rectangle
/// that are off by up to 0.3 of the spacing give 0.955, equally spaced ones 0.99 and more.
const EVEN: f64 = 0.97;
/// Minimum lead in likeness over the next best numbering.
const CLEAR: f64 = 0.03;

/// Asks, listens, and writes the scene.
pub(crate) fn run(args: &InitArgs, is_json: bool) -> Result<Answer, CliError> {
    check(args)?;
    let mut questions = Questions::new(is_json);
    let mut first = described(args, &mut questions)?;
    first.scene()?;
    let mut found = Found::default();
    if let Some(port) = &args.port {
        found = board::find(args, port, &mut first, &questions)?;
    }
    let notes = notes(&first, &found);
    let text = first.to_toml(&notes);
    // never write a scene that cannot be read
    first.scene()?;
    write(&args.out, &text, args.force)?;
    Ok(answer(&args.out, &first, &found))
}

/// What was determined about the board.
#[derive(Debug, Default)]
struct Found {
    /// Results for people, one per line.
    lines: Vec<String>,
    /// What is uncertain, and what to do about it.
    warnings: Vec<String>,
    values: Option<usize>,
    rate_hz: Option<f64>,
    reciprocity: Option<f64>,
    correlation: Option<f64>,
    numbering: Option<Numbering>,
    /// Neighbouring electrodes whose wires look exchanged, from 0.
    swapped: Option<[usize; 2]>,
}

/// Rejects invalid numbers before asking anything.
fn check(args: &InitArgs) -> Result<(), CliError> {
    // a smaller skin is a slip of unit, though possible in a scene file; a larger one is none of a scene file either
    let ranges = [
        ("--radius-mm", args.radius_mm, 1.0, 1e4),
        ("--width-mm", args.width_mm, 1.0, 1e4),
        ("--height-mm", args.height_mm, 1.0, 1e4),
        ("--electrode-width-mm", args.electrode_width_mm, 0.01, 1e4),
        ("--listen-s", Some(args.listen_s), 0.1, 1e5),
        ("--press-wait-s", Some(args.press_wait_s), 0.1, 1e5),
    ];
    for (name, value, least, most) in ranges {
        if let Some(value) = value.filter(|value| !(least..=most).contains(value)) {
            let message = format!("{name} {value}: it must be from {least} to {most}");
            return Err(CliError::input(message));
        }
    }
    if !args.electrode_at_deg.is_finite() {
        let message = format!("--electrode-at-deg {}: it must be finite", args.electrode_at_deg);
        return Err(CliError::input(message));
    }
    let is_disc = args.shape == Some(ShapeArg::Disc) || args.radius_mm.is_some();
    let is_rectangle = args.shape == Some(ShapeArg::Rectangle)
        || args.width_mm.is_some()
        || args.height_mm.is_some();
    if is_disc && is_rectangle {
        let message =
            "a disc has --radius-mm, a rectangle --width-mm and --height-mm: keep one shape";
        return Err(CliError::input(message));
    }
    if args.out.exists() && !args.force {
        return Err(CliError::input(format!(
            "{} exists: give --force to overwrite it",
            args.out.display()
        )));
    }
    Ok(())
}

/// What is known about the skin, from the command line or by asking.
fn described(args: &InitArgs, questions: &mut Questions) -> Result<FirstScene, CliError> {
    let shape = match (args.shape, args.radius_mm, args.width_mm.or(args.height_mm)) {
        (Some(shape), ..) => shape,
        (None, Some(_), _) => ShapeArg::Disc,
        (None, None, Some(_)) => ShapeArg::Rectangle,
        (None, None, None) => questions.shape()?,
    };
    let mut size_m = |given: Option<f64>, name: &str, question: &str| {
        given.map_or_else(|| questions.number(name, question), Ok).map(|size_mm| size_mm / 1e3)
    };
    let outline = match shape {
        ShapeArg::Disc => {
            Outline::Disc { radius_m: size_m(args.radius_mm, "--radius-mm", "radius, mm")? }
        }
        ShapeArg::Rectangle => Outline::Rectangle {
            width_m: size_m(args.width_mm, "--width-mm", "extent from left to right, mm")?,
            height_m: size_m(args.height_mm, "--height-mm", "extent from bottom to top, mm")?,
        },
    };
    let electrodes = match args.electrodes {
        Some(count) => count,
        None => questions.count("--electrodes", "number of electrodes on the rim")?,
    };
    let mut first = FirstScene::new(outline, electrodes);
    first.first_angle_deg = args.electrode_at_deg;
    if let Some(width_mm) = args.electrode_width_mm {
        first.electrode_width_m = width_mm / 1e3;
    }
    first.port.clone_from(&args.port);
    first.baud = (args.baud != 115_200).then_some(args.baud);
    Ok(first)
}

/// Comments at the head of the scene.
fn notes(first: &FirstScene, found: &Found) -> Vec<String> {
    let mut notes = vec!["Written by `eit init`; docs/SCENE.md has every key.".to_owned()];
    notes.extend(found.lines.iter().cloned());
    notes.extend(found.warnings.iter().map(|warning| format!("UNSURE: {warning}")));
    if first.port.is_none() {
        notes.push(
            "Written without a board: [protocol] and [instrument] are a template.".to_owned(),
        );
    }
    notes
}

fn write(place: &Path, text: &str, force: bool) -> Result<(), CliError> {
    use std::io::Write as _;
    let failed = |error: std::io::Error| {
        CliError::input(format!("{}: cannot be written: {error}", place.display()))
    };
    let mut options = std::fs::OpenOptions::new();
    options.write(true);
    match force {
        true => options.create(true).truncate(true),
        // never overwrite a file that was created meanwhile
        false => options.create_new(true),
    };
    options.open(place).and_then(|mut file| file.write_all(text.as_bytes())).map_err(failed)
}

fn answer(place: &Path, first: &FirstScene, found: &Found) -> Answer {
    let mut lines = found.lines.clone();
    lines.extend(found.warnings.iter().map(|warning| format!("unsure: {warning}")));
    let place = place.display();
    lines.push(format!("{place} is written. Draw it: `eit mesh {place} --out skin.png`"));
    if first.port.is_some() {
        lines.push(format!("Then: `eit check {place}`, and touches: `eit live {place} --web`"));
    } else {
        lines.push(format!("Then see what it needs and costs: `eit plan {place}`"));
    }
    Answer { text: lines.join("\n"), json: to_json(&place.to_string(), first, found) }
}

fn to_json(place: &str, first: &FirstScene, found: &Found) -> Value {
    json!({
        "scene": place,
        "driver": first.driver,
        "values": found.values,
        "frame_rate_hz": found.rate_hz,
        "reciprocity_error": found.reciprocity,
        "model_correlation": found.correlation,
        "first_angle_deg": first.first_angle_deg,
        "direction": match first.direction {
            Direction::Counterclockwise => "counterclockwise",
            Direction::Clockwise => "clockwise",
        },
        "sign": match first.sign {
            ChangeSign::Increase => "increase",
            ChangeSign::Decrease => "decrease",
        },
        "numbering": found.numbering.as_ref().map(|numbering| json!({
            "likeness": numbering.likeness,
            "next_likeness": numbering.next_likeness,
            "press_errors_m": numbering.errors_m,
        })),
        "swapped_electrodes": found.swapped.map(|pair| pair.map(|electrode| electrode + 1)),
        "unsure": found.warnings,
    })
}
