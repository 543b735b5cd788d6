//! The frame to subtract: one frame, a mean, or another file.

use super::{Loaded, name_of, read};
use crate::error::CliError;
use crate::scene::{Reference, Scene};
use eit_fem::Protocol;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Values, where they came from in words, and which of them are good.
type ReferenceFrame = (Vec<f64>, String, Vec<bool>);

/// Takes the reference of the command line (`given`, files relative to the working folder), else
/// the scene's (files relative to the scene), else the one the file marks.
pub(super) fn take(
    scene: &Scene,
    protocol: &Protocol,
    loaded: &Loaded,
    given: Option<&Reference>,
) -> Result<ReferenceFrame, CliError> {
    let count = loaded.frames.values.nrows();
    let marked = loaded.marked_reference.map(Reference::Frame);
    let reference = given.or(scene.recording.reference.as_ref()).or(marked.as_ref());
    let (range, words) = match reference {
        None => {
            return Err(CliError::input(
                "no reference frame: give --reference with a frame number, \"mean\", \"N..M\" or \
                 a file, or [recording] reference in the scene",
            ));
        }
        Some(Reference::Frame(n)) => single(*n),
        Some(Reference::Text(text)) => match range_of(text, count) {
            Some(found) => found,
            None if given.is_some() => return from_file(scene, protocol, &PathBuf::from(text)),
            None => return from_file(scene, protocol, &scene.resolve(Path::new(text))),
        },
    };
    if range.is_empty() {
        let message = format!("reference {words}: the range is empty; N..M ends before frame M");
        return Err(CliError::input(message));
    }
    if range.end > count {
        let last = count - 1;
        let message = format!("reference {words}: the recording has frames 0 to {last}");
        return Err(CliError::input(message));
    }
    let (values, good) = loaded.frames.mean_of(range);
    Ok((values, words, good))
}

fn from_file(scene: &Scene, protocol: &Protocol, path: &Path) -> Result<ReferenceFrame, CliError> {
    let other = read(scene, protocol, std::slice::from_ref(&path.to_path_buf()))?;
    let count = other.frames.values.nrows();
    let (values, good) = other.frames.mean_of(0..count);
    let frames = if count == 1 { "1 frame".to_owned() } else { format!("mean of {count} frames") };
    Ok((values, format!("{} ({frames})", name_of(path)), good))
}

fn single(frame: usize) -> (Range<usize>, String) {
    (frame..frame.saturating_add(1), format!("frame {frame}"))
}

/// Frames named by a text: "mean", "N..M" or a number; `None` where it must be a file.
fn range_of(text: &str, count: usize) -> Option<(Range<usize>, String)> {
    if text == "mean" {
        return Some((0..count, format!("mean of {count} frames")));
    }
    if let Some((from, to)) = text.split_once("..") {
        return Some((from.parse().ok()?..to.parse().ok()?, format!("mean of frames {text}")));
    }
    text.parse().ok().map(single)
}
