//! `eit convert`: converts recordings to and from tables of numbers.

mod streamed;

use self::streamed::{Source, Streamed};
use super::{Answer, check_ending};
use crate::cli::ConvertArgs;
use crate::error::CliError;
use eit_hw::capture::{self, CaptureSettings, CaptureWriter, SessionRecord};
use eit_hw::{Component, Frame, Layout, Quadruple, Recording};
use eit_report::output::{OutFile, write_csv, write_npy};
use eit_skin::scene::Scene;
use ndarray::Array2;
use serde_json::json;
use std::path::Path;

/// Frames as written.
struct Table {
    real: Array2<f64>,
    imaginary: Option<Array2<f64>>,
    quality: Array2<eit_hw::Quality>,
    /// Electrodes of each value; empty if not named.
    quadruples: Vec<Quadruple>,
}

/// Reads any recording and writes it in the format of the file name extension.
pub(crate) fn run(args: &ConvertArgs) -> Result<Answer, CliError> {
    let ending = check_ending(&args.out, &["mcap", "csv", "npy"])?;
    if ending == "mcap" {
        capture::check_new(&args.out)?;
    }
    if is_same_file(&args.input, &args.out) {
        let message = "is the file to convert, and would be lost: name another file";
        return Err(CliError::input(format!("{}: {message}", args.out.display())));
    }
    let scene = args.scene.as_deref().map(Scene::load).transpose()?;
    if !args.input.is_dir() && capture::is_recording(&args.input)? {
        return stream(args, &ending, scene.as_ref());
    }
    let options = eit_hw::ReadOptions { complex: args.complex, ..Default::default() };
    let mut recording = eit_hw::read_recording(&args.input, None, &options)?;
    let table = table(&mut recording, scene.as_ref())?;
    let mut notes: Vec<String> = recording.notes.iter().map(ToString::to_string).collect();
    let (written, skipped) = match ending.as_str() {
        "mcap" => (write_mcap(args, &recording, &table)?, 0),
        format => write_table(args, &table, format)?,
    };
    let flagged = table.quality.iter().filter(|quality| !quality.is_good()).count();
    if ending != "mcap" && flagged > 0 {
        notes.push(format!("{flagged} flagged values: a table has no flags"));
    }
    if skipped > 0 {
        notes.push(format!("{skipped} frames skipped: a value is not finite"));
    }
    let complex = table.imaginary.is_some();
    if complex && ending != "mcap" {
        notes.push(ALTERNATE.into());
    }
    let count = table.real.ncols();
    Ok(answer(args, &Counts { written, skipped, count, complex, flagged }, &notes))
}

/// Whether both paths exist and denote the same file.
fn is_same_file(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}

/// Finishes a new recording, or removes it after a failure, because it would look complete.
fn whole_or_none(
    writer: CaptureWriter,
    written: Result<(), CliError>,
    place: &Path,
) -> Result<(), CliError> {
    let ended = match written {
        Ok(()) => writer.finish().map_err(CliError::from),
        Err(error) => {
            drop(writer);
            Err(error)
        }
    };
    if ended.is_err() {
        // the file was created for this; the original error matters more
        let _ = std::fs::remove_file(place);
    }
    ended
}

/// What was converted.
struct Counts {
    written: usize,
    skipped: usize,
    count: usize,
    complex: bool,
    flagged: usize,
}

fn answer(args: &ConvertArgs, counts: &Counts, notes: &[String]) -> Answer {
    let Counts { written, skipped, count, complex, flagged } = *counts;
    let mut text = format!("{written} frames of {count} values in {}", args.out.display());
    for note in notes {
        text += &format!("\nnote: {note}");
    }
    let json = json!({
        "file": args.out.display().to_string(),
        "frames": written,
        "values": count,
        "complex": complex,
        "flagged_values": flagged,
        "skipped_frames": skipped,
        "notes": notes,
    });
    Answer { text, json }
}

const ALTERNATE: &str =
    "rows of real and imaginary parts alternate: read it with [recording] complex = true";

