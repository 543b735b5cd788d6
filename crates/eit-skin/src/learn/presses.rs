//! Frames of the presses in a table.

use super::{PlaceErrors, PressTable};
use crate::error::SkinError;
use crate::fitted::FittedFrames;
use crate::frames::{FramesInput, ReferenceInput};
use crate::progress::Progress;
use crate::scene::Reference;
use crate::skin::Skin;
use crate::touches::PressTouch;
use eit_core::vector::distance;
use ndarray::Array2;
use std::sync::Arc;

/// The presses of a table in a recording, from which [`LearnedSkin::learn`](super::LearnedSkin::learn) learns.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct RecordedPresses {
    /// All frames of the recording.
    pub fitted: FittedFrames,
    /// Those of the presses.
    pub pressed: PressFrames,
}

impl Skin {
    /// Takes the presses of a table from a recording. Without any reference, it is the mean if every press has frames
    /// before it.
    ///
    /// # Errors
    ///
    /// The errors of [`Skin::frames`] and [`PressFrames::new`].
    pub fn recorded_presses(
        &self,
        table: &PressTable,
        frames: FramesInput<'_>,
        reference: ReferenceInput<'_>,
        progress: &mut Progress,
    ) -> Result<RecordedPresses, SkinError> {
        let mut skin = self.clone();
        // ignore what was learnt before
        skin.settings.touch.learned = None;
        let recording = &mut skin.settings.recording;
        // the table counts frames from the start of the recording
        recording.first_frame = None;
        if table.presses.iter().all(|press| press.before_first.is_some()) {
            recording.reference.get_or_insert_with(|| Reference::Text("mean".to_owned()));
        }
        let linearised = Arc::new(skin.linearise(progress)?);
        let frames = progress.stage("read frames", || skin.frames(frames, reference))?;
        let fitted = linearised.fit(frames)?;
        let pressed = PressFrames::new(table, &fitted.frames)?;
        Ok(RecordedPresses { fitted, pressed })
    }
}

/// Frames of presses, each with the untouched frame to subtract from it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[non_exhaustive]
pub struct PressFrames {
    /// `[press, measurement]`, volts; arbitrary for measurements that do not count.
    pub values: Array2<f64>,
    /// Frames of the untouched skin, `[press, measurement]`, volts.
    pub references: Array2<f64>,
    /// Places in the coordinates of the table, metres.
    pub places_m: Vec<[f64; 3]>,
    /// Forces, newtons, if known.
    pub forces_n: Vec<Option<f64>>,
    /// Time from one press to the next, seconds, if known.
    pub interval_s: Option<f64>,
    /// Lines of the table, from 1.
    pub lines: Vec<usize>,
    /// Name of the table, for messages.
    pub place: String,
}

impl PressFrames {
    /// Returns the name of a press in messages.
    pub fn name(&self, press: usize) -> String {
        match self.lines.get(press) {
            Some(line) => format!("{}, line {line}", self.place),
            None => self.place.clone(),
        }
    }

    /// Returns pressed minus untouched frames, `[press, channel]`.
    pub fn differences(&self, channels: &[usize]) -> Array2<f64> {
        let all = &self.values - &self.references;
        all.select(ndarray::Axis(1), channels)
    }

    /// Returns the presses with these indices.
    pub fn select(&self, which: &[usize]) -> Self {
        let axis = ndarray::Axis(0);
        Self {
            values: self.values.select(axis, which),
            references: self.references.select(axis, which),
            places_m: which.iter().map(|&k| self.places_m[k]).collect(),
            forces_n: which.iter().map(|&k| self.forces_n[k]).collect(),
            interval_s: self.interval_s,
            lines: which.iter().map(|&k| self.lines[k]).collect(),
            place: self.place.clone(),
        }
    }

    /// Returns the number of presses.
    pub fn len(&self) -> usize {
        self.places_m.len()
    }

    /// Returns whether there are no presses.
    pub fn is_empty(&self) -> bool {
        self.places_m.is_empty()
    }

    /// Frame and reference of each press, `[measurement]`.
    pub(super) fn pairs(&self) -> impl Iterator<Item = [Vec<f64>; 2]> {
        let pairs = self.values.rows().into_iter().zip(self.references.rows());
        pairs.map(|(values, reference)| [values.to_vec(), reference.to_vec()])
    }
}

impl PlaceErrors {
    /// Returns median and mean of distances.
    pub(crate) fn of_errors(mut errors_m: Vec<f64>) -> Self {
        errors_m.sort_unstable_by(f64::total_cmp);
        let mean_m = errors_m.iter().sum::<f64>() / errors_m.len().max(1) as f64;
        Self { median_m: errors_m.get(errors_m.len() / 2).copied().unwrap_or(0.0), mean_m }
    }
}

/// Error of each press; one that was not found has `missed_m`.
pub(super) fn errors_of_detected(
    detected: &[Option<PressTouch>],
    places_m: &[[f64; 3]],
    missed_m: f64,
) -> Vec<f64> {
    let error = |(found, place): (&Option<PressTouch>, &[f64; 3])| match found {
        Some(found) => distance(found.position_m, *place),
        None => missed_m,
    };
    detected.iter().zip(places_m).map(error).collect()
}
