//! Presses at known places, and touches with what they teach.

use super::touches_of;
use eit_skin::FittedFrames;
use eit_skin::learn::{LearnedSkin, Press};
use eit_skin::touches::{TouchRow, Touches};
use std::ops::Range;
use std::sync::Arc;

/// A line of the table: place, force, frames of the press and untouched ones before it.
pub fn press(
    [x_m, y_m]: [f64; 2],
    force_n: f64,
    held: Range<usize>,
    before: Range<usize>,
) -> Press {
    Press {
        x_m,
        y_m,
        force_n: Some(force_n),
        first_frame: Some(held.start),
        last_frame: Some(held.end - 1),
        before_first: Some(before.start),
        before_last: Some(before.end - 1),
        ..Default::default()
    }
}

/// Touches with what was learnt applied, as for a scene that names its file.
pub fn touches_with(fitted: &FittedFrames, learned: &LearnedSkin) -> Touches {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), learned.to_bytes().unwrap()).unwrap();
    let (mut fitted, mut skin) = (fitted.clone(), (*fitted.skin).clone());
    skin.skin.settings.touch.learned = Some(file.path().to_path_buf());
    fitted.skin = Arc::new(skin);
    touches_of(&fitted)
}

pub fn strongest(rows: &[TouchRow], frame: usize) -> Option<&TouchRow> {
    let strength = |row: &&TouchRow| row.touch.intensity_s_m2.abs();
    let of_frame = rows.iter().filter(|row| row.frame == frame);
    of_frame.max_by(|a, b| strength(a).total_cmp(&strength(b)))
}