fn stream(args: &ConvertArgs, ending: &str, scene: Option<&Scene>) -> Result<Answer, CliError> {
    if args.complex {
        let place = args.input.display();
        let message = "--complex is for tables, but this is a recording; leave it out";
        return Err(CliError::input(format!("{place}: {message}")));
    }
    let protocol = match scene {
        Some(scene) => Some(scene.protocol(scene.electrode_count()?)?),
        None => None,
    };
    let quadruples = protocol.as_ref().and_then(|protocol| protocol.quadruples());
    if protocol.is_some() && quadruples.is_none() {
        let message = "[protocol] has general current patterns, which recordings do not support";
        return Err(CliError::input(message));
    }
    let (source, found) = Source::new(&args.input, quadruples)?;
    let Streamed { frames, complex, unfinished, flagged, damage, .. } = found;
    let mut notes: Vec<String> = damage.note().map(|note| note.to_string()).into_iter().collect();
    let skipped = match ending {
        "mcap" => {
            source.write_mcap(&args.out)?;
            0
        }
        format => {
            source.write_table(&found, &args.out, format)?;
            if flagged > 0 {
                notes.push(format!("{flagged} flagged values: a table has no flags"));
            }
            if unfinished > 0 {
                notes.push(format!("{unfinished} frames skipped: a value is not finite"));
            }
            if complex {
                notes.push(ALTERNATE.into());
            }
            unfinished
        }
    };
    let count = source.columns(&found);
    let written = frames - skipped;
    Ok(answer(args, &Counts { written, skipped, count, complex, flagged }, &notes))
}

/// Takes the frames of a recording as recorded, or in the order of a scene's protocol.
fn table(recording: &mut Recording, scene: Option<&Scene>) -> Result<Table, CliError> {
    let Some(scene) = scene else {
        return Ok(Table {
            real: std::mem::take(&mut recording.real),
            imaginary: recording.imaginary.take(),
            quality: std::mem::take(&mut recording.quality),
            quadruples: match &recording.layout {
                Layout::Quadruples(quadruples) => quadruples.clone(),
                Layout::ProtocolOrder => Vec::new(),
                Layout::Potentials { .. } => {
                    return Err(CliError::input(format!(
                        "{}: contains electrode potentials: give --scene, whose protocol defines the \
                         differences",
                        recording.path.display()
                    )));
                }
            },
        });
    };
    let electrodes = scene.electrode_count()?;
    let protocol = scene.protocol(electrodes)?;
    let part =
        |component| recording.frames_for(protocol.quadruples(), protocol.measurements(), component);
    let real = part(Component::Real)?;
    let imaginary = match recording.imaginary.is_some() {
        true => Some(part(Component::Imaginary)?.values),
        false => None,
    };
    let quadruples = protocol.quadruples().map_or_else(Vec::new, <[_]>::to_vec);
    Ok(Table { real: real.values, imaginary, quality: real.quality, quadruples })
}

fn write_mcap(args: &ConvertArgs, recording: &Recording, table: &Table) -> Result<usize, CliError> {
    let session = SessionRecord {
        driver: "file".into(),
        instrument: recording.format.to_string(),
        unit: recording.unit.into(),
        quadruples: table.quadruples.clone(),
        current_a: recording.current_a,
        frequency_hz: recording.frequency_hz,
        recorder: concat!("eit ", env!("CARGO_PKG_VERSION")).to_owned(),
        ..SessionRecord::default()
    };
    let settings = CaptureSettings::default();
    let mut writer = CaptureWriter::create(&args.out, &session, settings)
        .map_err(|error| CliError::input(error.to_string()))?;
    let written = (0..table.real.nrows()).try_for_each(|row| {
        writer.frame(&Frame {
            values: table.real.row(row).to_vec(),
            imaginary: table.imaginary.as_ref().map(|parts| parts.row(row).to_vec()),
            quality: table.quality.row(row).to_vec(),
            sequence: row as u64,
            epoch: 0,
            device_time_s: recording.device_time_s.as_ref().map(|times| times[row]),
            host_time_s: None,
        })
    });
    whole_or_none(writer, written.map_err(CliError::from), &args.out)?;
    Ok(table.real.nrows())
}

/// Returns the number of frames written, and of frames skipped.
fn write_table(
    args: &ConvertArgs,
    table: &Table,
    format: &str,
) -> Result<(usize, usize), CliError> {
    let parts = |row: usize| {
        let imaginary = table.imaginary.as_ref().map(|parts| parts.row(row).to_vec());
        std::iter::once(table.real.row(row).to_vec()).chain(imaginary).collect::<Vec<_>>()
    };
    let frames = table.real.nrows();
    let is_finite = |rows: &Vec<Vec<f64>>| rows.iter().flatten().all(|value| value.is_finite());
    let kept: Vec<Vec<Vec<f64>>> = (0..frames).map(parts).filter(is_finite).collect();
    let rows: Vec<&Vec<f64>> = kept.iter().flatten().collect();
    let shape = (rows.len(), table.real.ncols());
    let values = Array2::from_shape_fn(shape, |(row, column)| rows[row][column]);
    OutFile::new(&args.out)?.write(|out| match format {
        "npy" => write_npy(&values, out),
        _ => write_csv(values.view(), out),
    })?;
    Ok((kept.len(), frames - kept.len()))
}
