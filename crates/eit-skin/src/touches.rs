//! Touches of a recording: detected in its frames as distinct from all other effects, and tracked over time,
//! with a reference that follows drift.

mod background;
#[cfg(feature = "learn")]
mod by_presses;
mod by_score;
mod by_search;
mod choices;
mod finder;
mod model;
mod tracked;

pub(crate) use background::{LEAK, UNTOUCHED, reference_errors, reference_of_model, uneven_sheet};
pub use choices::{Choices, FoundSheet};
#[cfg(feature = "learn")]
pub(crate) use finder::PressTouch;
pub use finder::TouchFinder;
pub(crate) use model::{common_mode, unknowns};

use crate::error::SkinError;
use crate::faults::ElectrodeFault;
use crate::fitted::FittedFrames;
use crate::frames::Frames;
use crate::live::SkinState;
use crate::progress::Progress;
use eit_inverse::touch::{DetectorStep, Touch, TouchState};
use ndarray::Array2;

/// Frame rate that is assumed where none is known, hertz.
pub const DEFAULT_RATE_HZ: f64 = 20.0;

/// Says that a frame rate is assumed: times and velocities of touches depend on it.
pub(crate) fn assumed_rate_text() -> String {
    format!(
        "neither the scene nor the recording states the frame rate: times and velocities of touches are those of \
         {DEFAULT_RATE_HZ} frames a second; if it is another one, set [recording] frame_rate_hz"
    )
}

/// A touch in a frame.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct TouchRow {
    /// Index of the frame, from 0.
    pub frame: usize,
    /// Time of the frame, seconds.
    pub time_s: f64,
    /// Touch in the frame named above.
    pub touch: Touch,
}

/// Ratio of the largest difference of a damaged frame to that of frames that touches explain.
const DAMAGED: f64 = 3.0;

/// Touches of all frames, and how they were found.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct Touches {
    /// One row per touch and frame.
    pub rows: Vec<TouchRow>,
    /// Number of frames searched.
    pub frames: usize,
    /// Frame of the recording that was searched first.
    pub first_frame: usize,
    /// Frame rate that was used, hertz.
    pub rate_hz: f64,
    /// What the finder chose, and why.
    pub choices: Choices,
    /// Faults of electrodes, in the order in which they were found.
    pub faults: Vec<ElectrodeFault>,
    /// How each frame was explained.
    pub steps: Vec<DetectorStep>,
    /// Frames that neither touches nor their absence explain: no touch is valid there, and that there is none does not mean
    /// that nothing touches the skin.
    pub not_explained: Vec<usize>,
    /// Frames in which the instrument repeated an old frame, so that nothing is known of the skin.
    pub frozen: Vec<usize>,
    /// Conductivity change of the faintest touch, siemens.
    pub level_s: f64,
    /// Values that were excluded, [frame, measurement]: bad ones, and those of faulty electrodes.
    pub is_missing: Array2<bool>,
}

impl Touches {
    /// Returns the number of distinct touches.
    pub fn count(&self) -> usize {
        let valid = self.rows.iter().filter(|row| row.touch.valid);
        valid.map(|row| row.touch.id).collect::<std::collections::BTreeSet<_>>().len()
    }

    /// Returns the number of listed touches that were valid in no frame.
    pub fn never_valid(&self) -> usize {
        let all = self.rows.iter().map(|row| row.touch.id);
        all.collect::<std::collections::BTreeSet<_>>().len() - self.count()
    }

    /// Returns the largest number of simultaneous touches.
    pub fn most(&self) -> usize {
        let frames = self.rows.chunk_by(|a, b| a.frame == b.frame);
        let alive = |rows: &[TouchRow]| {
            let is_there = |row: &&TouchRow| row.touch.valid && row.touch.state != TouchState::End;
            rows.iter().filter(is_there).count()
        };
        frames.map(alive).max().unwrap_or(0)
    }

    /// Returns the number of frames with a valid touch.
    pub fn frames_with_touch(&self) -> usize {
        let frames = self.rows.chunk_by(|a, b| a.frame == b.frame);
        let acted_on = |row: &TouchRow| row.touch.valid && row.touch.state != TouchState::End;
        frames.filter(|rows| rows.iter().any(acted_on)).count()
    }

