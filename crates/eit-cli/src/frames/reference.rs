//! The frame to subtract: one frame, a mean, or another file.

use super::{Loaded, mean_over, name_of, read};
use crate::error::CliError;
use crate::scene::{Reference, Scene};
use eit_fem::Protocol;
use eit_hw::Quality;
use std::path::{Path, PathBuf};

/// Values, where they came from in words, and quality flags if from another file.
type ReferenceFrame = (Vec<f64>, String, Option<Vec<Quality>>);

/// Takes the reference of the command line, else the scene's, else the one the file marks.
pub(super) fn take(
    scene: &Scene,
    protocol: &Protocol,
    loaded: &Loaded,
    reference: Option<&Reference>,
) -> Result<ReferenceFrame, CliError> {
    let count = loaded.values.nrows();
    let marked = loaded.marked_reference.map(Reference::Frame);
    let Some(reference) = reference.or(scene.recording.reference.as_ref()).or(marked.as_ref())
    else {
        return Err(CliError::input(
            "no reference frame: give --reference with a frame number, \"mean\", \"N..M\" or a \
             file, or [recording] reference in the scene",
        ));
    };
    let range = match reference {
        Reference::Frame(n) => Some((*n..n.saturating_add(1), format!("frame {n}"))),
        Reference::Text(t) if t == "mean" => Some((0..count, format!("mean of {count} frames"))),
        Reference::Text(t) => match range_of(t) {
            Some(range) => Some((range, format!("mean of frames {t}"))),
            None => t.parse().ok().map(|n: usize| (n..n.saturating_add(1), format!("frame {n}"))),
        },
    };
    if let Some((range, words)) = range {
        if range.end > count || range.is_empty() {
            let message = format!("reference {words}: the recording has frames 0 to {}", count - 1);
            return Err(CliError::input(message));
        }
        return Ok((mean_over(&loaded.values, range), words, None));
    }
    let Reference::Text(file) = reference else { return Err(CliError::input("no reference")) };
    let path = scene.resolve(Path::new(file));
    let path = if path.exists() { path } else { PathBuf::from(file) };
    let other = read(scene, protocol, std::slice::from_ref(&path))?;
    let quality = other.quality.columns().into_iter();
    let quality = quality.map(|c| c.iter().fold(Quality::GOOD, |all, q| all | *q)).collect();
    let words = format!("{} ({} frames)", name_of(&path), other.values.nrows());
    Ok((mean_over(&other.values, 0..other.values.nrows()), words, Some(quality)))
}

fn range_of(text: &str) -> Option<std::ops::Range<usize>> {
    let (from, to) = text.split_once("..")?;
    Some(from.parse().ok()?..to.parse().ok()?)
}
