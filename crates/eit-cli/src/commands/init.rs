//! `eit init`: the first scene of a new skin, from its size, a port and two presses.

mod ask;
mod board;
mod presses;

use crate::cli::{InitArgs, ShapeArg};
use crate::commands::prelude::*;
use eit_skin::first_scene::{FirstScene, Numbering, Outline};
use eit_skin::twins;

/// Correlation below which the model does not represent the skin at all.
const UNLIKE: f64 = 0.6;
/// Minimum lead in likeness over the next best numbering.
const CLEAR: f64 = 0.03;

/// Asks, listens, and writes the scene.
pub(super) fn run(args: &InitArgs) -> Result<Answer, CliError> {
    check(args)?;
    let mut first = described(args)?;
    first.scene()?;
    let mut found = match &args.port {
        Some(port) => board::find(args, port, &mut first)?,
        None => Found::default(),
    };
    // never write a scene that cannot be read
    let twins = Skin::from_scene(first.scene()?)?.twins()?;
    found.warnings.extend(twins::finding(twins.share()).map(|finding| finding.to_string()));
    let notes = notes(&first, &found);
    write(&args.out, &first.to_toml(&notes), args.force)?;
    Ok(answer(&args.out, &first, &found))
}

/// What was found out about the board.
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
    for (name, value, least, most) in [
        ("--radius-mm", args.radius_mm, 1.0, 1e4),
        ("--width-mm", args.width_mm, 1.0, 1e4),
        ("--height-mm", args.height_mm, 1.0, 1e4),
        ("--electrode-width-mm", args.electrode_width_mm, 0.01, 1e4),
        ("--listen-s", Some(args.listen_s), 0.1, 1e5),
        ("--press-wait-s", Some(args.press_wait_s), 0.1, 1e5),
    ] {
        let Some(value) = value else { continue };
        let wanted = format!("from {least} to {most}");
        check_option(name, value, (least..=most).contains(&value), &wanted)?;
    }
    let angle_deg = args.electrode_at_deg;
    check_option("--electrode-at-deg", angle_deg, angle_deg.is_finite(), "finite")?;
    let is_disc = args.shape == Some(ShapeArg::Disc) || args.radius_mm.is_some();
    let is_rectangle =
        args.shape == Some(ShapeArg::Rectangle) || args.width_mm.or(args.height_mm).is_some();
    if is_disc && is_rectangle {
        let message =
            "a disc has --radius-mm, a rectangle --width-mm and --height-mm: keep one shape";
        return Err(CliError::input(message));
    }
    if args.out.exists() && !args.force {
        let message = "exists: give --force to overwrite it";
        return Err(CliError::input(format!("{} {message}", args.out.display())));
    }
    Ok(())
}

/// What the builder knows: from the command line, or by asking.
fn described(args: &InitArgs) -> Result<FirstScene, CliError> {
    let shape = match (args.shape, args.radius_mm, args.width_mm.or(args.height_mm)) {
        (Some(shape), ..) => shape,
        (None, Some(_), _) => ShapeArg::Disc,
        (None, None, Some(_)) => ShapeArg::Rectangle,
        (None, None, None) => ask::shape()?,
    };
    let size_m = |given: Option<f64>, name: &str, question: &str| {
        given.map_or_else(|| ask::number(name, question), Ok).map(|size_mm| size_mm / 1e3)
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
    let ask = || ask::count("--electrodes", "number of electrodes on the rim");
    let first = FirstScene::new(outline, args.electrodes.map_or_else(ask, Ok)?);
    Ok(FirstScene {
        electrode_width_m: args.electrode_width_mm.map_or(first.electrode_width_m, |mm| mm / 1e3),
        first_angle_deg: args.electrode_at_deg,
        port: args.port.clone(),
        baud: (args.baud != 115_200).then_some(args.baud),
        ..first
    })
}

/// Comments at the head of the scene.
fn notes(first: &FirstScene, found: &Found) -> Vec<String> {
    let mut notes = vec!["Written by `eit init`; docs/SCENE.md has every key.".to_owned()];
    notes.extend(found.lines.iter().cloned());
    notes.extend(found.warnings.iter().map(|warning| format!("UNSURE: {warning}")));
    if first.port.is_none() {
        let note = "Written without a board: [protocol] and [instrument] are a template.";
        notes.push(note.to_owned());
    }
    notes
}

fn write(path: &Path, text: &str, force: bool) -> Result<(), CliError> {
    use std::io::Write as _;
    let mut options = std::fs::OpenOptions::new();
    // never overwrite a file that was created meanwhile
    options.write(true).create(force).truncate(force).create_new(!force);
    let written = options.open(path).and_then(|mut file| file.write_all(text.as_bytes()));
    let path = path.display();
    written.map_err(|error| CliError::input(format!("{path}: cannot be written: {error}")))
}

fn answer(path: &Path, first: &FirstScene, found: &Found) -> Answer {
    let mut lines = found.lines.clone();
    lines.extend(found.warnings.iter().map(|warning| format!("unsure: {warning}")));
    let path = path.display();
    lines.push(format!("{path} is written. Draw it: `eit mesh {path} --out skin.png`"));
    lines.push(match first.port {
        Some(_) => format!("Then: `eit check {path}`, and touches: `eit live {path} --web`"),
        None => format!("Then see what it needs and costs: `eit plan {path}`"),
    });
    let json = json!({
        "scene": path.to_string(),
        "driver": first.driver,
        "values": found.values,
        "frame_rate_hz": found.rate_hz,
        "reciprocity_error": found.reciprocity,
        "model_correlation": found.correlation,
        "first_angle_deg": first.first_angle_deg,
        "direction": first.direction,
        "sign": first.sign,
        "numbering": found.numbering.as_ref().map(|numbering| json!({
            "likeness": numbering.likeness,
            "next_likeness": numbering.next_likeness,
            "press_errors_m": numbering.errors_m,
        })),
        "swapped_electrodes": found.swapped.map(|pair| pair.map(|electrode| electrode + 1)),
        "unsure": found.warnings,
    });
    Answer { text: lines.join("\n"), json }
}