    /// Returns the number and time of a row's frame in the recording, of which the first frames may have been skipped.
    pub fn in_recording(&self, row: &TouchRow) -> (u64, f64) {
        let first_s = self.first_frame as f64 / self.rate_hz;
        ((self.first_frame + row.frame) as u64, first_s + row.time_s)
    }

    /// Returns what is known of the skin in a frame.
    pub fn state(&self, frame: usize) -> SkinState {
        let is_in = |frames: &[usize]| frames.binary_search(&frame).is_ok();
        match (is_in(&self.frozen), is_in(&self.not_explained)) {
            (true, _) => SkinState::Frozen,
            (false, true) => SkinState::NotExplained,
            (false, false) => SkinState::Sound,
        }
    }

    /// Groups the touches by frame: one list for each, empty where there is none.
    pub fn by_frame(&self) -> Vec<Vec<Touch>> {
        let mut frames = vec![Vec::new(); self.frames];
        for row in &self.rows {
            frames[row.frame].push(row.touch);
        }
        frames
    }

    /// Marks excluded values as not good, so that images ignore them too; and all values of damaged frames, which would
    /// set the weights and spoil the images of the others. Notes which these are.
    ///
    /// A frame is damaged if none of its values counts, or if touches do not explain it and its largest difference is
    /// more than three times that of any frame that they do explain.
    pub fn leave_out(&self, frames: &mut Frames) {
        for (mut good, missing) in frames.good.rows_mut().into_iter().zip(self.is_missing.rows()) {
            good.zip_mut_with(&missing, |good, missing| *good &= !missing);
        }
        let largest = |frame: usize| {
            let values = frames.values.row(frame);
            let counts = |i: &usize| frames.used[*i] && frames.good[[frame, *i]];
            let differences =
                (0..values.len()).filter(counts).map(|i| values[i] - frames.reference[i]);
            differences.fold(0.0_f64, |most, d| most.max(d.abs()))
        };
        let is_explained = |frame: &usize| self.not_explained.binary_search(frame).is_err();
        let explained = (0..self.frames).filter(is_explained).map(largest).fold(0.0, f64::max);
        let had_values: Vec<usize> =
            self.not_explained.iter().copied().filter(|&f| largest(f) > 0.0).collect();
        let damaged: Vec<usize> = match explained {
            // nothing to compare with
            0.0 => Vec::new(),
            most => had_values.into_iter().filter(|&f| largest(f) > DAMAGED * most).collect(),
        };
        for &frame in &damaged {
            frames.good.row_mut(frame).fill(false);
        }
        if let (Some(first), Some(last)) = (damaged.first(), damaged.last()) {
            frames.notes.push(format!(
                "{} frame(s) from {first} to {last} left out of the images: touches do not explain them, and they differ from \
                 the reference more than {DAMAGED} times as much as any frame that touches explain",
                damaged.len()
            ));
        }
    }

    /// Returns the positions of each frame's valid touches as seen from +z, metres.
    pub fn marks(&self, frames: usize) -> Vec<Vec<[f64; 2]>> {
        let mut marks = vec![Vec::new(); frames];
        for TouchRow { frame, touch, .. } in self.rows.iter().filter(|row| row.touch.valid) {
            marks[*frame].push([touch.position_m[0], touch.position_m[1]]);
        }
        marks
    }
}

impl Frames {
    /// Returns a note for the user if the frame rate of these touches is assumed
    /// ([`Touches::rate_hz`]).
    pub fn rate_note(&self) -> Option<String> {
        (self.rate_hz.is_none() && self.values.nrows() > 1).then(assumed_rate_text)
    }
}

/// Finds touches in frames, independently of any image. `None` if the noise of the data is unknown.
///
/// # Errors
///
/// Invalid settings.
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
            first_frame: fitted.skin.skin.settings.recording.first_frame.unwrap_or(0),
            rate_hz,
            choices: finder.choices.clone(),
            faults: Vec::new(),
            steps: Vec::with_capacity(count),
            not_explained: Vec::new(),
            frozen: Vec::new(),
            level_s: finder.level_s(),
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
            found.steps.extend(finder.step());
            if finder.is_frozen() {
                found.frozen.push(frame);
            }
            if !finder.is_explained() {
                found.not_explained.push(frame);
            }
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
