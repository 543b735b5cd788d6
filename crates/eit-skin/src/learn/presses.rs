//! Frames of the presses in a table.

use super::PlaceErrors;
use crate::touches::PressTouch;
use eit_core::vector::distance;
use ndarray::Array2;

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
