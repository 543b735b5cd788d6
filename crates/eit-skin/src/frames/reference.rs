//! The reference frame, which is subtracted: a frame, a mean, or another file.

use super::load::{Loaded, name_of, of_values, read};
use super::steady;
use crate::error::SkinError;
use crate::scene::Reference;
use crate::skin::Skin;
use crate::text::counted;
use eit_hw::{MeasuredFrames, Quality};
use ndarray::{Array2, Axis};
use std::ops::Range;
use std::path::Path;

/// A reference frame.
#[derive(Debug, Clone)]
pub(crate) struct ReferenceFrame {
    /// Mean frame, `[measurement]`.
    pub values: Vec<f64>,
    /// Whether each value of the mean is finite and may be used.
    pub good: Vec<bool>,
    /// Source of the reference, in words.
    pub source: String,
    /// Frames that were averaged.
    pub frames: FlaggedValues,
    /// Whether it is the mean of the whole recording, touches included.
    pub touched: bool,
    /// Number of frames that were not averaged, because they are of another kind than the others.
    pub left_out: usize,
}

/// Values and their flags, both [frame, measurement].
#[derive(Debug, Clone)]
pub(crate) struct FlaggedValues {
    pub values: Array2<f64>,
    pub quality: Array2<Quality>,
}

impl ReferenceFrame {
    /// Averages frames.
    fn mean(frames: MeasuredFrames, source: String) -> Self {
        let (values, good) = frames.mean_of(0..frames.values.nrows());
        let frames = FlaggedValues { values: frames.values, quality: frames.quality };
        Self { values, good, source, frames, touched: false, left_out: 0 }
    }
}

/// Chooses the reference of the command line (`given`, files relative to the working directory), else the
/// scene's (files relative to the scene), else the one that the file marks.
pub(crate) fn choose(
    skin: &Skin,
    loaded: &Loaded,
    given: Option<&Reference>,
) -> Result<ReferenceFrame, SkinError> {
    let count = loaded.frames.values.nrows();
    let marked = loaded.marked_reference.map(Reference::Frame);
    let reference = given.or(skin.settings.recording.reference.as_ref()).or(marked.as_ref());
    let (range, words) = match reference {
        None => {
            return Err(SkinError::argument(
                "reference",
                "no reference frame: give a frame number, \"mean\", \"N..M\" or a file, or set [recording] reference in \
                 the scene",
            ));
        }
        Some(Reference::Frame(n)) => single(*n),
        Some(Reference::Text(text)) => match range_of(text, count) {
            Some(found) => found,
            None => return from_file(skin, Path::new(text)),
        },
    };
    if range.is_empty() {
        let message = format!("reference {words}: the range is empty; N..M ends before frame M");
        return Err(SkinError::input(message));
    }
    if range.end > count {
        let last = count - 1;
        return Err(SkinError::NoSuchFrame { what: format!("reference {words}"), last });
    }
    let touched = range == (0..count);
    let wanted = range.len();
    let rows = if touched { range.collect() } else { of_one_kind(&loaded.frames, range) };
    let MeasuredFrames { values, quality, unit, .. } = &loaded.frames;
    let select = (values.select(Axis(0), &rows), quality.select(Axis(0), &rows));
    let mean = ReferenceFrame::mean(of_values(select.0, select.1, *unit), words);
    Ok(ReferenceFrame { touched, left_out: wanted - rows.len(), ..mean })
}

/// Returns the frames of a range without damaged ones and those of another level, as for live
/// frames; all of them if many would be left out.
fn of_one_kind(frames: &MeasuredFrames, range: Range<usize>) -> Vec<usize> {
    let values = frames.values.slice_axis(Axis(0), range.clone().into());
    let is_good = |f: usize, i: usize| frames.quality[(range.start + f, i)].is_good();
    let others = steady::others(values, is_good);
    let is_few = 2 * others.len() < range.len();
    range.clone().filter(|f| !is_few || !others.contains(&(f - range.start))).collect()
}

/// Describes how many frames were left out of a reference.
pub(crate) fn left_out(count: usize) -> String {
    let frames = counted(count, "frame", "frames");
    format!("{frames} left out of the reference: damaged, or of another level than the others")
}

/// Averages frames of the untouched skin.
pub(crate) fn of_quiet(frames: &MeasuredFrames) -> ReferenceFrame {
    let source = format!("the first {} frames", frames.values.nrows());
    ReferenceFrame::mean(frames.clone(), source)
}

fn from_file(skin: &Skin, path: &Path) -> Result<ReferenceFrame, SkinError> {
    let other = read(skin, std::slice::from_ref(&path.to_path_buf()))?;
    Ok(of_others(other.frames, &name_of(path)))
}

/// Averages frames of another recording, or that the caller gave.
pub(crate) fn of_others(others: MeasuredFrames, name: &str) -> ReferenceFrame {
    let count = others.values.nrows();
    let frames = if count == 1 { "1 frame".to_owned() } else { format!("mean of {count} frames") };
    ReferenceFrame::mean(others, format!("{name} ({frames})"))
}

fn single(frame: usize) -> (Range<usize>, String) {
    (frame..frame.saturating_add(1), format!("frame {frame}"))
}

/// Frames named by a text: "mean", "N..M" or a number; `None` if the text must be a file name.
fn range_of(text: &str, count: usize) -> Option<(Range<usize>, String)> {
    if text == "mean" {
        return Some((0..count, format!("mean of {count} frames")));
    }
    if let Some((from, to)) = text.split_once("..") {
        return Some((from.parse().ok()?..to.parse().ok()?, format!("mean of frames {text}")));
    }
    text.parse().ok().map(single)
}
