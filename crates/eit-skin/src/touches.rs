//! Touches of a recording: found in its frames, held against everything that is not a touch, and
//! followed over time, against a reference that follows drift.

mod background;
mod choices;
mod finder;
mod model;

pub use choices::{Choices, FoundSheet};
pub use finder::TouchFinder;

use crate::error::SkinError;
use crate::faults::ElectrodeFault;
use crate::fitted::FittedFrames;
use crate::frames::Frames;
use crate::progress::Progress;
use eit_inverse::touch::{Touch, TouchState};
use ndarray::Array2;

/// Frames a second where nobody says.
pub(crate) const DEFAULT_RATE_HZ: f64 = 20.0;

/// A touch of a frame.
#[derive(Debug, Clone, Copy)]
pub struct TouchRow {
    /// Number of the frame, from 0.
    pub frame: usize,
    /// Its time, seconds.
    pub time_s: f64,
    /// The touch.
    pub touch: Touch,
}

/// Touches of all frames, and what they rest on.
#[derive(Debug, Clone)]
pub struct Touches {
    /// One row for each touch of each frame.
    pub rows: Vec<TouchRow>,
    /// Number of frames.
    pub frames: usize,
    /// Frames a second that were counted with.
    pub rate_hz: f64,
    /// What the finder chose, and why.
    pub choices: Choices,
    /// Faults of electrodes, in the order in which they were found.
    pub faults: Vec<ElectrodeFault>,
    /// Values that were left out, [frame, measurement]: bad ones, and those of faulty electrodes.
    pub is_missing: Array2<bool>,
}

impl Touches {
    /// How many different ones.
    pub fn count(&self) -> usize {
        self.rows.iter().filter(|row| row.touch.state == TouchState::Begin).count()
    }

    /// Most at once.
    pub fn most(&self) -> usize {
        let frames = self.rows.chunk_by(|a, b| a.frame == b.frame);
        let alive = |rows: &[TouchRow]| {
            rows.iter().filter(|row| row.touch.state != TouchState::End).count()
        };
        frames.map(alive).max().unwrap_or(0)
    }

    /// Frames that show a touch to be acted on.
    pub fn frames_with_touch(&self) -> usize {
        let frames = self.rows.chunk_by(|a, b| a.frame == b.frame);
        let acted_on = |row: &TouchRow| row.touch.valid && row.touch.state != TouchState::End;
        frames.filter(|rows| rows.iter().any(acted_on)).count()
    }

    /// Marks what was left out as not good, so that images do without it, too. Frames of which nothing
    /// would be left stay as they are.
    pub fn leave_out(&self, frames: &mut Frames) {
        for (mut good, missing) in frames.good.rows_mut().into_iter().zip(self.is_missing.rows()) {
            let left = good.iter().zip(missing).zip(&frames.used);
            if left.into_iter().any(|((good, missing), used)| *good && !missing && *used) {
                good.zip_mut_with(&missing, |good, missing| *good &= !missing);
            }
        }
    }

    /// Places seen from +z of each frame's valid touches, metres.
    pub fn marks(&self, frames: usize) -> Vec<Vec<[f64; 2]>> {
        let mut marks = vec![Vec::new(); frames];
        for TouchRow { frame, touch, .. } in self.rows.iter().filter(|row| row.touch.valid) {
            marks[*frame].push([touch.position_m[0], touch.position_m[1]]);
        }
        marks
    }
}

/// Finds touches in frames, whatever method makes the pictures. `None` where the noise of the data
/// is unknown.
///
/// # Errors
///
/// Settings that no finder can be made with.
pub fn touches(
    fitted: &FittedFrames,
    progress: &mut Progress,
) -> Result<Option<Touches>, SkinError> {
    let frames = &fitted.frames;
    let rate_hz = frames.rate_hz.unwrap_or(DEFAULT_RATE_HZ);
    let finder = TouchFinder::new(fitted, rate_hz, progress)?;
    let Some(mut finder) = finder else { return Ok(None) };
    progress.stage("touches", || {
        let count = frames.values.nrows();
        let mut found = Touches {
            rows: Vec::new(),
            frames: count,
            rate_hz,
            choices: finder.choices.clone(),
            faults: Vec::new(),
            is_missing: Array2::from_elem(frames.values.dim(), false),
        };
        for frame in 0..count {
            let time_s = frame as f64 / rate_hz;
            let values = frames.values.row(frame).to_vec();
            let good = frames.good.row(frame);
            let touches = finder
                .push(&values, |i| good[i], time_s)
                .map_err(|e| e.within(&format!("frame {frame}")))?;
            found.rows.extend(touches.iter().map(|&touch| TouchRow { frame, time_s, touch }));
            for (i, missing) in found.is_missing.row_mut(frame).iter_mut().enumerate() {
                *missing = finder.is_missing(i);
            }
            for fault in finder.faults() {
                if !found.faults.contains(fault) {
                    found.faults.push(*fault);
                }
            }
        }
        Ok(Some(found))
    })
}
