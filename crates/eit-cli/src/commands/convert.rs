//! `eit convert`: converts recordings to and from tables of numbers.

mod stored;
mod streamed;

use self::stored::Stored;
use self::streamed::{Source, Streamed};
use super::{Answer, check_ending};
use crate::cli::ConvertArgs;
use crate::error::CliError;
use eit_hw::capture::{self, CaptureWriter, PartFile};
use eit_report::output;
use eit_skin::scene::Scene;
use eit_skin::words::counted;
use serde_json::json;
use std::path::Path;

/// Reads any recording and writes it in the format of the file name extension.
pub(crate) fn run(args: &ConvertArgs) -> Result<Answer, CliError> {
    let ending = check_ending(&args.out, &["mcap", "csv", "npy"])?;
    if ending == "mcap" {
        capture::check_new(&args.out)?;
        output::remember(PartFile::part_of(&args.out));
    }
    if is_same_file(&args.input, &args.out) {
        let message = "is the file to convert, and would be lost: name another file";
        return Err(CliError::input(format!("{}: {message}", args.out.display())));
    }
    let scene = args.scene.as_deref().map(Scene::load).transpose()?;
    if !args.input.is_dir() && capture::is_recording(&args.input)? {
        return stream(args, &ending, scene.as_ref());
    }
    // the scene says how its tables are arranged, as for `eit reconstruct`
    let stated = scene.as_ref().map(|scene| scene.stage_settings().recording.reading());
    let (format, mut options) = stated.transpose()?.unwrap_or_default();
    options.complex |= args.complex;
    let recording = eit_hw::read_recording(&args.input, format, &options)?;
    let stored = Stored::new(&recording, scene.as_ref())?;
    let found = stored.look()?;
    let mut notes: Vec<String> = recording.notes.iter().map(ToString::to_string).collect();
    // frames that the reader could not read whole
    let cut = recording.skipped.frames;
    if cut > 0 {
        notes.push(recording.skipped.to_string());
    }
    let (frames, finite, flagged) = (found.is_finite.len(), found.finite(), found.flagged);
    let complex = recording.imaginary.is_some();
    let written = match ending.as_str() {
        "mcap" => {
            stored.write_mcap(&args.out)?;
            frames
        }
        format => {
            stored.write_table(&found, &args.out, format)?;
            finite
        }
    };
    let unfinished = frames - written;
    if ending != "mcap" {
        notes.extend(table_notes(flagged, unfinished, complex));
    }
    let (count, skipped) = (stored.columns(), cut + unfinished);
    Ok(answer(args, &Counts { written, skipped, count, complex, flagged }, &notes))
}

/// Notes about what a table cannot store.
fn table_notes(flagged: usize, skipped: usize, complex: bool) -> impl Iterator<Item = String> {
    let flagged = (flagged > 0).then(|| {
        format!("{}: a table has no flags", counted(flagged, "flagged value", "flagged values"))
    });
    let skipped = (skipped > 0)
        .then(|| format!("{} skipped: a value is not finite", counted(skipped, "frame", "frames")));
    flagged.into_iter().chain(skipped).chain(complex.then(|| ALTERNATE.into()))
}

/// Whether both paths exist and denote the same file.
fn is_same_file(one: &Path, other: &Path) -> bool {
    match (one.canonicalize(), other.canonicalize()) {
        (Ok(one), Ok(other)) => one == other,
        _ => false,
    }
}

/// Finishes a new recording, unless writing it failed: then it has no name yet, and is removed.
fn whole_or_none(writer: CaptureWriter, written: Result<(), CliError>) -> Result<(), CliError> {
    written?;
    Ok(writer.finish()?)
}

/// Numbers of converted and skipped frames.
struct Counts {
    written: usize,
    skipped: usize,
    count: usize,
    complex: bool,
    flagged: usize,
}

fn answer(args: &ConvertArgs, counts: &Counts, notes: &[String]) -> Answer {
    let Counts { written, skipped, count, complex, flagged } = *counts;
    let frames = counted(written, "frame", "frames");
    let mut text = format!("{frames} of {count} values in {}", args.out.display());
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
            notes.extend(table_notes(flagged, unfinished, complex));
            unfinished
        }
    };
    let count = source.columns(&found);
    let written = frames - skipped;
    Ok(answer(args, &Counts { written, skipped, count, complex, flagged }, &notes))
}
