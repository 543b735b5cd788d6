//! Frames of the untouched skin, from which the noise is measured.

use super::reference::ReferenceFrame;
use super::steady;
use crate::error::SkinError;
use crate::skin::Skin;
use eit_hw::{MeasuredFrames, Quality};
use ndarray::{Array2, Axis};

/// Smallest number of frames that distinguishes noise from drift.
const LEAST_FRAMES: usize = 3;

/// Frames of the untouched skin.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct QuietFrames {
    /// [frame, measurement], in the unit of the frames; 0 in measurements that are not used.
    pub values: Array2<f64>,
    /// Source of the frames, in words.
    pub source: String,
}

/// Returns the frames that `noise.quiet_frames` names, else those of the reference if there are several and
/// they are not the whole recording, touches included. Frames with bad values are skipped.
pub(crate) fn find(
    skin: &Skin,
    recording: &MeasuredFrames,
    reference: &ReferenceFrame,
    used: &[bool],
    notes: &mut Vec<String>,
) -> Result<Option<QuietFrames>, SkinError> {
    let Some(range) = skin.settings.noise.quiet_frames else {
        let frames = &reference.frames;
        let values = clean(&frames.values, &frames.quality, 0..frames.values.nrows(), used);
        let source = format!("the reference frames ({})", reference.source);
        let enough = !reference.touched && values.nrows() >= LEAST_FRAMES;
        return Ok(enough.then_some(QuietFrames { values, source }));
    };
    let count = recording.values.nrows();
    if range.end > count {
        let what = format!("noise.quiet_frames = \"{range}\"");
        return Err(SkinError::NoSuchFrame { what, last: count - 1 }.within(&skin.place));
    }
    let values = clean(&recording.values, &recording.quality, range.start..range.end, used);
    let found = values.nrows();
    if found < LEAST_FRAMES {
        return Err(SkinError::input(format!(
            "noise.quiet_frames = \"{range}\": {found} of them have no bad values; measuring the \
             noise needs {LEAST_FRAMES} or more"
        ))
        .within(&skin.place));
    }
    let left_out = range.count() - found;
    if left_out > 0 {
        notes.push(format!("{left_out} quiet frames with bad values skipped"));
    }
    let others = steady::others(values.view(), |_, _| true);
    let kept: Vec<usize> = (0..found).filter(|f| !others.contains(f)).collect();
    let values = match 2 * others.len() < found && kept.len() >= LEAST_FRAMES {
        true => {
            if !others.is_empty() {
                notes.push(format!("{} quiet frames of another level skipped", others.len()));
            }
            values.select(Axis(0), &kept)
        }
        false => values,
    };
    Ok(Some(QuietFrames {
        values,
        source: format!("quiet frames {} to {}", range.start, range.end - 1),
    }))
}

/// Frames of a range whose used values are all good.
fn clean(
    values: &Array2<f64>,
    quality: &Array2<Quality>,
    range: std::ops::Range<usize>,
    used: &[bool],
) -> Array2<f64> {
    let is_clean =
        |f: &usize| quality.row(*f).iter().zip(used).all(|(q, used)| q.is_good() || !*used);
    let rows: Vec<usize> = range.filter(is_clean).collect();
    let mut values = values.select(Axis(0), &rows);
    for (mut column, _) in values.columns_mut().into_iter().zip(used).filter(|(_, used)| !**used) {
        column.fill(0.0);
    }
    values
}
